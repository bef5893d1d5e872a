"""Read logs of robots: rosbag2 files (MCAP) or folders, by the names of their topics."""

import json
import math
from collections.abc import Callable, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from lissajous_env.logs.log import Log, Series, Track
from lissajous_env.logs.ros_types import rosbags, type_store
from lissajous_env.settings.checks import is_whole
from lissajous_env.wording import few_of, nearest

EPISODE = "/lissajous/episode"
ODOMETRY = ("/robot_{}/odom",)
COMMAND, PHASE, STATUS = "/robot_{}/command", "/robot_{}/phase", "/robot_{}/status"
_POSES = {
    "nav_msgs/msg/Odometry": lambda message: message.pose.pose,
    "geometry_msgs/msg/PoseStamped": lambda message: message.pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: message.pose.pose,
}
"""Function that returns the pose in a message, by its type."""
_FEWEST = 2


def read(
    path: str | Path,
    topics: Sequence[str] = ODOMETRY,
    commands: str = COMMAND,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Log:
    """Read a log.

    Args:
        path: A file (.mcap) or the folder of a rosbag2.
        topics: Topics of the poses, of type nav_msgs/Odometry, geometry_msgs/PoseStamped or
            geometry_msgs/PoseWithCovarianceStamped: one for each robot in their order, or one name in which {} stands
            for 0, 1, 2 ... (or 1, 2, 3 ...).
        commands: Topic of the commands, with {} for the same numbers: sensor_msgs/JointState with joints named steering
            and throttle, or std_msgs/Float64MultiArray of the two.
        origin: x, y [m] and heading [rad] of the middle of the rectangle in the frame of the log.

    Raises:
        MissingExtraError: rosbags, of the extra `logs`, is not installed.
        ValueError: the file is damaged or no log, has no such topic, or poses that are not finite.
        OSError: the file cannot be read.
    """
    rosbag2 = rosbags()
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(2, "there is no such log", str(path))
    try:
        with rosbag2.Reader(path) as reader:
            return _Reading(reader, path.name, origin).log(tuple(topics), commands)
    except (OSError, _RefusedError):
        raise
    except Exception as error:  # damaged bytes make the library raise almost any error
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise ValueError(f"{path} must be an undamaged rosbag2 file (.mcap) or folder, but {reason}") from error


class _RefusedError(ValueError):
    """A log that can be read but has not what is needed."""


class _Reading:
    """An open log."""

    def __init__(self, reader: Any, name: str, origin: tuple[float, float, float]):
        self._reader, self._name, self._origin = reader, name, origin
        self._connections = {each.topic: each for each in reader.connections}
        self._store = type_store()  # of ROS alone: the types that a file defines are not compiled

    def log(self, topics: tuple[str, ...], commands: str) -> Log:
        names, numbers = self._expanded(topics)
        tracks = tuple(self._track(name) for name in names)
        return Log(
            self._name,
            tracks,
            self._others(commands, numbers, _command_of),
            self._others(PHASE, numbers, lambda message: message.data),
            self._others(STATUS, numbers, lambda message: message.data),
            self._episode(),
        )

    def _expanded(self, topics: tuple[str, ...]) -> tuple[list[str], list[int]]:
        """Return the topic of each robot, and the number in the topics of its other messages."""
        if len(topics) != 1 or "{}" not in topics[0]:
            self._require(topics)
            return list(topics), list(range(len(topics)))
        pattern = topics[0]
        first = 0 if pattern.format(0) in self._connections else 1
        numbers = []
        for number in count(first):
            if pattern.format(number) not in self._connections:
                break
            numbers.append(number)
        if not numbers:
            self._require([pattern.format(0)])
        return [pattern.format(number) for number in numbers], numbers

    def _require(self, topics: Sequence[str]) -> None:
        for topic in topics:
            if topic not in self._connections:
                there = sorted(name for name, each in self._connections.items() if each.msgtype in _POSES)
                hint = nearest(topic, there)
                raise _RefusedError(
                    f"topics must be topics of poses in {self._name}, which has {few_of(there) or 'none'}, "
                    f"got {topic}{hint}"
                )
            if (kind := self._connections[topic].msgtype) not in _POSES:
                raise _RefusedError(f"topic {topic} of {self._name} must be of type {', '.join(_POSES)}, got {kind}")

    def _messages(self, topic: str) -> list[tuple[float, Any]]:
        """Return time [s] and content of each message of a topic, the time of its header if it has one."""
        found = []
        for connection, logged, raw in self._reader.messages([self._connections[topic]]):
            message = self._store.deserialize_cdr(raw, connection.msgtype)
            stamp = message.header.stamp if hasattr(message, "header") else None
            time = logged / 1e9 if stamp is None or stamp.sec == 0 else stamp.sec + stamp.nanosec / 1e9
            found.append((time, message))
        return found

    def _track(self, topic: str) -> Track:
        self._require([topic])
        pose_of = _POSES[kind := self._connections[topic].msgtype]
        rows = []
        for time, message in self._messages(topic):
            pose = pose_of(message)
            place, turn = pose.position, pose.orientation
            heading = math.atan2(2 * (turn.w * turn.z + turn.x * turn.y), 1 - 2 * (turn.y**2 + turn.z**2))
            speed = message.twist.twist.linear.x if kind == "nav_msgs/msg/Odometry" else math.nan
            rows.append((time, place.x, place.y, place.z, heading, speed))
        values = _in_order(np.array(rows, dtype=float).reshape(-1, 6))
        if len(values) < _FEWEST:
            raise _RefusedError(f"topic {topic} of {self._name} must have at least {_FEWEST} poses, got {len(values)}")
        if not np.isfinite(values[:, :5]).all():
            at = values[~np.isfinite(values[:, :5]).all(axis=1)][0, 0]
            raise _RefusedError(
                f"topic {topic} of {self._name} must have finite poses, got NaN or infinity at {at:.3f} s"
            )
        return self._moved(values)

    def _moved(self, values: np.ndarray) -> Track:
        """Return a track in the frame of the rectangle; a speed that was not logged is that of the positions."""
        time, position, speed = values[:, 0], values[:, 1:4].copy(), values[:, 5]
        x, y, turn = self._origin
        if any(self._origin):
            away = position[:, :2] - (x, y)
            position[:, 0] = math.cos(turn) * away[:, 0] + math.sin(turn) * away[:, 1]
            position[:, 1] = math.cos(turn) * away[:, 1] - math.sin(turn) * away[:, 0]
        heading = np.unwrap(values[:, 4]) - turn
        if not np.isfinite(speed).all():
            speed = np.linalg.norm(np.gradient(position[:, :2], time, axis=0), axis=1)
        return Track(time, position, heading, speed)

    def _others(self, pattern: str, numbers: list[int], value_of: Callable[[Any], Any]) -> dict[int, Series]:
        found = {}
        for robot, number in enumerate(numbers):
            topic = pattern.format(number)
            if topic in self._connections:
                rows = [(time, *np.atleast_1d(value_of(message))) for time, message in self._messages(topic)]
                values = _in_order(np.array(rows, dtype=float))
                series = values[:, 1:] if value_of is _command_of else values[:, 1]
                found[robot] = Series(values[:, 0], series)
        return found

    def _episode(self) -> dict[str, Any] | None:
        if EPISODE not in self._connections:
            return None
        episode = json.loads(self._messages(EPISODE)[0][1].data)
        if not isinstance(episode, dict) or not isinstance(episode.get("scenario"), dict):
            raise ValueError(f"its {EPISODE} must contain a scenario")
        seed: Any = episode.get("seed")
        if not is_whole(seed) or not 0 <= seed < 2**31:
            raise ValueError(f"its {EPISODE} must contain the seed, a whole number from 0 to {2**31 - 1}")
        return episode


def _command_of(message: Any) -> list[float]:
    """Return the values of a command."""
    if not hasattr(message, "name"):
        return list(message.data)
    names = list(message.name)
    if {"steering", "throttle"} <= set(names):
        first = [names.index("steering"), names.index("throttle")]
        order = first + [k for k in range(len(names)) if k not in first]
        return [float(message.position[k]) for k in order]
    return [float(value) for value in message.position]


def _in_order(values: np.ndarray) -> np.ndarray:
    """Return rows in the order of their times, in the first column, of equal ones the last."""
    values = values[np.argsort(values[:, 0], kind="stable")]
    return values[np.append(np.diff(values[:, 0]) > 0, True)] if len(values) else values
