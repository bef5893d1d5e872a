"""The order of a robot's steps: a pose arrives, the message goes out, the neighbours' messages arrive, it decides."""

import math
from typing import Any

import numpy as np

from baselines.onboard import Message, Odometry, Onboard, Output

_HISTORY = 64
"""Number of messages of each neighbour that are stored."""


class Pilot:
    """Decides when a robot outside the simulator acts; all times are on the clock of the robots [s].

    Its two kinds follow a clock in real time, and a simulation in lock-step.

    Args:
        onboard: The robot's policy.

    Attributes:
        started: True from the first call of `start` on.
        pose: The latest pose.
    """

    def __init__(self, onboard: Onboard):
        self.onboard, self.started = onboard, False
        self.pose: Odometry | None = None
        self._step = onboard.scenario.task.step
        self._heard: dict[int, dict[int, Message]] = {sender: {} for sender in onboard.neighbours if sender >= 0}

    @property
    def heard(self) -> dict[int, Message | None]:
        """The message of each ring neighbour that arrived last, by its index; None for none yet."""
        return {sender: next(reversed(sent.values()), None) for sender, sent in self._heard.items()}

    def start(self) -> None:
        """Begin an episode: from now on, the robot drives."""
        self.onboard.reset()
        self.started = True

    def hear(self, message: Message) -> None:
        """Store a message of a neighbour."""
        sent, key = self._heard[message.sender], _key(message.sent_at)
        sent.pop(key, None)
        sent[key] = message
        if len(sent) > _HISTORY:
            del sent[next(iter(sent))]

    def take(self, part: str, value: Any, stamp: float, now: float) -> Message | None:
        """Store a part of the input of a time `stamp` that arrived now; return the message to send at once, if any."""
        raise NotImplementedError

    def act(self, now: float) -> tuple[float, Output] | None:
        """Decide on the command of a step that is due; return its time and the output, None while none is due."""
        raise NotImplementedError


class RealTimePilot(Pilot):
    """Acts once in each control step, on the first pose that arrives from a quarter of a step before its time on.

    The robot first announces this pose to its neighbours, and waits until it has heard of theirs, at most for `wait`.
    Where no pose arrives in time it acts on the one before, so that the rules by which it stops apply, and then on the
    next one as soon as it arrives. The parts of its input are `pose`, `robots`, `targets` and `works`.

    Args:
        onboard: The robot's policy.
        wait: Longest time that a pose waits for the messages of the neighbours [s].
    """

    def __init__(self, onboard: Onboard, wait: float):
        super().__init__(onboard)
        self._wait, self._works = wait, True
        self._seen: dict[str, tuple[float, Any]] = {}
        self._announced_at = -math.inf
        self._forget()

    def _forget(self) -> None:
        self.pose = None
        self._taken_at: float | None = None
        self._due: float | None = None
        self._waits = True

    def start(self) -> None:
        """Begin an episode, with new messages and poses alone."""
        super().start()
        for sent in self._heard.values():
            sent.clear()
        self._forget()

    def take(self, part: str, value: Any, stamp: float, now: float) -> Message | None:
        """Store a part; return the message of a pose on which the robot acts."""
        if part == "works":
            self._works = value
        elif part != "pose":
            self._seen[part] = stamp, value
        elif self._taken_at is None:
            self.pose = value
            return self._announced(now)
        return None

    def _announced(self, now: float) -> Message | None:
        if self.started and not self._waits and self._due is not None and now < self._due - 0.25 * self._step:
            return None
        if not self.started and now - self._announced_at < 0.75 * self._step:
            return None
        self._announced_at = now
        if self.started:
            self._taken_at = now
        assert self.pose is not None
        return self.onboard.announce(self.pose)

    def _is_due(self, now: float) -> bool:
        if not self.started:
            return False
        if self._taken_at is None:
            return self._due is None or now >= self._due + 0.5 * self._step
        return now - self._taken_at >= self._wait or now < self._taken_at or self._has_heard()

    def _has_heard(self) -> bool:
        """Return True if the messages of all neighbours are of the time of the pose."""
        if not self.onboard.listens or self.pose is None:
            return True
        oldest = self.pose.stamp - 0.5 * self._step
        return all(message is not None and message.sent_at >= oldest for message in self.heard.values())

    def act(self, now: float) -> tuple[float, Output] | None:
        """Decide on the command of the next step, on what the sensors have reported not too long ago."""
        if not self._is_due(now):
            return None
        limit = self.onboard.limits.pose_age
        seen: dict[str, Any] = {part: rows for part, (stamp, rows) in self._seen.items() if abs(now - stamp) <= limit}
        heard = [message for message in self.heard.values() if message is not None]
        output = self.onboard.act(now, self.pose, heard, works=self._works, **seen)
        taken_at, self._taken_at = self._taken_at, None
        if taken_at is None:
            self._due = now + 0.5 * self._step
        elif self._waits or self._due is None or abs(taken_at - self._due) > self._step:
            self._due = taken_at + self._step
        else:
            self._due += self._step
        self._waits = taken_at is None
        return now, output


class LockstepPilot(Pilot):
    """Acts on the input of each step of a simulation, which announces the times of the messages that have arrived.

    The parts of its input are `pose`, `robots`, `targets` and `simulated`.
    """

    def __init__(self, onboard: Onboard):
        super().__init__(onboard)
        self._parts: dict[int, dict[str, Any]] = {}
        self._acted_at, self._sent = -1, None

    def start(self) -> None:
        """Begin an episode."""
        super().start()
        self._acted_at, self._sent = -1, None

    def take(self, part: str, value: Any, stamp: float, now: float) -> Message | None:
        """Store a part; return the message of the pose when it and its phase are there."""
        key = _key(stamp)
        if key < self._acted_at:
            return None
        parts = self._parts.setdefault(key, {})
        parts[part] = value
        if part in ("pose", "simulated") and {"pose", "simulated"} <= parts.keys():
            if key == self._acted_at:  # sent again, because another robot has missed it
                return self._sent
            return self.onboard.announce(parts["pose"], parts["simulated"].phase)
        return None

    def act(self, now: float) -> tuple[float, Output] | None:
        """Decide on the command of the earliest step whose input is complete."""
        if not self.started:
            return None
        for key in sorted(self._parts):
            parts = self._parts[key]
            if key > self._acted_at and {"pose", "robots", "targets", "simulated"} <= parts.keys():
                given = parts["simulated"]
                heard = self._arrived(given.heard_at)
                if heard is None:
                    return None
                seen = parts["robots"], parts["targets"]
                output = self.onboard.act(key / 1e9, parts["pose"], heard, *seen, given.phase, given.works)
                self._acted_at, self._sent = key, output.message
                self._parts = {time: rest for time, rest in self._parts.items() if time >= key}
                return key / 1e9, output
        return None

    def _arrived(self, heard_at: tuple[float, float]) -> list[Message] | None:
        """Return the messages that have arrived in the simulation; None if one has not arrived here."""
        messages = []
        for neighbour, time in zip(self.onboard.neighbours, heard_at, strict=True):
            if neighbour >= 0 and np.isfinite(time):
                message = self._heard[neighbour].get(_key(time))
                if message is None:
                    return None
                messages.append(message)
        return messages


def _key(time: float) -> int:
    """Return a time in whole nanoseconds."""
    return round(time * 1e9)
