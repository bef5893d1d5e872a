"""One robot's policy outside the simulator decides as in the simulator, and drives robots of another make."""

import numpy as np
import pytest

import baselines
import lissajous_env
from baselines.onboard import Limits, Message, Odometry, inputs_of
from baselines.onboard.signals import conversion_to_commands
from baselines.onboard.simulated import Vehicle
from baselines.policies import patrol
from baselines.policies.base import Filtered
from baselines.policies.safety.safe import Safe
from lissajous_env.logs.commands import actions_of_commands, commands_of_actions
from lissajous_env.theory.closed_forms import curve_point
from lissajous_env.theory.geometry import locate
from lissajous_env.world.observation import layout
from lissajous_env.world.state import REMOVED

CARS = [name for name in lissajous_env.scenarios() if lissajous_env.scenario(name).actuation == "car"]
MESSAGES = {"messages.size": 3, "noise.message_loss": 0.3, "noise.message_delay": 0.2}
PAIRS = [
    ("experiment", "kuramoto-mpcc"),
    (lissajous_env.scenario("rough", **{"robot.kind": "differential"}), "kuramoto-mpcc-safe"),
    ("rough-lost", "tracked-reference-mpcc"),
    ("evaders-lost", "partition-repair"),
    ("team", "sweep"),
    (lissajous_env.scenario("rough", **MESSAGES), "random"),
]


def play(name, policy, steps=None, seed=3, same_rows=False):
    """Compare rows and actions of every robot with those of the simulation; return the number of decisions.

    All bits must be equal, except of velocities in sight: half of two within 2e-7 (`device.trig`), used by filters.
    """
    scenario = lissajous_env.scenario(name).resolve()
    exact = [k for k, name in enumerate(layout(scenario).names) if "velocity" not in name]
    simulation = lissajous_env.Simulation(scenario, seed=seed)
    together = baselines.make(policy, scenario)
    alone = [baselines.Onboard(policy, scenario, i, Limits(*[np.inf] * 4)) for i in range(scenario.num_robots)]
    decide, decisions, tolerance = baselines.Onboard._decide, 0, 1e-5 * ("-safe" in policy and not same_rows)
    for robot in alone if same_rows else ():
        robot._decide = lambda row, robot=robot: decide(robot, observed[robot.robot])
    for k in range(steps or scenario.task.steps):
        observed = simulation.observation.numpy()[0].copy()
        action = together.act(simulation.observation).numpy().copy()
        for i in range(scenario.num_robots):
            if simulation.robots.status.numpy()[0, i] != int(REMOVED):
                inputs = inputs_of(simulation, i)
                output = alone[i].act(*inputs)
                at = f"robot {i} in step {k}"
                np.testing.assert_array_equal(output.row[exact], observed[i][exact], err_msg=at)
                np.testing.assert_allclose(output.row, observed[i], rtol=0, atol=4e-7, err_msg=at)
                np.testing.assert_allclose(output.action, action[0, i], rtol=0, atol=tolerance, err_msg=at)
                assert bool(output.stopped) != inputs.works
                decisions += 1
        simulation.step(action)
    return decisions


@pytest.mark.parametrize(("fields", "commands"), [
    ({}, [(0.35, 0.25), (-0.35, 0.1), (0.0, 0.175)]),
    ({"robot.kind": "differential", "robot.speed_max": 2.0, "robot.speed_min": -0.5, "robot.yaw_rate_max": 3.0},
     [(2.0, 3.0), (-0.5, -3.0), (0.0, 0.0)]),
])  # fmt: skip
def test_a_robot_is_commanded_the_input_of_its_action_and_its_base_understands_it(fields, commands):
    # Oracle: by hand; the base of a simulated robot understands the command as the same action.
    scenario = lissajous_env.scenario("experiment", **{"robot.steering_max": 0.35} | fields).resolve()
    command_of = conversion_to_commands(scenario)
    for action, wanted in zip([[1, 1], [-1, -1], [0, 0]], commands, strict=True):
        command, base = command_of(action), Vehicle(scenario, 1.0)
        assert command == pytest.approx(wanted, rel=1e-6)
        base.take(0.0, command)
        np.testing.assert_allclose(base.action(0.0), action, atol=1e-6)
    onboard = baselines.Onboard("random", scenario, 0)
    assert onboard.command_at(0.0) == pytest.approx((0.0, 0.1 if not fields else 0.0))
    actions = np.random.default_rng(0).uniform(-1, 1, (7, 3, 2)).astype(np.float32)
    restored = actions_of_commands(scenario.robot, commands_of_actions(scenario.robot, actions))
    np.testing.assert_allclose(restored, actions, atol=1e-6)
    assert actions_of_commands(scenario.robot, np.array([9.0, -9.0])).tolist() == [1, -1]


