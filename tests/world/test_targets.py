"""Targets: arrival, motion and detection."""

import math

import numpy as np
import pytest

import lissajous_env

# One robot that sees next to nothing, and targets that stay: nothing disturbs them.
ALONE = {
    "robot.count": 1, "formation.p": 0, "formation.ring": None, "faults.schedule": (), "sensing.radius": 1e-3,
    "targets.leave": False, "task.grid": None, "targets.arrival_rate": 0.0,
}  # fmt: skip
WIDE = {"curve.half_width": 40.0, "curve.half_height": 30.0}


def undisturbed(worlds=1, seed=0, name="experiment", **overrides):
    return lissajous_env.Simulation(lissajous_env.scenario(name, **{**ALONE, **overrides}), worlds, seed=seed)


def stand_still(simulation, steps=1):
    """Let the robots roll out, or stand where they are points."""
    action = np.zeros(simulation.action_shape, dtype=np.float32)
    if simulation.scenario.robot.kind == "car":
        action[..., 1] = -1
    for _ in range(steps):
        simulation.step(action)


def places(simulation):
    return simulation.targets.position.numpy().astype(float)


# Appearance.


@pytest.mark.parametrize("rate", [0.05, 3.0])
def test_arrivals_are_a_poisson_process(rate):
    # Oracle: mean and variance of a Poisson count are rate x time, and the times are spread evenly over the episode.
    duration = 20.0
    overrides = {"targets.count": 2, "targets.arrival_rate": rate, "task.duration": duration}
    simulation = undisturbed(3000, **overrides)
    steps = simulation.targets.appears_at.numpy()
    assert (steps[:, :2] == 0).all()
    arrivals = steps[:, 2:]
    assert (np.diff(arrivals, axis=1) >= 0).all()
    assert arrivals.min() >= 1
    counts = (arrivals <= 200).sum(axis=1)
    mean = rate * duration
    assert abs(counts.mean() - mean) < 4 * math.sqrt(mean / 3000)
    assert counts.var() == pytest.approx(mean, rel=0.15)
    # Six standard deviations of room: no world of 3,000 runs out of slots.
    assert arrivals.shape[1] == math.ceil(mean + 6 * math.sqrt(mean))
    assert counts.max() < arrivals.shape[1]
    times = arrivals[arrivals <= 200] / 200
    assert abs(times.mean() - 0.5) < 0.01 + 4 / math.sqrt(12 * times.size)
    assert times.var() == pytest.approx(1 / 12, rel=0.1)


def test_an_intruder_stands_on_the_boundary_when_it_appears():
    # Oracle: a uniform point of the perimeter lies on a long side with probability A / (A + B), and along it evenly.
    simulation = undisturbed(500, **{"targets.count": 40, "targets.entry": "boundary"})
    x, y = places(simulation).reshape(-1, 2).T
    half_width, half_height = 1.8, 0.8
    on_short = np.abs(np.abs(x) - half_width) < 1e-6
    on_long = np.abs(np.abs(y) - half_height) < 1e-6
    assert (on_short | on_long).all()
    assert (np.abs(x) <= half_width + 1e-6).all()
    assert (np.abs(y) <= half_height + 1e-6).all()
    share = half_width / (half_width + half_height)
    deviation = 4 / math.sqrt(len(x))
    assert abs(on_long.mean() - share) < deviation
    for along, side, half in [(x, on_long & (y > 0), half_width), (x, on_long & (y < 0), half_width),
                              (y, on_short & (x > 0), half_height), (y, on_short & (x < 0), half_height)]:  # fmt: skip
        assert abs(along[side].mean() / half) < 0.05
        assert (along[side] / half).var() == pytest.approx(1 / 3, rel=0.05)
    assert abs((y[on_long] > 0).mean() - 0.5) < deviation
    assert abs((x[on_short] > 0).mean() - 0.5) < deviation


def test_a_target_inside_is_anywhere_in_the_rectangle():
    # Oracle: mean and variance of a uniform distribution, and no correlation.
    simulation = undisturbed(500, **{"targets.count": 40})
    x, y = (places(simulation) / [1.8, 0.8]).reshape(-1, 2).T
    headings = simulation.targets.heading.numpy().ravel()
    assert np.abs([x.mean(), y.mean(), (x * y).mean()]).max() < 4 / math.sqrt(len(x))
    assert x.var() == pytest.approx(1 / 3, rel=0.03)
    assert y.var() == pytest.approx(1 / 3, rel=0.03)
    assert abs(np.exp(1j * headings).mean()) < 4 / math.sqrt(len(x))
    assert np.abs(x).max() <= 1


