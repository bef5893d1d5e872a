"""The rules by which a robot outside the simulator stops: each is broken once, and only that one stops the robot."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import baselines
import lissajous_env
from baselines.onboard import Limits, Message, Odometry, inputs_of

STEP = 0.1
POSE = Odometry(1.7, 0.1, 1.5, 0.5, 0.0)
REST = (0.0, 0.1)


class Robot:
    """Robot 0 of the experiment, with its neighbours' messages in each step unless a test leaves something out."""

    def __init__(self, **limits):
        self.onboard = baselines.Onboard("kuramoto-mpcc", "experiment", 0, limits=Limits(**limits))
        self.now = 0.0

    def call(self, after=STEP, pose=POSE, age=0.0, hears=True, **more):
        self.now += after
        heard = [Message(j, self.now, 1.0, 0.0, 1.0, 0.0) for j in self.onboard.neighbours] if hears else []
        odometry = pose._replace(stamp=self.now - age) if pose is not None else None
        return self.onboard.act(self.now, odometry, heard, **more)


def is_at_rest(output):
    return output.command == pytest.approx(REST)


@pytest.mark.parametrize(("fault", "words"), [
    ({"age": 0.3}, "the pose is 0.3 s old, the limit is 0.25 s"),
    ({"age": -0.3}, "of 0.3 s from now"),
    ({"pose": None}, "there is no pose"),
    ({"pose": POSE._replace(x=math.nan)}, "the pose is not finite"),
    ({"pose": POSE._replace(speed=math.inf)}, "the pose is not finite"),
    ({"pose": POSE._replace(heading=1e300)}, "the pose is not finite"),  # where a row has float32
    ({"robots": [(0.1, math.nan, 0, 0)]}, "sensor's data is not finite"),
    ({"targets": [(math.inf, 0)]}, "sensor's data is not finite"),
    ({"phase": (1e39, 0.0)}, "the phase or of the sensor's data is not finite"),
    ({"works": False}, "does not work"),
])  # fmt: skip
def test_bad_input_stops_a_robot_until_it_is_good_again(fault, words):
    robot = Robot()
    assert robot.call().stopped == ""
    output = robot.call(**fault)
    assert words in output.stopped
    assert is_at_rest(output)
    assert output.row[7] == 0  # as in the simulator, its policy observes that it has failed
    assert np.isfinite(output.row).all()
    assert robot.call().stopped == ""


@pytest.mark.parametrize(("fault", "words"), [
    ({"after": 0.5}, "the clock jumped by 0.5 s"),
    ({"after": -0.1}, "the clock went back by 0.1 s"),
    ({"after": 0.0}, "the clock stopped"),
    ({"pose": POSE._replace(x=3.0)}, "1.2 m outside of the rectangle"),
    ({"pose": POSE._replace(y=-2.0)}, "1.2 m outside of the rectangle"),
])  # fmt: skip
def test_some_faults_stop_a_robot_until_a_person_resumes_it(fault, words):
    robot = Robot()
    robot.call()
    assert words in robot.call(**fault).stopped
    output = robot.call()
    assert words in output.stopped
    assert is_at_rest(output)
    robot.onboard.resume()
    assert robot.call().stopped == ""


@pytest.mark.parametrize(("jump", "steps"), [(-0.4, [3, 2, 1]), (3.0, [21, 12]), (-3600.0, []), (1e6, [])])
def test_a_policy_makes_up_for_a_jump_of_the_clock_or_begins_anew_after_one_by_more_than_an_episode(jump, steps):
    robot = Robot()
    assert [robot.call().stopped, "the clock" in robot.call(after=jump).stopped] == ["", True]
    robot.onboard.resume()
    assert [f"the policy is {off} step" in robot.call().stopped for off in steps] == [True] * len(steps)
    assert robot.call().stopped == ""
    age = robot.call(hears=False).row[9] * robot.onboard.scenario.time_unit
    assert age == pytest.approx(STEP, rel=1e-3), "messages since then count"


