"""Poses of robots in messages, as tables, and which of them are of the robots that a user names.

The poses of a robot have the name of their topic, or of a topic and a part of it: "/tf:car_2" for the frame car_2,
"/poses:2" for the third pose of an array.
"""

import math
import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from lissajous_env.logs.filling import seconds
from lissajous_env.logs.messages import Bags
from lissajous_env.wording import few_of, nearest

TOPICS = ("/robot_{}/odom",)
"""Topics of poses by default."""
ODOMETRY, TRANSFORMS, ARRAY = "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/PoseArray"
PARTS: dict[str, Callable[[Any], list[tuple[str, Any, Any, Any]]]] = {
    ODOMETRY: lambda m: [("", m.header, m.pose.pose.position, m.pose.pose.orientation)],
    "geometry_msgs/msg/PoseStamped": lambda m: [("", m.header, m.pose.position, m.pose.orientation)],
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda m: [
        ("", m.header, m.pose.pose.position, m.pose.pose.orientation)
    ],
    "geometry_msgs/msg/TransformStamped": lambda m: [("", m.header, m.transform.translation, m.transform.rotation)],
    TRANSFORMS: lambda m: [
        (edge.child_frame_id.strip("/"), edge.header, edge.transform.translation, edge.transform.rotation)
        for edge in m.transforms
    ],
    ARRAY: lambda m: [(str(k), m.header, pose.position, pose.orientation) for k, pose in enumerate(m.poses)],
}
"""Function that returns the poses in a message, by its type: the part, header, position and orientation of each."""
_BODIES = ("base_link", "base_footprint")

ROW = np.dtype([
    ("bag", int), ("logged", float), ("stamp", float), ("pose", float, 5), ("square", float), ("measured", bool),
    ("frame", object),
])  # fmt: skip
"""Row of a table of poses: number of the file, time of the recorder and stamp [s]; x, y, z [m], heading [rad] and speed
[m/s], NaN where there is none; square of the quaternion's length; False where the log says that the speed is no
measurement, by a first covariance of -1; name of the frame."""


class Robot(NamedTuple):
    """A robot of a log."""

    label: str
    """Its number in the names of the log."""
    name: str
    """Name of its poses."""
    bag: int | None
    """Number of the file with its poses; None for any."""