def test_motions_have_their_shares():
    # Oracle: binomial deviations.
    overrides = {"targets.drifting": 0.2, "targets.wandering": 0.3, "targets.fleeing": 0.1, "targets.count": 50}
    motion = undisturbed(200, **overrides).targets.motion.numpy().ravel()
    shares = np.bincount(motion, minlength=4) / len(motion)
    assert shares == pytest.approx([0.4, 0.2, 0.3, 0.1], abs=4 * 0.5 / math.sqrt(len(motion)))


# Motion.


def test_a_wandering_heading_walks_at_random():
    # Oracle: a random walk of independent steps has variance turn_rate^2 time; after a second it is normal (kurtosis).
    overrides = {"targets.turn_rate": 0.8, "targets.speed": 0.3, "targets.count": 200}
    simulation = undisturbed(100, **overrides, **WIDE)
    before, place = simulation.targets.heading.numpy().astype(float), places(simulation)
    far_inside = (np.abs(place) < [38, 28]).all(axis=-1)
    headings = [before]
    for _ in range(10):
        stand_still(simulation)
        headings.append(simulation.targets.heading.numpy().astype(float))
        moved = places(simulation)
        way = np.linalg.norm(moved - place, axis=-1)
        np.testing.assert_allclose(way[far_inside], 0.03, rtol=2e-3)
        course = np.arctan2(*(moved - place)[..., ::-1].reshape(-1, 2).T).reshape(way.shape)
        turned = np.angle(np.exp(1j * (course - headings[-1])))[far_inside]
        assert np.abs(turned).max() < 2e-3, "a target goes where it heads"
        place = moved
    turns = np.diff(np.array(headings)[:, far_inside], axis=0)
    turns = np.angle(np.exp(1j * turns))
    assert turns.std() == pytest.approx(0.8 * math.sqrt(0.1), rel=0.01)
    assert abs(turns.mean()) < 4 * 0.8 * math.sqrt(0.1 / turns.size)
    after_a_second = turns.sum(axis=0)
    assert after_a_second.std() == pytest.approx(0.8, rel=0.03)
    assert (after_a_second**4).mean() / after_a_second.var() ** 2 == pytest.approx(3, abs=0.3)
    assert abs(np.corrcoef(turns[3], turns[4])[0, 1]) < 4 / math.sqrt(turns.shape[1])
    assert abs(np.corrcoef(turns[3, :-1], turns[3, 1:])[0, 1]) < 4 / math.sqrt(turns.shape[1])


@pytest.mark.parametrize("speed", [0.2, 100.0])
def test_targets_stay_inside(speed):
    # Story: however fast, whatever their motion, none ever leaves the rectangle. A robot chases those that flee.
    overrides = {"targets.drifting": 0.3, "targets.wandering": 0.3, "targets.fleeing": 0.4, "sensing.radius": 0.05}
    settings = {"targets.speed": speed, "targets.flee_speed": 3 * speed, "targets.leave": False, "task.grid": None}
    simulation = lissajous_env.Simulation(lissajous_env.scenario("failure", **overrides, **settings), 50)
    for k in range(60):
        simulation.step(np.full(simulation.action_shape, math.sin(k / 7), dtype=np.float32))
        assert (np.abs(places(simulation)) <= np.float32([1.8, 0.8])).all()
    assert np.isfinite(simulation.targets.heading.numpy()).all()


# Detection.


def test_all_ten_thousand_targets_are_found_in_time():
    # Oracle: T_max = (2 pi / omega) / (N / kappa) = 8.38 s of the paper; simulated independently with theta_0 = 0, 56 %
    # are seen at the start and the last one after 4.6 to 4.8 s (the paper says 4.5 s).
    simulation = lissajous_env.Simulation(
        lissajous_env.scenario("ideal", **{"formation.start": "equilibrium"}), 2, seed=1
    )
    scenario = simulation.scenario
    assert scenario.detection_time_bound == pytest.approx(8.378, abs=1e-3)
    at_start = [row["detected_fraction"] for row in simulation.score()]
    rate = scenario.formation.phase_rate / scenario.alpha
    for _ in range(scenario.task.steps):
        simulation.step(np.full(simulation.action_shape, rate / scenario.robot.phase_rate_max, dtype=np.float32))
    for row in simulation.score():
        assert row["targets"] == 10_000
        assert row["detected_fraction"] == 1
        assert row["detected_within_bound"] == 1
        assert row["detection_time_max"] <= 4.9
        assert row["detection_time_max"] >= 4.5
    assert at_start == pytest.approx([0.56, 0.56], abs=0.015)
