"""Robots as nodes of ROS 2, and the simulated world that they drive in: over DDS, on the loopback interface."""

import math
import signal
import tracemalloc

import numpy as np
import pytest

pytest.importorskip("rclpy", reason='ROS 2 is not installed: pip install ".[ros]"')
from ros_team import AGILE, Team, in_ros, node_of, wait_until

import baselines
import lissajous_env
from baselines.onboard import Message, Odometry, Twist
from baselines.ros import library as ros
from baselines.ros import messages
from baselines.ros.running import RosProcess
from baselines.ros.settings import RobotSettings
from lissajous_env.console.terminal import CommandError
from lissajous_env.episodes.recording import record
from lissajous_env.logs.messages import seconds


@pytest.fixture(autouse=True)
def _ros():
    with in_ros():
        yield


def test_a_cloud_that_claims_more_points_than_its_data_contain_is_refused():
    # Story: a damaged message claims gigabytes. Nothing is allocated before its length has been compared.
    most = 2**32 - 1
    sizes = [(*size, step, 4) for step in (0, 8, most) for size in ((most, 1), (1, most), (most, most), (4, 1))]
    for size in (*sizes, (2, 1, 12, 12), (2, 1, 12, most)):  # the last two have a damaged offset of a field
        cloud = messages.cloud_message(np.ones((2, 2), dtype=np.float32), 1.0, "map")
        cloud.width, cloud.height, cloud.point_step, cloud.fields[1].offset, cloud.row_step = *size, 0
        tracemalloc.start()
        with pytest.raises(ValueError, match="a point cloud must have room and data"):
            messages.cloud_rows(cloud, 4)
        assert tracemalloc.get_traced_memory()[1] < 1e7
        tracemalloc.stop()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_within_the_executor_is_handled_after_it(number):
    # Story: Ctrl-C while the executor calls Python, whose error it would turn into a RuntimeError.
    process, ended = RosProcess(), []
    before = signal.signal(number, process.note)
    node, executor = ros.Node("interrupted"), ros.make_executor()
    executor.add_node(node)

    def interrupt():
        timer.cancel()
        signal.raise_signal(number)
        ended.append("the callback")

    def spin():
        while len(ended) < 100:
            executor.spin_once(timeout_sec=1.0)
            process.check()

    timer = node.create_timer(0.001, interrupt)
    try:
        with pytest.raises(KeyboardInterrupt):
            spin()
    finally:
        signal.signal(number, before)
        executor.shutdown()
        node.destroy_node()
    assert ended == ["the callback"]
    with pytest.raises(KeyboardInterrupt):
        process.note(number, None)  # the second one does not wait


def test_headings_stamps_and_rows_survive_messages():
    # Oracle: the numbers that went in; headings and sensor rows are of single precision, and keep every bit.
    draw = np.random.default_rng(3)
    for heading in draw.uniform(-math.pi, math.pi, 200).astype(np.float32).tolist():
        pose = Odometry(0.1, -0.2, heading, 0.4, 12.3)
        message = messages.odometry_message(pose, "map", "car/base_link")
        assert np.float32(messages.yaw(message.pose.pose.orientation)) == np.float32(heading)
        assert seconds(message.header.stamp) == 12.3
    for width in (2, 4):
        rows = draw.normal(size=(8, width)).astype(np.float32)
        cloud = messages.cloud_message(rows, 1.0, "car/aligned")
        np.testing.assert_array_equal(messages.cloud_rows(cloud, width), rows)
        half = 4 * cloud.point_step
        cloud.height, cloud.width, cloud.row_step = 2, 4, half + 8  # two rows, each with 8 bytes without a meaning
        cloud.data = bytes(cloud.data)[:half] + bytes(range(8)) + bytes(cloud.data)[half:] + bytes(range(8))
        np.testing.assert_array_equal(messages.cloud_rows(cloud, width), rows)
        assert messages.cloud_rows(messages.cloud_message(rows[:0], 1.0, "map"), width).shape == (0, width)
    sent = Message(3, 2.5, 0.6, -0.8, 1.0, -2.0, (0.25, -1.0))
    assert messages.heard(messages.ring_message(sent, "map"), 3) == sent
    assert messages.heard(ros.JointState(name=["steering"], position=[1.0]), 3) is None
    (twist,) = messages.command_messages(Twist(0.5, -0.25), "twist", 1.0, 2.5, "car/base_link")
    assert (twist.linear.x, twist.angular.z) == (0.5, -0.25)
    tilted = ros.PoseStamped().pose.orientation
    tilted.w = 0.0  # no rotation at all
    assert math.isnan(messages.yaw(tilted))


