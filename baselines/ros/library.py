"""The libraries and standard messages of ROS 2: the one file that imports them.

They are those of an installed distribution or of the extra `ros`. Import this module only where a node is made.

Raises:
    MissingExtraError: the libraries are not installed.
"""

# pyright: reportMissingImports=false

from typing import Any

from lissajous_env.extras import missing

try:
    import rclpy
    from builtin_interfaces.msg import Time
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
    from geometry_msgs.msg import Point, PoseStamped, Twist, TwistStamped
    from nav_msgs.msg import Odometry
    from rcl_interfaces.msg import ParameterDescriptor
    from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
    from rclpy.qos_overriding_options import QoSOverridingOptions
    from rclpy.signals import SignalHandlerOptions
    from rosgraph_msgs.msg import Clock
    from sensor_msgs.msg import JointState, PointCloud2, PointField
    from std_msgs.msg import ColorRGBA, Float32, Float64, UInt8
    from std_srvs.srv import Trigger
    from visualization_msgs.msg import Marker, MarkerArray
except ImportError as error:
    raise missing("a node of ROS 2", "ros", error) from error

__all__ = [
    "Clock",
    "ColorRGBA",
    "DiagnosticArray",
    "DiagnosticStatus",
    "Float32",
    "Float64",
    "InvalidParameterTypeException",
    "InvalidParameterValueException",
    "JointState",
    "KeyValue",
    "Marker",
    "MarkerArray",
    "Node",
    "Odometry",
    "ParameterDescriptor",
    "Point",
    "PointCloud2",
    "PointField",
    "PoseStamped",
    "QoSOverridingOptions",
    "Time",
    "Trigger",
    "Twist",
    "TwistStamped",
    "UInt8",
    "lasting",
    "latest",
    "make_executor",
    "rclpy",
    "reliable",
    "start_ros",
]


def make_executor() -> Any:
    """Return an executor of one thread: the one that waits for events, which costs a quarter, where there is one."""
    try:
        from rclpy.experimental.events_executor import EventsExecutor

        return EventsExecutor()
    except (ImportError, OSError):  # before Kilted, or where stderr is no file, as in notebooks
        return SingleThreadedExecutor()


def latest() -> Any:
    """Return the quality of service with which measurements are received: the latest one, without repetitions."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def reliable(depth: int = 10) -> Any:
    """Return the quality of service of everything that is sent, which receivers of every kind can have."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=ReliabilityPolicy.RELIABLE)


def lasting() -> Any:
    """Return the quality of service of states: a node that joins later receives the latest one."""
    kept = DurabilityPolicy.TRANSIENT_LOCAL
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=kept)


def start_ros() -> None:
    """Start ROS 2 with the arguments that follow `--ros-args`; Ctrl-C then interrupts the process as usual.

    Raises:
        ValueError: the arguments that follow `--ros-args` are not of ROS 2.
    """
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # a class of the C library
        raise ValueError(f"arguments after --ros-args must be of ROS 2, got: {error}") from error
