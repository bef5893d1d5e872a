"""The node of the simulation, in place of the hardware of all robots: poses out, commands in."""

import math
from collections.abc import Callable, Iterator
from functools import partial
from time import monotonic
from typing import Any

import numpy as np

from baselines.onboard import Limits, inputs_of
from baselines.onboard.commands import check_robots
from baselines.ros import library as ros
from baselines.ros.messages import (
    COMMAND_TOPICS,
    Simulated,
    cloud_message,
    marker,
    odometry_message,
    pose_message,
    seconds,
    simulated_message,
    stamp_of,
)
from baselines.ros.settings import WorldSettings
from baselines.ros.vehicle import Vehicle
from lissajous_env.console.terminal import CommandError
from lissajous_env.episodes.recording import Recorder, Recording
from lissajous_env.logs.markers import target_shape
from lissajous_env.logs.reading import EPISODE
from lissajous_env.logs.writing import episode_text
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import REMOVED

NAME = "world"
START = 1.0
"""Time of the reset in lock-step [s]; ROS interprets 0 as no time."""
_AGAIN = 0.25
"""Period in which a state is sent again while robots are waited for [s]."""
DISCOVERY = 4.0
"""Time after which a node has discovered everyone that was there before, such as a recorder [s]; participants of DDS
announce themselves every 3 s."""
_PATIENCE = 30.0
"""Longest time to wait for an answer of a robot that has been there [s]."""
_CLOCK_PERIOD = 0.005
"""Period in which `/clock` is published if the simulation does not run at the pace of the system's clock [s]."""


