"""The order of a robot's steps: a pose arrives, the message goes out, the neighbours' messages arrive, it decides."""

import math
from typing import Any

import numpy as np

from baselines.onboard import Message, Odometry, Onboard, Output

_HISTORY = 64
"""Number of messages of each neighbour that are stored."""


class Pilot:
    """Decides when a robot outside the simulator acts, in real time; all times are on the clock of the robots [s].

    A robot acts once in each control step, on the first pose that arrives from a quarter of a step before its time on.
    It first announces this pose to its neighbours, and waits until it has heard of theirs, at most for `wait`. Where no
    pose arrives in time it acts on the one before, so that the rules by which it stops apply, and then on the next one
    as soon as it arrives.

    Args:
        onboard: The robot's policy.
        wait: Longest time that a pose waits for the messages of the neighbours [s].
    """

    def __init__(self, onboard: Onboard, wait: float):
        self.onboard, self._wait = onboard, wait
        self._step = onboard.scenario.task.step
        self.heard: dict[int, list[Message]] = {each: [] for each in onboard.neighbours if each >= 0}
        self.started = False
        self._announced_at = -math.inf
        self._clear()

    def _clear(self) -> None:
        self.pose: Odometry | None = None
        self._taken_at: float | None = None
        self._due: float | None = None
        self._waits = True

    def start(self) -> None:
        """Begin: from now on, the robot drives."""
        self.onboard.reset()
        for messages in self.heard.values():
            messages.clear()
        self._clear()
        self.started = True

    def stop(self) -> None:
        """Stop until `resume`, or `start`."""
        self.onboard.stop()

    def resume(self) -> None:
        """Drive again after a stop that requires a person."""
        self.onboard.resume()

    def take_pose(self, now: float, pose: Odometry) -> Message | None:
        """Store a pose that arrived now; return the message to send at once, None where there is none."""
        if self._taken_at is not None:
            return None
        self.pose = pose
        if self.started and not self._waits and self._due is not None and now < self._due - 0.25 * self._step:
            return None
        if not self.started and now - self._announced_at < 0.75 * self._step:
            return None
        self._announced_at = now
        if self.started:
            self._taken_at = now
        return self.onboard.announce(pose)

    def hear(self, message: Message) -> None:
        """Store a message of a neighbour."""
        messages = self.heard[message.sender]
        messages.append(message)
        del messages[:-_HISTORY]

    def is_due(self, now: float) -> bool:
        """Return True if the robot has to act now."""
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
        return all(messages and messages[-1].sent_at >= oldest for messages in self.heard.values())

    def act(self, now: float, robots: Any = (), targets: Any = (), works: bool = True) -> Output:
        """Decide on the command of the next step."""
        heard = [messages[-1] for messages in self.heard.values() if messages]
        output = self.onboard.act(now, self.pose, heard, robots, targets, works=works)
        taken_at, self._taken_at = self._taken_at, None
        if taken_at is None:
            self._due = now + 0.5 * self._step
        elif self._waits or self._due is None or abs(taken_at - self._due) > self._step:
            self._due = taken_at + self._step
        else:
            self._due += self._step
        self._waits = taken_at is None
        return output


class LockstepPilot:
    """The same in lock-step with a simulation, which announces the times of the messages that have arrived.

    Args:
        onboard: The robot's policy.
    """

    def __init__(self, onboard: Onboard):
        self.onboard, self.started = onboard, False
        self.heard: dict[int, dict[int, Message]] = {each: {} for each in onboard.neighbours if each >= 0}
        self._parts: dict[int, dict[str, Any]] = {}
        self._acted_at = -1
        self.output: Output | None = None

    def start(self) -> None:
        """Begin a new episode."""
        self.onboard.reset()
        self._acted_at, self.output, self.started = -1, None, True

    def stop(self) -> None:
        """Stop until `resume`, or `start`."""
        self.onboard.stop()

    def resume(self) -> None:
        """Drive again after a stop that requires a person."""
        self.onboard.resume()

    def take(self, time: float, part: str, value: Any) -> Message | None:
        """Store a part of the input of a time: `pose`, `robots`, `targets` or `simulated`.

        Returns:
            The message to send at once: that of the pose, when it and its phase are there.
        """
        key = _key(time)
        if key < self._acted_at:
            return None
        parts = self._parts.setdefault(key, {})
        parts[part] = value
        if part in ("pose", "simulated") and {"pose", "simulated"} <= parts.keys():
            if key == self._acted_at:  # sent again, because another robot has missed it
                return self.output.message if self.output is not None else None
            return self.onboard.announce(parts["pose"], parts["simulated"].phase)
        return None

    def hear(self, message: Message) -> None:
        """Store a message of a neighbour."""
        messages = self.heard[message.sender]
        messages[_key(message.sent_at)] = message
        while len(messages) > _HISTORY:
            del messages[min(messages)]

    def act(self) -> tuple[float, Output] | None:
        """Return time and output of the earliest step whose input is complete; None while there is none."""
        if not self.started:
            return None
        for key in sorted(self._parts):
            parts = self._parts[key]
            if key > self._acted_at and {"pose", "robots", "targets", "simulated"} <= parts.keys():
                heard = self._heard(parts["simulated"].heard_at)
                if heard is None:
                    return None
                given = parts["simulated"]
                seen = parts["robots"], parts["targets"]
                self.output = self.onboard.act(key / 1e9, parts["pose"], heard, *seen, given.phase, given.works)
                self._acted_at = key
                self._parts = {time: kept for time, kept in self._parts.items() if time >= key}
                return key / 1e9, self.output
        return None

    def _heard(self, heard_at: tuple[float, float]) -> list[Message] | None:
        """Return the messages that have arrived in the simulation; None if one has not arrived here."""
        messages = []
        for neighbour, time in zip(self.onboard.neighbours, heard_at, strict=True):
            if neighbour >= 0 and np.isfinite(time):
                message = self.heard[neighbour].get(_key(time))
                if message is None:
                    return None
                messages.append(message)
        return messages


def _key(time: float) -> int:
    """Return a time in whole nanoseconds."""
    return round(time * 1e9)
