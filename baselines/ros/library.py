"""The libraries and standard messages of ROS 2: the one file that imports them.

They are those of an installed distribution or of the extra `ros`. Import this module only where a node is made.

Raises:
    MissingExtraError: the libraries are not installed.
"""

from importlib import import_module
from typing import Any

from lissajous_env.extras import missing


def _names(module: str, *names: str) -> list[Any]:
    """Return some names of a module; their types are those of whichever distribution is installed."""
    loaded = import_module(module)
    return [getattr(loaded, name) for name in names]


try:
    rclpy: Any = import_module("rclpy")
    (Time,) = _names("builtin_interfaces.msg", "Time")
    DiagnosticArray, DiagnosticStatus, KeyValue = _names(
        "diagnostic_msgs.msg", "DiagnosticArray", "DiagnosticStatus", "KeyValue"
    )
    Point, PoseStamped, Twist, TwistStamped = _names(
        "geometry_msgs.msg", "Point", "PoseStamped", "Twist", "TwistStamped"
    )
    (Odometry,) = _names("nav_msgs.msg", "Odometry")
    (ParameterDescriptor,) = _names("rcl_interfaces.msg", "ParameterDescriptor")
    InvalidParameterTypeException, InvalidParameterValueException = _names(
        "rclpy.exceptions", "InvalidParameterTypeException", "InvalidParameterValueException"
    )
    (SingleThreadedExecutor,) = _names("rclpy.executors", "SingleThreadedExecutor")
    (Node,) = _names("rclpy.node", "Node")
    DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy = _names(
        "rclpy.qos", "DurabilityPolicy", "HistoryPolicy", "QoSProfile", "ReliabilityPolicy"
    )
    (QoSOverridingOptions,) = _names("rclpy.qos_overriding_options", "QoSOverridingOptions")
    (SignalHandlerOptions,) = _names("rclpy.signals", "SignalHandlerOptions")
    (Clock,) = _names("rosgraph_msgs.msg", "Clock")
    JointState, PointCloud2, PointField = _names("sensor_msgs.msg", "JointState", "PointCloud2", "PointField")
    ColorRGBA, Float32, Float64, String, UInt8 = _names(
        "std_msgs.msg", "ColorRGBA", "Float32", "Float64", "String", "UInt8"
    )
    (Trigger,) = _names("std_srvs.srv", "Trigger")
    Marker, MarkerArray = _names("visualization_msgs.msg", "Marker", "MarkerArray")
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
    "String",
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
        (make,) = _names("rclpy.experimental.events_executor", "EventsExecutor")
        return make()
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
