"""Messages of ROS 2: blank ones, and functions that fill and read fields, for the classes of any library."""

import functools
import math
from typing import Any

import numpy as np

from lissajous_env.plugins import of_extra

Place = tuple[float, float, float, float]
"""x, y, z [m] and heading [rad]."""
rosbags = functools.partial(of_extra, "rosbags.rosbag2", "a log (.mcap)", "logs")
"""Function that returns the module that reads and writes logs."""


@functools.cache
def type_store() -> Any:
    """Return the message types of ROS 2 Humble, which later distributions have too."""
    rosbags()
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def blank(kind: str) -> Any:
    """Return a message of a type whose fields are zeros and empty, as those of ROS are at first."""
    _, fields = type_store().fielddefs[kind]
    return type_store().types[kind](**{name: _zero(*field) for name, field in fields})


def _zero(node: Any, about: Any) -> Any:
    """Return the first value of a field, by its kind and what it is about: a type, or a type and a size."""
    if node.name == "NAME":
        return blank(about)
    if node.name == "BASE":
        return {"string": "", "bool": False}.get(about[0], 0)
    (entry, of_entry), size = about
    return np.zeros(size, of_entry[0]) if entry.name == "BASE" and of_entry[0] != "string" else []


def set_stamp(header: Any, time: float, frame: str) -> None:
    """Write a time [s] and a frame into a header."""
    header.stamp.sec, header.stamp.nanosec = divmod(round(time * 1e9), 10**9)
    header.frame_id = frame


def seconds(stamp: Any) -> float:
    """Return a time stamp in seconds."""
    return (stamp.sec * 10**9 + stamp.nanosec) / 1e9


def set_pose(pose: Any, place: Place) -> None:
    """Write a place into a pose; a quaternion of zeros marks an unknown heading."""
    pose.position.x, pose.position.y, pose.position.z, heading = place
    turn = (math.sin(heading / 2), math.cos(heading / 2)) if math.isfinite(heading) else (0.0, 0.0)
    pose.orientation.z, pose.orientation.w = turn


def set_odometry(message: Any, time: float, frames: tuple[str, str], place: Place, speed: float) -> None:
    """Write the place and the speed [m/s] of a robot into a nav_msgs/Odometry.

    The frames are those of the place and of the robot.
    """
    set_stamp(message.header, time, frames[0])
    message.child_frame_id = frames[1]
    set_pose(message.pose.pose, place)
    message.twist.twist.linear.x = speed