def test_a_robot_with_good_input_drives_until_it_is_told_to_stop_and_then_still_sends_its_phase():
    robot = Robot()
    for _ in range(30):
        before = robot.call()
        assert before.stopped == ""
        assert not is_at_rest(before)
    turned = POSE._replace(heading=POSE.heading + 2e6 * math.pi)
    assert robot.call(pose=turned).row == pytest.approx(before.row, abs=1e-5), "headings may be unwrapped"
    robot.onboard.stop()
    assert robot.onboard.command_at(robot.now) == pytest.approx(REST)
    output = robot.call()
    assert output.stopped == "the robot was requested to stop"
    assert output.message.sent_at == robot.now
    assert output.message[2:6] == pytest.approx(before.message[2:6], abs=1e-3)
    robot.onboard.resume()
    assert robot.call().stopped == ""


@pytest.mark.parametrize("was_heard", [True, False])
def test_a_silent_neighbour_stops_a_robot_that_listens_from_the_first_call_on(was_heard):
    robot = Robot(silence=0.35)
    robot.call(hears=was_heard)
    stopped = [bool(robot.call(hears=False).stopped) for _ in range(6)]
    assert stopped == [False, False, False, True, True, True]
    assert robot.call().stopped == ""
    robot.onboard = baselines.Onboard("open-loop-mpcc", "experiment", 0, limits=Limits(silence=0.35))
    assert [robot.call(hears=False).stopped for _ in range(8)] == [""] * 8, "it does not listen"


def test_an_action_that_is_not_finite_stops_a_robot():
    def broken(observation):
        return np.full((*observation.shape[:2], 2), np.nan)

    onboard = baselines.Onboard(broken, "experiment", 0)
    output = onboard.act(0.0, POSE)
    assert output.stopped == "the action of the policy is not finite"
    assert is_at_rest(output)


@settings(max_examples=60)
@given(st.lists(st.tuples(st.booleans(), st.floats(-0.5, 0.5)), min_size=1, max_size=20))
@example([(True, 0.0), (False, -0.5), (False, -0.5)])
def test_no_command_outlives_the_watchdog(moves):
    # Whatever the clock does: a command that is not that of rest is at most 0.2 s old.
    robot, driven_at = ROBOT, None
    latest = robot.now
    robot.onboard.reset()
    for calls, after in moves:
        if calls:
            stopped = robot.call(after=after).stopped
            driven_at = None if stopped else robot.now
            latest = max(latest, robot.now)
        else:
            robot.now += after
        command = robot.onboard.command_at(robot.now)
        if command != pytest.approx(REST):
            assert driven_at is not None
            assert 0 <= robot.now - driven_at <= 0.2
    assert robot.onboard.command_at(math.nan) == pytest.approx(REST)
    assert robot.onboard.command_at(latest + 1.0) == pytest.approx(REST)


ROBOT = Robot(watchdog=0.2, clock_jump=10.0)


@pytest.mark.parametrize("name", ["intruders", "rough"])
def test_the_limits_let_the_shipped_robots_drive(name):
    # With the limits of a scenario, robots stop only where the simulated ones fail.
    scenario = lissajous_env.scenario(name).resolve()
    simulation, policy = lissajous_env.Simulation(scenario, seed=1), baselines.make("kuramoto-mpcc", scenario)
    onboard = [baselines.Onboard("kuramoto-mpcc", scenario, i) for i in range(scenario.num_robots)]
    for _ in range(120):
        for i, robot in enumerate(onboard):
            inputs = inputs_of(simulation, i)
            assert robot.act(*inputs).stopped == ("" if inputs.works else "the robot does not work")
        simulation.step(policy.act(simulation.observation))


def test_input_of_another_type_is_refused_by_name():
    bad = [("robots", [(1.0, 2.0)], "rows of 4"), ("targets", "none", "real number"), ("heard", [3], "have messages")]
    bad += [("odometry", tuple(POSE), "be a baselines.onboard.Odometry")]
    for name, value, rule in (*bad, ("odometry", POSE._replace(x="left"), "have five")):
        with pytest.raises(ValueError, match=f"{name} must .*{rule}.* got"):
            Robot().onboard.act(0.1, **{"odometry": POSE, name: value})
