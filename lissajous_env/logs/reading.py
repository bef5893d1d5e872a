"""Read logs of robots: rosbag2 files (MCAP) or folders, by the names of their topics."""

import json
import math
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lissajous_env.logs.clocks import SAME, Clock
from lissajous_env.logs.filling import seconds
from lissajous_env.logs.inputs import INPUTS
from lissajous_env.logs.log import Log, Series, Track
from lissajous_env.logs.messages import Bags
from lissajous_env.logs.poses import TOPICS, Sources
from lissajous_env.settings.checks import is_finite, is_whole
from lissajous_env.wording import few_of, shown
from lissajous_env.world.state import REMOVED, STUCK, WORKING

EPISODE = "/lissajous/episode"
COMMAND, PHASE, STATUS = "/robot_{}/command", "/robot_{}/phase", "/robot_{}/status"
_FEWEST = 2
_LATE = 1.0
"""Time between the first poses of two robots from which on a note says that the episode begins late [s]."""
_UNIT = 0.01
"""Difference from 1 up to which the square of a quaternion's length is rounded."""


def read(
    path: str | Path | Sequence[str | Path],
    topics: Sequence[str] = TOPICS,
    commands: str = COMMAND,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Log:
    """Read a log.

    Args:
        path: A file (.mcap) or the folder of a rosbag2, or several that belong together.
        topics: Topics of the poses: one for each robot in their order, or one name in which {} stands for their
            numbers. A topic with the poses of several robots is named alone, or with a part after a colon: a frame of
            /tf (`/tf:car_{}`), or a place in an array (`/poses:2`). Of several files, one name without {} stands for
            one robot in each.
        commands: Topic of the commands, with {} for the same numbers: sensor_msgs/JointState with joints named steering
            and throttle, or std_msgs/Float64MultiArray of the two; of differential drives speed and yaw rate, also as
            geometry_msgs/Twist or TwistStamped.
        origin: x, y [m] and heading [rad] of the middle of the rectangle in the frame of the log.

    Raises:
        MissingExtraError: rosbags, of the extra `logs`, is not installed.
        ValueError: a file is damaged or no log, has no such topic, its poses are in several frames or of times that do
            not overlap, or a clock was set while it was recorded.
        OSError: a file cannot be read.
    """
    if len(origin) != 3 or not all(map(math.isfinite, origin)):
        raise ValueError(f"origin must be three finite numbers, x, y [m] and heading [rad], got {shown(origin)}")
    paths = [Path(path)] if isinstance(path, (str, Path)) else [Path(part) for part in path]
    if not paths:
        raise ValueError("path must name at least one log, got none")
    name = paths[0].name if len(paths) == 1 else f"{paths[0].name} and {len(paths) - 1} more"
    with Bags(paths) as bags:
        return _Reading(bags, name, tuple(topics), commands).log(origin)


class _Reading:
    """The files of a log that is being read."""

    def __init__(self, bags: Bags, name: str, topics: tuple[str, ...], commands: str):
        self._bags, self._name = bags, name
        sources = Sources(bags, name)
        self._robots, self._notes = sources.robots(topics)
        if "{}" not in commands and len(self._robots) > 1 and self._robots[0].bag is None:
            raise ValueError(f"commands must be a topic in which {{}} stands for a robot's number, got {commands}")
        self._commands, self._blank = commands, Log(name, (), labels=tuple(robot.label for robot in self._robots))
        self._called = self._blank.called
        poses = self._sound([sources.of(robot) for robot in self._robots])
        frames = {str(frame) for own in poses for frame in own["frame"]}
        if len(frames) > 1:
            got = [
                f"{frame or 'no name'} of {self._called([k for k, own in enumerate(poses) if frame in own['frame']])}"
                for frame in sorted(frames)
            ]
            raise ValueError(f"the poses of {name} must be in one frame, got {'; '.join(got)}")
        self._clock = Clock(poses, self._blank)
        self._notes += self._clock.notes
        self._ignored: Counter[tuple[str, str]] = Counter()

    def log(self, origin: tuple[float, float, float]) -> Log:
        """Return the log, with poses relative to an origin."""
        tracks = [self._track(k, poses, origin) for k, poses in enumerate(self._clock.poses)]
        self._check_times(tracks)
        episode, begin = self._episode(tracks)
        commands, phases, statuses = (self._series(pattern) for pattern in (self._commands, PHASE, STATUS))
        reasons: dict[str, Counter[str]] = {}
        for (topic, reason), count in sorted((self._bags.ignored + self._ignored).items()):
            reasons.setdefault(reason, Counter())[topic] += count
        for reason, topics in reasons.items():
            self._notes.append(f"{topics.total()} messages of {few_of(topics)} are ignored: {reason}")
        phases, statuses = (
            {k: Series(own.time, own.value[:, 0]) for k, own in series.items()} for series in (phases, statuses)
        )
        series = commands, phases, statuses
        return Log(self._name, tuple(tracks), *series, episode, begin, self._blank.labels, tuple(self._notes))

    def _sound(self, poses: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Return the finite poses of each robot, and note the others."""
        words, sound = [], []
        for k, own in enumerate(poses):
            finite = np.isfinite(own["pose"][:, :3]).all(axis=1) & np.isfinite(own["square"])
            broken, odd = int((~finite).sum()), int((np.abs(own["square"][finite] - 1) > _UNIT).sum())
            if finite.sum() < _FEWEST:
                got = f"{int(finite.sum())}" + (f" and {broken} that are not finite" if broken else "")
                name = self._robots[k].name
                raise ValueError(f"topic {name} of {self._name} must have at least {_FEWEST} poses, got {got}")
            words += [(k, f"{broken} poses that are not finite are left out")] if broken else []
            words += [(k, f"{odd} quaternions are not of length 1")] if odd else []
            sound.append(own[finite])
        self._notes += self._blank.grouped(words)
        return sound

    def _track(self, robot: int, poses: np.ndarray, origin: tuple[float, float, float]) -> Track:
        """Return a track in the frame of the rectangle."""
        if len(poses) < _FEWEST:
            words = f"must have at least {_FEWEST} poses in {self._name} whose stamps are set"
            raise ValueError(f"{self._called([robot])} {words}, got {len(poses)}")
        measured = bool(poses["measured"].all())
        poses = poses[np.argsort(poses["stamp"], kind="stable")]
        poses = poses[np.append(np.diff(poses["stamp"]) > SAME, True)]
        position, heading, speed = poses["pose"][:, :3].copy(), poses["pose"][:, 3].copy(), poses["pose"][:, 4]
        x, y, turn = origin
        if any(origin):
            away = position[:, :2] - (x, y)
            position[:, 0] = math.cos(turn) * away[:, 0] + math.sin(turn) * away[:, 1]
            position[:, 1] = math.cos(turn) * away[:, 1] - math.sin(turn) * away[:, 0]
        known = np.isfinite(heading)
        heading[known] = np.unwrap(heading[known]) - turn
        return Track(poses["stamp"], position, heading, np.where(np.isfinite(speed), speed, np.nan), measured)

    def _check_times(self, tracks: Sequence[Track]) -> None:
        """Check that there is a time at which all robots have poses."""
        first, last = (np.array([track.time[place] for track in tracks]) for place in (0, -1))
        if first.max() < last.min() or len(tracks) < 2:
            return
        together = (first[:, None] <= last) & (first <= last[:, None])
        odd = int(np.argmin(together.sum(axis=1)))
        rest = np.delete(np.arange(len(tracks)), odd)
        raise ValueError(
            f"the poses of all robots of {self._name} must overlap in time, got those of {self._called([odd])} from "
            f"{first[odd]:.3f} to {last[odd]:.3f} s and the others' from {first[rest].min():.3f} to "
            f"{last[rest].max():.3f} s: is a clock set wrong?"
        )

    def _series(self, pattern: str) -> dict[int, Series]:
        """Return the values of the robots that have any on the topics of a pattern.

        Messages without as many finite numbers, of the same names, as the first are noted.
        """
        kinds, series = _KINDS.get(pattern, _COMMANDS), {}
        for k, robot in enumerate(self._robots):
            topic = pattern.replace("{}", robot.label)
            rows, times = [], []
            for message in self._bags.of(topic, tuple(kinds)):
                if "{}" not in pattern and robot.bag not in (None, message.bag):
                    continue  # a topic without a number is that of one robot in each file
                try:
                    names, numbers = kinds[message.kind](message.content)
                    _check(all(map(math.isfinite, numbers)), "they have numbers that are not finite")
                    same = not rows or (names, len(numbers)) == (rows[0][0], len(rows[0][1]))
                    _check(same, "they have other names or another length than the first")
                except ValueError as error:
                    self._ignored[topic, str(error)] += 1
                    continue
                stamp = getattr(getattr(message.content, "header", None), "stamp", None)
                rows.append((names, numbers))
                times.append((message.bag, message.logged, np.nan if stamp is None else seconds(stamp)))
            if rows:
                time = self._times(topic, *np.array(times).T)
                order = np.argsort(time, kind="stable")
                order = order[np.append(np.diff(time[order]) > 0, True)]
                values = np.array([numbers for _, numbers in rows], dtype=float)
                series[k] = Series(time[order], values[order], rows[0][0])
        return series

    def _times(self, topic: str, bag: np.ndarray, logged: np.ndarray, stamp: np.ndarray) -> np.ndarray:
        """Return the times of messages: of their stamps if they have any on the clock of the poses."""
        if np.isfinite(stamp).all():
            ahead = self._clock.differs(bag, logged, stamp)
            if ahead == 0:
                return stamp
            if ahead and stamp.any():
                words = f"the stamps of {topic} differ by {abs(ahead):.3g} s from the clock of the poses"
                self._notes.append(f"{words}; the recorder's times are used for them")
        return self._clock.times(bag, logged)

    def _episode(self, tracks: Sequence[Track]) -> tuple[dict[str, Any] | None, float | None]:
        """Return what a simulation wrote about its episode, and when it began: with a pose."""
        messages = list(self._bags.of(EPISODE, ("std_msgs/msg/String",)))
        if not messages:
            first = np.array([track.time[0] for track in tracks])
            if np.ptp(first) > _LATE:
                late, early = (self._called([int(which(first))]) for which in (np.argmax, np.argmin))
                words = f"the episode begins with the first pose of {late}"
                self._notes.append(f"{words}, {np.ptp(first):.3g} s after that of {early}")
            return None, None
        if len({message.content.data for message in messages}) > 1 or len(messages) > len(self._bags.paths):
            self._notes.append(f"{len(messages)} episodes begin in {self._name}: the last of them counts")
        last = messages[-1]
        episode = _checked_episode(last.content.data, self._name)
        bag, logged = np.array([last.bag]), np.array([last.logged])
        time = float(self._clock.times(bag, logged)[0])
        if "begin" in episode and self._clock.differs(bag, logged, np.array([episode["begin"]])) == 0:
            time = float(episode["begin"])
        stamps = np.concatenate([track.time for track in tracks])
        return episode, float(stamps[np.argmin(np.abs(stamps - time))])


def _check(holds: bool, reason: str) -> None:
    if not holds:
        raise ValueError(reason)


def _checked_episode(text: str, name: str) -> dict[str, Any]:
    rule = f"log {name} must be undamaged, but its {EPISODE}"
    try:
        episode = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{rule} is no JSON") from error
    if not isinstance(episode, dict) or not isinstance(episode.get("scenario"), dict):
        raise ValueError(f"{rule} contains no scenario")
    seed: Any = episode.get("seed")
    if not is_whole(seed) or not 0 <= seed < 2**31:
        raise ValueError(f"{rule} does not contain the seed, a whole number from 0 to {2**31 - 1}")
    if "begin" in episode and not is_finite(episode["begin"]):
        raise ValueError(f"{rule} has a begin that must be a finite number [s], got {shown(episode['begin'])}")
    return episode


def _joints(message: Any) -> tuple[tuple[str, ...], list[float]]:
    """Return the names and positions of joints in the order of their names."""
    names = list(message.name)
    one_each = len(message.position) == len(names) == len(set(names))
    _check(one_each, "they do not have one position for each name")
    order = sorted(range(len(names)), key=lambda k: names[k])
    return tuple(names[k] for k in order), [float(message.position[k]) for k in order]


def _twist(twist: Any) -> tuple[tuple[str, ...], list[float]]:
    return INPUTS["differential"], [twist.linear.x, twist.angular.z]


def _status(message: Any) -> tuple[tuple[str, ...], list[float]]:
    statuses = int(WORKING), int(STUCK), int(REMOVED)
    _check(message.data in statuses, f"they have the unknown status {message.data}")
    return (), [message.data]


_COMMANDS: dict[str, Callable[[Any], tuple[tuple[str, ...], list[float]]]] = {
    "sensor_msgs/msg/JointState": _joints,
    "std_msgs/msg/Float64MultiArray": lambda message: ((), list(message.data)),
    "geometry_msgs/msg/Twist": _twist,
    "geometry_msgs/msg/TwistStamped": lambda message: _twist(message.twist),
}
_KINDS = {
    PHASE: {"std_msgs/msg/Float64": lambda message: ((), [message.data])},
    STATUS: {"std_msgs/msg/UInt8": _status},
}
"""Functions that return the names of some numbers, or (), and the numbers in a message, by its type; a topic with
another pattern has commands. A message that says nothing raises a ValueError with the reason."""
