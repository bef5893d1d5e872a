"""Robots that fail: by schedule, at random, for good."""

import math

import numpy as np
import pytest

import lissajous_env

QUIET = {"targets.count": 0, "targets.arrival_rate": 0.0, "formation.start_noise": 0.0, "faults.schedule": ()}


def run(simulation, steps, action=0.3):
    """(steps, W, N) status in each step."""
    history = []
    for _ in range(steps):
        simulation.step(np.full(simulation.action_shape, action, dtype=np.float32))
        history.append(simulation.robots.status.numpy().copy())
    return np.array(history)


def test_what_a_removed_robot_knows_of_itself_stays_even_with_noise():
    # Contract of the observation: entries 0 to 6 keep what they were.
    overrides = {**QUIET, "faults.removed": ((1, 0.5),), "noise.position": 0.1, "noise.speed": 0.1}
    for name in ("failure", "experiment"):
        simulation = lissajous_env.Simulation(lissajous_env.scenario(name, **overrides))
        run(simulation, 5)
        last = simulation.observation.numpy()[0, 1, :7].copy()
        run(simulation, 1)
        np.testing.assert_array_equal(simulation.observation.numpy()[0, 1, :7], last)
        run(simulation, 5)
        np.testing.assert_array_equal(simulation.observation.numpy()[0, 1, :7], last)


def test_random_faults_have_their_rate_and_duration():
    # Oracle: in each working step a fault begins with probability 1 - exp(-rate step); an exponential time with mean m
    # lasts ceil(time / step) steps, on average 1 / (1 - exp(-step / m)).
    rate, mean, step = 0.2, 0.7, 0.1
    overrides = {**QUIET, "faults.rate": rate, "faults.mean_duration": mean}
    scenario = lissajous_env.scenario("failure", **overrides, **{"task.duration": 100.0})
    stuck = run(lissajous_env.Simulation(scenario, 300, seed=5), 400) == 1
    begins = stuck[1:] & ~stuck[:-1]
    could = (~stuck[:-1]).sum()
    chance = 1 - math.exp(-rate * step)
    # A fault may also begin in the very step after another; to an observer these are one.
    assert begins.sum() / could == pytest.approx(chance, abs=4 * math.sqrt(chance / could))
    lengths = [
        np.diff(np.flatnonzero(np.diff(np.pad(column.astype(int), 1))))[::2] for column in stuck.reshape(400, -1).T
    ]
    seen = np.concatenate([column for column in lengths if len(column)])
    expected = 1 / (1 - math.exp(-step / mean)) / (1 - chance)
    assert seen.mean() == pytest.approx(expected, rel=0.04)
    # Independent of each other: of the world, and of the robot.
    assert np.abs(np.corrcoef(stuck[:, 0].T) - np.eye(5)).max() < 0.25
    assert abs(stuck[200, :, 0].mean() - stuck[200, :, 4].mean()) < 0.1
    # No fault begins at random while one of the schedule lasts: after it, the robot resumes as often as any works on.
    overrides["faults.schedule"] = ((0, 0.0, 2.0),)
    assert (run(lissajous_env.Simulation("failure", 300, **overrides), 21)[-1, :, 0] == 1).mean() < 0.06


@pytest.mark.parametrize("lost", [1, 2, 5])
def test_lost_robots_are_drawn_evenly_and_go_in_the_middle_half(lost):
    # Oracle: exactly `lost` of five in each world, each with the same probability, times uniform in [T/4, 3T/4).
    overrides = {**QUIET, "faults.lost": lost, "task.duration": 10.0}
    simulation = lissajous_env.Simulation(lissajous_env.scenario("failure", **overrides), 2000)
    removed = run(simulation, 100) == 2
    assert (removed[-1].sum(axis=1) == lost).all()
    share = removed[-1].mean(axis=0)
    assert share == pytest.approx([lost / 5] * 5, abs=4 * math.sqrt(0.25 / 2000) + 1e-9)
    first = np.argmax(removed, axis=0)[removed[-1]]
    assert ((first >= 25) & (first < 75)).all()
    assert abs(first.mean() - 49.5) < 4 * 50 / math.sqrt(12 * len(first))
    assert (np.diff(removed.astype(int), axis=0) >= 0).all()
