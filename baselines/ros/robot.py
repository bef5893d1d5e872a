"""The node of a robot: its policy on board, with the topics, parameters and services that users of ROS 2 expect."""

import dataclasses
import math
import random
import re
import threading
from collections import deque
from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from baselines.onboard import Odometry, Onboard, Output
from baselines.ros import library as ros
from baselines.ros import messages
from baselines.ros.control_loop import ControlLoop, SpeedOfPoses, in_scenario_frame, relative_to_robot
from baselines.ros.messages import named_numbers, ring_message, yaw
from baselines.ros.settings import RobotSettings, command_topics
from lissajous_env.logs.messages import seconds
from lissajous_env.parameters.scenario import Scenario

NAME = "policy"
_WAITS = "waits for the service start"
_TICK = 0.01
"""Period in which the node tests whether it must act [s]."""


class RobotNode(ros.Node):
    """A robot's policy as a node of ROS 2.

    Each field of the settings is a parameter, so that `--ros-args -p name:=value` and parameter files change it.
    docs/ros.md lists topics and services.

    Args:
        settings: Defaults of the parameters.
        namespace: Namespace; None means `robot_K`.
        scenario: The scenario; None means that of the settings.
        **options: Further arguments of `rclpy.node.Node`.

    Raises:
        ValueError: a parameter is invalid, or as `baselines.Onboard`.
    """

    _publishing: threading.Thread | None = None

    def __init__(
        self,
        settings: RobotSettings,
        namespace: str | None = None,
        scenario: Scenario | None = None,
        **options: Any,
    ):
        super().__init__(NAME, namespace=f"robot_{settings.robot}" if namespace is None else namespace, **options)
        self.settings = settings = self._declared(settings)
        self.onboard = Onboard(settings.policy, scenario or settings.scenario, settings.robot, settings)
        self._command_topics = command_topics(self.onboard.scenario, settings.command)
        self.scenario = self.onboard.scenario
        self._loop = ControlLoop(self.onboard, settings.message_wait)
        self._speed = SpeedOfPoses(self.scenario.task.step)
        self._random = random.Random(settings.robot)
        self._wrong_frame, self._reported = "", "?"
        self._output: Output | None = None
        self._times: deque[float] = deque(maxlen=1000)
        self._warm_up()
        self._starts = settings.autostart
        self._connect()

    @classmethod
    def simulated(cls, settings: RobotSettings, scenario: Scenario, **options: Any) -> "RobotNode":
        """Return a node whose clock is that of a simulated world."""
        clock = ros.Parameter("use_sim_time", value=True)
        return cls(settings, scenario=scenario, parameter_overrides=[clock], **options)

    @property
    def now(self) -> float:
        """Time of the node's clock [s]."""
        return self.get_clock().now().nanoseconds / 1e9

    @property
    def reason(self) -> str:
        """Reason for which the robot is stopped; empty while it drives."""
        if self._wrong_frame or not self._loop.started:
            return self._wrong_frame or _WAITS
        return "there is no pose yet" if self._output is None else self._output.stopped

    def _declared(self, settings: RobotSettings) -> RobotSettings:
        given = {}
        for field in dataclasses.fields(settings):
            default = getattr(settings, field.name)
            default = list(default) if isinstance(default, tuple) else default
            describes = ros.ParameterDescriptor(read_only=True, description=field.name.replace("_", " "))
            try:
                value = self.declare_parameter(field.name, default, describes).value
            except (ros.InvalidParameterTypeException, ros.InvalidParameterValueException) as error:
                raise ValueError(f"node.{field.name} must be of type {type(default).__name__}: {error}") from error
            given[field.name] = tuple(value) if isinstance(default, list) else value
        return RobotSettings(**given)

    def _warm_up(self) -> None:
        """Compile and load every kernel before the first step."""
        curve = self.scenario.curve
        pose = Odometry(curve.half_width / 2, curve.half_height / 2, 0.0, 0.0, 0.0)
        self.onboard.announce(pose)
        self.onboard.act(0.0, pose)
        self.onboard.reset()

    def _connect(self) -> None:
        settings, measured = self.settings, ros.LATEST
        changes = {"qos_overriding_options": ros.QoSOverridingOptions.with_default_policies()}
        self._send_message = self.create_publisher(ros.JointState, "message", ros.RELIABLE, **changes).publish
        self._send_action = self.create_publisher(ros.JointState, "action", ros.RELIABLE, **changes).publish
        self._send_phase = self.create_publisher(ros.Float64, "phase", ros.RELIABLE, **changes).publish
        self._send_diagnostics = self.create_publisher(ros.DiagnosticArray, "/diagnostics", ros.RELIABLE).publish
        topics = self._command_topics.items()
        self._command_senders = [self.create_publisher(getattr(ros, cls), name, 1, **changes) for name, cls in topics]
        measurements: dict[str, tuple[Any, Callable[[Any], None]]] = {
            "robots": (ros.PointCloud2, partial(self._see, "robots", 4)),
            "targets": (ros.PointCloud2, partial(self._see, "targets", 2)),
        }
        measurements |= {f"/robot_{k}/message": (ros.JointState, partial(self._hear, k)) for k in self._loop.heard}
        if settings.pose == "odometry":
            measurements["odom"] = ros.Odometry, lambda m: self._take(m.header, m.pose.pose, m.twist.twist.linear.x)
        else:
            measurements["pose"] = ros.PoseStamped, lambda m: self._take(m.header, m.pose)
        for name, (cls, take) in measurements.items():
            self.create_subscription(cls, name, take, measured, **changes)
        self.create_subscription(ros.UInt8, "status", self._take_status, ros.LASTING)
        for name in ("start", "stop", "resume"):
            self.create_service(ros.Trigger, name, partial(self._serve, name))
        steady = ros.rclpy.clock.Clock(clock_type=ros.rclpy.clock.ClockType.STEADY_TIME)  # goes on while /clock waits
        self.create_timer(0.5, self._report, clock=steady)
        self.create_timer(_TICK, self._tick, clock=steady)
        self._ended, self._sending = threading.Event(), threading.Lock()
        self._publishing = threading.Thread(target=self._publish_commands, daemon=True)
        self._publishing.start()

    def rest(self) -> None:
        """Stop the robot, and publish the command of rest."""
        self.onboard.stop()
        self._send_command()

    def destroy_node(self) -> None:
        """End the thread that publishes commands, and the node."""
        if self._publishing is not None:
            self._ended.set()
            self._publishing.join()
        super().destroy_node()

    def _take(self, header: Any, pose: Any, speed: float | None = None) -> None:
        """Take a pose, with a measured speed [m/s] or with that of the poses before."""
        if header.frame_id not in ("", self.settings.frame):
            self._wrong_frame = f"the pose is in frame {header.frame_id}, it must be {self.settings.frame}"
            return
        place = in_scenario_frame(self.settings.origin, pose.position.x, pose.position.y, yaw(pose.orientation))
        stamp = seconds(header.stamp)
        odometry = self._speed.add(*place, stamp) if speed is None else Odometry(*place, speed, stamp)
        if odometry is not None:
            self._wrong_frame = ""
            self._loop.take(odometry)
            self._tick()

    def _take_status(self, message: Any) -> None:
        self._loop.works = message.data == 0

    def _hear(self, sender: int, message: Any) -> None:
        heard = messages.heard(message, sender)
        if heard is not None and self._random.random() >= self.settings.message_loss:
            self._loop.heard[sender] = heard
            self._tick()

    def _see(self, name: str, width: int, message: Any) -> None:
        settings, frame = self.settings, message.header.frame_id
        try:
            rows = messages.cloud_rows(message, width)
            rows = relative_to_robot(rows, frame, settings.frame, self._loop.pose, settings.origin)
            if rows is not None:
                self._loop.detections[name] = seconds(message.header.stamp), rows
        except ValueError as error:
            self.get_logger().warning(f"{name}: {error}", throttle_duration_sec=5.0)

    def _serve(self, name: str, _request: Any, response: Any) -> Any:
        if name == "start":
            self._loop.start(self.now)
            self._output = None
        else:
            getattr(self.onboard, name)()
        response.success, response.message = True, f"robot {self.onboard.robot}: {name}"
        return response

    def _tick(self) -> None:
        """Announce a new pose, and decide on the command of a step that is due."""
        before, now = perf_counter(), self.now
        if now == 0:
            return  # A simulated clock reads zero until its first message.
        if self._starts:
            self._starts = False
            self._loop.start(now)
        if (message := self._loop.announce(now)) is not None:
            self._send_message(ring_message(message, self.settings.frame))
        if (output := self._loop.act(now)) is not None:
            self._output = output
            self._send_command()
            # A simulated world that has received the action takes the command that came before it.
            self._publish(output, now)
            self._times.append(perf_counter() - before)

    def _send_command(self) -> None:
        """Publish the command that is valid now."""
        largest, frame = self.scenario.robot.steering_max, f"{self.get_namespace()[1:]}/base_link".lstrip("/")
        with self._sending:  # of two threads, so that no command follows a newer one
            now = self.now
            command = self.onboard.command_at(math.nan if self._wrong_frame else now)
            parts = messages.command_messages(command, self.settings.command, largest, now, frame)
            for sender, message in zip(self._command_senders, parts, strict=True):
                sender.publish(message)

    def _publish(self, output: Output, time: float) -> None:
        self._send_action(named_numbers(self.scenario.action_names, output.action.tolist(), time))
        if (sent := output.message) is not None:
            self._send_phase(ros.Float64(data=math.atan2(sent.sin_phase, sent.cos_phase) % math.tau))

    def _publish_commands(self) -> None:
        """Publish the command at a steady rate, from a thread that does not wait for the policy."""
        while not self._ended.wait(1 / self.settings.rate):
            self._send_command()

    def _report(self) -> None:
        kind = re.sub(r"\d[\d.]*", "", self.reason)  # a reason whose number changes is the same reason
        if kind != self._reported:
            self._reported = kind
            self.get_logger().info(self.reason or "drives")
        now, heard = self.now, self._loop.heard
        values: dict[str, Any] = {"policy": self.settings.policy}
        for sender, last in heard.items():
            values[f"message of robot {sender}, age [s]"] = math.nan if last is None else now - last.sent_at
        values["time of a step, 99th percentile [s]"] = float(np.percentile(self._times or [math.nan], 99))
        self._send_diagnostics(messages.diagnostics(self.get_namespace()[1:], self.onboard, self.reason, values, now))
