"""Commands of cars and differential drives in physical units: those of logs, and those of actions and the way back."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.device.structs import RobotStruct, to_struct
from lissajous_env.logs.log import Series
from lissajous_env.settings.parts import Robot
from lissajous_env.wording import few_of, require
from lissajous_env.world.robots.car import action_of_input, steering_and_throttle
from lissajous_env.world.robots.differential import commanded_speed, drive_action

wp.set_module_options(OPTIONS)

COMMAND_NAMES = {"car": ("steering", "throttle"), "differential": ("speed", "yaw rate")}
"""Names of the commands by `robot.kind`: steering angle [rad] and throttle, or speed [m/s] and yaw rate [rad/s]."""
_UNITS = {"steering": "rad", "speed": "m/s", "yaw rate": "rad/s"}


@wp.kernel
def convert(
    robot: RobotStruct, is_car: int, is_action: int, given: wp.array(dtype=wp.vec2), result_out: wp.array(dtype=wp.vec2)
):
    """Write the commands of actions, or the actions of commands."""
    k = wp.tid()
    value = given[k]
    if is_action == 1 and is_car == 1:
        result_out[k] = steering_and_throttle(robot, value)
    elif is_action == 1:
        result_out[k] = wp.vec2(commanded_speed(robot, value[0]), value[1] * robot.yaw_rate_max)
    elif is_car == 1:
        result_out[k] = action_of_input(robot, value[0], value[1])
    else:
        result_out[k] = drive_action(robot, value[0], value[1])


def named_commands(series: Series, names: Sequence[str]) -> np.ndarray:
    """Return the columns (K, A) of commands with some names; commands without names must be as many, in this order.

    Raises:
        ValueError: there are no such commands, a number is not finite, or steering angles are not in radians.
    """
    known = list(series.names or (names if series.value.shape[1:] == (len(names),) else ()))
    if not set(names) <= set(known):
        wanted = [f"{name} [{_UNITS[name]}]" if name in _UNITS else name for name in names]
        got = few_of(series.names) or f"values of shape {series.value.shape} without names"
        raise ValueError(f"commands must be {' and '.join(wanted)}, got {got}")
    values = series.value[:, [known.index(name) for name in names]]
    require(np.isfinite(values).all(), "commands", "must be finite", values)
    if "steering" in names and (largest := float(np.abs(values[:, names.index("steering")]).max())) >= np.pi / 2:
        raise ValueError(f"steering must be an angle below pi / 2 [rad], got {largest:.4g}: is it in degrees?")
    return values


def commands_of_actions(robot: Robot, actions: np.ndarray) -> np.ndarray:
    """Return the commands (..., 2) of actions (..., 2), those of `COMMAND_NAMES`."""
    return _converted(robot, actions, 1)


def actions_of_commands(robot: Robot, commands: np.ndarray) -> np.ndarray:
    """Return the actions (..., 2) in [-1, 1] of commands (..., 2), clipped to what the robot can do."""
    return _converted(robot, commands, 0)


def _converted(robot: Robot, values: np.ndarray, is_action: int) -> np.ndarray:
    given = wp.array(values.reshape(-1, 2), dtype=wp.vec2, device=as_device("cpu"))
    conversion, converted = conversion_of(robot, given, is_action)
    conversion.launch()
    return converted.numpy().reshape(values.shape)


def conversion_of(robot: Robot, given: wp.array, is_action: int = 1) -> tuple[Any, wp.array]:
    """Return a recorded launch that converts the present values of an array on the CPU, and the array of results."""
    converted, settings = wp.zeros_like(given), [to_struct(RobotStruct, robot), int(robot.kind == "car"), is_action]
    with compile_quietly():
        launch = wp.launch(convert, len(given), [*settings, given], [converted], device="cpu", record_cmd=True)
    return launch, converted
