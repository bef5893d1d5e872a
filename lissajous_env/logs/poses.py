"""Poses of robots in messages: which messages have any, of which robots, and in which frame.

A robot is named by its topic, or by a topic and a part of it, "/tf:car_2" for the frame car_2 or "/poses:2" for the
third pose of an array.
"""

import math
import re
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from lissajous_env.logs.clocks import Recorded
from lissajous_env.logs.messages import Bags, Message
from lissajous_env.wording import few_of

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
_STATIC = "_static"
_BODIES = ("base_link", "base_footprint")
_UNIT = 0.01
"""Difference from 1 up to which the square of a quaternion's length is rounded."""


class RobotPoses(NamedTuple):
    """Poses of a robot in the messages of a log."""

    recorded: Recorded
    """Its poses, without those that are not finite."""
    frames: frozenset[str]
    """Names of the frames that they are in."""
    broken: int
    """Number of poses that are not finite."""
    turned: int
    """Number of orientations that are not of length 1."""
    unmeasured: int = 0
    """Number of speeds that are no measurements, with a first covariance of -1."""


class PoseRows:
    """Poses that are being collected."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, ...]] = []
        self._frames: set[str] = set()
        self._broken = self._turned = 0

    def add(self, message: Message, header: Any, place: Any, turn: Any, speed: float = math.nan) -> None:
        """Add a pose."""
        self._frames.add(header.frame_id.strip("/"))
        heading, length = heading_of(turn.x, turn.y, turn.z, turn.w)
        if not all(map(math.isfinite, (place.x, place.y, place.z, length))):
            self._broken += 1
            return
        self._turned += abs(length - 1) > _UNIT
        stamp = header.stamp.sec + header.stamp.nanosec / 1e9
        self._rows.append((message.bag, message.logged, stamp, place.x, place.y, place.z, heading, speed))

    def poses(self) -> RobotPoses:
        """Return the poses so far."""
        rows = np.array(self._rows, dtype=float).reshape(-1, 8)
        recorded = Recorded(rows[:, 0].astype(int), rows[:, 1], rows[:, 2], rows[:, 3:])
        return RobotPoses(recorded, frozenset(self._frames), self._broken, self._turned)


def heading_of(x: float, y: float, z: float, w: float) -> tuple[float, float]:
    """Return the heading of a quaternion of any length [rad], NaN for one of length 0, and the square of its length."""
    length = x * x + y * y + z * z + w * w
    if not length > 1e-12:
        return math.nan, length
    return math.atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z), length


class Poses:
    """The poses in the files of a log, each topic of which is read once."""

    def __init__(self, bags: Bags):
        self._bags = bags
        self._shared: dict[str, dict[str, RobotPoses]] = {}

    @property
    def topics(self) -> list[str]:
        """Topics with poses."""
        return sorted(topic for topic, kinds in self._bags.kinds.items() if kinds & set(KINDS))

    def is_shared(self, topic: str) -> bool:
        """Return whether the messages of a topic have the poses of several robots."""
        return bool(self._bags.kinds.get(topic, set()) & {TRANSFORMS, ARRAY})

    def parts(self, topic: str) -> list[str]:
        """Return the robots of a shared topic: frames that differ in a number alone, or the places in an array.

        Raises:
            ValueError: there are none, or frames of several kinds.
        """
        parts = self._of_topic(topic)
        if TRANSFORMS not in self._bags.kinds[topic]:
            return list(parts)
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

    def frames(self, topic: str) -> list[str]:
        """Return the names of all parts of a shared topic."""
        return list(self._of_topic(topic))

    def of(self, topic: str, part: str | None, bag: int | None = None) -> RobotPoses | None:
        """Return the poses of a robot, of one file alone if it is given; None if there are none."""
        if part is not None:
            return self._of_topic(topic).get(part)
        rows, unmeasured = PoseRows(), 0
        for message in self._bags.of(topic, tuple(SINGLE)):
            if bag is None or message.bag == bag:
                content = message.content
                speed = math.nan
                if message.kind == ODOMETRY:
                    speed = content.twist.twist.linear.x
                    unmeasured += content.twist.covariance[0] == -1
                rows.add(message, content.header, *SINGLE[message.kind](content), speed)
        return rows.poses()._replace(unmeasured=int(unmeasured))

    def _of_topic(self, topic: str) -> dict[str, RobotPoses]:
        if topic not in self._shared:
            kinds = self._bags.kinds.get(topic, set())
            self._shared[topic] = self._transforms(topic) if TRANSFORMS in kinds else self._array(topic)
        return self._shared[topic]

    def _array(self, topic: str) -> dict[str, RobotPoses]:
        places: list[PoseRows] = []
        for message in self._bags.of(topic, (ARRAY,)):
            poses = message.content.poses
            if places and len(poses) != len(places):
                words = f"must have as many poses in every message, got {len(places)} and {len(poses)}"
                raise ValueError(f"topic {topic} {words} at {message.logged:.3f} s")
            places = places or [PoseRows() for _ in poses]
            for rows, pose in zip(places, poses, strict=True):
                rows.add(message, message.content.header, pose.position, pose.orientation)
        return {str(k): rows.poses() for k, rows in enumerate(places)}

    def _transforms(self, topic: str) -> dict[str, RobotPoses]:
        edges: dict[str, PoseRows] = {}
        for message in self._both(topic):
            for edge in message.content.transforms:
                child = edge.child_frame_id.strip("/")
                rows = edges.setdefault(child, PoseRows())
                rows.add(message, edge.header, edge.transform.translation, edge.transform.rotation)
        frames = {child: rows.poses() for child, rows in edges.items()}
        return {child: _in_root(child, frames) for child in frames}

    def _both(self, topic: str) -> Iterator[Message]:
        for name in (topic, topic + _STATIC):
            if name in self._bags.kinds:
                yield from self._bags.of(name, (TRANSFORMS,))


def _in_root(child: str, edges: dict[str, RobotPoses]) -> RobotPoses:
    """Return the poses of a frame in the root of the tree of frames, in the plane and in height."""
    own, above = edges[child], {child} | {frame for frame, edge in edges.items() if not len(edge.recorded.stamp)}
    while len(own.frames) == 1 and (parent := next(iter(own.frames))) in edges.keys() - above:
        above.add(parent)
        outer, pose = edges[parent], own.recorded.pose.copy()
        order = np.argsort(outer.recorded.stamp, kind="stable")
        latest = np.searchsorted(outer.recorded.stamp[order], own.recorded.stamp, side="right") - 1
        x, y, z, turn, _ = outer.recorded.pose[order[np.maximum(latest, 0)]].T
        pose[:, 0] = x + np.cos(turn) * own.recorded.pose[:, 0] - np.sin(turn) * own.recorded.pose[:, 1]
        pose[:, 1] = y + np.sin(turn) * own.recorded.pose[:, 0] + np.cos(turn) * own.recorded.pose[:, 1]
        pose[:, 2], pose[:, 3] = z + pose[:, 2], turn + pose[:, 3]
        own = own._replace(recorded=own.recorded._replace(pose=pose), frames=outer.frames)
    return own
