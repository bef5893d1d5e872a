"""Parts of the nodes of ROS 2 that do not require it: frames, speeds, the order of steps, and a robot's base."""

import math
import sys

import numpy as np
import pytest
from command_line import called
from hypothesis import given, settings
from hypothesis import strategies as st

import baselines.ros
import lissajous_env
from baselines.onboard import Command, Limits, Odometry
from baselines.onboard.simulated import Vehicle
from baselines.ros.control_loop import ControlLoop, SpeedOfPoses, in_scenario_frame, relative_to_robot
from baselines.ros.settings import RobotSettings
from lissajous_env.logs.samples import moved

EXPERIMENT = lissajous_env.scenario("experiment").resolve()
STEP = EXPERIMENT.task.step
PLACES = st.floats(-50, 50)
ANGLES = st.floats(-3.1, 3.1)


@given(PLACES, PLACES, ANGLES, PLACES, PLACES, ANGLES)
def test_a_pose_of_the_laboratory_comes_back(x, y, heading, own_x, own_y, own_heading):
    outside = moved(np.array([own_x, own_y]), (x, y, heading))
    back = in_scenario_frame((x, y, heading), *outside, own_heading + heading)
    np.testing.assert_allclose(back[:2], (own_x, own_y), atol=1e-9)
    assert math.cos(back[2] - own_heading) == pytest.approx(1)


@given(ANGLES, ANGLES, PLACES, PLACES)
def test_a_sensor_reports_the_same_in_each_frame(heading, origin_heading, x, y):
    # Oracle: the same robot and target, written in the frame of the robot, of the laboratory, and of the axes.
    origin, pose = (2.0, -1.0, origin_heading), Odometry(x, y, heading, 0.7, 0.0)
    away, velocity = np.array([0.6, -0.3]), np.array([0.2, 0.5])  # relative, along the scenario's axes

    def turned(vector, angle):
        after = complex(*vector) * np.exp(1j * angle)
        return [after.real, after.imag]

    moves = velocity + 0.7 * np.array([math.cos(heading), math.sin(heading)])
    absolute = [*moved(np.array([x, y]) + away, origin), *turned(moves, origin_heading)]
    body = [*turned(away, -heading), *turned(velocity, -heading)]
    for own in ("map", "lab/aligned", "lab/base_link"):
        for row, frame in ((absolute, own), (body, "car/base_link"), ([*away, *velocity], "car/aligned")):
            rows = relative_to_robot(np.array([row], dtype=np.float64), frame, own, pose, origin)
            np.testing.assert_allclose(rows, [[*away, *velocity]], atol=2e-5)
        assert relative_to_robot(np.zeros((1, 4)), "car/base_link", own, None, origin) is None
    with pytest.raises(ValueError, match="must be map, or end in base_link or aligned, got 'laser'"):
        relative_to_robot(np.zeros((1, 2)), "laser", "map", pose, origin)


@pytest.mark.parametrize("rate", [10, 100])
def test_the_speed_of_poses_on_a_circle(rate):
    # Oracle: a circle of radius 2 m at 0.8 m/s; the chord is shorter than the arc by less than 1 in 1,000.
    speeds, measured = [], SpeedOfPoses(0.1)
    for k in range(rate):
        angle = 0.4 * k / rate
        place = 2 * math.cos(angle), 2 * math.sin(angle)
        assert math.isnan(measured.add(math.nan, 0.0, 0.0, 5 + (k - 0.5) / rate).speed), "a lost pose, and only that"
        if (odometry := measured.add(*place, angle + math.pi / 2, 5 + k / rate)) is not None:
            speeds.append(odometry.speed)
        assert measured.add(*place, angle, 5 + k / rate) is None  # a repetition changes nothing
    np.testing.assert_allclose(speeds, 0.8, rtol=1e-3)
    assert (len(speeds), measured.add(0.0, 0.0, 0.0, 9.0)) == (rate - 1, None), "after a gap there is no speed"


@given(st.lists(st.tuples(st.floats(0.0, 0.4), st.sampled_from([None, 0.1, math.nan, math.inf])), max_size=20))
def test_no_sound_command_outlives_the_watchdog_of_a_base(moves):
    vehicle, now, last = Vehicle(EXPERIMENT, 0.25), 0.0, -1.0
    for after, steering in moves:
        now += after
        if steering is not None:
            vehicle.take(now, Command(steering, 0.12))
            last = now if math.isfinite(steering) else last
        rests = vehicle.action(now)[1] == -1
        assert rests == (now - last > 0.25 or last < 0)


@pytest.mark.parametrize("rate", [10, 30, 100])
@pytest.mark.parametrize(("offset", "again"), [(0.0, False), (0.06, False), (0.0, True)])
def test_a_robot_acts_once_in_each_step_at_any_rate_of_poses(rate, offset, again):
    # Oracle: the number of control steps; the clock is looked at every 5 ms. Poses that arrive again change nothing.
    clock = [0.0]
    loop = ControlLoop(baselines.Onboard("open-loop-mpcc", EXPERIMENT, 0), 0.02, lambda: clock[0])
    loop.start(0.0)
    acts, stamps, count = [], [], 0
    for k in range(1000):
        now = clock[0] = 0.005 * k
        if now >= 0.3 + offset + count / rate:
            count += 1
            loop.take(pose := Odometry(1.7, 0.0, 1.5, 0.4, now))
        elif again and count > 0:
            loop.take(pose)
        if (announced := loop.announce(now)) is not None:
            stamps.append(announced.sent_at)
        if (output := loop.act(now)) is not None:
            assert output.stopped == "" or now < 0.6
            acts.append(now)
    assert len(acts) == pytest.approx(5.0 / STEP, abs=3)
    assert np.diff(acts)[5:] == pytest.approx(STEP, abs=0.05)
    assert len(stamps) == pytest.approx(4.7 / STEP, abs=3)
    # Nearly every act follows a pose of that moment.
    late = [now - max(stamp for stamp in stamps if stamp <= now) for now in acts[6:]]
    assert np.mean(np.array(late) <= 0.021) > 0.95


