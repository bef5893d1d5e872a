"""Actions of cars as steering angles and throttles, and the way back, for whole logs."""

from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.car_input import action_of_input, steering_and_throttle
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.device.part_structs import RobotStruct
from lissajous_env.device.structs import to_struct
from lissajous_env.settings.robot import Robot

wp.set_module_options(OPTIONS)

LARGEST_STEERING = np.pi / 2
"""Steering angle that no car reaches [rad]."""


@wp.kernel
def to_inputs(robot: RobotStruct, action: wp.array(dtype=wp.vec2), input_out: wp.array(dtype=wp.vec2)):
    """Return steering angle [rad] and throttle of each action."""
    k = wp.tid()
    input_out[k] = steering_and_throttle(robot, action[k])


@wp.kernel
def to_actions(robot: RobotStruct, given: wp.array(dtype=wp.vec2), action_out: wp.array(dtype=wp.vec2)):
    """Return the action of each steering angle [rad] and throttle."""
    k = wp.tid()
    action_out[k] = action_of_input(robot, given[k][0], given[k][1])


def inputs_of(robot: Robot, actions: np.ndarray) -> np.ndarray:
    """Return steering angles [rad] and throttles (..., 2) of actions (..., 2)."""
    return _converted(to_inputs, robot, actions)


def actions_of(robot: Robot, inputs: np.ndarray) -> np.ndarray:
    """Return the actions (..., 2) in [-1, 1] of steering angles [rad] and throttles (..., 2)."""
    return _converted(to_actions, robot, inputs)


def _converted(kernel: Any, robot: Robot, values: np.ndarray) -> np.ndarray:
    given = wp.array(values.reshape(-1, 2), dtype=wp.vec2, device=as_device("cpu"))
    converted = wp.zeros_like(given)
    with compile_quietly():
        wp.launch(kernel, len(given), [to_struct(RobotStruct, robot), given], [converted], device="cpu")
    return converted.numpy().reshape(values.shape)
