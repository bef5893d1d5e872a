"""Poses of robots in messages: which messages have any, and which of them are of the robots that a user names.

The poses of a robot have the name of their topic, or of a topic and a part of it: "/tf:car_2" for the frame car_2,
"/poses:2" for the third pose of an array.
"""

import math
import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from lissajous_env.logs.messages import Bags, Message
from lissajous_env.wording import few_of, nearest

TOPICS = ("/robot_{}/odom",)
"""Topics of poses by default."""
ODOMETRY, TRANSFORMS, ARRAY = "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/PoseArray"
SINGLE: dict[str, Callable[[Any], tuple[Any, Any]]] = {
    ODOMETRY: lambda message: (message.pose.pose.position, message.pose.pose.orientation),
    "geometry_msgs/msg/PoseStamped": lambda message: (message.pose.position, message.pose.orientation),
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda m: (m.pose.pose.position, m.pose.pose.orientation),
    "geometry_msgs/msg/TransformStamped": lambda m: (m.transform.translation, m.transform.rotation),
}
"""Function that returns position and orientation in the message of one robot, by its type."""
KINDS = (*SINGLE, TRANSFORMS, ARRAY)
"""Types of messages with poses."""
_BODIES = ("base_link", "base_footprint")


class Poses(NamedTuple):
    """Poses of a robot as they were recorded, K rows."""

    bag: np.ndarray
    """(K,) number of the file."""
    logged: np.ndarray
    """(K,) times of the recorder [s]."""
    stamp: np.ndarray
    """(K,) stamps [s]."""
    pose: np.ndarray
    """(K, 5) x, y, z [m], heading [rad], speed [m/s], NaN where there is none."""
    square: np.ndarray
    """(K,) squares of the lengths of the quaternions."""
    measured: np.ndarray
    """(K,) False where the log says that a speed is no measurement, by a first covariance of -1."""
    frame: np.ndarray
    """(K,) names of the frames."""

    def rows(self, chosen: np.ndarray) -> "Poses":
        """Return some of the rows."""
        return Poses(*(values[chosen] for values in self))


class Robot(NamedTuple):
    """A robot of a log."""

    label: str
    """Its number in the names of the log."""
    name: str
    """Name of its poses."""
    bag: int | None
    """Number of the file with its poses; None for any."""


class _Rows(list):
    """Poses that are being collected."""

    def add(self, message: Message, header: Any, place: Any, turn: Any, speed: float = math.nan, measured: bool = True):
        stamp = header.stamp.sec + header.stamp.nanosec / 1e9
        heading, square = heading_of(turn.x, turn.y, turn.z, turn.w)
        pose = (place.x, place.y, place.z, heading, speed)
        self.append((message.bag, message.logged, stamp, pose, square, measured, header.frame_id.strip("/")))

    def poses(self) -> Poses:
        kinds = (int, float, float, float, float, bool, object)
        columns = zip(*self, strict=True) if self else [()] * len(kinds)
        poses = Poses(*(np.array(values, dtype=kind) for values, kind in zip(columns, kinds, strict=True)))
        return poses._replace(pose=poses.pose.reshape(-1, 5))


def heading_of(x: float, y: float, z: float, w: float) -> tuple[float, float]:
    """Return the heading of a quaternion of any length [rad], NaN for one of length 0, and the square of its length."""
    square = x * x + y * y + z * z + w * w
    if not square > 1e-12:
        return math.nan, square
    return math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z), square


