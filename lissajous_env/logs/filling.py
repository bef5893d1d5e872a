"""Fields of messages of ROS, filled alike whichever library made the messages."""

import math
from typing import Any

Place = tuple[float, float, float, float]
"""x, y, z [m] and heading [rad]."""


def set_stamp(header: Any, time: float, frame: str) -> None:
    """Write a time [s] and a frame into a header."""
    header.stamp.sec, header.stamp.nanosec = divmod(round(time * 1e9), 10**9)
    header.frame_id = frame


def seconds(stamp: Any) -> float:
    """Return a time stamp in seconds."""
    return (stamp.sec * 10**9 + stamp.nanosec) / 1e9


def set_pose(pose: Any, place: Place) -> None:
    """Write a place into a pose."""
    pose.position.x, pose.position.y, pose.position.z, heading = place
    pose.orientation.z, pose.orientation.w = math.sin(heading / 2), math.cos(heading / 2)


def set_odometry(message: Any, time: float, frames: tuple[str, str], place: Place, speed: float) -> None:
    """Write the place and the speed [m/s] of a robot into a nav_msgs/Odometry.

    The frames are those of the place and of the robot.
    """
    set_stamp(message.header, time, frames[0])
    message.child_frame_id = frames[1]
    set_pose(message.pose.pose, place)
    message.twist.twist.linear.x = speed
