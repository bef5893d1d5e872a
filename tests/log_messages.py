"""Logs as other tools write them, for tests: five robots on circles, in messages of any type, clock and order."""

import math

import numpy as np
import pytest

pytest.importorskip("rosbags")

from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

from lissajous_env.logs.messages import rosbags, type_store

STORE = type_store()
KINDS = STORE.types
EPOCH = 1.7e9
"""A time of the epoch [s]."""
CENTRES = ((-1.2, -0.4), (-0.6, 0.4), (0.0, -0.4), (0.6, 0.4), (1.2, -0.4))
RADIUS, SPEED = 0.2, 0.5


def circle(k, t):
    """x, y [m] and heading [rad] of a robot on its circle."""
    angle = SPEED / RADIUS * t + k
    x, y = CENTRES[k]
    return x + RADIUS * math.cos(angle), y + RADIUS * math.sin(angle), angle + math.pi / 2


def header(t, frame="map"):
    whole = round(t * 1e9)
    return KINDS["std_msgs/msg/Header"](KINDS["builtin_interfaces/msg/Time"](whole // 10**9, whole % 10**9), frame)


def turn(yaw, length=1.0):
    return KINDS["geometry_msgs/msg/Quaternion"](0.0, 0.0, length * math.sin(yaw / 2), length * math.cos(yaw / 2))


def pose(x, y, yaw, z=0.0, length=1.0):
    return KINDS["geometry_msgs/msg/Pose"](KINDS["geometry_msgs/msg/Point"](x, y, z), turn(yaw, length))


def odometry(t, x, y, yaw, speed=SPEED, frame="map", z=0.0, length=1.0):
    vector, zeros = KINDS["geometry_msgs/msg/Vector3"], np.zeros(36)
    twist = KINDS["geometry_msgs/msg/Twist"](vector(speed, 0.0, 0.0), vector(0.0, 0.0, 0.0))
    return KINDS["nav_msgs/msg/Odometry"](
        header(t, frame),
        "base_link",
        KINDS["geometry_msgs/msg/PoseWithCovariance"](pose(x, y, yaw, z, length), zeros),
        KINDS["geometry_msgs/msg/TwistWithCovariance"](twist, zeros),
    )


def stamped(t, x, y, yaw, z=0.0):
    return KINDS["geometry_msgs/msg/PoseStamped"](header(t), pose(x, y, yaw, z))


def transform(t, x, y, yaw, child, frame="map"):
    moved = KINDS["geometry_msgs/msg/Transform"](KINDS["geometry_msgs/msg/Vector3"](x, y, 0.0), turn(yaw))
    return KINDS["geometry_msgs/msg/TransformStamped"](header(t, frame), child, moved)


def transforms(*those):
    return KINDS["tf2_msgs/msg/TFMessage"](list(those))


def array(t, poses):
    return KINDS["geometry_msgs/msg/PoseArray"](header(t), [pose(*numbers) for numbers in poses])


def joints(t, names, numbers):
    return KINDS["sensor_msgs/msg/JointState"](header(t), list(names), np.array(numbers), np.zeros(0), np.zeros(0))


def plain(kind, value):
    """Return a message of std_msgs with one value."""
    return KINDS[f"std_msgs/msg/{kind}"](value)


def write(path, messages, stored=lambda topic, time, data: data, mode="NONE"):
    """Write (topic, message, time of the recorder [s]) in the order of these times; a further entry names a channel.

    `stored` returns the bytes that are written of a message, which a mode of rosbag2 may compress.
    """
    library, channels = rosbags(), {}
    writer = library.Writer(path, version=9, storage_plugin=library.StoragePlugin.MCAP)
    writer.set_compression(library.CompressionMode[mode], library.CompressionFormat.ZSTD)
    with writer:
        for topic, message, time, *part in sorted(messages, key=lambda record: record[2]):
            key = topic, message.__msgtype__, *part
            if key not in channels:
                depth = 1 + len(channels)  # another profile is another channel
                qos = [_quality(depth)]
                channels[key] = writer.add_connection(*key[:2], typestore=STORE, offered_qos_profiles=qos)
            data = STORE.serialize_cdr(message, message.__msgtype__)
            writer.write(channels[key], round(time * 1e9), stored(topic, time, data))
    return path


def _quality(depth):
    forever = QosTime(0, 0)
    return Qos(
        QosHistory.KEEP_LAST, depth, QosReliability.RELIABLE, QosDurability.VOLATILE, forever, forever,
        QosLiveliness.AUTOMATIC, forever, False,
    )  # fmt: skip


def moments(duration=20.0, period=0.1):
    return np.arange(round(duration / period) + 1) * period


def circles(make=odometry, topic="/robot_{}/odom", robots=range(5), times=None, begin=EPOCH):
    """Messages of the robots on their circles, whose stamps are the recorder's times."""
    times = moments() if times is None else times
    return [(topic.format(k), make(begin + t, *circle(k, t)), begin + t) for t in times for k in robots]
