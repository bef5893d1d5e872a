"""The libraries and standard messages of ROS 2: the one file that imports them.

They are those of an installed distribution or of the extra `ros`. Import this module only where a node is made.

Raises:
    MissingExtraError: the libraries are not installed.
"""

from functools import partial
from importlib import import_module
from typing import Any

from lissajous_env.plugins import of_extra

_NAMES = {
    "diagnostic_msgs.msg": "DiagnosticArray DiagnosticStatus KeyValue",
    "geometry_msgs.msg": "PoseStamped Twist TwistStamped",
    "nav_msgs.msg": "Odometry",
    "rcl_interfaces.msg": "ParameterDescriptor",
    "rclpy.exceptions": "InvalidParameterTypeException InvalidParameterValueException",
    "rclpy.executors": "SingleThreadedExecutor",
    "rclpy.logging": "LoggingSeverity",
    "rclpy.node": "Node",
    "rclpy.parameter": "Parameter",
    "rclpy.qos": "DurabilityPolicy QoSProfile ReliabilityPolicy",
    "rclpy.qos_overriding_options": "QoSOverridingOptions",
    "rclpy.signals": "SignalHandlerOptions",
    "rosgraph_msgs.msg": "Clock",
    "sensor_msgs.msg": "JointState PointCloud2 PointField",
    "std_msgs.msg": "Float32 Float64 String UInt8",
    "std_srvs.srv": "Trigger",
}
"""Names that this module offers, by their modules. Their types are those of whichever distribution is installed."""

_of_ros = partial(of_extra, what="a node of ROS 2", extra="ros")
rclpy: Any = _of_ros("rclpy")
_OFFERED = {name: getattr(_of_ros(module), name) for module, names in _NAMES.items() for name in names.split()}
LATEST: Any = _OFFERED["QoSProfile"](depth=1, reliability=_OFFERED["ReliabilityPolicy"].BEST_EFFORT)
"""Quality of service with which measurements are received: the latest one, without repetitions."""
LASTING: Any = _OFFERED["QoSProfile"](depth=1, durability=_OFFERED["DurabilityPolicy"].TRANSIENT_LOCAL)
"""Quality of service of states: a node that joins later receives the latest one."""
RELIABLE = 10
"""Depth of the queues of everything else, which is sent and received reliably, as ROS 2 does by default."""


def __getattr__(name: str) -> Any:
    if name not in _OFFERED:
        raise AttributeError(f"module {__name__} has no attribute {name}")
    return _OFFERED[name]


def make_executor() -> Any:
    """Return an executor of one thread: the one that waits for events, which costs a quarter, where there is one."""
    try:
        return import_module("rclpy.experimental.events_executor").EventsExecutor()
    except (ImportError, OSError):  # before Kilted, or where stderr is no file, as in notebooks
        return _OFFERED["SingleThreadedExecutor"]()


def start_ros() -> None:
    """Start ROS 2 with the arguments that follow `--ros-args`; Ctrl-C then interrupts the process as usual.

    Raises:
        ValueError: the arguments that follow `--ros-args` are not of ROS 2.
    """
    try:
        rclpy.init(signal_handler_options=_OFFERED["SignalHandlerOptions"].NO)
    except Exception as error:  # a class of the C library
        raise ValueError(f"arguments after --ros-args must be of ROS 2, got: {error}") from error
