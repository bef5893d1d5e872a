"""The control loop of a robot outside the simulator: its measurements in the frame of the scenario, and when it acts.

`Onboard` decides on the command of a control step; `ControlLoop` decides when. A pose arrives, the message is sent, the
neighbours' messages arrive, the robot acts.
"""

import math
from collections import deque
from collections.abc import Callable
from time import monotonic
from typing import Any

import numpy as np

from baselines.onboard import Message, Odometry, Onboard, Output
from lissajous_env.logs.samples import moved, relative

Origin = tuple[float, float, float]
"""x, y [m] and heading [rad] of the middle of the rectangle in the frame of the laboratory."""


def in_scenario_frame(origin: Origin, x: float, y: float, heading: float) -> tuple[float, float, float]:
    """Return a pose of the laboratory in the frame of the scenario."""
    return (*relative(np.array([x, y]), origin).tolist(), math.remainder(heading - origin[2], 2 * math.pi))


def relative_to_robot(
    rows: np.ndarray, frame: str, own: str, pose: Odometry | None, origin: Origin
) -> np.ndarray | None:
    """Return a sensor's detections (K, 2 or 4) relative to the robot, in the directions of the scenario's axes.

    Only those of a frame that ends in `aligned` are known without a pose; those of the others are None then.

    Args:
        rows: x, y [m], and velocities [m/s] if there are two more.
        frame: Frame of the rows: `own` is that of the laboratory, in which the places are absolute; another one that
            ends in `base_link` is the robot's own, and one that ends in `aligned` has the origin in the robot and the
            axes of the scenario.
        own: Frame of the laboratory.
        pose: The robot's pose, in the frame of the scenario; None if there is none yet.
        origin: The middle of the rectangle in the frame of the laboratory.

    Raises:
        ValueError: the frame is none of these.
    """
    if frame != own and frame.endswith("aligned"):
        return rows
    if frame != own and not frame.endswith("base_link"):
        raise ValueError(f"frame of a sensor's data must be {own}, or end in base_link or aligned, got {frame!r}")
    if pose is None:
        return None
    vectors = rows.reshape(len(rows), rows.shape[1] // 2, 2).astype(np.float64)
    if frame != own:
        return moved(vectors, (0.0, 0.0, pose.heading)).reshape(rows.shape)
    away = relative(vectors[:, :1], origin) - (pose.x, pose.y)
    velocity = moved(np.array([pose.speed, 0.0]), (0.0, 0.0, pose.heading))
    moving = relative(vectors[:, 1:], (0.0, 0.0, origin[2])) - velocity
    return np.concatenate([away, moving], axis=1).reshape(rows.shape)


class SpeedOfPoses:
    """Speed over the ground, forwards, of the poses of the latest `window` seconds whose places are finite."""

    def __init__(self, window: float):
        self._window = window
        self._poses: deque[tuple[float, float, float]] = deque(maxlen=1000)

    def add(self, x: float, y: float, heading: float, stamp: float) -> Odometry | None:
        """Return the pose with its speed; None for a repetition, and if none precedes it by less than four windows."""
        poses = self._poses
        if poses and stamp == poses[-1][2]:
            return None
        if not math.isfinite(x + y):
            return Odometry(x, y, heading, math.nan, stamp)
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


class ControlLoop:
    """Latest measurements of a robot outside the simulator, on which it acts once in each control step.

    From a quarter of a step before the next step is due, the latest new pose counts. The robot announces it to its
    neighbours, and waits for their messages, at most for `wait`. Without a new pose, half a step after the step was due
    it acts on the one before, so that the rules by which it stops apply, and then on the next one as soon as it
    arrives; likewise at once if the clock went back by more than a step. It never acts twice at one time, as while the
    clock of a simulation stands still.

    All times are on the clock of the robots [s], except for `wait`: if the clock of a simulation waits for the robot,
    the robot must not wait for this clock.

    Args:
        onboard: The robot's policy.
        wait: Longest time that a pose waits for the messages of the neighbours [s], on the machine's clock.
        wall: Function that returns the time of the machine's clock [s].

    Attributes:
        started: True from the first call of `start` on.
        pose: The latest pose.
        works: False while the robot cannot move.
        detections: Time and rows of the `robots` and `targets` that the sensor detected last.
        heard: The message of each ring neighbour that arrived last, by its index; None for none yet.
    """

    def __init__(self, onboard: Onboard, wait: float, wall: Callable[[], float] = monotonic):
        self.onboard, self.works = onboard, True
        self._step, self._wait, self._wall = onboard.scenario.task.step, wait, wall
        self.detections: dict[str, tuple[float, Any]] = {}
        self._announced_at = -math.inf
        self.start(0.0)
        self.started = False

    def start(self, now: float) -> None:
        """Begin an episode: from now on, the robot drives, by poses that are still to come."""
        self.onboard.reset()
        self.pose: Odometry | None = None
        self.heard: dict[int, Message | None] = {sender: None for sender in self.onboard.neighbours if sender >= 0}
        self._waits_since: float | None = None  # the time of the announcement of a pose that waits for messages
        self.started, self._is_new, self._acted_at = True, False, -math.inf
        self._due, self._deadline = -math.inf, now + 1.5 * self._step

    def take(self, pose: Odometry) -> None:
        """Store a pose, unless one is waiting for the messages of the neighbours, or the robot acted on a later one.

        So a pose that arrives twice, or after a later one, is not new, unless the clock went back in between.
        """
        acted_later = self.pose is not None and pose.stamp <= self.pose.stamp <= self._acted_at
        if self._waits_since is None and not acted_later:
            self.pose, self._is_new = pose, True

    def announce(self, now: float) -> Message | None:
        """Return the message of a new pose if it is time to send it; from then on, the robot waits to act on it.

        A robot that has not been started announces its poses, too, so that others know of it.
        """
        wall, step = self._wall(), self._step
        is_due = now > self._acted_at and now >= self._due - 0.25 * step
        if not (is_due if self.started else wall - self._announced_at >= 0.75 * step):
            return None
        if not self._is_new or self.pose is None:
            return None
        self._is_new, self._announced_at = False, wall
        if self.started:
            self._waits_since = now
        return self.onboard.announce(self.pose)

    def act(self, now: float) -> Output | None:
        """Decide on the command of a step that is due, on what the sensors have reported; return None if none is."""
        if now < self._acted_at - self._step:  # the clock went back, so that the policy must stop the robot
            self._acted_at = self._due = self._deadline = -math.inf
        if not self._is_due(now):
            return None
        limit = self.onboard.limits.pose_age
        recent = {part: rows for part, (stamp, rows) in self.detections.items() if abs(now - stamp) <= limit}
        heard = [message for message in self.heard.values() if message is not None]
        output = self.onboard.act(now, self.pose, heard, works=self.works, **recent)
        waits_since, self._waits_since, self._acted_at = self._waits_since, None, now
        if waits_since is None:
            # Over a step later, so that the pose of a step comes first on a clock that goes on by whole steps.
            self._due, self._deadline = -math.inf, now + 1.25 * self._step
        else:
            self._due = self._step + (self._due if abs(waits_since - self._due) <= self._step else waits_since)
            self._deadline = self._due + 0.5 * self._step
        return output

    def _is_due(self, now: float) -> bool:
        if not self.started or now == self._acted_at:
            return False
        if self._waits_since is None:
            return now >= self._deadline
        return self._has_heard() or self._wall() - self._announced_at >= self._wait

    def _has_heard(self) -> bool:
        """Return True if the messages of all neighbours are of the time of the pose."""
        if not self.onboard.listens or self.pose is None:
            return True
        oldest = self.pose.stamp - 0.5 * self._step
        return all(message is not None and message.sent_at >= oldest for message in self.heard.values())
