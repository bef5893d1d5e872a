"""Failures of robots that communicate over ROS 2: of a node, of the world, and of the network."""

import signal
import time

import numpy as np
import pytest

pytest.importorskip("rclpy", reason='ROS 2 is not installed: pip install ".[ros]"')
from ros_team import AGILE, Team, in_real_time, in_ros, process

import lissajous_env
from baselines.ros import library as ros
from baselines.ros.messages import seconds

STEP = 0.1
WATCHDOG = 2.5 * STEP
REST = -1.0
RATE = 0.1


@pytest.fixture(autouse=True)
def _ros():
    with in_ros():
        yield


class EnoughError(Exception):
    """End of a story before the episode's."""


def team_scenario(duration):
    """Cars at the speeds of a first run in a laboratory, 0.2 to 0.7 m/s."""
    return lissajous_env.scenario("experiment", **AGILE, **{"task.duration": duration, "formation.phase_rate": RATE})


class Watch:
    """Record of the simulated robots, step by step: their throttles, speeds and least distance."""

    def __init__(self, world):
        self._world, self.throttles, self.speeds, self.phases, self.apart = world, [], [], [], []

    def look(self):
        simulation = self._world.simulation
        self.throttles.append(simulation.action.numpy()[0, :, 1].copy())
        self.speeds.append(simulation.robots.speed.numpy()[0].copy())
        self.phases.append(simulation.robots.phase.numpy()[0].copy())
        place = simulation.robots.position.numpy()[0, :, :2]
        apart = np.linalg.norm(place[:, None] - place[None], axis=-1) + 9 * np.eye(len(place))
        self.apart.append(apart.min())

    def advance(self, steps):
        """Phases by which the robots have advanced in the last steps [rad]."""
        return np.angle(np.exp(1j * (self.phases[-1] - self.phases[-1 - steps])))


def check_distances(watch):
    assert min(watch.apart) > 2 * 0.125


def check_all_drive(watch):
    """Every robot was driven in the last second, and went forwards on the curve."""
    assert (np.array(watch.throttles[-10:]) > REST).any(axis=0).all()
    assert watch.advance(10).min() > 0


@in_real_time
def test_a_robot_whose_node_is_killed_stops_and_joins_again():
    # A physical story: kill -9 of a node at 1 s; it is started again, while the others wait for it.
    made = team_scenario(30.0)
    with Team(made, "kuramoto-mpcc", robots=[1, 2, 3, 4]) as team:
        arguments = (
            "robot",
            "--robot",
            0,
            "--policy",
            "kuramoto-mpcc",
            "--scenario",
            team.file,
            "--quiet",
            "--clock-jump",
            5,
        )
        nodes, watch, joined_at = [process(*arguments)], Watch(team.world), []

        def follow():
            watch.look()
            step = len(watch.speeds)
            if step == 10:
                nodes[0].kill()
                nodes[0].wait()
            if step == 20:
                nodes.append(process(*arguments, "--autostart"))
            if step > 30 and not joined_at and watch.throttles[-1][0] > REST:
                joined_at.append(step)
            if joined_at and step > joined_at[0] + 20:
                raise EnoughError

        try:
            with pytest.raises(EnoughError):
                team.world.play(follow)
        finally:
            for node in nodes:
                node.kill()
                node.wait()
    throttles, speeds = np.array(watch.throttles), np.array(watch.speeds)
    # It stops within the watchdog's time, counted from the last of its commands, which come every half step.
    after = 10 + int(np.ceil((WATCHDOG + STEP / 2) / STEP)) + 1
    assert (throttles[after:20, 0] == REST).all()
    assert (np.diff(speeds[after:20, 0]) < 0).all()
    check_distances(watch)
    check_all_drive(watch)


