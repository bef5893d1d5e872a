"""Classical policies: their computations, inputs, and results on the paper's scenarios."""

import math
from functools import partial

import numpy as np
import pytest

import baselines
import lissajous_env
from baselines.mpcc.solver import MpccParameters
from baselines.policies.coordinators import Consensus, Kuramoto
from baselines.policies.loops import SweepParameters, corner_radius, cruising_speed, fastest_speed, patrol_loop
from baselines.policies.patrol import Laps, Sweep
from baselines.policies.trackers import FieldParameters, WithMpcc, WithVectorField


def played(policy, simulation, steps):
    observation = simulation.observation
    for _ in range(steps):
        observation, *_ = simulation.step(policy.act(observation))
    return observation.numpy()


def test_kuramoto_acts_by_equation_1():
    """Oracle: (1) in float64 on the true phases, which points without noise observe exactly."""
    overrides = {"formation.start": "random", "formation.coupling": 0.7, "robot.phase_rate_max": 0.3 + 2 * 0.7}
    scenario = lissajous_env.scenario("failure", **overrides)
    simulation = lissajous_env.Simulation(scenario, num_worlds=8, seed=3)
    action = baselines.make("kuramoto", scenario, num_worlds=8).act(simulation.observation.numpy())
    phases = simulation.robots.phase.numpy()
    ahead = phases[:, scenario.neighbours] - phases[..., None]
    rates = 0.3 / scenario.alpha - 0.7 * np.sin(ahead).sum(axis=-1)
    np.testing.assert_allclose(action[..., 0] * simulation.scenario.robot.phase_rate_max, rates, atol=2e-6)


@pytest.mark.parametrize(("name", "overrides"), [
    ("experiment", {}), ("intruders", {}), ("intruders", {"targets.entry": "inside"}), ("evaders", {}),
    ("evaders", {"curve.half_width": 5.4, "curve.half_height": 1.0, "sensing.radius": 1.0}),
    ("evaders", {"curve.half_width": 1.0, "curve.half_height": 0.8, "sensing.radius": 0.1}),
])  # fmt: skip
def test_the_patrol_loop_can_be_driven(name, overrides):
    """Oracle: the loop's own curvature by finite differences, against the tightest turn of the car; a transposition."""
    scenario = lissajous_env.scenario(name, **{"task.contamination": None, **overrides})
    loop = patrol_loop(scenario)
    sides = np.roll(loop, -1, axis=0) - loop
    turns = np.abs(np.angle(np.exp(1j * np.diff(np.unwrap(np.arctan2(sides[:, 1], sides[:, 0]))))))
    window = 40
    radius = window * np.linalg.norm(sides, axis=1).mean() / np.convolve(turns, np.ones(window), "valid").max()
    tightest = scenario.robot.wheelbase / math.tan(scenario.robot.steering_max)
    assert radius > 0.8 * min(corner_radius(scenario), tightest)
    assert (np.abs(loop) <= [scenario.curve.half_width, scenario.curve.half_height]).all()
    tall = {"curve.half_width": scenario.curve.half_height, "curve.half_height": scenario.curve.half_width}
    same = SweepParameters(corner=corner_radius(scenario))
    np.testing.assert_array_equal(patrol_loop(lissajous_env.scenario(scenario, **tall), same), loop[::-1, ::-1])


def test_still_cars_come_to_rest():
    """Oracle: below the dead zone the car coasts, v = v0 exp(-c t)."""
    simulation = lissajous_env.Simulation(lissajous_env.scenario("experiment"))
    start = simulation.robots.speed.numpy().copy()
    played(baselines.make("still", "experiment"), simulation, 50)
    np.testing.assert_allclose(simulation.robots.speed.numpy(), start * math.exp(-0.945 * 5.0), rtol=1e-3)
    # Law: what the wall rule changed before does not matter.
    simulation, policy = lissajous_env.Simulation("evaders-walls"), baselines.make("still", "evaders-walls")
    seen, first = simulation.observation.numpy().copy(), policy.act(simulation.observation).numpy().copy()
    played(policy, simulation, 60)
    np.testing.assert_array_equal(policy.act(seen), first)


