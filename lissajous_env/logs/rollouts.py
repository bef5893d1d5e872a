"""Cars by the model (12) with many sets of constants at once, from many starts, under logged commands."""

from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.device.part_structs import RobotStruct
from lissajous_env.device.structs import to_struct
from lissajous_env.settings.robot import Robot
from lissajous_env.world.robots.car import car_step, motor_push

wp.set_module_options(OPTIONS)

CONSTANTS: tuple[str, ...] = ("wheelbase", "drag", "drive", "offset", "dead_zone", "delay")
"""Constants of a car in their order here: [m], [1/s], [m/s^2], [m/s^2], throttle, [s]."""

_LONGEST = wp.constant(wp.float64(0.05))
"""Longest integration step [s]."""
_ROUNDING = wp.constant(wp.float64(1e-9))


@wp.kernel
def roll_out(
    robot: RobotStruct,
    constants: wp.array2d(dtype=float),
    starts: wp.array2d(dtype=wp.vec4),
    begin: wp.array(dtype=int),
    time: wp.array(dtype=wp.float64),
    command_time: wp.array(dtype=wp.float64),
    command: wp.array(dtype=wp.vec2),
    predicted_out: wp.array2d(dtype=wp.vec4),
):
    """Predict the states of a car at the times of a segment of a log, with one set of constants."""
    p, s = wp.tid()
    car = robot
    car.drag = constants[p, 1]
    car.offset = constants[p, 3]
    car.dead_zone = constants[p, 4]
    delay = wp.float64(constants[p, 5])
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
            push = motor_push(car, constants[p, 2], command[k][1])
            state = car_step(car, state, wp.tan(command[k][0]) / constants[p, 0], push, float(until - now))
            now = until
            following = wp.min(k + 1, last)
            if following > k and command_time[following] + delay <= now + _ROUNDING:
                k = following
        predicted_out[p, j] = state


class Rollouts:
    """Segments of the log of one car, which are predicted each from a start of its own.

    Args:
        robot: The constants that are not varied.
        begin: (S + 1,) first sample of each of S segments, and the number of samples K.
        time: (K,) times of the samples [s].
        command_time: (C,) times of the commands [s].
        command: (C, 2) steering angles [rad] and throttles from these times on.
    """

    def __init__(
        self, robot: Robot, begin: np.ndarray, time: np.ndarray, command_time: np.ndarray, command: np.ndarray
    ):
        self._robot = to_struct(RobotStruct, robot)
        kinds = ((begin, wp.int32), (time, wp.float64), (command_time, wp.float64), (command, wp.vec2))
        device = as_device("cpu")
        self._data = [wp.array(values, dtype=kind, device=device) for values, kind in kinds]
        self._shape = len(begin) - 1, len(time)

    def predict(self, constants: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Return x, y, heading, speed (P, K, 4) for P sets of `CONSTANTS` (P, 6) and their starts (P, S, 4)."""
        sets, (segments, samples) = len(constants), self._shape
        predicted: Any = wp.zeros((sets, samples), dtype=wp.vec4, device="cpu")
        given = [wp.array(constants, dtype=wp.float32, device="cpu"), wp.array(starts, dtype=wp.vec4, device="cpu")]
        with compile_quietly():
            wp.launch(roll_out, (sets, segments), [self._robot, *given, *self._data], [predicted], device="cpu")
        return predicted.numpy()
