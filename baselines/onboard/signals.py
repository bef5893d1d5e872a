"""Signals of a robot outside the simulator: its pose, messages and detections, and the commands for its actuators."""

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from lissajous_env.device.devices import as_floats
from lissajous_env.logs.commands import COMMAND_NAMES, conversion_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import require, shown

_LARGEST = 1e15
"""Number from which on numbers count as infinite, because their squares have no room in float32."""


def are_finite(numbers: Iterable[float]) -> bool:
    """Return whether all numbers are finite, and less than 1e15 in size."""
    return all(abs(number) < _LARGEST for number in numbers)


class Odometry(NamedTuple):
    """Pose and speed of a robot, as it measures them, in the frame whose origin is the middle of the rectangle."""

    x: float
    """x [m]."""
    y: float
    """y [m]."""
    heading: float
    """Heading from the x axis, counter-clockwise [rad]."""
    speed: float
    """Speed over the ground, forwards [m/s]."""
    stamp: float
    """Time at which they were measured [s], on the clock that all robots share."""


def finite_pose(odometry: Odometry | None) -> Odometry | None:
    """Return a pose; None if there is none, or if a number in it is not finite.

    Raises:
        ValueError: it is no `Odometry`, or one of its entries is not a number.
    """
    require(isinstance(odometry, Odometry | None), "odometry", "must be a baselines.onboard.Odometry or None", odometry)
    try:
        return odometry if odometry is not None and are_finite(odometry) else None
    except TypeError:
        raise ValueError(f"odometry must have five numbers, got {shown(odometry)}") from None


class Message(NamedTuple):
    """Message of a robot to its two neighbours on the communication ring."""

    sender: int
    """Index of the robot that sends it."""
    sent_at: float
    """Time at which it was sent [s], on the clock that all robots share."""
    cos_phase: float
    """Cosine of the sender's phase."""
    sin_phase: float
    """Sine of the sender's phase."""
    x: float
    """x of the sender [m]."""
    y: float
    """y of the sender [m]."""
    numbers: tuple[float, ...] = ()
    """Message of the sender's policy, `messages.size` numbers in [-1, 1]."""

    def is_sound(self, size: int) -> bool:
        """Return whether the numbers are finite, `size` of them are the policy's, and the phase is one."""
        is_phase = abs(math.hypot(self.cos_phase, self.sin_phase) - 1) < 1e-3
        return are_finite((*self[1:6], *self.numbers)) and len(self.numbers) == size and is_phase


def detection_rows(name: str, given: Any, width: int) -> np.ndarray:
    """Return the objects that a sensor detects as rows (K, width).

    Raises:
        ValueError: it has another shape, or does not contain numbers.
    """
    rows = as_floats(name, given)
    if rows.size == 0:
        return np.zeros((0, width), dtype=np.float32)
    require(rows.ndim == 2 and rows.shape[1] == width, name, f"must be rows of {width} numbers", rows.shape)
    return rows


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


def conversion_to_commands(scenario: Scenario) -> Callable[[Any], Command | Twist]:
    """Return the function that converts an action of a scenario's robots, clipped to [-1, 1], into a command.

    Raises:
        ValueError: the robots are neither cars nor differential drives.
    """
    robot = scenario.robot
    kinds = " or ".join(COMMAND_NAMES)
    require(robot.kind in COMMAND_NAMES, "scenario", f"must be of robots of kind {kinds}", robot.kind)
    given = wp.zeros(1, dtype=wp.vec2, device="cpu")
    conversion, converted = conversion_of(robot, given)
    make, own_action, own_command = Command if robot.kind == "car" else Twist, given.numpy()[0], converted.numpy()[0]

    def command_of(action: Any) -> Command | Twist:
        own_action[:] = np.clip(action[:2], -1, 1)
        conversion.launch()
        return make(*own_command.tolist())

    return command_of