class Sources:
    """The poses in the files of a log, each topic of which is read once.

    Args:
        bags: The files.
        name: Name of the log.
    """

    def __init__(self, bags: Bags, name: str):
        self._bags, self._log = bags, name
        self.topics = sorted(topic for topic, kinds in bags.kinds.items() if kinds & set(PARTS))
        self._tables: dict[str, dict[str, np.ndarray]] = {}

    def of(self, robot: Robot) -> np.ndarray:
        """Return the poses of a robot, rows of `ROW`."""
        topic, _, part = robot.name.partition(":")
        poses = self._parts(topic).get(part, np.zeros(0, ROW))
        return poses if robot.bag is None else poses[poses["bag"] == robot.bag]

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
        if not any("{}" in topic for topic in topics):
            return self._named(topics), []
        pattern = topics[0]
        if len(topics) > 1 or pattern.count("{}") > 1 or "{" in pattern.replace("{}", ""):
            raise ValueError(f"topics must be names, or one name in which {{}} stands once for a number, got {topics}")
        robots = self._numbered(pattern)
        if not robots and tuple(topics) == TOPICS and len(self.topics) == 1 and self._is_shared(self.topics[0]):
            words = f"the poses are those of {self.topics[0]}, because there is no topic {pattern}"
            return self._named(self.topics), [words]
        if not robots:
            self._require(pattern.replace("{}", "0"))
        numbers = [int(robot.label) for robot in robots]
        missing = sorted(set(range(min(numbers, default=0), max(numbers, default=0))) - set(numbers))
        words = f"the robots' numbers are {few_of(numbers)}; there is no robot {few_of(missing)} in the log"
        return robots, [words] if missing else []

    def _numbered(self, pattern: str) -> list[Robot]:
        """Return the robots whose names match a pattern, in the order of their numbers."""
        topic, _, part = pattern.partition(":")
        names = list(self._bags.kinds)
        if part:
            self._require(topic)
            names = [f"{topic}:{part}" for part in self._parts(topic)]
        begin, end = pattern.split("{}")
        number = re.compile(re.escape(begin) + r"(\d+)" + re.escape(end))
        robots = [Robot(match[1], name, None) for name in names if (match := number.fullmatch(name))]
        for robot in robots:
            self._require(robot.name)
        return sorted(robots, key=lambda robot: int(robot.label))

    def _named(self, names: Sequence[str]) -> list[Robot]:
        """Return the robots of some names in their order, whose numbers are the first ones in their names."""
        sources: list[tuple[str, int | None]] = []
        for name in names:
            self._require(name)
            bags = self._bags.holders(name)
            if ":" not in name and self._is_shared(name):
                sources += [(f"{name}:{part}", None) for part in self._bodies(name)]
            elif ":" not in name and len(names) == 1 and len(bags) > 1:
                sources += [(name, bag) for bag in bags]
            else:
                sources.append((name, None))
        numbers = [_number_in(name.rpartition(":")[2]) for name, _ in sources]
        if "" in numbers or len(set(numbers)) < len(numbers):
            numbers = list(map(str, range(len(sources))))
        return [Robot(number, name, bag) for number, (name, bag) in zip(numbers, sources, strict=True)]

    def _bodies(self, topic: str) -> list[str]:
        """Return the robots of a shared topic: frames that differ in a number alone, or the places in an array.

        Raises:
            ValueError: there are none, or frames of several kinds.
        """
        parts = list(self._parts(topic))
        if TRANSFORMS not in self._bags.kinds[topic]:
            return parts
        patterns: dict[str, list[str]] = {}
        for part in filter(_number_in, parts):
            patterns.setdefault(part.replace(_number_in(part), "{}", 1), []).append(part)
        likely = [pattern for pattern in patterns if pattern.endswith(_BODIES)] or list(patterns)
        if len(likely) != 1:
            got = few_of(likely) or few_of(parts) or "none"
            rule = f"topics must name the robots' frames in {topic}, such as {topic}:robot_{{}}/base_link"
            raise ValueError(f"{rule}, because its frames are {got}")
        return sorted(patterns[likely[0]], key=lambda part: int(_number_in(part)))

    def _is_shared(self, topic: str) -> bool:
        """Return whether the messages of a topic have the poses of several robots."""
        return bool(self._bags.kinds[topic] & {TRANSFORMS, ARRAY})

    def _require(self, name: str) -> None:
        """Check that the topic of a name has poses."""
        topic = name.partition(":")[0]
        kinds = self._bags.kinds.get(topic)
        if kinds is None:
            rule = f"topics must be topics of poses in {self._log}, which has {few_of(self.topics) or 'none'}"
            raise ValueError(f"{rule}, got {topic}{nearest(topic, self.topics)}")
        if not kinds & set(PARTS):
            got = few_of(sorted(kinds))
            raise ValueError(f"topic {topic} of {self._log} must be of type {', '.join(PARTS)}, got {got}")

    def _parts(self, topic: str) -> dict[str, np.ndarray]:
        """Return the poses of a topic by their parts; a topic of one robot has the part ""."""
        if topic not in self._tables:
            self._tables[topic] = self._read(topic)
        return self._tables[topic]

    def _read(self, topic: str) -> dict[str, np.ndarray]:
        rows: dict[str, list[tuple]] = {}
        for name in (topic, f"{topic}_static"):  # transforms that never change have a topic of their own
            for message in self._bags.of(name, tuple(PARTS)):
                speed, measured = math.nan, True
                if message.kind == ODOMETRY:
                    twist = message.content.twist
                    speed, measured = twist.twist.linear.x, twist.covariance[0] != -1
                for part, header, place, turn in PARTS[message.kind](message.content):
                    heading, square = heading_of(turn.x, turn.y, turn.z, turn.w)
                    pose = place.x, place.y, place.z, heading, speed
                    about = square, measured, header.frame_id.strip("/")
                    rows.setdefault(part, []).append((message.bag, message.logged, seconds(header.stamp), pose, *about))
        tables = {part: np.array(values, ROW) for part, values in rows.items()}
        counts = sorted({len(table) for table in tables.values()})
        if ARRAY in self._bags.kinds[topic] and len(counts) > 1:
            got = f"{len(tables)} in {counts[0]} and fewer in {counts[-1] - counts[0]}"
            raise ValueError(f"topic {topic} of {self._log} must have as many poses in every message, got {got}")
        return {part: _in_root(part, tables) for part in tables} if TRANSFORMS in self._bags.kinds[topic] else tables


def heading_of(x: float, y: float, z: float, w: float) -> tuple[float, float]:
    """Return the heading of a quaternion of any length [rad], NaN for one of length 0, and the square of its length."""
    square = x * x + y * y + z * z + w * w
    if not square > 1e-12:
        return math.nan, square
    return math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z), square


def _number_in(name: str) -> str:
    """Return the first number in a name; "" if it has none."""
    match = re.search(r"\d+", name)
    return match[0] if match else ""


def _in_root(child: str, tables: dict[str, np.ndarray]) -> np.ndarray:
    """Return the poses of a frame in the root of the tree of frames, in the plane and in height."""
    own, above = tables[child].copy(), {child}
    while len(set(own["frame"])) == 1 and (parent := own["frame"][0]) in tables.keys() - above:
        above.add(parent)
        outer = tables[parent][np.argsort(tables[parent]["stamp"], kind="stable")]
        outer = outer[np.maximum(np.searchsorted(outer["stamp"], own["stamp"], side="right") - 1, 0)]
        x, y, _, turn, _ = outer["pose"].T
        place, own["pose"] = own["pose"].copy(), own["pose"] + outer["pose"] * (0, 0, 1, 1, 0)
        own["pose"][:, 0] = x + np.cos(turn) * place[:, 0] - np.sin(turn) * place[:, 1]
        own["pose"][:, 1] = y + np.sin(turn) * place[:, 0] + np.cos(turn) * place[:, 1]
        own["frame"] = outer["frame"]
    return own
