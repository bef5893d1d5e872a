"""Commands of a robot in physical units, computed from an action by the functions of the simulated robot."""

from typing import Any, NamedTuple

import numpy as np
import warp as wp

from baselines.policies.driving import twist_reached
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.device.part_structs import RobotStruct
from lissajous_env.device.structs import to_struct
from lissajous_env.device.work import Work
from lissajous_env.logs.inputs import input_of
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import shown
from lissajous_env.world.robots.car import speed_limit_below

wp.set_module_options(OPTIONS)

KINDS = ("car", "twist")


def check_robots(scenario: Scenario, command: str) -> None:
    """Check that robots understand a kind of commands.

    Raises:
        ValueError: they are neither cars nor differential drives, or are drives and the command is no twist.
    """
    kind = scenario.robot.kind
    if kind not in ("car", "differential"):
        raise ValueError(f"scenario must be of robots of kind car or differential, got {kind}")
    if kind == "differential" and not command.startswith("twist"):
        raise ValueError(f"command must be a twist for differential drives, got {command}")


class Command(NamedTuple):
    """Command of a car."""

    steering: float
    """Steering angle, positive to the left [rad]."""
    throttle: float
    """Throttle tau of (12), from `robot.throttle_min` to `robot.throttle_max`; below 0 in reverse."""


class Twist(NamedTuple):
    """Command of a robot that controls its velocity itself."""

    speed: float
    """Speed forwards [m/s]."""
    yaw_rate: float
    """Yaw rate, positive to the left [rad/s]."""


@wp.kernel
def to_commands(
    robot: RobotStruct,
    is_car: int,
    step: float,
    action: wp.array(dtype=float),
    speed: wp.array(dtype=float),
    command_out: wp.array(dtype=wp.vec4),
):
    """Write the steering angle [rad] and throttle of a car, and the speed [m/s] and yaw rate [rad/s] of a twist."""
    k = wp.tid()
    given = input_of(robot, is_car, wp.vec2(wp.clamp(action[0], -1.0, 1.0), wp.clamp(action[1], -1.0, 1.0)))
    twist = given
    if is_car == 1:
        twist = twist_reached(robot, given[0], given[1], wp.max(speed[0], speed_limit_below(robot)), step)
    command_out[k] = wp.vec4(given[0], given[1], twist[0], twist[1])


class Actuation:
    """Conversion of the actions of a scenario's robots into commands of one kind.

    A `Twist` has the speed that the car of the scenario would reach at the end of the control step, and the yaw rate
    that this car has at that speed and steering angle. For a differential drive it is the commanded twist.

    Raises:
        ValueError: an unknown kind of command, or as `check_robots`.
    """

    def __init__(self, scenario: Scenario, kind: str):
        if kind not in KINDS:
            raise ValueError(f"command must be one of {', '.join(KINDS)}, got {shown(kind)}")
        check_robots(scenario, kind)
        self._is_twist, robot = kind == "twist", scenario.robot
        self._action, self._speed = (wp.zeros(size, dtype=wp.float32, device="cpu") for size in (2, 1))
        self._command = wp.zeros(1, dtype=wp.vec4, device="cpu")
        self._hosts = tuple(array.numpy() for array in (self._action, self._speed, self._command))
        fixed = [to_struct(RobotStruct, robot), int(robot.kind == "car"), scenario.task.step]
        device, given = as_device("cpu"), [*fixed, self._action, self._speed]
        with compile_quietly():
            launch = wp.launch(to_commands, 1, given, [self._command], device=device, record_cmd=True)
            self._work = Work([[launch]], device)
        rest = np.array(model_of(robot.kind).rest_action(robot), dtype=np.float32)
        self.stop: Command | Twist = Twist(0.0, 0.0) if self._is_twist else self.command(rest, 0.0)

    def command(self, action: np.ndarray, speed: float) -> Any:
        """Return the command of an action in [-1, 1], of a robot at a speed [m/s]."""
        action_host, speed_host, command_host = self._hosts
        action_host[:], speed_host[0] = action[:2], speed
        self._work.lead()
        steering, throttle, reached, yaw_rate = command_host[0].tolist()
        return Twist(reached, yaw_rate) if self._is_twist else Command(steering, throttle)
