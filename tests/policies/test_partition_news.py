"""News of failures that messages carry: who learns of what, the shares of a line, and what comes of them."""

import warnings

import numpy as np
import pytest

import baselines
import lissajous_env
from baselines.policies.cells import divisions
from baselines.policies.partition import loops_lie_apart
from baselines.policies.partition_plan import Plan
from baselines.policies.partition_repair import PartitionRepair
from baselines.policies.repair_plan import lines_of

NEWS = {"messages.size": 15, "task.contamination": (40, 40)}


def play(schedule, seeds, **overrides):
    """Return the longest undetected time [s], and the collisions that begin after the drive into the cells."""
    overrides = {**NEWS, "faults.schedule": schedule, "task.duration": 38.0, **overrides}
    scenario = lissajous_env.scenario("team", **overrides)
    policy = baselines.make("partition-repair", scenario, len(seeds))
    simulation = lissajous_env.Simulation(scenario, len(seeds))
    simulation.reset(seeds=seeds)
    longest, collisions = [], []
    for _ in range(scenario.task.steps):
        simulation.step(policy.act(simulation.observation))
        longest.append(simulation.contamination.age.numpy().max() * scenario.task.step)
        collisions.append(simulation.tally.collisions.numpy().sum())
    return max(longest), collisions[-1] - collisions[140]


def test_news_of_a_failure_reach_every_robot():
    """Oracle: the ring of 15, on which two robots that fail together leave one way round of 13 hops, one a step."""
    scenario = lissajous_env.scenario("team", **NEWS)
    policy, simulation = PartitionRepair(scenario), lissajous_env.Simulation(scenario)
    for step in range(1, 271):
        simulation.step(policy.act(simulation.observation))
        failed = policy._news.numpy()[0] < 0
        if step == 150:
            assert not failed.any()
        if step in (165, 249):
            np.testing.assert_array_equal(failed, [np.arange(15) < 2] * 15)
    assert not failed.any(), "2 s after they resumed all know that they work"
    wide = np.ptp(policy.takeover.loop, axis=2)[..., policy.takeover.lines.along]
    assert (wide[8] > 1.5 * wide[0]).all(), "loops in a third of a row and in a fifth"


def test_two_that_fail_leave_no_cell_open():
    """Oracle: the same without messages, where the cell of robot 0 stays open for the whole stop of 10 s."""
    stops = ((0, 15.0, 25.0), (1, 15.0, 25.0))
    informed, collisions = play(stops, range(40, 44))
    alone, _ = play(stops, range(40, 41), **{"messages.size": 0})
    assert informed <= 9.0
    assert alone > 10.0
    assert collisions == 0


@pytest.mark.parametrize(
    ("policy", "size"), [("partition-repair", 15), pytest.param("line-abreast", 0, marks=pytest.mark.long)]
)
def test_no_robots_of_a_team_collide_under_the_proved_filter(policy, size):
    """Oracle: half a minute in which two robots stop. Without a headway, cars of seeds 33 and 35 collide at once."""
    scenario = lissajous_env.scenario("team", **{**NEWS, "messages.size": size, "task.duration": 30.0})
    rows = lissajous_env.evaluate(baselines.make(f"{policy}-proved", scenario, 8), scenario, range(33, 41))
    assert sum(row["collisions"] for row in rows) == 0
    assert max(row["guaranteed_detection_time"] for row in rows) <= 9.0


@pytest.mark.long
@pytest.mark.parametrize("robot", [0, 7, 14])
def test_any_robot_that_fails_is_replaced(robot):
    """Oracle: the stop of 10 s, for which its cell would be open."""
    longest, _ = play(((robot, 15.7, 25.7),), range(60, 64))
    assert longest < 9.0


def test_lines_are_rows_or_columns_whichever_are_longer():
    """Oracle: the cells of a grid of 5 x 3 and of its mirror image in the diagonal."""
    for along, half in ((0, (5.0, 3.0)), (1, (3.0, 5.0))):
        cells = next(each for each in divisions(15, half) if len(np.unique(each[:, along].round(9))) == 5
                     and len(np.unique(each[:, 1 - along].round(9))) == 3)  # fmt: skip
        lines = lines_of(Plan(cells, np.zeros((15, 4, 2)), 1.0), np.arange(15))
        assert (lines.along, lines.robots.shape) == (along, (15, 5))
        places = cells[lines.robots]
        assert (np.diff(places[..., along], axis=1) > 0).all()
        assert np.ptp(places[..., 1 - along], axis=1).max() < 1e-9


def test_loops_that_cross_do_not_lie_apart():
    """Oracle: circles of radius 1 in phase, whose centres are 3 and 1 apart."""
    angle = 2 * np.pi * np.arange(24) / 24
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    for distance, apart in ((3.0, True), (1.0, False)):
        loops = np.stack([circle, circle + np.array([distance, 0.0])])
        assert loops_lie_apart(loops, 0.5) == apart


@pytest.mark.parametrize(
    ("name", "changes", "warns"),
    [
        ("team", {}, True),
        ("team", {"messages.size": 15}, False),
        ("team", {"faults.schedule": ()}, False),
        ("team", {"faults.schedule": (), "faults.lost": 1}, True),
        ("evaders-failure", {}, False),  # its loops cross, so messages would change nothing
    ],
)
def test_a_team_that_could_pass_on_news_of_failures_without_messages_is_warned(name, changes, warns):
    made = lissajous_env.scenario(name, **changes)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        baselines.make("partition-repair", made)
    words = [str(each.message) for each in caught if "partition-repair" in str(each.message)]
    assert [f"at least {made.num_robots}, got {made.messages.size}" in each for each in words] == [True] * warns