@pytest.mark.parametrize(("scenario", "policy"), PAIRS)
def test_actions_are_those_of_the_simulation(scenario, policy):
    # Oracle: the simulation with the team's policy; every bit, with noise, losses, delays, faults, removals, messages.
    steps = 40 if policy in ("sweep", "random") else 100
    assert play(scenario, policy, steps) > steps


@pytest.mark.long
@pytest.mark.parametrize("scenario", CARS)
def test_actions_of_every_policy_are_those_of_the_simulation(scenario):
    for policy in baselines.names(scenario):
        try:
            baselines.Onboard(policy, scenario, 0)
        except ValueError:  # it does not fit, or requires messages to all robots
            continue
        assert play(scenario, policy, same_rows=True) > lissajous_env.scenario(scenario).task.steps


@pytest.mark.parametrize("name", ["experiment", "hall"])
def test_the_phase_follows_the_curve_without_being_given_whether_or_not_a_pose_was_announced(name):
    # Oracle: the phase of the simulation. The first is found by the pose, and in a hall, where each place has four, by
    # those of the neighbours: the others follow by the same Newton steps.
    agile = {"robot.steering_max": 0.8, "robot.model_offset": None, "formation.start_noise": 0.0}  # on the whole curve
    scenario = lissajous_env.scenario(name, **agile).resolve()
    simulation, policy = lissajous_env.Simulation(scenario), baselines.make("kuramoto-mpcc", scenario)
    announces, other = (baselines.Onboard("kuramoto-mpcc", scenario, 2) for _ in range(2))
    for k in range(300):
        inputs = inputs_of(simulation, 2)
        for robot in (announces, other) if k == 150 else ():
            robot.reset()
        given = inputs[:2] if k in (0, 150) else inputs[:5]  # at first, no message has arrived
        message = announces.announce(inputs.odometry)
        output, expected = announces.act(*given), other.act(*given)
        assert output.message == expected.message
        assert output.message == message or (name == "hall" and k in (1, 151))
        np.testing.assert_array_equal(output.row, expected.row)
        np.testing.assert_array_equal(output.action, expected.action)
        np.testing.assert_allclose(output.message[2:4], inputs.phase, atol=1e-3 if name != "hall" or given[2:] else 2)
        simulation.step(policy.act(simulation.observation))
    np.testing.assert_allclose(output.message[2:4], inputs.phase, atol=1e-5)
    assert announces.announce(Odometry(np.nan, 0.0, 0.0, 0.0, 9.0)) is None


@pytest.mark.parametrize("name", ["experiment", "team", "hall"])
def test_the_phase_is_found_from_any_pose_on_the_curve(name):
    # Oracle: the phases from which the poses were made, crossings of the curve among them.
    scenario = lissajous_env.scenario(name).resolve()
    for theta in np.linspace(0, 2 * np.pi, 97):
        ahead, here = (curve_point(scenario.curve, scenario.alpha * np.array(theta + d)) for d in (1e-5, 0))
        heading = np.arctan2(*(ahead - here)[::-1])
        phase = locate(scenario.curve, scenario.alpha, *here, heading, theta)
        assert np.cos(phase - theta) > np.cos(2e-3)


def test_a_function_and_a_factory_are_policies():
    for policy in (lambda observation: np.zeros((*observation.shape[:2], 2), np.float32), patrol.Sweep):
        output = baselines.Onboard(policy, "experiment", 0).act(0.0, Odometry(1.7, 0.0, 1.5, 0.0, 0.0))
        assert output.action.shape == (2,)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"robot": 5}, "robot must be a whole number from 0 to 4, got 5"),
        ({"scenario": "failure", "policy": "kuramoto"}, "kind car or differential, got 'curve'"),
        ({"policy": "kuramoto"}, "which drives kind curve"),
        ({"policy": lambda team, *_: Filtered(baselines.make("sweep-proved", team), Safe)}, "filter -proved"),
        ({"scenario": "watch", "policy": lambda rows: rows}, "tracks_seen and sensing.teammates_seen must be 0"),
        ({"scenario": lissajous_env.scenario("experiment", **{"sensing.cells_seen": (4, 2)})}, "cells_seen must be"),
    ],
)
def test_what_does_not_fit_is_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        baselines.Onboard(**{"policy": "kuramoto-mpcc", "scenario": "experiment", "robot": 0} | changes)