@pytest.mark.parametrize(
    ("changes", "policy", "more"),
    [
        ({}, "kuramoto-mpcc-safe", {}),
        ({"messages.size": 5}, "partition-repair", {}),
        ({"robot.kind": "differential"}, "kuramoto-mpcc", {"command": "twist_stamped"}),
    ],
)
def test_the_run_is_the_simulation(changes, policy, more):
    # Oracle: the simulation without ROS, with messages of policies; commands in physical units round.
    scenario = lissajous_env.scenario("experiment", **AGILE | {"task.duration": 2.0} | changes)
    with Team(scenario, policy, world={"seed": 2} | more, **more) as team:
        played = team.world.play()
    wanted = record(baselines.make(policy, scenario), scenario, seed=2)
    np.testing.assert_array_equal(played.status, wanted.status)
    np.testing.assert_allclose(played.position, wanted.position, atol=1e-3)
    np.testing.assert_allclose(played.action[1:, :, :2], wanted.action[1:, :, :2], atol=1e-2)
    np.testing.assert_allclose(played.observation, wanted.observation, atol=1e-2)
    for name in ("spacing_factor", "min_separation", "phase_error"):
        assert played.score[name] == pytest.approx(wanted.score[name], rel=1e-3)


def test_cars_whose_speeds_come_from_motion_capture_follow_the_curve():
    # A physical story: with poses alone and commands of another type, five robots keep their distance.
    scenario = lissajous_env.scenario("experiment", **AGILE, **{"task.duration": 2.5})
    with Team(scenario, "kuramoto-mpcc", world={"command": "dart"}, command="dart", pose="pose") as team:
        played = team.world.play()
    assert played.speed[-1].min() > 0.3
    assert played.score["lateral_error_max"] < 0.2
    assert played.score["min_separation"] > 2 * scenario.robot.radius


def test_services_stop_and_resume_a_robot_which_reports_it():
    # A physical story: one robot is stopped by a person, and then told to continue.
    seen, scenario = {}, lissajous_env.scenario("experiment", **AGILE, **{"task.duration": 4.0})
    stopped, drives = "the robot was requested to stop", "drives"
    with Team(scenario, "open-loop-mpcc", fence=2.0) as team:
        listener = team.add(ros.Node("listener"))
        listener.create_subscription(
            ros.DiagnosticArray, "/diagnostics", lambda m: seen.update({m.status[0].name: m.status[0]}), 10
        )
        calls = {name: listener.create_client(ros.Trigger, f"/robot_1/{name}") for name in ("stop", "resume")}
        speeds, reports = [], []

        def reports_that(words):
            return lambda: "lissajous: robot_1" in seen and seen["lissajous: robot_1"].message == words

        def follow():
            speeds.append(team.world.simulation.robots.speed.numpy()[0].copy())
            for step, name in ((10, "stop"), (25, "resume")):
                if len(speeds) == step:
                    answer = calls[name].call_async(ros.Trigger.Request())
                    wait_until(answer.done, team.spin)
            for step, words in ((12, stopped), (28, drives)):
                if len(speeds) == step:
                    wait_until(reports_that(words), team.spin)
                    reports.append(seen["lissajous: robot_1"].level)

        team.world.recorded = False
        assert len(team.world.play(follow)) == 1, "only the first moment"
    speeds = np.array(speeds)
    assert (np.diff(speeds[12:25, 1]) < 0).all()  # rolls to a halt
    assert speeds[-1, 1] > speeds[25, 1]
    assert speeds[12:, [0, 2, 3, 4]].min() > 0.3
    assert reports == [ros.DiagnosticStatus.WARN, ros.DiagnosticStatus.OK]


def test_parameters_namespaces_and_remapping():
    arguments = ["--ros-args", "-r", "__ns:=/car3", "-r", "odom:=/vicon/car3", "-p", "command:=dart", "-p", "robot:=3"]
    node = node_of(RobotSettings(policy="open-loop-mpcc"), cli_args=arguments)
    try:
        assert node.onboard.robot == 3
        topics = dict(node.get_topic_names_and_types())
        assert topics["/car3/steering"] == ["std_msgs/msg/Float32"]
        assert topics["/vicon/car3"] == ["nav_msgs/msg/Odometry"]
    finally:
        node.destroy_node()


def test_wrong_parameters_are_refused():
    of_cars = "command must be car or dart for robots of kind car, got 'twist'"
    for argument, words in (("robot:=two", "node.robot must be of type int"), ("command:=twist", of_cars)):
        with pytest.raises(ValueError, match=words):
            node_of(RobotSettings(), cli_args=["--ros-args", "-p", argument])


def test_robots_that_are_missing_or_in_another_frame_are_named():
    scenario = lissajous_env.scenario("experiment", **{"task.duration": 0.6})
    with Team(scenario, "open-loop-mpcc", robots=[0, 2], world={"wait": 1.0}, frame="map") as team:
        lost = team.add(node_of(RobotSettings(robot=1, policy="open-loop-mpcc", frame="lab", pose="pose")))
        words = "the pose is in frame map, it must be lab"
        wait_until(lambda: lost.reason == words, lambda: (team.world._publish(), team.spin()))
        pose = messages.pose_message(Odometry(0.0, 0.0, 0.0, 0.0, team.world.now + 0.1), "lab")
        lost._take(pose.header, pose.pose)
        assert lost._loop.pose is None  # it has no speed yet, as those in the other frame do not count
        team.world.discovery = 30.0  # which is not waited for where robots are missing
        with pytest.raises(CommandError, match="no node of robot_3, robot_4 within 1 s"):
            team.world.play()
        assert team.world.now < 5.0  # a control step each quarter of a second