class WorldNode(ros.Node):
    """The simulation as a node of ROS 2, in real time or in lock-step.

    Args:
        scenario: The scenario, of cars or differential drives.
        settings: Settings.
        **options: Further arguments of `rclpy.node.Node`.

    Attributes:
        simulation: The simulation.
        loop: Executor that runs this node while it plays; further nodes may be added.
        late_steps: Number of steps that came late, in real time.
        discovery: Time for which the node waits at least, so that a recorder that was there before misses nothing [s].

    Raises:
        ValueError: as `baselines.onboard.commands.check_robots`.
    """

    loop: Any = None
    discovery = DISCOVERY

    def __init__(self, scenario: Scenario, settings: WorldSettings, **options: Any):
        check_robots(scenario, settings.command)
        super().__init__(NAME, **options)
        self.settings, self.simulation = settings, Simulation(scenario, seed=settings.seed)
        self._begun, self._clock_sent_at = monotonic(), -math.inf
        self.scenario, self.late_steps = self.simulation.scenario, 0
        # Compile and load every kernel before robots wait for a step.
        self.simulation.advance()
        inputs_of(self.simulation, 0)
        self.simulation.reset(seeds=[settings.seed])
        self._recorder = Recorder(self.simulation)
        count = self.scenario.num_robots
        self._actions: list[dict[int, np.ndarray]] = [{} for _ in range(count)]
        watchdog = settings.watchdog or float(Limits().of(self.scenario).watchdog or 0.0)
        self._vehicles = [Vehicle(self.scenario, watchdog) for _ in range(count)]
        self._vehicles[0].warm_up()
        self._status, self._heading = [-1] * count, np.zeros(count)
        self._is_there = [False] * count
        self.loop = ros.make_executor()
        self.loop.add_node(self)
        self._robots = [self._connect(k) for k in range(count)]
        self._send_clock = self.create_publisher(ros.Clock, "/clock", ros.reliable(1)).publish
        self._send_episode = self.create_publisher(ros.String, EPISODE, ros.lasting()).publish
        self._send_markers = self.create_publisher(ros.MarkerArray, "/markers", ros.reliable(1)).publish

    @property
    def now(self) -> float:
        """Time of the robots' clock [s], which is that of the system if the pace is 1."""
        if self.settings.pace == 1:
            return self.get_clock().now().nanoseconds / 1e9
        return START + (monotonic() - self._begun) * self.settings.pace

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
        self._call("start")
        self._recorder.take()
        for _ in self._lockstep() if self.settings.lockstep else self._realtime():
            self._recorder.take()
            on_step()
        self._call("stop")
        return self._recorder.recording()

    def destroy_node(self) -> None:
        """End the node."""
        if self.loop is not None:
            self.loop.shutdown()
        super().destroy_node()

    def _connect(self, robot: int) -> dict[str, Any]:
        names, reliable = f"/robot_{robot}/", ros.reliable()

        def publisher(name: str, cls: Any, quality: Any = reliable) -> Any:
            return self.create_publisher(cls, names + name, quality).publish

        def listen(name: str, cls: Any, take: Callable[[Any], None]) -> None:
            self.create_subscription(cls, names + name, take, reliable)

        if self.settings.lockstep:
            listen("action", ros.JointState, lambda message: self._take_action(robot, message))
        else:
            for topic, cls in COMMAND_TOPICS[self.settings.command].items():
                take = partial(self._vehicles[robot].receive, topic=topic)
                listen(topic, getattr(ros, cls), lambda message, take=take: take(self.now, message=message))
        listen("message", ros.JointState, lambda _message: self._is_there.__setitem__(robot, True))
        calls = {name: self.create_client(ros.Trigger, names + name) for name in ("start", "stop")}
        return calls | {
            "odom": publisher("odom", ros.Odometry),
            "pose": publisher("pose", ros.PoseStamped),
            "status": publisher("status", ros.UInt8, ros.lasting()),
            "robots": publisher("robots", ros.PointCloud2),
            "targets": publisher("targets", ros.PointCloud2),
            "simulated": publisher("simulated", ros.JointState),
        }

    def _take_action(self, robot: int, message: Any) -> None:
        if tuple(message.name) == tuple(self.scenario.action_names):
            time = round(seconds(message.header.stamp) * 1e9)
            self._actions[robot] = {time: np.array(message.position, dtype=np.float32)}

    def _spin(self, timeout: float) -> None:
        """Receive a message, within a time of the system's clock [s]."""
        if self.settings.pace != 1:
            timeout = min(timeout, _CLOCK_PERIOD)
            if monotonic() - self._clock_sent_at >= _CLOCK_PERIOD:
                self._clock_sent_at = monotonic()
                self._send_clock(ros.Clock(clock=stamp_of(self.now)))
        self.loop.spin_once(timeout_sec=max(timeout, 0.0))
        self._check()

    def _spin_until(self, holds: Callable[[], bool], limit: float, every: Callable[[], None] | None = None) -> bool:
        """Receive messages and call a function regularly until a condition is true; return False after a time limit."""
        begun = again = monotonic()
        while not holds():
            now = monotonic()
            if now - begun > limit:
                return False
            if every is not None and now >= again:
                every()
                again = now + _AGAIN
            self._spin(min(_AGAIN, 0.05))
        return True

    def _await_robots(self) -> None:
        def publish() -> None:
            self._publish(START if self.settings.lockstep else self.now)

        def ready() -> bool:
            return all(self._is_there) and monotonic() - self._begun >= self.discovery

        if not self._spin_until(ready, max(self.settings.wait, self.discovery), publish) and not all(self._is_there):
            missing = ", ".join(f"robot_{k}" for k, there in enumerate(self._is_there) if not there)
            raise CommandError(f"no message of {missing} within {self.settings.wait:g} s")

    def _call(self, name: str) -> None:
        """Call a service of every robot that has not been removed."""
        clients = {k: robot[name] for k, robot in enumerate(self._robots) if self._status[k] != int(REMOVED)}
        limit = _PATIENCE if name == "start" else 2.0
        ready = self._spin_until(lambda: all(each.service_is_ready() for each in clients.values()), limit)
        answers = {k: each.call_async(ros.Trigger.Request()) for k, each in clients.items() if each.service_is_ready()}
        ready = ready and self._spin_until(lambda: all(each.done() for each in answers.values()), limit)
        if not ready and name == "start":
            silent = ", ".join(f"robot_{k}" for k in clients if k not in answers or not answers[k].done())
            raise CommandError(f"the service {name} of {silent} does not answer")

    def _realtime(self) -> Iterator[None]:
        step = self.scenario.task.step
        end = self.now
        self._announce_episode(end)
        self._publish(end)
        while not self.simulation.over[0]:
            begun, end = end, end + step
            while (left := end - self.now) > 0:
                self._spin(left / self.settings.pace)
            if -left > 0.5 * step:
                self.late_steps += 1
                end = self.now
            speeds = self.simulation.robots.speed.numpy()[0].tolist()
            # A command that arrives in the first half of a step is the one in force for most of it.
            middle = begun + 0.5 * step
            actions = [each.action(middle, speed) for each, speed in zip(self._vehicles, speeds, strict=True)]
            self.simulation.step(np.stack(actions)[None])
            self._publish(end)
            yield

    def _lockstep(self) -> Iterator[None]:
        step, taken = self.scenario.task.step, 0
        while not self.simulation.over[0]:
            time = START + taken * step
            key = round(time * 1e9)

            def publish(time: float = time) -> None:
                self._publish(time)

            def missing(key: int = key) -> list[int]:
                there = [k for k, status in enumerate(self._status) if status != int(REMOVED)]
                return [k for k in there if key not in self._actions[k]]

            if not taken:
                self._announce_episode(time)
            publish()
            if not self._spin_until(lambda: not missing(), _PATIENCE, publish if missing() else None):
                silent = ", ".join(f"robot_{k}" for k in missing())
                raise CommandError(f"no action of {silent} for the time {time:g} s within {_PATIENCE:g} s")
            action = np.zeros(self.simulation.action_shape, dtype=np.float32)
            for k, given in enumerate(self._actions):
                action[0, k] = given.get(key, 0.0)
            self.simulation.step(action)
            taken += 1
            yield

    def _announce_episode(self, begin: float) -> None:
        """Publish the scenario, the seed and the stamp of the first pose [s].

        A recorded log then contains all that `lissajous score` needs.
        """
        self._send_episode(ros.String(data=episode_text(self.scenario, self.settings.seed, "ros", begin)))

    def _publish(self, time: float) -> None:
        """Publish the measurements and detections of each robot at a time [s]."""
        lockstep, frame = self.settings.lockstep, self.settings.frame
        if lockstep:
            self._send_clock(ros.Clock(clock=stamp_of(time)))
        begun = time - int(self.simulation.clock.step.numpy()[0]) * self.scenario.task.step
        for k, status in enumerate(self.simulation.robots.status.numpy()[0].tolist()):
            robot = self._robots[k]
            if status != self._status[k]:
                robot["status"](ros.UInt8(data=status))
                self._status[k] = status
            if status == int(REMOVED):
                continue
            inputs = inputs_of(self.simulation, k)
            odometry = inputs.odometry._replace(stamp=time)
            turned = math.remainder(odometry.heading - self._heading[k], 2 * math.pi) / self.scenario.task.step
            self._heading[k] = odometry.heading
            aligned = f"robot_{k}/aligned"
            robot["odom"](odometry_message(odometry, turned, frame, f"robot_{k}/base_link"))
            if not lockstep:
                robot["pose"](pose_message(odometry, frame))
            robot["robots"](cloud_message(inputs.robots, time, aligned))
            robot["targets"](cloud_message(inputs.targets, time, aligned))
            if lockstep:
                heard = {message.sender: begun + message.sent_at for message in inputs.heard}
                before, after = (heard.get(int(j), math.nan) for j in self.scenario.neighbours[k])
                known = Simulated(inputs.phase, inputs.works, (before, after))
                robot["simulated"](simulated_message(known, time))
        present = self.simulation.targets.in_sight.numpy()[0] == 1
        targets = target_shape(self.scenario, self.simulation.targets.position.numpy()[0][present])
        self._send_markers(ros.MarkerArray(markers=[marker(targets, frame, time)]))
