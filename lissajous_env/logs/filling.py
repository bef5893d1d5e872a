"""Fields of messages of ROS, filled alike whichever library made the messages."""

import math
from collections.abc import Callable
from typing import Any

from lissajous_env.logs.markers import Place, Shape


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


def set_odometry(message: Any, time: float, frames: tuple[str, str], place: Place, twist: tuple[float, float]) -> None:
    """Write the place, the speed [m/s] and the yaw rate [rad/s] of a robot into a nav_msgs/Odometry.

    The frames are those of the place and of the robot.
    """
    set_stamp(message.header, time, frames[0])
    message.child_frame_id = frames[1]
    set_pose(message.pose.pose, place)
    message.twist.twist.linear.x, message.twist.twist.angular.z = twist


def set_marker(
    message: Any,
    point: Callable[[], Any],
    shape: Shape,
    time: float,
    frame: str,
    outside: Callable = lambda *pose: pose,
) -> None:
    """Write a shape into a visualization_msgs/Marker.

    Args:
        message: The marker.
        point: Function that makes a geometry_msgs/Point.
        shape: The shape.
        time: Time [s].
        frame: Frame of the marker.
        outside: Function from x, y [m] and heading [rad] of the scenario to those in the frame.
    """
    set_stamp(message.header, time, frame)
    message.ns, message.id, message.type, message.action = shape.space, shape.number, shape.kind, shape.action
    message.scale.x, message.scale.y, message.scale.z = shape.scale
    message.color.r, message.color.g, message.color.b, message.color.a = shape.colour
    x, y, z, heading = shape.place
    message.pose.orientation.w = 1.0
    if not shape.points:
        x, y, heading = outside(x, y, heading)
        set_pose(message.pose, (x, y, z, heading))
    for end in shape.points:
        corner = point()
        corner.x, corner.y, _ = outside(*end, 0.0)
        message.points.append(corner)
