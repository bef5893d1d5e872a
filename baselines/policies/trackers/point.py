"""Points on the curve, which follow a coordinator exactly."""

import warp as wp

from baselines.policies.trackers.base import Coordinated
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.part_structs import RobotStruct

wp.set_module_options(OPTIONS)


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
