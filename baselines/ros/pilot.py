"""The order of a robot's steps: a pose arrives, the message goes out, the neighbours' messages arrive, it decides."""

import math
from collections.abc import Callable
from time import monotonic
from typing import Any

from baselines.onboard import Message, Odometry, Onboard, Output


class Pilot:
    """Decides when a robot outside the simulator acts: once in each control step, on a new pose.

    A pose counts from a quarter of a step before its time on. The robot announces it to its neighbours, and waits until
    it has heard of theirs, at most for `wait`. If no pose arrives within half a step after its time, the robot acts on
    the one before, so that the rules by which it stops apply, and then on the next one as soon as it arrives. It never
    acts twice at one time, as while the clock of a simulation stands still.

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
        heard: The message of each ring neighbour that arrived last, by its index; None for none yet.
    """

    def __init__(self, onboard: Onboard, wait: float, wall: Callable[[], float] = monotonic):
        self.onboard, self.started, self.works = onboard, False, True
        self.pose: Odometry | None = None
        self.heard: dict[int, Message | None] = {sender: None for sender in onboard.neighbours if sender >= 0}
        self._step, self._wait, self._wall = onboard.scenario.task.step, wait, wall
        self._seen: dict[str, tuple[float, Any]] = {}
        self._is_new, self._announced_at = False, -wall() - self._step
        self._taken_at: float | None = None
        self._acted_at, self._due, self._is_late = -math.inf, 0.0, True

    def start(self, now: float) -> None:
        """Begin an episode: from now on, the robot drives, by poses that are still to come."""
        self.onboard.reset()
        self.started, self.pose, self._is_new = True, None, False
        self._taken_at, self._acted_at, self._due, self._is_late = None, -math.inf, now + self._step, True

    def take(self, pose: Odometry) -> None:
        """Store a pose, unless one is waiting for the messages of the neighbours."""
        if self._taken_at is None:
            self.pose, self._is_new = pose, True

    def see(self, part: str, rows: Any, stamp: float) -> None:
        """Store `robots` or `targets` that the sensor detected at a time."""
        self._seen[part] = stamp, rows

    def announce(self, now: float) -> Message | None:
        """Return the message of a new pose if it is time to send it; from then on, the robot waits to act on it.

        A robot that has not been started announces its poses, too, so that others know of it.
        """
        wall = self._wall()
        if not self._is_new or self.pose is None:
            return None
        if self.started and (now <= self._acted_at or not (self._is_late or now >= self._due - 0.25 * self._step)):
            return None
        if not self.started and wall - self._announced_at < 0.75 * self._step:
            return None
        self._is_new, self._announced_at = False, wall
        if self.started:
            self._taken_at = now
        return self.onboard.announce(self.pose)

    def act(self, now: float) -> Output | None:
        """Decide on the command of a step that is due, on what the sensors have reported; return None if none is."""
        if not self._is_due(now):
            return None
        limit = self.onboard.limits.pose_age
        seen: dict[str, Any] = {part: rows for part, (stamp, rows) in self._seen.items() if abs(now - stamp) <= limit}
        heard = [message for message in self.heard.values() if message is not None]
        output = self.onboard.act(now, self.pose, heard, works=self.works, **seen)
        taken_at, self._taken_at, self._acted_at = self._taken_at, None, now
        if taken_at is None:
            # Over half a step later, so that the pose of a step comes first on a clock that goes on by whole steps.
            self._due = now + 0.75 * self._step
        elif self._is_late or abs(taken_at - self._due) > self._step:
            self._due = taken_at + self._step
        else:
            self._due += self._step
        self._is_late = taken_at is None
        return output

    def _is_due(self, now: float) -> bool:
        if not self.started or now == self._acted_at:
            return False
        if self._taken_at is None:
            return now >= self._due + 0.5 * self._step
        return self._has_heard() or self._wall() - self._announced_at >= self._wait

    def _has_heard(self) -> bool:
        """Return True if the messages of all neighbours are of the time of the pose."""
        if not self.onboard.listens or self.pose is None:
            return True
        oldest = self.pose.stamp - 0.5 * self._step
        return all(message is not None and message.sent_at >= oldest for message in self.heard.values())