def test_the_experiment_is_the_papers():
    """Oracle: Fig. 9 (eta_1 = 1.2429, one collision at 0.192 m) and an independent simulation with IPOPT."""
    scenario = lissajous_env.scenario("experiment", **{"faults.schedule": ()})
    rows = lissajous_env.evaluate(baselines.make("kuramoto-mpcc", scenario, num_worlds=6), scenario, range(6))
    assert all(1.10 < row["spacing_factor"] < 1.30 for row in rows)
    assert min(row["min_separation"] for row in rows) < 0.25
    assert np.mean([row["tracking_error_mean"] for row in rows]) == pytest.approx(0.137, abs=0.025)
    assert np.max([row["phase_error"] for row in rows]) < 0.3
    without = lissajous_env.evaluate(baselines.make("open-loop-mpcc", scenario, num_worlds=6), scenario, range(6))
    # Without feedback the cars, which differ, drift apart: the formation is lost, and robots meet on every lap.
    assert np.mean([row["phase_error"] for row in without]) > 2.5 * np.mean([row["phase_error"] for row in rows])
    assert np.mean([row["spacing_factor"] for row in without]) > 1.35
    assert np.mean([r["collisions"] for r in without]) > 5 * np.mean([r["collisions"] for r in rows])


@pytest.mark.parametrize(("size", "steps"), [(1, 200), (100, 4000)])
def test_laps_are_driven_as_fast_as_the_formation(size, steps):
    """Oracle: the loop itself, and the formation's top speed less what corners and chords cost."""
    large = {"curve.half_width": 5.4 * size, "curve.half_height": 2.4 * size, "task.duration": 1e3}
    scenario = lissajous_env.scenario("intruders", **{"targets.arrival_rate": 0.0, "task.grid": None}, **large)
    simulation, policy = lissajous_env.Simulation(scenario), baselines.make("laps", scenario)
    played(policy, simulation, steps)
    before = simulation.robots.position.numpy()[0, :, :2].copy()
    played(policy, simulation, 10)
    after = simulation.robots.position.numpy()[0, :, :2]
    assert (np.linalg.norm(after - before, axis=1) > 0.85 * fastest_speed(scenario)).all()
    assert np.linalg.norm(after[:, None] - patrol_loop(scenario)[None], axis=2).min(axis=1).max() < 0.3
    assert (before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] > 0).all(), "counter-clockwise"


def test_cars_with_little_grip_return_to_their_loop():
    """Story: cars of the formation's speed slide around outside for 83 and 66 robot-seconds; slower cars turn."""
    scenario = lissajous_env.scenario("evaders", **{"robot.lateral_acceleration_max": 2.0, "task.duration": 20.0})
    for name, outside in (("sweep", 12.0), ("laps", 8.0)):
        (row,) = lissajous_env.evaluate(baselines.make(name, scenario), scenario, [1])
        assert row["outside_time"] < outside


def test_a_patrol_is_what_its_parameters_say():
    scenario = lissajous_env.scenario("intruders", **{"targets.arrival_rate": 0.0})
    half = np.array([scenario.curve.half_width, scenario.curve.half_height])
    loop = patrol_loop(scenario, parameters=SweepParameters(inset=0.5))
    assert np.abs(loop).max(axis=0) == pytest.approx(half - 0.5, abs=1e-3)
    bowed = patrol_loop(scenario, parameters=SweepParameters(inset=0.1, corner=1.0, bow=0.3))
    for k, corner in ((0, half[1]), (1, half[0])):
        from_side = half[k] - np.abs(bowed[:, k])
        in_middle = np.abs(bowed[:, 1 - k]) < 0.02
        share = min((corner - 0.1 - 1.0) / 2, 1)  # of the bow, which is whole two radii from the corner
        assert from_side[in_middle] == pytest.approx(0.1 + 0.3 * share**2 * (3 - 2 * share), abs=5e-3)
    # The arc of a corner of 1 m is (sqrt 2 - 1) m closer to the middle than the corner of the loop.
    assert np.linalg.norm(half - np.abs(bowed), axis=1).min() == pytest.approx(0.1 * 2**0.5 + 2**0.5 - 1, abs=2e-3)
    lanes = patrol_loop(scenario, parameters=SweepParameters(lanes=4))
    crossings = np.flatnonzero(np.diff(np.sign(lanes[:, 0] - 0.1)))
    assert len(crossings) == 4
    simulation, laps = lissajous_env.Simulation(scenario), Laps(scenario, parameters=SweepParameters(lookahead=100.0))
    played(laps, simulation, 2)
    assert (abs(laps._memory.numpy() - len(loop) / 2) <= len(loop) / 2).all(), "on the loop, also laps ahead"
    policy = Sweep(scenario, parameters=SweepParameters(cruise=0.8))
    played(policy, simulation, 300)
    before = simulation.robots.position.numpy()[0, :, :2].copy()
    played(policy, simulation, 10)
    gone = np.linalg.norm(simulation.robots.position.numpy()[0, :, :2] - before, axis=1)
    assert gone == pytest.approx(0.8, abs=0.1)


