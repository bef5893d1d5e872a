"""Input of a robot outside the simulator: its own pose, and the messages of its ring neighbours."""

import math
from typing import Any, NamedTuple

import numpy as np

from lissajous_env.wording import shown


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

    @property
    def is_finite(self) -> bool:
        """Return whether every number is finite."""
        return all(map(math.isfinite, self))


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
        total = self.sent_at + self.cos_phase + self.sin_phase + self.x + self.y + sum(self.numbers)
        is_phase = abs(math.hypot(self.cos_phase, self.sin_phase) - 1) < 1e-3
        return math.isfinite(total) and len(self.numbers) == size and is_phase


def seen_rows(name: str, given: Any, width: int) -> np.ndarray:
    """Return the objects that a sensor detects as rows (K, width).

    Raises:
        ValueError: it has another shape, or does not contain numbers.
    """
    try:
        rows = np.asarray(given, dtype=np.float32)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be rows of {width} numbers, got {shown(given)}") from None
    if rows.size == 0:
        return np.zeros((0, width), dtype=np.float32)
    if rows.ndim != 2 or rows.shape[1] != width:
        raise ValueError(f"{name} must be rows of {width} numbers, got shape {rows.shape}")
    return rows
