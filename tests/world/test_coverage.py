"""Coverage and idleness of the grid, compared with brute force and closed forms."""

import math

import numpy as np
import pytest

import lissajous_env
from lissajous_env.world.coverage import last_sensed

QUIET = {"targets.count": 0, "targets.arrival_rate": 0.0, "faults.schedule": ()}
STANDING = np.array([0.0, -1.0], dtype=np.float32)


def centres(scenario):
    """(rows, columns, 2) centres of the cells [m]."""
    columns, rows = scenario.task.grid
    curve = scenario.curve
    x = -curve.half_width + (np.arange(columns) + 0.5) * 2 * curve.half_width / columns
    y = -curve.half_height + (np.arange(rows) + 0.5) * 2 * curve.half_height / rows
    return np.stack(np.meshgrid(x, y), axis=-1)


def distances(scenario, robots):
    """(..., N, rows, columns) of the centre of each cell from each robot at (..., N, 2) [m]."""
    return np.linalg.norm(centres(scenario) - np.asarray(robots)[..., None, None, :], axis=-1)


def bits(words, columns):
    """(..., rows, columns) bool of 64-bit words (..., B, rows)."""
    spread = (words.swapaxes(-1, -2)[..., None] >> np.arange(64, dtype=np.uint64)) & 1
    return spread.reshape(*spread.shape[:-2], -1)[..., :columns].astype(bool)


def parked(places, worlds=1, **overrides):
    """Cars at rest at places (worlds, N, 2); what they saw from where they began is forgotten by the caller."""
    n = np.shape(places)[1]
    settings = {"robot.count": n, "robot.radius": 1e-3, "formation.p": 0, "formation.ring": None, **QUIET, **overrides}
    simulation = lissajous_env.Simulation(lissajous_env.scenario("experiment", **settings), worlds)
    padded = np.pad(np.array(places, dtype=np.float32), ((0, 0), (0, 0), (0, 1)))
    simulation.robots.position.assign(padded)
    simulation.robots.speed.zero_()
    return simulation


def stand_still(simulation, steps=1):
    for _ in range(steps):
        simulation.step(np.broadcast_to(STANDING, simulation.action_shape))


def forget(simulation):
    """Forget what was sensed before."""
    cells, tally = simulation.cells, simulation.tally
    for array in (cells.sensed_at, cells.in_discs, cells.sensed, cells.sensed_by, cells.idle_squares, cells.idle_max):
        array.zero_()
    tally.covered.zero_()
    tally.covered_each.zero_()
    tally.covered_at.fill_(2**30)
    tally.covered_each_at.fill_(2**30)


@pytest.mark.parametrize("grid", [(1, 1), (64, 17), (65, 4), (130, 9)])
@pytest.mark.parametrize("radius", [0.35, 5.0])
def test_the_cells_sensed_are_those_whose_centre_is_in_a_disc(grid, radius):
    # Oracle: distance of every centre from every robot; robots also outside the rectangle. 60 worlds of 3 robots.
    places = np.random.default_rng(1).uniform([-2.5, -1.5], [2.5, 1.5], (60, 3, 2)).astype(np.float32)
    simulation = parked(places, worlds=60, **{"task.grid": grid, "sensing.radius": radius})
    away = distances(simulation.scenario, places)
    clear = (np.abs(away - radius) > 1e-5).all(axis=(1, 2, 3))  # worlds in which no edge of a disc is on a centre
    assert clear.sum() > 50
    forget(simulation)
    stand_still(simulation)
    expected = (away < radius)[clear]
    columns = grid[0]
    seen_by = bits(simulation.cells.sensed_by.numpy()[clear], columns)  # (W, N, rows, columns)
    np.testing.assert_array_equal(seen_by, expected)
    np.testing.assert_array_equal(bits(simulation.cells.sensed.numpy()[clear], columns), expected.any(axis=1))
    seen_at = last_sensed(simulation.cells.sensed_at.numpy(), simulation.cells.in_discs.numpy(), [1] * 60)
    np.testing.assert_array_equal(seen_at[clear] == 1, expected.any(axis=1))
    assert simulation.tally.covered.numpy()[clear].tolist() == expected.any(axis=1).sum(axis=(1, 2)).tolist()
    assert simulation.tally.covered_each.numpy()[clear].tolist() == expected.sum(axis=(1, 2, 3)).tolist()


def test_the_formation_covers_the_rectangle_within_a_lap():
    # Oracle: (7): with a sensor of coverage_radius, one lap of one robot senses every point, 2 pi / omega = 21 s; five
    # need a fifth of it for somebody to have seen each cell.
    scenario = lissajous_env.scenario("failure", **QUIET)
    scenario = lissajous_env.scenario(scenario, **{"sensing.radius": scenario.coverage_radius, "task.duration": 25.0})
    simulation = lissajous_env.Simulation(scenario)
    resolved = simulation.scenario
    rate = resolved.formation.phase_rate / resolved.alpha / resolved.robot.phase_rate_max
    for _ in range(resolved.task.steps):
        simulation.step(np.full(simulation.action_shape, rate, dtype=np.float32))
    (row,) = simulation.score()
    assert row["coverage_time"] <= 21 / 5 + 0.1
    assert row["coverage_time_each"] <= 2 * math.pi / 0.3 + 0.1
    assert row["coverage_time"] < row["coverage_time_each"]
