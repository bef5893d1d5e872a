"""Failures of robots that communicate over ROS 2: of a node, of the poses, and of the network."""

import math
import time

import numpy as np
import pytest

pytest.importorskip("rclpy", reason='ROS 2 is not installed: pip install ".[ros]"')
from ros_team import AGILE, PATIENCE, Team, in_ros, node_of, wait_until

import lissajous_env
from baselines.onboard import Odometry
from baselines.ros import library as ros
from baselines.ros.messages import odometry_message
from baselines.ros.settings import RobotSettings
from lissajous_env.logs.messages import seconds

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


def team_scenario(duration, **changes):
    """Cars at the speeds of a first run in a laboratory, 0.2 to 0.7 m/s."""
    fields = {"task.duration": duration, "formation.phase_rate": RATE, **changes}
    return lissajous_env.scenario("experiment", **AGILE, **fields)


class Watch:
    """Record of the simulated robots, step by step: their throttles, speeds and least distance."""

    def __init__(self, world):
        self._world, self.throttles, self.speeds, self.phases, self.apart = world, [], [], [], []

    def record(self):
        simulation = self._world.simulation
        self.throttles.append(simulation.action.numpy()[0, :, 1].copy())
        self.speeds.append(simulation.robots.speed.numpy()[0].copy())
        self.phases.append(simulation.robots.phase.numpy()[0].copy())
        place = simulation.robots.position.numpy()[0, :, :2]
        apart = np.linalg.norm(place[:, None] - place[None], axis=-1) + 9 * np.eye(len(place))
        self.apart.append(apart.min())

    def check(self):
        """No robots touch, every robot was driven in the last second, and went forwards on the curve."""
        assert min(self.apart) > 2 * 0.125
        assert (np.array(self.throttles[-10:]) > REST).any(axis=0).all()
        assert np.angle(np.exp(1j * (self.phases[-1] - self.phases[-11]))).min() > 0


def test_a_robot_whose_node_ends_stops_and_joins_again():
    # A physical story: a node ends at 1 s without a word; it is started again, while the others wait for it.
    # At twice real time a command of 0.1 s later is in time also on a slow machine; for one not waited for, time jumps.
    scenario, world = team_scenario(200.0), {"patience": 1.0, "pace": 2.0}
    with Team(scenario, "kuramoto-mpcc", message_wait=0.02, clock_jump=1e3, world=world) as team:
        watch, joined_at = Watch(team.world), []

        def follow():
            watch.record()
            step = len(watch.speeds)
            if step == 10:
                ended = team.robots.pop(0)
                team.world.loop.remove_node(ended)
                ended.destroy_node()
            if step == 20:
                team.add(team.robot(0, autostart=True))
            if step > 30 and not joined_at and watch.throttles[-1][0] > REST:
                joined_at.append(step)
            if joined_at and step > joined_at[0] + 20:
                raise EnoughError

        with pytest.raises(EnoughError):
            team.world.play(follow)
    throttles, speeds = np.array(watch.throttles), np.array(watch.speeds)
    # It stops within the watchdog's time after the last of its commands.
    after = 10 + math.ceil(WATCHDOG / STEP) + 1
    assert (throttles[5:10, 0] > REST).any()
    assert (throttles[after:20, 0] == REST).all()
    assert (np.diff(speeds[after:20, 0]) < 0).all()
    watch.check()


@pytest.mark.parametrize(("at", "policy"), [(0.0, "open-loop-mpcc"), (1.0, "kuramoto-mpcc")])
def test_the_others_drive_on_without_a_removed_robot(at, policy):
    scenario = team_scenario(3.0, **{"faults.removed": ((0, at),)})
    with Team(scenario, policy, message_wait=0.02, silence=1e6) as team:
        watch = Watch(team.world)
        played = team.world.play(watch.record)
        assert team.world.awaited[0], "it was never waited for in vain"
    assert played.status[-1].tolist() == [2, 0, 0, 0, 0]
    assert (played.speed[20:, 1:] > 0.05).all()


