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

    clearance: float = number(0.07, 0, 1e3, "m")
    """Distance to keep besides the two radii [m]."""
    growth: float = number(0.2, 0, 1e3, "m/s")
    """Growth of the required distance with the prediction time, as the prediction gets worse [m/s]."""
    horizon: int = whole(8, 1, 100)
    """Control steps that are looked ahead."""
    ample: float = number(0.1, 0, 1e3, "m")
    """Margin beyond which a way out does not get better [m]."""
    effort: float = number(0.1, 0, 1e3, "m")
    """Margin that full steering must be worth in a way out, and coasting or full throttle half of it [m]."""
    right: float = number(0.01, -1e3, 1e3, "m")
    """Margin by which a way out to the right counts as better: what breaks a symmetric meeting [m]."""
    throttle_weight: float = number(0.5, 1e-6, 1e6)
    """Weight of a change of the throttle's action against one of the steering's."""
    passes: int = whole(3, 1, 20)
    """Most linearisations of the margins, each a quadratic program."""
    resting: float = number(0.05, 0, 1e3, "m/s")
    """Speed below which another robot is taken to stay where it is [m/s]."""
    unit: float = number(1.0, 1e-9, 1e6, "m")
    """Length that margins are measured in when an action is sought [m]."""
    speed_max: float | None = number(None, 1e-9, 1e5, "m/s")
    """Speed that the throttle may not lead above [m/s]; None is `baselines.safety.filter.speed_limit`."""

    def of(self, scenario: Scenario) -> "SafetyParameters":
        """Return the same parameters scaled from the paper's experiment to another scenario.

        Slow cars are looked ahead for longer, in control steps, so that what they can do still shows.
        """
        scale = motion_scale(scenario)
        seconds = self.horizon * EXPERIMENT.task.step * scale.time
        horizon = min(max(math.ceil(seconds / scenario.task.step - 1e-6), self.horizon), _LONGEST)
        return dataclasses.replace(self.scaled(scale.length, scale.time), horizon=horizon)


SafetyStruct = struct_of(SafetyParameters)