@in_real_time
def test_robots_whose_world_is_killed_stop(tmp_path):
    # A physical story: kill -9 of the node that measures the poses; each robot commands rest within the limits.
    made = team_scenario(60.0)
    commands, listener = {}, ros.Node("listener")
    with Team(made, "kuramoto-mpcc") as team:
        team.world.destroy_node()
        loop = ros.make_executor()
        for node in (*team.robots, listener):
            loop.add_node(node)
        for k in range(5):
            listener.create_subscription(ros.JointState, f"/robot_{k}/command", taking(commands.setdefault(k, [])), 10)
        world = process("world", "--scenario", team.file, "--quiet")

        def spin_until(holds, limit):
            ends = time.monotonic() + limit
            while not holds() and time.monotonic() < ends:
                loop.spin_once(timeout_sec=0.02)

        try:
            spin_until(lambda: all(not robot.reason for robot in team.robots), 40.0)
            spin_until(lambda: False, 1.0)
            drove = [max(throttle for _, throttle in commands[k][-10:]) for k in range(5)]
            world.send_signal(signal.SIGKILL)
            world.wait()
            killed_at = time.time()
            spin_until(lambda: False, 1.5)
        finally:
            world.kill()
            world.wait()
        reasons = [robot.reason for robot in team.robots]
        listener.destroy_node()
        team.robots, robots = [], team.robots
        for robot in robots:
            robot.destroy_node()
        team.world = ros.Node("nothing")
    idle = made.resolve().robot.throttle_min
    assert min(drove) > idle
    assert all("the pose is" in reason for reason in reasons)
    for k in range(5):
        # The pose may reach the limit of its age, and the last command that was decided before is valid as long.
        late = [throttle for at, throttle in commands[k] if at > killed_at + 2 * WATCHDOG]
        assert len(late) > 10
        assert late == pytest.approx([idle] * len(late))


def taking(kept):
    """A function that keeps time [s] and throttle of commands."""
    return lambda message: kept.append((seconds(message.header.stamp), message.position[1]))


class Radio(ros.Node):
    """The network of a laboratory, which passes poses, commands and messages on, or is silent."""

    def __init__(self, count):
        super().__init__("radio")
        self.is_silent = False
        for k in range(count):
            self._pass_on(ros.Odometry, f"/robot_{k}/odom", f"/onboard_{k}/odom")
            self._pass_on(ros.JointState, f"/onboard_{k}/command", f"/robot_{k}/command")
            self._pass_on(ros.JointState, f"/onboard_{k}/message", f"/robot_{k}/message")

    def _pass_on(self, kind, here, there):
        publish = self.create_publisher(kind, there, 10).publish
        self.create_subscription(kind, here, lambda message: None if self.is_silent else publish(message), 10)


def through_radio(robot):
    """Options of a robot's node whose topics pass through the network; its services do not."""
    services = [f"{name}:=/robot_{robot}/{name}" for name in ("start", "stop", "resume")]
    remapped = [word for service in services for word in ("-r", service)]
    return {"namespace": f"onboard_{robot}", "cli_args": ["--ros-args", *remapped]}


@in_real_time
def test_robots_stop_while_the_network_is_silent_and_go_on_after():
    # A physical story: nothing arrives anywhere from 1.5 s to 3.5 s.
    made = team_scenario(6.0)
    with Team(made, "kuramoto-mpcc", options_of=through_radio) as team:
        radio, watch, reasons = team.add(Radio(5)), Watch(team.world), []

        def follow():
            watch.look()
            step = len(watch.speeds)
            radio.is_silent = 15 <= step < 35
            if step == 30:
                reasons.extend(robot.reason for robot in team.robots)

        team.world.play(follow)
    throttles, speeds = np.array(watch.throttles), np.array(watch.speeds)
    after = 15 + int(np.ceil((WATCHDOG + STEP / 2) / STEP)) + 1
    assert (throttles[after:35] == REST).all()
    assert (np.diff(speeds[after:35], axis=0) < 0).all()
    assert all("the pose is" in reason for reason in reasons)
    assert len(reasons) == 5
    check_all_drive(watch)
    check_distances(watch)