class Sources:
    """The poses in the files of a log, each topic of which is read once.

    Args:
        bags: The files.
        name: Name of the log.
    """

    def __init__(self, bags: Bags, name: str):
        self._bags, self._log = bags, name
        self.topics = sorted(topic for topic, kinds in bags.kinds.items() if kinds & set(KINDS))
        self._read: dict[str, dict[str, Poses]] = {}

    def of(self, robot: Robot) -> Poses:
        """Return the poses of a robot."""
        topic, _, part = robot.name.partition(":")
        poses = self._parts(topic).get(part, _Rows().poses())
        return poses if robot.bag is None else poses.rows(poses.bag == robot.bag)

    def robots(self, topics: Sequence[str]) -> tuple[list[Robot], list[str]]:
        """Return the robots in the order of their numbers or of the given names, and notes.

        Args:
            topics: Names of topics, each of which may be followed by a colon and a part; or one such name with {}.

        Raises:
            ValueError: a topic is missing, of another type, or named twice.
        """
        twice = [topic for k, topic in enumerate(topics) if topic in topics[:k]]
        if twice:
            raise ValueError(f"topics must name each topic once, got {twice[0]} twice")
        patterns = [topic for topic in topics if "{}" in topic]
        if not patterns:
            return self._named(topics), []
        if len(topics) > 1 or topics[0].count("{}") > 1 or "{" in topics[0].replace("{}", ""):
            raise ValueError(f"topics must be names, or one name in which {{}} stands once for a number, got {topics}")
        (pattern,) = topics
        robots = self._numbered(pattern)
        if not robots and tuple(topics) == TOPICS and len(self.topics) == 1 and self._is_shared(self.topics[0]):
            return self._named(self.topics), [
                f"the poses are those of {self.topics[0]}, because there is no topic {pattern}"
            ]
        if not robots:
            self._require(pattern.partition(":")[0].replace("{}", "0"))
        numbers = [int(robot.label) for robot in robots]
        missing = sorted(set(range(min(numbers, default=0), max(numbers, default=0))) - set(numbers))
        if not missing:
            return robots, []
        return robots, [f"the robots' numbers are {few_of(numbers)}; there is no robot {few_of(missing)} in the log"]

    def _numbered(self, pattern: str) -> list[Robot]:
        """Return the robots whose names match a pattern, in the order of their numbers."""
        topic, _, part = pattern.partition(":")
        names = list(self._bags.kinds)
        if part:
            self._require(topic)
            names = [f"{topic}:{part}" for part in self._parts(topic)]
        begin, end = pattern.split("{}")
        number = re.compile(re.escape(begin) + r"(\d+)" + re.escape(end))
        matches = sorted((int(match[1]), match[1], name) for name in names if (match := number.fullmatch(name)))
        for *_, matched in matches:
            self._require(matched.partition(":")[0])
        return [Robot(label, matched, None) for _, label, matched in matches]

    def _named(self, names: Sequence[str]) -> list[Robot]:
        """Return the robots of some names in their order."""
        robots: list[Robot] = []
        for name in names:
            topic, _, part = name.partition(":")
            self._require(topic)
            bags = self._bags.holders(topic)
            if self._is_shared(topic) and not part:
                robots += [Robot("", f"{topic}:{own}", None) for own in self._bodies(topic)]
            elif len(names) == 1 and len(bags) > 1 and not part:
                robots += [Robot("", topic, bag) for bag in bags]
            else:
                robots.append(Robot("", name, None))
        begin = re.escape(TOPICS[0].partition("{}")[0])
        labels = [match[1] for robot in robots if (match := re.fullmatch(rf"{begin}(\d+)/.*", robot.name))]
        if len(set(labels)) < len(robots):
            labels = [re.sub(r"\D*(\d+).*", r"\1", robot.name.partition(":")[2]) for robot in robots]
        if len(set(labels)) < len(robots) or not all(label.isdigit() for label in labels):
            labels = [str(k) for k in range(len(robots))]
        robots = [robot._replace(label=label) for robot, label in zip(robots, labels, strict=True)]
        by_number = len(names) == 1 and all(":" in robot.name for robot in robots)
        return sorted(robots, key=lambda robot: int(robot.label)) if by_number else robots

    def _bodies(self, topic: str) -> list[str]:
        """Return the robots of a shared topic: frames that differ in a number alone, or the places in an array.

        Raises:
            ValueError: there are none, or frames of several kinds.
        """
        parts = list(self._parts(topic))
        if TRANSFORMS not in self._bags.kinds[topic]:
            return parts
        patterns: dict[str, list[str]] = {}
        for part in parts:
            if re.search(r"\d", part):
                patterns.setdefault(re.sub(r"\d+", "{}", part, count=1), []).append(part)
        likely = [pattern for pattern in patterns if pattern.endswith(_BODIES)] or list(patterns)
        if len(likely) != 1:
            got = few_of(likely) or few_of(parts) or "none"
            rule = f"topics must name the robots' frames in {topic}, such as {topic}:robot_{{}}/base_link"
            raise ValueError(f"{rule}, because its frames are {got}")
        return patterns[likely[0]]

    def _is_shared(self, topic: str) -> bool:
        """Return whether the messages of a topic have the poses of several robots."""
        return bool(self._bags.kinds[topic] & {TRANSFORMS, ARRAY})

    def _require(self, topic: str) -> None:
        if topic not in self._bags.kinds:
            rule = f"topics must be topics of poses in {self._log}, which has {few_of(self.topics) or 'none'}"
            raise ValueError(f"{rule}, got {topic}{nearest(topic, self.topics)}")
        if not self._bags.kinds[topic] & set(KINDS):
            got = few_of(sorted(self._bags.kinds[topic]))
            raise ValueError(f"topic {topic} of {self._log} must be of type {', '.join(KINDS)}, got {got}")

    def _parts(self, topic: str) -> dict[str, Poses]:
        """Return the poses of a topic by their parts; a topic of one robot has the part ""."""
        if topic not in self._read:
            kinds = self._bags.kinds[topic]
            read = _transforms if TRANSFORMS in kinds else _arrays if ARRAY in kinds else _singles
            self._read[topic] = read(self._bags, topic)
        return self._read[topic]