def test_a_row_lists_the_nearest_of_what_the_sensor_detects():
    # Story: a sensor reports more than a row lists, the nearest last.
    onboard = baselines.Onboard("random", "experiment", 0)
    places = np.linspace(0.9, 0.1, 400)[:, None] * onboard.scenario.sight
    pose, seen = Odometry(1.7, 0.0, 1.5, 0.5, 0.0), {"robots": places * [1, 0, 0, 0], "targets": places * [0, -1]}
    rows = baselines.Rows(onboard.act(0.0, pose, **seen).row[None, None], onboard.scenario)
    for name, along in (("robot", 0), ("target", 1)):
        distances = np.abs(getattr(rows, f"{name}_offset")[0, 0, :, along])
        np.testing.assert_allclose(distances, np.sort(places[:, 0])[: len(distances)], rtol=1e-6)
    failed = baselines.Rows(onboard.act(0.1, pose, works=False, **seen).row[None, None], onboard.scenario)
    assert not failed.robots_seen.any()
    assert not failed.targets_seen.any(), "a robot that has failed senses nothing"


def test_messages_that_are_no_messages_are_ignored():
    onboard = baselines.Onboard("kuramoto-mpcc", "experiment", 0)
    pose, good = Odometry(1.7, 0.0, 1.5, 0.5, 0.0), Message(onboard.neighbours[0], 0.0, 1.0, 0.0, 1.0, 0.0)
    bad = [good._replace(sin_phase=float("nan")), good._replace(cos_phase=0.5), good._replace(sent_at=99.0)]
    bad += [good._replace(sender=0), good._replace(sender=-1), good._replace(numbers=(1.0,))]
    assert onboard.act(0.0, pose, bad).row[8] == 0
    row = onboard.act(0.1, pose, [good, good._replace(sent_at=-0.1, x=-1.0)]).row  # the second was sent before
    assert row[8] == 1
    assert row[12] == pytest.approx(0.5 * (good.x - pose.x) / onboard.scenario.curve.half_width)
    row = onboard.act(0.2, pose._replace(stamp=0.2), [good._replace(sent_at=0.165)]).row
    assert row[9] == pytest.approx(0.035 / onboard.scenario.time_unit, rel=1e-2)


@pytest.mark.parametrize("policy", ["sweep", "tracked-reference-mpcc"])
def test_the_steps_of_a_policy_follow_the_clock(policy):
    # Oracle: the same robot, called at every step. Calls are left out or made twice, or the first pose comes late.
    scenario = lissajous_env.scenario("experiment").resolve()
    simulation, together = lissajous_env.Simulation(scenario), baselines.make(policy, scenario)
    limits, calls = Limits(*[np.inf] * 5), []
    steady, uneven = (baselines.Onboard(policy, scenario, 0, limits) for _ in range(2))
    late = baselines.Onboard(lambda rows: calls.append(1) or np.zeros((1, 5, 2)), scenario, 0, limits)
    for k in range(60):
        inputs = inputs_of(simulation, 0)
        action = steady.act(*inputs).action
        if k != 20:
            uneven_action = uneven.act(*inputs).action
            if policy == "sweep" or k < 20:  # the other keeps a warm start besides the time
                np.testing.assert_array_equal(uneven_action, action)
            np.testing.assert_allclose(uneven_action, action, atol=0.02)
        before = len(calls)
        stopped = late.act(*inputs if k > 14 else inputs._replace(odometry=None)).stopped
        assert len(calls) - before == {15: 10, 16: 7}.get(k, k > 16), "it makes up for ten steps a call at most"
        assert ("16 steps behind" in stopped) == (k == 15)
        if k > 40:
            early = inputs._replace(now=inputs.now + 0.02)
            np.testing.assert_array_equal(uneven.act(*early).action, uneven_action)
        simulation.step(together.act(simulation.observation))
