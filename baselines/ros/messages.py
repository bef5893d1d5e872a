"""Messages of ROS 2: the input and output of `Onboard`, diagnostics."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from baselines.onboard import Command, Message, Odometry, Onboard, Twist
from baselines.ros import library as ros
from lissajous_env.logs.messages import seconds, set_odometry, set_pose, set_stamp
from lissajous_env.logs.samples import heading_of

RING = ("cos_phase", "sin_phase", "x", "y")
"""Names in a message to the ring neighbours, before `number_0`, `number_1` ... of the policy."""


def yaw(orientation: Any) -> float:
    """Return the heading of a quaternion [rad]; NaN if its length is not 1."""
    heading, square = heading_of(orientation.x, orientation.y, orientation.z, orientation.w)
    return heading if abs(square - 1) < 0.01 else math.nan


def odometry_message(odometry: Odometry, frame: str, child: str) -> Any:
    """Return a pose and speed as nav_msgs/Odometry."""
    message, (x, y, heading, speed, stamp) = ros.Odometry(), odometry
    set_odometry(message, stamp, (frame, child), (x, y, 0.0, heading), speed)
    return message


def pose_message(odometry: Odometry, frame: str) -> Any:
    """Return a pose as geometry_msgs/PoseStamped."""
    message = ros.PoseStamped()
    set_stamp(message.header, odometry.stamp, frame)
    set_pose(message.pose, (odometry.x, odometry.y, 0.0, odometry.heading))
    return message


def named_numbers(names: Sequence[str], numbers: Sequence[float], time: float, frame: str = "") -> Any:
    """Return numbers with names and a time [s] as sensor_msgs/JointState."""
    message = ros.JointState(name=list(names), position=[float(number) for number in numbers])
    set_stamp(message.header, time, frame)
    return message


def ring_message(message: Message, frame: str) -> Any:
    """Return a message to the ring neighbours as sensor_msgs/JointState."""
    names = (*RING, *(f"number_{k}" for k in range(len(message.numbers))))
    return named_numbers(names, (*message[2:6], *message.numbers), message.sent_at, frame)


def heard(message: Any, sender: int) -> Message | None:
    """Return what was received of a robot; None if it is not a message to ring neighbours."""
    values = list(message.position)
    if tuple(message.name[:4]) != RING or len(values) != len(message.name):
        return None
    return Message(sender, seconds(message.header.stamp), *values[:4], numbers=tuple(values[4:]))


def command_messages(command: Command | Twist, kind: str, steering_max: float, time: float, frame: str) -> list[Any]:
    """Return the messages of a command at a time [s], one for each topic of its kind.

    Args:
        command: The command.
        kind: One of those in `baselines.ros.settings.COMMANDS`.
        steering_max: Largest steering angle [rad].
        time: Time [s].
        frame: Frame of the robot.
    """
    if isinstance(command, Twist):
        message = ros.Twist() if kind == "twist" else ros.TwistStamped()
        twist = message if kind == "twist" else message.twist
        twist.linear.x, twist.angular.z = command.speed, command.yaw_rate
        if kind == "twist_stamped":
            set_stamp(message.header, time, frame)
        return [message]
    if kind == "car":
        return [named_numbers(command._fields, command, time)]
    return [ros.Float32(data=command.steering / steering_max), ros.Float32(data=command.throttle)]


def cloud_message(rows: np.ndarray, time: float, frame: str) -> Any:
    """Return places (K, 2), or places and velocities (K, 4), as sensor_msgs/PointCloud2."""
    names = ("x", "y", "z", "vx", "vy")[: 3 if rows.shape[1] == 2 else 5]
    points = np.zeros((len(rows), len(names)), dtype="<f4")
    points[:, :2], points[:, 3:] = rows[:, :2], rows[:, 2:]
    message = ros.PointCloud2(height=1, width=len(rows), point_step=4 * len(names), row_step=points.nbytes)
    set_stamp(message.header, time, frame)
    for k, name in enumerate(names):
        message.fields.append(ros.PointField(name=name, offset=4 * k, datatype=ros.PointField.FLOAT32, count=1))
    message.is_dense, message.data = True, points.tobytes()
    return message


def cloud_rows(message: Any, width: int) -> np.ndarray:
    """Return the rows (K, width) of a point cloud: x, y [m] and, if requested and present, vx, vy [m/s].

    Raises:
        ValueError: the cloud has no x and y as 32-bit floats, or its data is shorter than its points.
    """
    offsets = {field.name: field.offset for field in message.fields if field.datatype == ros.PointField.FLOAT32}
    if not {"x", "y"} <= offsets.keys():
        raise ValueError(f"a point cloud must have x and y as FLOAT32, got {[field.name for field in message.fields]}")
    columns = {name: k for k, name in enumerate(("x", "y", "vx", "vy")[:width]) if name in offsets}
    point: Any = {"names": [*columns], "formats": [">f4" if message.is_bigendian else "<f4"] * len(columns)}
    point |= {"offsets": [offsets[name] for name in columns], "itemsize": message.point_step}
    shape, row_step = (message.height, message.width), max(message.row_step, message.width * message.point_step)
    try:
        points = np.ndarray(shape, np.dtype(point), bytes(message.data), strides=(row_step, message.point_step)).ravel()
    except (ValueError, OverflowError) as error:  # NumPy compares the sizes before it allocates
        raise ValueError(f"a point cloud must have room and data for the fields of its points: {error}") from error
    rows = np.zeros((len(points), width), dtype=np.float32)
    for name, k in columns.items():
        rows[:, k] = points[name]
    return rows


def diagnostics(name: str, onboard: Onboard, reason: str, values: dict[str, Any], time: float) -> Any:
    """Return the state of a robot: OK while it drives, a warning with the reason where it is stopped."""
    level = ros.DiagnosticStatus.WARN if reason else ros.DiagnosticStatus.OK
    status = ros.DiagnosticStatus(level=level, name=f"lissajous: {name}", message=reason or "drives", hardware_id=name)
    for key, value in ({"robot": onboard.robot, "scenario": onboard.scenario.name} | values).items():
        status.values.append(ros.KeyValue(key=key, value=f"{value:.4g}" if isinstance(value, float) else str(value)))
    message = ros.DiagnosticArray(status=[status])
    set_stamp(message.header, time, "")
    return message