def _singles(bags: Bags, topic: str) -> dict[str, Poses]:
    rows = _Rows()
    for message in bags.of(topic, tuple(SINGLE)):
        content, of_speed = message.content, ()
        if message.kind == ODOMETRY:
            of_speed = content.twist.twist.linear.x, content.twist.covariance[0] != -1
        rows.add(message, content.header, *SINGLE[message.kind](content), *of_speed)
    return {"": rows.poses()}


def _arrays(bags: Bags, topic: str) -> dict[str, Poses]:
    places: list[_Rows] = []
    for message in bags.of(topic, (ARRAY,)):
        poses = message.content.poses
        if places and len(poses) != len(places):
            words = f"must have as many poses in every message, got {len(places)} and {len(poses)}"
            raise ValueError(f"topic {topic} {words} at {message.logged:.3f} s")
        places = places or [_Rows() for _ in poses]
        for rows, pose in zip(places, poses, strict=True):
            rows.add(message, message.content.header, pose.position, pose.orientation)
    return {str(k): rows.poses() for k, rows in enumerate(places)}


def _transforms(bags: Bags, topic: str) -> dict[str, Poses]:
    edges: dict[str, _Rows] = {}
    for name in (topic, f"{topic}_static"):
        for message in bags.of(name, (TRANSFORMS,)):
            for edge in message.content.transforms:
                rows = edges.setdefault(edge.child_frame_id.strip("/"), _Rows())
                rows.add(message, edge.header, edge.transform.translation, edge.transform.rotation)
    frames = {child: rows.poses() for child, rows in edges.items()}
    return {child: _in_root(child, frames) for child in frames}


def _in_root(child: str, edges: dict[str, Poses]) -> Poses:
    """Return the poses of a frame in the root of the tree of frames, in the plane and in height."""
    own, above = edges[child], {child}
    while len(set(own.frame)) == 1 and (parent := own.frame[0]) in edges.keys() - above:
        above.add(parent)
        outer = edges[parent]
        order = np.argsort(outer.stamp, kind="stable")
        latest = order[np.maximum(np.searchsorted(outer.stamp[order], own.stamp, side="right") - 1, 0)]
        (x, y, z, turn, _), pose = outer.pose[latest].T, own.pose.copy()
        pose[:, 0] = x + np.cos(turn) * own.pose[:, 0] - np.sin(turn) * own.pose[:, 1]
        pose[:, 1] = y + np.sin(turn) * own.pose[:, 0] + np.cos(turn) * own.pose[:, 1]
        pose[:, 2], pose[:, 3] = z + pose[:, 2], turn + pose[:, 3]
        own = own._replace(pose=pose, frame=outer.frame[latest])
    return own
