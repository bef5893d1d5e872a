"""Poses in the frame of a laboratory, and in that of the scenario, whose origin is the middle of the rectangle."""

import math
from collections import deque

import numpy as np

from baselines.onboard import Odometry


class Origin:
    """Pose of the middle of the rectangle in the frame of the laboratory.

    Args:
        x: x [m].
        y: y [m].
        heading: Direction of the rectangle's x axis [rad].
    """

    def __init__(self, x: float = 0.0, y: float = 0.0, heading: float = 0.0):
        self._x, self._y, self.heading = x, y, heading
        self._cos, self._sin = math.cos(heading), math.sin(heading)

    def inside(self, x: float, y: float, heading: float) -> tuple[float, float, float]:
        """Return a pose of the laboratory in the frame of the scenario."""
        if (self._x, self._y, self.heading) == (0.0, 0.0, 0.0):
            return x, y, heading
        dx, dy = x - self._x, y - self._y
        turned = math.remainder(heading - self.heading, 2 * math.pi)
        return self._cos * dx + self._sin * dy, self._cos * dy - self._sin * dx, turned

    def outside(self, x: float, y: float, heading: float = 0.0) -> tuple[float, float, float]:
        """Return a pose of the scenario in the frame of the laboratory."""
        place = self._x + self._cos * x - self._sin * y, self._y + self._sin * x + self._cos * y
        return (*place, heading + self.heading)


class SpeedOfPoses:
    """Speed over the ground, forwards, of the poses of the latest `window` seconds."""

    def __init__(self, window: float):
        self._window = window
        self._poses: deque[tuple[float, float, float]] = deque(maxlen=1000)

    def add(self, x: float, y: float, heading: float, stamp: float) -> Odometry | None:
        """Return the pose with its speed; None for the first one, after a gap of four windows, and for a repetition."""
        poses = self._poses
        if poses and stamp == poses[-1][2]:
            return None
        if poses and not 0 < stamp - poses[-1][2] < 4 * self._window:
            poses.clear()
        poses.append((x, y, stamp))
        while len(poses) > 2 and stamp - poses[1][2] >= 0.99 * self._window:
            poses.popleft()
        if len(poses) < 2:
            return None
        before_x, before_y, before = poses[0]
        along = math.cos(heading) * (x - before_x) + math.sin(heading) * (y - before_y)
        return Odometry(x, y, heading, along / (stamp - before), stamp)


def relative(rows: np.ndarray, frame: str, own: str, pose: Odometry | None, origin: Origin) -> np.ndarray:
    """Return a sensor's detections (K, 2 or 4) relative to the robot, in the directions of the scenario's axes.

    Args:
        rows: x, y [m], and velocities [m/s] if there are two more.
        frame: Frame of the rows: one that ends in `base_link` is the robot's own, one that ends in `aligned` has the
            origin in the robot and the axes of the scenario; `own` is that of the laboratory, in which the places are
            absolute.
        own: Frame of the laboratory.
        pose: The robot's pose, in the frame of the scenario; None for a frame that ends in `aligned`.
        origin: The middle of the rectangle in the frame of the laboratory.

    Raises:
        ValueError: the frame is none of these.
    """
    if frame.endswith("aligned") or pose is None:
        return rows
    if frame.endswith("base_link"):
        return _turned(rows, pose.heading)
    if frame == own:
        places = rows.astype(np.float64)
        places[:, :2] -= origin.outside(0.0, 0.0)[:2]
        turned = _turned(places, -origin.heading)
        turned[:, :2] -= (pose.x, pose.y)
        if rows.shape[1] > 2:
            turned[:, 2:] -= pose.speed * np.array([math.cos(pose.heading), math.sin(pose.heading)])
        return turned
    raise ValueError(f"frame of a sensor's data must be {own}, or end in base_link or aligned, got {frame!r}")


def _turned(rows: np.ndarray, angle: float) -> np.ndarray:
    """Return vectors, two columns each, turned by an angle [rad]."""
    cos, sin = math.cos(angle), math.sin(angle)
    return (rows.reshape(len(rows), rows.shape[1] // 2, 2) @ np.array([[cos, sin], [-sin, cos]])).reshape(rows.shape)
