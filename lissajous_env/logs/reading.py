"""Read logs of robots: rosbag2 files (MCAP) or folders, by the names of their topics."""

import contextlib
import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lissajous_env.logs.bags import LARGEST, Bags, Decoder, Samples
from lissajous_env.logs.clocks import SAME_STAMP, Clock
from lissajous_env.logs.log import Log, Series, Track
from lissajous_env.logs.poses import TOPICS, robots_of
from lissajous_env.logs.samples import COMMANDS, PHASES, STATUSES, TEXTS, relative
from lissajous_env.settings.checks import is_number, is_whole
from lissajous_env.wording import require, shown

EPISODE = "/lissajous/episode"
COMMAND, PHASE, STATUS = "/robot_{}/command", "/robot_{}/phase", "/robot_{}/status"
_LATE = 1.0
"""Longest time between the first poses of two robots without a note that the episode begins late [s]."""


def read(
    path: str | Path | Sequence[str | Path],
    topics: str | Sequence[str] = TOPICS,
    commands: str = COMMAND,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Log:
    """Read a log.

    Args:
        path: A file (.mcap) or the folder of a rosbag2, or several that belong together.
        topics: Topics of the poses: one for each robot in their order, or one name in which {} stands for their
            numbers. A frame of /tf is named after a colon (`/tf:car_{}`), and so is a place in an array (`/poses:2`);
            an array alone stands for all of its places. Of several files, one name without {} stands for one robot in
            each.
        commands: Topic of the commands, with {} for the same numbers: sensor_msgs/JointState with joints named steering
            and throttle, or std_msgs/Float64MultiArray of the two; of differential drives speed and yaw rate, also as
            geometry_msgs/Twist or TwistStamped.
        origin: x, y [m] and heading [rad] of the middle of the rectangle in the frame of the log.

    Raises:
        MissingExtraError: rosbags, of the extra `logs`, is not installed.
        ValueError: a file is damaged or no log, has no such topic, its poses are in several frames, or a clock was set
            while it was recorded.
        OSError: a file cannot be read.
    """
    rule = "must be three finite numbers, x, y [m] and heading [rad]"
    require(len(origin) == 3 and all(map(math.isfinite, origin)), "origin", rule, origin)
    paths = [Path(path)] if isinstance(path, (str, Path)) else [Path(part) for part in path]
    require(paths, "logs", "must be one or more files or folders", path)
    with Bags(paths) as bags:
        return _Reading(bags, (topics,) if isinstance(topics, str) else tuple(topics)).log(commands, origin)


class _Reading:
    """The files of a log that is being read."""

    def __init__(self, bags: Bags, topics: tuple[str, ...]):
        self._bags, self._name = bags, bags.name
        self._robots = robots_of(bags, topics)
        poses = [robot.poses for robot in self._robots]
        self._blank = Log(self._name, (), labels=tuple(robot.label for robot in self._robots))
        frames = [(k, str(frame) or "no name") for k, own in enumerate(poses) for frame in sorted(set(own.frame))]
        if len({frame for _, frame in frames}) > 1:
            got = "; ".join(self._blank.grouped(frames))
            raise ValueError(f"the poses of {self._name} must be in one frame, got {got}")
        self._clock = Clock(poses, self._blank)
        self._notes = list(self._clock.notes)

    def log(self, commands: str, origin: tuple[float, float, float]) -> Log:
        """Return the log, with commands of a topic, and with poses relative to an origin."""
        if "{}" not in commands and len(self._robots) > 1 and self._robots[0].bag is None:
            raise ValueError(f"commands must be a topic in which {{}} stands for a robot's number, got {commands}")
        tracks = [_track(poses, origin) for poses in self._clock.poses]
        episode, begin = self._episode(tracks)
        series = self._series(commands, COMMANDS), self._series(PHASE, PHASES), self._series(STATUS, STATUSES)
        notes = *self._notes, *self._bags.notes()
        return Log(self._name, tuple(tracks), *series, episode, begin, self._blank.labels, notes)

    def _series(self, pattern: str, decoders: dict[str, Decoder]) -> dict[int, Series]:
        """Return the values of the robots that have any on the topics of a pattern."""
        series = {}
        for k, robot in enumerate(self._robots):
            topic = pattern.replace("{}", robot.label)
            # A topic without a number is that of one robot in each file.
            parts = self._bags.samples(topic, decoders, None if "{}" in pattern else robot.bag)
            if parts and len(samples := self._bags.finite(topic, parts[""])):
                samples = dataclasses.replace(samples, stamp=self._times(topic, samples)).in_order()
                value = samples.values if decoders is COMMANDS else samples.values[:, 0]
                series[k] = Series(samples.stamp, value, samples.names)
        return series

    def _times(self, topic: str, samples: Samples) -> np.ndarray:
        """Return the times of messages: of their stamps if they have any on the clock of the poses."""
        if np.isfinite(samples.stamp).all():
            lead = self._clock.lead_of(samples, samples.stamp)
            if lead == 0:
                return samples.stamp
            if samples.stamp.any():
                words = f"differ by {abs(lead):.3g} s from the clock of the poses"
                words = "are all the same" if math.isnan(lead) else words
                self._notes.append(f"the stamps of {topic} {words}; the recorder's times are used for them")
        return self._clock.times(samples)

    def _episode(self, tracks: Sequence[Track]) -> tuple[dict[str, Any] | None, float | None]:
        """Return what a simulation wrote about its episode, and the time of its first pose [s]; None if unknown."""
        texts = self._bags.samples(EPISODE, TEXTS).get("")
        if texts is None:
            first = np.array([track.time[0] for track in tracks])
            if np.ptp(first) > _LATE:
                late, early = (self._blank.called([int(which(first))]) for which in (np.argmax, np.argmin))
                words = f"the episode begins with the first pose of {late}"
                self._notes.append(f"{words}, {np.ptp(first):.3g} s after that of {early}")
            return None, None
        if len(set(texts.values[:, 0])) > 1 or len(texts) > len(self._bags.paths):
            self._notes.append(f"{len(texts)} episodes begin in {self._name}: the last of them counts")
        last = texts.take(slice(-1, None))
        episode = _checked_episode(str(last.values[0, 0]), self._name)
        time = float(self._clock.times(last)[0])
        if "begin" in episode and self._clock.lead_of(last, np.array([episode["begin"]])) == 0:
            time = float(episode["begin"])
        stamps = np.concatenate([track.time for track in tracks])
        return episode, float(stamps[np.argmin(np.abs(stamps - time))])


def _track(poses: Samples, origin: tuple[float, float, float]) -> Track:
    """Return a track in the frame of the rectangle."""
    poses = poses.in_order(SAME_STAMP)
    position, (heading, speed) = poses.values[:, :3], poses.values[:, 3:].T.copy()
    if any(origin):
        position = np.column_stack([relative(position[:, :2], origin), position[:, 2]])
    known = np.isfinite(heading)
    heading[known] = np.unwrap(heading[known]) - origin[2]
    speed[~(np.abs(speed) <= LARGEST)] = np.nan
    return Track(poses.stamp, position, heading, speed)


def _checked_episode(text: str, name: str) -> dict[str, Any]:
    """Return what a text contains: a scenario, a seed, and perhaps a policy and the begin of the episode."""
    episode: Any = None
    with contextlib.suppress(ValueError, RecursionError):
        episode = json.loads(text)
    parts = episode if isinstance(episode, dict) else {}
    seed: Any = parts.get("seed")
    has_seed = is_whole(seed) and 0 <= seed < 2**31
    if not (has_seed and isinstance(parts.get("scenario"), dict) and is_number(parts.get("begin", 0.0))):
        rule = f"JSON with a scenario, a seed from 0 to {2**31 - 1} and a finite begin [s]"
        raise ValueError(f"log {name} must have {rule} on {EPISODE}, got {shown(text)}")
    return parts