@given(st.lists(st.tuples(st.booleans(), st.booleans(), st.integers(1, 3)), min_size=12, max_size=12))
@settings(max_examples=60)
def test_a_robot_drives_by_a_simulated_clock_in_any_order_of_clock_and_pose(steps):
    # The world sends clock and pose, in any order, and again until the robot has decided if it is patient.
    wall = [0.0]
    onboard = baselines.Onboard("kuramoto-mpcc", EXPERIMENT, 0, limits=Limits(silence=math.inf))
    loop = ControlLoop(onboard, 0.025, lambda: wall[0])
    now, acts = 3.6, []
    loop.start(now)

    def arrives(is_pose, time, ticks):
        nonlocal now
        if is_pose:
            loop.take(Odometry(1.7, 0.0, 1.5, 0.4, time))
        else:
            now = time
        for _ in range(ticks):
            wall[0] += 0.01
            loop.announce(now)
            if (output := loop.act(now)) is not None:
                acts.append((now, output.stopped))

    for k, (pose_comes_first, is_patient, ticks) in enumerate(steps):
        time = now + STEP
        for _ in range(6 if is_patient or k % 2 or k == 10 else 1):
            arrives(pose_comes_first, time, ticks)
            arrives(not pose_comes_first, time, ticks)
            if acts and acts[-1][0] == time:
                break
    assert np.diff([time for time, _ in acts]).min() > 0, "it never acts twice at one time"
    assert acts[-1][0] == time, "it acts at the time of a patient world"
    assert not any("clock" in reason for _, reason in acts)
    assert not acts[-1][1], "it drives after two steps of a patient world"


def test_a_robot_waits_for_its_neighbours_but_not_for_long():
    clock = [0.0]
    loop = ControlLoop(baselines.Onboard("kuramoto-mpcc", EXPERIMENT, 0), 0.02, lambda: clock[0])

    def acts_at(now):
        clock[0] = now
        return loop.act(now) is not None

    def take(now):
        clock[0] = now
        loop.take(Odometry(1.7, 0.0, 1.5, 0.4, now))
        return loop.announce(now)

    loop.start(0.99)
    take(1.0)
    assert [acts_at(now) for now in (1.0, 1.015, 1.021)] == [False, False, True]
    announced = take(1.1)
    assert not acts_at(1.101)
    for sender in loop.heard:
        loop.heard[sender] = announced._replace(sender=sender, sent_at=1.09)
    assert acts_at(1.102)
    assert take(1.11) is None, "too early"
    assert not acts_at(1.24)
    assert acts_at(1.26), "on the last pose"
    assert loop.announce(1.26) is None, "not twice at one time, as while the clock of a simulation stands still"
    assert loop.announce(1.27) is not None
    loop.start(1.9)
    assert not any(loop.heard.values()), "a message of before the start may be of another clock"
    assert acts_at(2.1), "without a pose"
    assert not acts_at(2.2), "the pose of this step may still come"
    assert loop.act(1.0).stopped == "the clock went back by 1.1 s"


def test_old_detections_are_not_passed_on():
    rows = []
    for stamp in (1.0, 0.5, None):
        loop = ControlLoop(baselines.Onboard("open-loop-mpcc", EXPERIMENT, 0), 0.0, lambda: 0.0)
        loop.start(0.9)
        if stamp is not None:
            loop.detections["targets"] = stamp, [(0.1, 0.0)]
        loop.take(Odometry(1.7, 0.0, 1.5, 0.4, 1.0))
        assert loop.announce(1.0) is not None
        rows.append(loop.act(1.0).row)
    assert (rows[0] != rows[1]).any()
    np.testing.assert_array_equal(rows[1], rows[2])


def test_wrong_settings_are_refused():
    with pytest.raises(ValueError, match=r"node.command must be one of car, dart, twist, twist_stamped, got 'boat'"):
        RobotSettings(command="boat")
    with pytest.raises(ValueError, match=r"node.origin must be x, y \[m\] and heading \[rad\], got"):
        RobotSettings(origin=(0.0, 1.0))


@pytest.mark.parametrize("command", ["robot", "world", "launch"])
def test_without_ros_the_extra_is_named(command, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rclpy", None)  # importing it raises ImportError
    for name in [name for name in sys.modules if name.startswith("baselines.ros.")]:
        monkeypatch.delitem(sys.modules, name)
        monkeypatch.delattr(baselines.ros, name.rpartition(".")[2])
    code, _, error = called(capsys, "ros", command)
    assert code == 2
    assert 'pip install "lissajous-env[ros]"' in error
    assert len(error.splitlines()) == 1
