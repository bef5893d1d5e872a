"""Commands of a robot in physical units, converted from an action by the functions of the simulated robot."""

from typing import NamedTuple

import numpy as np
import warp as wp

from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.device.structs import RobotStruct, to_struct
from lissajous_env.logs.inputs import convert
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.scenario import Scenario


class Command(NamedTuple):
    """Command of a car."""

    steering: float
    """Steering angle, positive to the left [rad]."""
    throttle: float
    """Throttle tau of (12), from `robot.throttle_min` to `robot.throttle_max`; below 0 in reverse."""


class Twist(NamedTuple):
    """Command of a differential drive."""

    speed: float
    """Speed forwards [m/s]."""
    yaw_rate: float
    """Yaw rate, positive to the left [rad/s]."""


KINDS = {"car": Command, "differential": Twist}
"""Commands by `robot.kind`."""


class Actuation:
    """Conversion of the actions of a scenario's robots into commands.

    Raises:
        ValueError: the robots are neither cars nor differential drives.
    """

    def __init__(self, scenario: Scenario):
        robot = scenario.robot
        if robot.kind not in KINDS:
            raise ValueError(f"scenario must be of robots of kind {' or '.join(KINDS)}, got {robot.kind}")
        self._kind, device = KINDS[robot.kind], as_device("cpu")
        action, command = (wp.zeros(1, dtype=wp.vec2, device=device) for _ in range(2))
        self._action, self._command = action.numpy()[0], command.numpy()[0]
        given = [to_struct(RobotStruct, robot), int(robot.kind == "car"), 1, action]
        with compile_quietly():
            self._work = wp.launch(convert, 1, given, [command], device=device, record_cmd=True)
        self.stop = self.command(np.array(model_of(robot.kind).rest_action(robot), dtype=np.float32))

    def command(self, action: np.ndarray) -> Command | Twist:
        """Return the command of an action, clipped to [-1, 1]."""
        self._action[:] = np.clip(action[:2], -1, 1)
        self._work.launch()
        return self._kind(*self._command.tolist())
