"""Cars and differential drives with many sets of constants at once, from many starts, under logged commands."""

from typing import Any, NamedTuple

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.device.structs import RobotStruct, to_struct
from lissajous_env.settings.parts import Robot
from lissajous_env.world.robots.car import car_step, motor_push
from lissajous_env.world.robots.differential import drive_step, ramp

wp.set_module_options(OPTIONS)

State = wp.types.vector(5, wp.float32)
"""x, y [m], heading [rad], speed [m/s], and of differential drives the yaw rate [rad/s]."""
_LONGEST = wp.constant(wp.float64(0.05))
"""Longest integration step [s]."""
_ROUNDING = wp.constant(wp.float64(1e-9))


class Model(NamedTuple):
    """A kind of robots whose constants are identified."""

    constants: dict[str, str]
    """Constants with their units; the last one is the delay of the commands."""
    least: tuple[float, ...]
    """Their least values."""
    units: tuple[str, str]
    """Units of the commands."""
    turning: int
    """The command that turns the robot."""
    free: int
    """Number of entries of `State` that its motion depends on."""
    limits: tuple[str, ...]
    """Constants that a log does not determine whose commands stay below them."""


MODELS = {
    "car": Model(
        {"wheelbase": "m", "drag": "1/s", "drive": "m/s^2", "offset": "m/s^2", "dead_zone": "", "delay": "s"},
        (1e-4, 1e-5, 1e-5, 0.0, -np.inf, 0.0), ("rad", ""), 0, 4, (),
    ),
    "differential": Model(
        {"speed_factor": "", "yaw_factor": "", "acceleration_max": "m/s^2", "yaw_acceleration_max": "rad/s^2",
         "delay": "s"},
        (0.05, 0.05, 1e-6, 1e-6, 0.0), ("m/s", "rad/s"), 1, 5,
        ("acceleration_max", "yaw_acceleration_max"),
    ),
}  # fmt: skip
"""Models by `robot.kind`: (12), and speed and yaw rate that follow the commands with factors and limited changes."""


@wp.func
def moved(
    robot: RobotStruct, is_car: int, constants: wp.array2d(dtype=float), p: int, now: State, given: wp.vec2, h: float
) -> State:
    """Return the state of a robot with a set of constants after a time h [s] under a command."""
    pose = wp.vec4(now[0], now[1], now[2], now[3])
    yaw_rate = now[4]
    own = robot
    if is_car == 1:
        own.drag = constants[p, 1]
        own.offset = constants[p, 3]
        own.dead_zone = constants[p, 4]
        push = motor_push(own, constants[p, 2], given[1])
        pose = car_step(own, pose, wp.tan(given[0]) / constants[p, 0], push, h)
    else:
        turning = constants[p, 1] * given[1]
        own.yaw_acceleration_max = constants[p, 3]
        pose = drive_step(own, pose, yaw_rate, constants[p, 0] * given[0], turning, constants[p, 2], h)
        yaw_rate = ramp(yaw_rate, turning, constants[p, 3] * h)
    return State(pose[0], pose[1], pose[2], pose[3], yaw_rate)


@wp.kernel
def roll_out(
    robot: RobotStruct,
    is_car: int,
    constants: wp.array2d(dtype=float),
    starts: wp.array2d(dtype=State),
    begin: wp.array(dtype=int),
    time: wp.array(dtype=wp.float64),
    command_time: wp.array(dtype=wp.float64),
    command: wp.array(dtype=wp.vec2),
    predicted_out: wp.array2d(dtype=State),
):
    """Predict the states of a robot at the times of a segment of a log, with one set of constants."""
    p, s = wp.tid()
    delay = wp.float64(constants[p, constants.shape[1] - 1])
    last = command.shape[0] - 1
    state = starts[p, s]
    now = time[begin[s]]
    k = int(wp.lower_bound(command_time, now - delay))
    if k > last or command_time[wp.min(k, last)] + delay > now + _ROUNDING:
        k = wp.max(k - 1, 0)
    predicted_out[p, begin[s]] = state
    for j in range(begin[s] + 1, begin[s + 1]):
        while now < time[j] - _ROUNDING:
            until = wp.min(time[j], now + _LONGEST)
            if k < last:
                until = wp.min(until, wp.max(command_time[k + 1] + delay, now))
            state = moved(robot, is_car, constants, p, state, command[k], float(until - now))
            now = until
            following = wp.min(k + 1, last)
            if following > k and command_time[following] + delay <= now + _ROUNDING:
                k = following
        predicted_out[p, j] = state


class Rollouts:
    """Segments of the log of one robot, which are predicted each from a start of its own.

    Args:
        robot: The kind, and the constants that are not varied.
        begin: (S + 1,) first sample of each of S segments, and the number of samples K.
        time: (K,) times of the samples [s].
        command_time: (C,) times of the commands [s].
        command: (C, 2) commands from these times on, those of `INPUTS`.
    """

    def __init__(
        self, robot: Robot, begin: np.ndarray, time: np.ndarray, command_time: np.ndarray, command: np.ndarray
    ):
        self._robot = to_struct(RobotStruct, robot), int(robot.kind == "car")
        kinds = ((begin, wp.int32), (time, wp.float64), (command_time, wp.float64), (command, wp.vec2))
        device = as_device("cpu")
        self._data = [wp.array(values, dtype=kind, device=device) for values, kind in kinds]
        self._shape = len(begin) - 1, len(time)

    def predict(self, constants: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Return x, y, heading, speed (P, K, 4) for P sets of constants (P, C) and their starts (P, S, 5)."""
        sets, (segments, samples) = len(constants), self._shape
        predicted: Any = wp.zeros((sets, samples), dtype=State, device="cpu")
        given = [wp.array(constants, dtype=wp.float32, device="cpu"), wp.array(starts, dtype=State, device="cpu")]
        with compile_quietly():
            wp.launch(roll_out, (sets, segments), [*self._robot, *given, *self._data], [predicted], device="cpu")
        return predicted.numpy()[..., :4]
