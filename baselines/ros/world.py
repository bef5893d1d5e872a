"""The node of the simulation, in place of the hardware of all robots: poses and the clock out, commands in."""

import json
import math
from collections.abc import Callable
from functools import partial
from time import monotonic
from typing import Any

import numpy as np

from baselines.onboard import Limits, inputs_of
from baselines.onboard.simulated import Vehicle
from baselines.ros import library as ros
from baselines.ros import messages
from baselines.ros.settings import WorldSettings, command_topics
from lissajous_env.console.terminal import CommandError
from lissajous_env.episodes.recording import Recorder, Recording
from lissajous_env.logs.messages import seconds
from lissajous_env.logs.reading import EPISODE
from lissajous_env.logs.writing import FRAME, START, episode_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import REMOVED

NAME = "world"
_AGAIN = 0.25
"""Period in which a state is sent again while robots are waited for [s]."""


class WorldNode(ros.Node):
    """The simulation as a node of ROS 2, on whose `/clock` the robots' nodes run.

    The clock goes on from step to step: not faster than the pace, and not before each robot has decided on its command.
    A robot that does not decide for `settings.patience` is not waited for until it decides again.

    Args:
        scenario: The scenario, of cars or differential drives.
        settings: Settings.
        **options: Further arguments of `rclpy.node.Node`.

    Attributes:
        simulation: The simulation.
        loop: Executor that runs this node while it plays; further nodes may be added.
        awaited: For each robot, whether the clock waits for its decision.
        recorded: True to record all moments; its size is limited. Otherwise only the first one is recorded.
        discovery: Time for which the node waits at least, so that a recorder that was there before misses nothing [s].

    Raises:
        ValueError: as `baselines.ros.settings.command_topics`.
    """

    loop: Any = None
    recorded = True
    discovery = 4.0  # participants of DDS announce themselves every 3 s

    def __init__(self, scenario: Scenario, settings: WorldSettings, **options: Any):
        self._command_topics = command_topics(scenario, settings.command)
        super().__init__(NAME, **options)
        self.settings, self.simulation = settings, Simulation(scenario, seed=settings.seed)
        self.scenario, self._begun, self._start = self.simulation.scenario, monotonic(), START
        # Compile and load every kernel before robots wait for a step.
        self.simulation.advance()
        self.simulation.reset(seeds=[settings.seed])
        self._recorder = Recorder(self.simulation)
        count = self.scenario.num_robots
        watchdog = Limits().of(self.scenario).watchdog
        self._vehicles = [Vehicle(self.scenario, watchdog) for _ in range(count)]
        self._status = [-1] * count
        self.awaited = [True] * count
        self._decided_at = [-math.inf] * count
        self.loop = ros.make_executor()
        self.loop.add_node(self)
        self._robots = [self._connect(k) for k in range(count)]
        self._send_clock = self.create_publisher(ros.Clock, "/clock", 1).publish
        self._send_episode = self.create_publisher(ros.String, EPISODE, ros.LASTING).publish

    @property
    def now(self) -> float:
        """Time of the robots' clock [s]."""
        return self._start + int(self.simulation.clock.step.numpy()[0]) * self.scenario.task.step

    def play(self, on_step: Callable[[], None] = lambda: None, check: Callable[[], None] = lambda: None) -> Recording:
        """Wait for the robots, start them, play the episode, and stop them.

        Args:
            on_step: Called after each step.
            check: Called after each message; it may end the episode by an error.

        Raises:
            CommandError: robots are missing, or do not answer.
        """
        self._check = check
        self._await_robots()
        if not self._call("start", self.settings.wait):
            raise CommandError(f"no answer of the robots to start within {self.settings.wait:g} s")
        self._start += self.scenario.task.step
        self._recorder.take()
        # A recorded log then contains all that `lissajous score` needs.
        episode = episode_of(self.scenario, self.settings.seed) | {"policy": "ros", "begin": self.now}
        self._send_episode(ros.String(data=json.dumps(episode)))
        begins = monotonic()
        while not self.simulation.over[0]:
            begins = max(begins + self.scenario.task.step / self.settings.pace, monotonic())
            self._await_decisions()
            while (left := begins - monotonic()) > 0:
                self._spin(left)
            self.simulation.step(np.stack([base.action(self.now) for base in self._vehicles])[None])
            if self.recorded:
                self._recorder.take()
            on_step()
        self._publish()
        self._call("stop", 2.0)
        return self._recorder.recording()

    def destroy_node(self) -> None:
        """End the node."""
        if self.loop is not None:
            self.loop.shutdown()
        super().destroy_node()

    def _connect(self, robot: int) -> dict[str, Any]:
        """Listen to a robot, and return its services and the functions that publish its topics, by their names."""
        names, reliable = f"/robot_{robot}/", ros.RELIABLE
        for topic, cls in self._command_topics.items():
            command = partial(self._command, robot, topic)
            self.create_subscription(getattr(ros, cls), names + topic, command, reliable)
        self.create_subscription(ros.JointState, names + "action", partial(self._decide, robot), reliable)
        outputs = {"odom": ros.Odometry, "pose": ros.PoseStamped, "robots": ros.PointCloud2, "targets": ros.PointCloud2}
        connected = {name: self.create_publisher(cls, names + name, reliable).publish for name, cls in outputs.items()}
        connected["status"] = self.create_publisher(ros.UInt8, names + "status", ros.LASTING).publish
        return connected | {name: self.create_client(ros.Trigger, names + name) for name in ("start", "stop")}

    def _command(self, robot: int, topic: str, message: Any) -> None:
        self._vehicles[robot].receive(self.now, topic, message)

    def _decide(self, robot: int, message: Any) -> None:
        self._decided_at[robot], self.awaited[robot] = seconds(message.header.stamp), True

    def _spin(self, timeout: float) -> None:
        """Receive a message, within a time of the machine's clock [s]."""
        self.loop.spin_once(timeout_sec=timeout)
        self._check()

    def _spin_until(self, holds: Callable[[], bool], limit: float, again: Callable[[], None] | None = None) -> bool:
        """Receive messages and call a function regularly until a condition is true; return False after a time limit."""
        begun = called_at = monotonic()
        while not holds():
            if monotonic() - begun > limit:
                return False
            if again is not None and monotonic() - called_at >= _AGAIN:
                again()
                called_at = monotonic()
            self._spin(0.05)
        return True

    def _await_decisions(self) -> None:
        """Publish the state, and wait until every robot that is waited for has decided on its command."""

        def missing() -> list[int]:
            late = [k for k, decided_at in enumerate(self._decided_at) if decided_at < self.now - 1e-6]
            return [k for k in late if self.awaited[k] and self._status[k] != REMOVED]

        self._publish()
        if not self._spin_until(lambda: not missing(), self.settings.patience, self._publish):
            for k in missing():
                self.awaited[k] = False

    def _await_robots(self) -> None:
        """Publish the first state, at which the robots stand still, until every robot can be started."""

        def stand() -> None:
            self._start += self.scenario.task.step
            self._publish()

        def missing() -> list[str]:
            return [f"robot_{k}" for k, robot in enumerate(self._robots) if not robot["start"].service_is_ready()]

        if not self._spin_until(lambda: not missing(), self.settings.wait, stand):
            raise CommandError(f"no node of {', '.join(missing())} within {self.settings.wait:g} s")
        self._spin_until(lambda: monotonic() - self._begun >= self.discovery, self.discovery, stand)

    def _call(self, name: str, limit: float) -> bool:
        """Call a service of every robot that is there; return False if one does not answer within a time [s]."""
        clients = [robot[name] for k, robot in enumerate(self._robots) if self._status[k] != REMOVED]
        answers = [client.call_async(ros.Trigger.Request()) for client in clients if client.service_is_ready()]
        return self._spin_until(lambda: all(answer.done() for answer in answers), limit)

    def _publish(self) -> None:
        """Publish the time, and the measurements and detections of each robot."""
        time, frame = self.now, FRAME
        clock = ros.Clock()
        clock.clock.sec, clock.clock.nanosec = divmod(round(time * 1e9), 10**9)
        self._send_clock(clock)
        for k, status in enumerate(self.simulation.robots.status.numpy()[0].tolist()):
            robot = self._robots[k]
            if status != self._status[k]:
                robot["status"](ros.UInt8(data=status))
                self._status[k] = status
            if status == REMOVED:
                continue
            inputs = inputs_of(self.simulation, k)
            odometry = inputs.odometry._replace(stamp=time)
            aligned = f"robot_{k}/aligned"
            robot["robots"](messages.cloud_message(inputs.robots, time, aligned))
            robot["targets"](messages.cloud_message(inputs.targets, time, aligned))
            robot["odom"](messages.odometry_message(odometry, frame, f"robot_{k}/base_link"))
            robot["pose"](messages.pose_message(odometry, frame))