def test_the_places_of_a_patrol_start_from_rest():
    """Oracle: the integral of the places' speed, c (t - g (1 - exp(-t / g))) ahead of where each began."""
    scenario = lissajous_env.scenario("intruders", **{"targets.arrival_rate": 0.0})
    length = np.linalg.norm(np.diff(loop := patrol_loop(scenario), axis=0, append=loop[:1]), axis=1).sum()
    reached = []
    for gather in (0.0, 4.0):
        simulation = lissajous_env.Simulation(scenario)
        played(Sweep(scenario, parameters=SweepParameters(gather=gather)), simulation, 400)
        places = simulation.robots.position.numpy()[0, :, :2]
        reached.append(np.linalg.norm(places[:, None] - loop, axis=2).argmin(axis=1) * length / len(loop))
    behind = (reached[0] - reached[1]) % length
    assert behind == pytest.approx(4.0 * cruising_speed(scenario) * (1 - np.exp(-10)), abs=0.1)


def test_cars_with_a_lowest_speed_reach_their_places_along_the_loop():
    """Oracle: the distances of the cars from the loop, and from one another along it."""
    scenario = lissajous_env.scenario("intruders", **{"targets.arrival_rate": 0.0})
    loop = patrol_loop(scenario)
    length = np.linalg.norm(np.diff(loop, axis=0, append=loop[:1]), axis=1).sum()
    farthest, uneven = [], []
    for slowest, by_phase in ((None, False), (0.3, False), (None, True)):
        policy = Sweep(scenario, 12, "cpu", SweepParameters(gather=2.0, slowest=slowest, by_phase=by_phase))
        simulation, away = lissajous_env.Simulation(scenario, 12, seed=1), []
        for steps in (60, *[5] * 12, 80):
            played(policy, simulation, steps)
            distances = np.linalg.norm(simulation.robots.position.numpy()[:, :, None, :2] - loop, axis=3)
            away.append(distances.min(axis=2).max())
        farthest.append(max(away[:-1]))
        along = np.sort(distances.argmin(axis=2), axis=1) * length / len(loop)
        gaps = np.diff(along, axis=1, append=along[:, :1] + length)
        uneven.append((np.abs(gaps - length / 5).max(axis=1) > 1).mean())
    assert farthest[1] < 0.15 < 0.3 < farthest[0]
    # Robots disagree on the order of their places; those by the phase alone are evenly spaced, but for the deviations.
    assert uneven[2] < 0.1 < uneven[0]


@pytest.mark.parametrize("fields", [{}, {"slowest": 0.3}, {"by_phase": True}])
def test_the_file_of_a_displaced_team_is_even(fields):
    displaced = {"formation.displaced": ((1, 0.23), (2, 0.4)), "formation.start_noise": 0.0}
    simulation = lissajous_env.Simulation(lissajous_env.scenario("evaders", **displaced))
    policy = Sweep(simulation.scenario, parameters=SweepParameters(**fields))
    policy.act(simulation.observation)
    places = np.sort(policy._memory.numpy()[0, :, 0] % (size := len(patrol_loop(simulation.scenario))))
    assert np.diff(places, append=places[0] + size) == pytest.approx(size / 5, abs=5)


@pytest.mark.parametrize(("default", "changed"), [
    (partial(WithMpcc, Kuramoto), lambda s: MpccParameters.of(s, weight_throttle=0.5)),
    (partial(WithVectorField, Consensus), lambda s: FieldParameters(turn=2.0)),
    (Sweep, lambda s: SweepParameters(lookahead=1.5)),
])  # fmt: skip
def test_parameters_reach_the_controller(default, changed):
    scenario = (simulation := lissajous_env.Simulation("experiment")).scenario
    one, other = default(scenario), default(scenario, parameters=changed(scenario))
    played(one, simulation, 10)
    assert np.abs(one.act(simulation.observation).numpy() - other.act(simulation.observation).numpy()).max() > 0.01
