"""Commands as the messages that a robot's base expects."""

from typing import Any

from baselines.onboard import Onboard
from baselines.ros import library as ros
from baselines.ros.conversions import named_numbers, stamp_of


class CommandPublisher:
    """Publisher of a robot's commands, of one of `settings.COMMANDS`.

    Args:
        node: The node.
        kind: Kind of the messages.
        onboard: The robot's policy.
    """

    def __init__(self, node: Any, kind: str, onboard: Onboard):
        self._kind, self._steering_max = kind, onboard.scenario.robot.steering_max
        self._base = f"{node.get_namespace()[1:]}/base_link".lstrip("/")
        changes = {"qos_overriding_options": ros.QoSOverridingOptions.with_default_policies()}
        topics = {
            "car": (("command", ros.JointState),),
            "twist": (("cmd_vel", ros.Twist),),
            "twist_stamped": (("cmd_vel", ros.TwistStamped),),
            "dart": (("steering", ros.Float32), ("throttle", ros.Float32)),
        }[kind]
        made = [node.create_publisher(cls, name, ros.reliable(1), **changes) for name, cls in topics]
        self._publish = [each.publish for each in made]

    def __call__(self, command: Any, time: float) -> None:
        """Publish a command at a time [s]."""
        if self._kind == "car":
            self._publish[0](named_numbers(("steering", "throttle"), command, time))
        elif self._kind == "dart":
            self._publish[0](ros.Float32(data=command.steering / self._steering_max))
            self._publish[1](ros.Float32(data=command.throttle))
        else:
            message = ros.Twist() if self._kind == "twist" else ros.TwistStamped()
            twist = message if self._kind == "twist" else message.twist
            twist.linear.x, twist.angular.z = command.speed, command.yaw_rate
            if self._kind == "twist_stamped":
                message.header.stamp, message.header.frame_id = stamp_of(time), self._base
            self._publish[0](message)
