"""Parameters of the collision filter."""

import dataclasses
import math
from dataclasses import dataclass

from baselines.similarity import EXPERIMENT, motion_scale
from lissajous_env.device.structs import struct_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, number, whole

_LONGEST = 40
"""Longest horizon [control steps]."""


@dataclass(frozen=True)
class SafetyParameters(Checked):
    """Parameters of the collision filter, besides the scenario.

    The defaults are those of the paper's experiment; `SafetyParameters.of` scales them to another scenario.
    """

    clearance: float = number(0.02, 0, 1e3, "m")
    """Least distance of two cars besides the two radii [m]."""
    growth: float = number(0.05, 0, 1e3, "m/s")
    """Growth of the required distance with the prediction time, because predictions get less accurate [m/s]."""
    horizon: int = whole(8, 1, 100)
    """Horizon of the prediction [control steps]."""
    ample: float = number(0.1, 0, 1e3, "m")
    """Margin above which all ways out are equally good [m]."""
    effort: float = number(0.1, 0, 1e3, "m")
    """Margin that full steering must add to a way out; coasting and full throttle must add half of it [m]."""
    right: float = number(0.01, -1e3, 1e3, "m")
    """Margin that is added to a way out to the right, to break the symmetry of a meeting [m]."""
    throttle_weight: float = number(0.5, 1e-6, 1e6)
    """Weight of a change of the throttle's action relative to one of the steering's."""
    passes: int = whole(3, 1, 20)
    """Largest number of linearisations of the margins, each of which is a quadratic program."""
    resting: float = number(0.05, 0, 1e3, "m/s")
    """Speed below which another robot is assumed to have stopped [m/s]."""
    unit: float = number(1.0, 1e-9, 1e6, "m")
    """Unit of the margins in the quadratic program [m]."""
    speed_max: float | None = number(None, 1e-9, 1e5, "m/s")
    """Largest speed to which the throttle may lead [m/s]; None is `baselines.policies.safety.filter.speed_limit`."""

    def of(self, scenario: Scenario) -> "SafetyParameters":
        """Return the same parameters scaled from the paper's experiment to another scenario.

        The horizon of slow cars has more control steps, so that their ways out still differ.
        """
        scale = motion_scale(scenario)
        seconds = self.horizon * EXPERIMENT.task.step * scale.time
        horizon = min(max(math.ceil(seconds / scenario.task.step - 1e-6), self.horizon), _LONGEST)
        return dataclasses.replace(self.scaled(scale.length, scale.time), horizon=horizon)


SafetyStruct = struct_of(SafetyParameters)
