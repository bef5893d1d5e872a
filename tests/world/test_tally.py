"""Sums of scores and rewards: no overflow of 32 bits, and no loss of small terms."""

import numpy as np
import pytest
import warp as wp

import lissajous_env
from lissajous_env.world.state import EpisodeTotals
from lissajous_env.world.tally import tally_coverage

STILL = {"faults.schedule": (), "targets.count": 0, "targets.arrival_rate": 0.0, "formation.start": "equilibrium"}


@wp.kernel
def keep_coverage(robots: int, cells_total: int, tally: EpisodeTotals):
    tally_coverage(0, 1, robots, cells_total, tally)


def simulation_of(name="failure", **overrides):
    return lissajous_env.Simulation(lissajous_env.scenario(name, **STILL, **overrides))


def stand_still(simulation, steps=1):
    for _ in range(steps):
        simulation.step(np.zeros(simulation.action_shape, dtype=np.float32))
    return simulation.score()[0]


@pytest.mark.parametrize("before", [2**31 - 1, 2**40])
def test_contact_and_collisions(before):
    # Oracle: whole numbers. Five robots that all touch are ten pairs.
    simulation = simulation_of(**{"robot.radius": 10.0})
    simulation.tally.contact_steps.fill_(before)
    simulation.tally.collisions.fill_(before)
    row = stand_still(simulation, 3)
    assert row["contact_time"] == pytest.approx(0.1 * (before + 30), rel=1e-12)
    assert row["collisions"] == before + 10


def test_the_idleness_that_a_step_ends():
    # Oracle: 64 x 64 cells, each unseen for 2^21 steps, are 2^33 steps of idleness, 2^21 on average.
    everywhere = {"sensing.radius": 100.0, "task.grid": (64, 64), "task.reward_idleness": 1.0}
    simulation = simulation_of(**everywhere)
    simulation.cells.sensed_at.fill_(1 - 2**21)
    simulation.cells.in_discs.zero_()
    stand_still(simulation)
    assert simulation.latest.idle_ended.numpy()[0] == 2**33
    assert simulation.reward_terms.numpy()[0, 0, 3] == pytest.approx(0.1 * 2**21)


def test_the_cells_that_every_robot_has_sensed():
    # Oracle: 200 robots and 4096 x 4096 cells are 3.4e9 of them; the score is kept as if the grid were as large.
    simulation = simulation_of()
    for cells, reached in ((200 * 4096 * 4096 - 1, False), (200 * 4096 * 4096, True)):
        simulation.tally.covered_each.fill_(cells)
        wp.launch(keep_coverage, dim=1, inputs=[200, 4096 * 4096, simulation.tally], device="cpu")
        assert (simulation.tally.covered_each_at.numpy()[0] < 2**30) == reached


@pytest.mark.parametrize("name", ["returns", "lateral_sum", "tracking_sum"])
def test_small_parts_of_a_large_sum(name):
    # Oracle: float64; to a sum of 2^30 a float32 adds nothing below 64.
    simulation = simulation_of("experiment", **{"task.reward_effort": -0.01})
    array = getattr(simulation.tally, name)
    array.fill_(2.0**30)
    other = simulation_of("experiment", **{"task.reward_effort": -0.01})
    for _ in range(50):
        for sim in (simulation, other):
            sim.step(np.full(sim.action_shape, 0.3, dtype=np.float32))
    gained = array.numpy() - 2.0**30
    assert np.abs(gained).min() > 1e-3
    assert gained == pytest.approx(getattr(other.tally, name).numpy(), abs=1e-5)
