"""Poses, commands, phases and statuses in the messages of a log."""

import dataclasses
import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from lissajous_env.logs.bags import Bags, Decoder, Sample, Samples
from lissajous_env.logs.commands import COMMAND_NAMES
from lissajous_env.wording import few_of, nearest, require
from lissajous_env.world.state import FAILED, REMOVED, WORKING

TRANSFORMS, ARRAY = "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/PoseArray"
_UNIT = 0.01
"""Difference from 1 up to which the square of a quaternion's length counts as rounded."""


def poses_of(bags: Bags, topic: str) -> dict[str, Samples]:
    """Return the poses of a topic by part: x, y, z [m], heading [rad], and speed [m/s]; that of one robot is "".

    Unknown headings and speeds are NaN. Poses in frames that have parents in the same topic are those in the root of
    the tree, in the plane and in height.

    Raises:
        ValueError: there is no such topic, its messages are no poses, or an array has another number of poses than the
            first one.
    """
    if topic in bags.poses:
        return bags.poses[topic]
    kinds = bags.kinds.get(topic)
    if kinds is None:
        topics = sorted(topic for topic, kinds in bags.kinds.items() if kinds & POSES.keys())
        rule = f"topics must be topics of poses in {bags.name}, which has {few_of(topics) or 'none'}"
        raise ValueError(f"{rule}, got {topic}{nearest(topic, topics)}")
    require(kinds & POSES.keys(), f"topic {topic} of {bags.name}", f"must be of type {', '.join(POSES)}", sorted(kinds))
    samples = bags.samples(topic, POSES)
    if TRANSFORMS in kinds:  # transforms that never change have a topic of their own
        samples = bags.samples(f"{topic}_static", POSES) | samples
    counts = sorted({len(own) for own in samples.values()})
    if ARRAY in kinds and len(counts) > 1:
        got = f"{len(samples)} in {counts[0]} and fewer in {counts[-1] - counts[0]}"
        raise ValueError(f"topic {topic} must have as many poses in every message, got {got}")
    poses = {}
    for part, whole in samples.items():
        own = bags.finite(topic, whole, 7)
        heading, square = heading_of(*own.values[:, 3:7].T)
        if (odd := int((np.abs(square - 1) > _UNIT).sum())) and not np.isnan(heading).all():  # else `Motion.remarks`
            bags.remark(topic, "accepted with quaternions that are not of length 1", odd)
        poses[part] = dataclasses.replace(own, values=np.column_stack([own.values[:, :3], heading, own.values[:, 7:]]))
    bags.poses[topic] = {part: _in_root(part, poses) for part in poses} if TRANSFORMS in kinds else poses
    return bags.poses[topic]


def heading_of(x: Any, y: Any, z: Any, w: Any) -> tuple[Any, Any]:
    """Return the headings of quaternions of any length [rad], NaN for length 0, and the squares of their lengths."""
    square = x * x + y * y + z * z + w * w
    heading = np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return np.where(square > 1e-12, heading, math.nan), square


def moved(place: np.ndarray, origin: Iterable[Any]) -> np.ndarray:
    """Return places (..., 2) of a frame in another frame, in which its `origin` is x, y [m] and heading [rad]."""
    x, y, turn = origin
    cos, sin = np.cos(turn), np.sin(turn)
    return np.stack([x + cos * place[..., 0] - sin * place[..., 1], y + sin * place[..., 0] + cos * place[..., 1]], -1)


def relative(place: np.ndarray, origin: tuple[float, float, float]) -> np.ndarray:
    """Return places (..., 2) in the frame whose `origin` is x, y [m] and heading [rad]: the inverse of `moved`."""
    return moved(place - np.array(origin[:2]), (0.0, 0.0, -origin[2]))


def _in_root(child: str, samples: dict[str, Samples]) -> Samples:
    """Return the poses of a frame in the root of the tree of frames, in the plane and in height."""
    own, above = samples[child], {child}
    while len(set(own.frame)) == 1 and (parent := own.frame[0]) in samples.keys() - above:
        above.add(parent)
        outer = samples[parent].in_order()
        outer = outer.take(np.maximum(np.searchsorted(outer.stamp, own.stamp, side="right") - 1, 0))
        values = own.values + outer.values * (0, 0, 1, 1, 0)
        values[:, :2] = moved(own.values[:, :2], outer.values[:, [0, 1, 3]].T)
        own = dataclasses.replace(own, values=values, frame=outer.frame)
    return own


def _pose(header: Any, place: Any, turn: Any, part: str = "", speed: float = math.nan) -> Sample:
    """Return the sample of a pose: x, y, z, a quaternion, and a speed."""
    return part, header, (), [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w, speed]


def _joints(message: Any) -> list[Sample]:
    """Return the positions of joints in the order of their names."""
    names = list(message.name)
    if not len(message.position) == len(names) == len(set(names)):
        raise ValueError("not one position for each name")
    order = sorted(range(len(names)), key=lambda k: names[k])
    return [("", message.header, tuple(names[k] for k in order), [message.position[k] for k in order])]


def _twist(twist: Any, header: Any = None) -> list[Sample]:
    return [("", header, COMMAND_NAMES["differential"], [twist.linear.x, twist.angular.z])]


def _status(message: Any) -> list[Sample]:
    if message.data not in (WORKING, FAILED, REMOVED):
        raise ValueError(f"unknown status {message.data}")
    return [("", None, (), [message.data])]


POSES: dict[str, Decoder] = {
    "nav_msgs/msg/Odometry": lambda m: [
        _pose(m.header, m.pose.pose.position, m.pose.pose.orientation, speed=m.twist.twist.linear.x)
    ],
    "geometry_msgs/msg/PoseStamped": lambda m: [_pose(m.header, m.pose.position, m.pose.orientation)],
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda m: [
        _pose(m.header, m.pose.pose.position, m.pose.pose.orientation)
    ],
    "geometry_msgs/msg/TransformStamped": lambda m: [_pose(m.header, m.transform.translation, m.transform.rotation)],
    TRANSFORMS: lambda m: [
        _pose(edge.header, edge.transform.translation, edge.transform.rotation, edge.child_frame_id.strip("/"))
        for edge in m.transforms
    ],
    ARRAY: lambda m: [_pose(m.header, pose.position, pose.orientation, str(k)) for k, pose in enumerate(m.poses)],
}
COMMANDS: dict[str, Decoder] = {
    "sensor_msgs/msg/JointState": _joints,
    "std_msgs/msg/Float64MultiArray": lambda m: [("", None, (), m.data)],
    "geometry_msgs/msg/Twist": _twist,
    "geometry_msgs/msg/TwistStamped": lambda m: _twist(m.twist, m.header),
}
PHASES: dict[str, Decoder] = {"std_msgs/msg/Float64": lambda m: [("", None, (), [m.data])]}
STATUSES: dict[str, Decoder] = {"std_msgs/msg/UInt8": _status}
TEXTS: dict[str, Decoder] = {"std_msgs/msg/String": lambda m: [("", None, (), [m.data])]}
