"""A coordinator over a tracker: one decides the phase rates, the other makes a robot follow them; points do exactly."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from baselines.policies.base import Policy
from baselines.policies.coordinators.base import PHASES, Coordinator
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import curve_struct
from lissajous_env.device.part_structs import RobotStruct
from lissajous_env.device.structs import to_struct
from lissajous_env.parameters.assumptions import warn_of_violations
from lissajous_env.parameters.scenario import Scenario

wp.set_module_options(OPTIONS)


class Coordinated(Policy):
    """Robots that follow a coordinator, each kind in its own way.

    `coordinator(scenario, num_worlds, device)` makes the coordinator: its class, or a `partial` of it that fixes
    parameters of its own.

    Warns:
        AssumptionWarning: the scenario violates an assumption of the paper about its formation.
    """

    arrays = "warp"

    def __init__(
        self,
        coordinator: Callable[[Scenario, int, Any], Coordinator],
        scenario: Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
    ):
        super().__init__(scenario, num_worlds, device)
        warn_of_violations(self.scenario)
        self.coordinator = coordinator(self.scenario, num_worlds, self.device)
        self.communicates = getattr(self.coordinator, "communicates", PHASES)
        self._curve = curve_struct(self.scenario.curve, self.device)
        self._robot = to_struct(RobotStruct, self.scenario.robot)
        self._alpha = float(self.scenario.alpha)

    def forget(self, mask: np.ndarray) -> None:
        """Reset the memory of these worlds."""
        super().forget(mask)
        if hasattr(self.coordinator, "forget"):
            self.coordinator.forget(mask)


@wp.kernel
def follow_as_point(robot: RobotStruct, phase_rate: wp.array2d(dtype=float), action_out: wp.array3d(dtype=float)):
    """Return the action of a point on the curve: its phase rate over the largest."""
    w, i = wp.tid()
    action_out[w, i, 0] = wp.clamp(phase_rate[w, i] / robot.phase_rate_max, -1.0, 1.0)


class OnCurve(Coordinated):
    """Points that follow a coordinator exactly."""

    kind = "curve"

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        self.coordinator.coordinate(observation)
        inputs = [self._robot, self.coordinator.phase_rate]
        self.launch(follow_as_point, self.shape, inputs, [self.action])