def test_a_robot_stops_when_its_poses_end_and_drives_again_with_the_next():
    # A physical story by the machine's clock, as on a robot: motion capture loses the robot, and finds it again.
    # The process may stand still for a while, in which the clock jumps, and messages of before arrive later.
    robot = node_of(RobotSettings(policy="open-loop-mpcc", autostart=True, clock_jump=1e3))
    capture, loop, poses, commands = ros.Node("capture", use_global_arguments=False), ros.make_executor(), [], []
    publish = capture.create_publisher(ros.Odometry, "/robot_0/odom", 10).publish
    capture.create_subscription(ros.JointState, "/robot_0/command", commands.append, 10)
    for node in (robot, capture):
        loop.add_node(node)

    def measure():
        poses.append(Odometry(1.7, 0.1, 1.5, 0.5, robot.now))
        publish(odometry_message(poses[-1], "map", "robot_0/base_link"))
        loop.spin_once(timeout_sec=0.02)

    def look_away():
        loop.spin_once(timeout_sec=0.02)

    def throttles():
        return [message.position[1] for message in commands if seconds(message.header.stamp) > lost_at[-1]]

    idle, lost_at = robot.scenario.robot.throttle_min, [0.0]
    try:
        for _ in range(2):
            wait_until(lambda: not robot.reason and throttles()[-1:] > [idle], measure)
            wait_until(lambda: robot.now > poses[-1].stamp + WATCHDOG and "the pose is" in robot.reason, look_away)
            lost_at.append(robot.now)
            wait_until(lambda: len(throttles()) > 5, look_away)
            assert throttles() == pytest.approx([idle] * len(throttles()))
    finally:
        loop.shutdown()
        for node in (robot, capture):
            node.destroy_node()


class Radio(ros.Node):
    """The network of a laboratory, which passes poses, commands and messages on, or is silent."""

    def __init__(self, count):
        super().__init__("radio")
        self.is_silent = False
        for k in range(count):
            self._pass_on(ros.Odometry, f"/robot_{k}/odom", f"/onboard_{k}/odom")
            for name in ("command", "message", "action"):
                self._pass_on(ros.JointState, f"/onboard_{k}/{name}", f"/robot_{k}/{name}")

    def _pass_on(self, kind, here, there):
        publish = self.create_publisher(kind, there, 10).publish
        self.create_subscription(kind, here, lambda message: None if self.is_silent else publish(message), 10)


def through_radio(robot):
    """Options of a robot's node whose topics pass through the network; its services do not."""
    services = [f"{name}:=/robot_{robot}/{name}" for name in ("start", "stop", "resume")]
    remapped = [word for service in services for word in ("-r", service)]
    return {"namespace": f"onboard_{robot}", "cli_args": ["--ros-args", *remapped]}


def drain(team):
    """Receive what is on its way, so that no command of before arrives later: every queue has many turns."""
    ends, turns = time.monotonic() + 0.3, 0
    while time.monotonic() < ends or turns < 500:
        team.spin()
        turns += 1


def test_robots_stop_while_the_network_is_silent_and_go_on_after():
    # A physical story: nothing arrives anywhere from 1.5 s to 3.5 s.
    cars = team_scenario(6.0)
    world = {"patience": PATIENCE, "pace": 10.0}
    with Team(cars, "kuramoto-mpcc", options_of=through_radio, world=world, clock_jump=1e3, message_wait=0.02) as team:
        radio, watch, reasons = team.add(Radio(5)), Watch(team.world), []

        def follow():
            watch.record()
            step = len(watch.speeds)
            if step == 30:
                wait_until(lambda: all("the pose is" in robot.reason for robot in team.robots), team.spin)
                reasons.append(step)
            radio.is_silent = 15 <= step < 35
            if step == 15:
                drain(team)
            if step in (15, 35):
                team.world.awaited[:] = [step == 35] * 5  # nobody decides in the silence

        team.world.play(follow)
    throttles, speeds = np.array(watch.throttles), np.array(watch.speeds)
    after = 15 + math.ceil(WATCHDOG / STEP) + 1
    assert (throttles[after:35] == REST).all()
    assert (np.diff(speeds[after:35], axis=0) < 0).all()
    assert reasons == [30]
    watch.check()
