"""Guarantees of plans: with robots that fail, over all episodes, inside walls, and with bodies apart."""

import dataclasses
import io
import itertools
import math
import re

import numpy as np
import pytest
from reference_contamination import Field, sensors_of
from rich.console import Console
from test_plan import planned

import lissajous_env
from baselines.planning import report
from baselines.planning.families import families_of, partitions
from baselines.planning.plans import Plan, worst_cases
from baselines.planning.rehearse import Episodes, play, remove_early
from baselines.planning.request import Request
from baselines.planning.search import PlanOutcome
from baselines.policies.settings import PolicySettings
from lissajous_env.episodes.evaluation import EpisodeRunner
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import REMOVED


def test_partition_has_no_bound_if_a_robot_fails():
    """Story: two of the five cells have no neighbour that senses them; whoever loses such a robot has no guarantee."""
    evaders = lissajous_env.scenario("evaders")
    partition = play(Plan("defaults", evaders, PolicySettings("partition")), Episodes(7, failures=1))
    assert math.isfinite(partition.figures.worst_case)
    assert partition.figures.worst_case_failed == math.inf
    assert report.worst_in_words(partition.failed_rows).startswith("no bound (median ")


@pytest.mark.parametrize(("robots", "failures", "count"), [(5, 1, 5), (5, 2, 10), (9, 3, 64)])
def test_each_combination_of_robots_is_lost_once_or_a_sample_of_them(robots, failures, count):
    # Oracle: the binomial coefficient.
    scenario = lissajous_env.scenario("evaders", **{"robot.count": robots})
    losses = Episodes(failures=failures).losses(scenario)
    assert len(losses) == len(set(losses)) == count
    assert all(len(set(lost)) == failures and set(lost) <= set(range(robots)) for lost in losses)
    if math.comb(robots, failures) <= 64:
        assert set(losses) == set(itertools.combinations(range(robots), failures))
    outcome = PlanOutcome(Request(scenario, failures=failures), scenarios={robots: scenario}, finals=[planned(1.0)])
    is_sample = f"64 of {math.comb(robots, failures)}" in report.sentences(outcome)[0]
    assert is_sample == (math.comb(robots, failures) > 64)


def test_lost_robots_are_removed_after_a_quarter_of_the_episode_and_no_others():
    """Oracle: the status of the robots at each step."""
    scenario = lissajous_env.scenario("evaders", **{"task.duration": 4.0})
    losses = Episodes(failures=2).losses(scenario)
    simulation = Simulation(scenario, len(losses), **{"faults.lost": 2})
    remove_early(simulation, losses)
    early = scenario.task.steps // 4
    for step in range(1, scenario.task.steps + 1):
        simulation.step(np.zeros(simulation.action_shape, dtype=np.float32))
        gone = simulation.robots.status.numpy() == int(REMOVED)
        for lost, row in zip(losses, gone, strict=True):
            assert set(np.flatnonzero(row)) == (set(lost) if step > early else set())


def row(longest, is_open=0.0, grows=False):
    return {"guaranteed_detection_time": longest, "guarantee_open": is_open, "still_growing": grows}


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([row(3.2), row(3.2), row(3.2)], "3.20"),
        ([row(3.2), row(3.2), row(7.3)], "7.30 (median 3.20)"),
        ([row(3.2), row(3.2), row(46.0, 1.0, True)], "no bound (median 3.20)"),
        ([row(3.2), row(46.0, 1.0, True), row(46.0, 1.0, True)], "no bound"),
        ([row(3.2), row(3.2), row(9.0, grows=True)], "> 9 (median 3.20)"),
    ],
)
def test_a_guarantee_is_the_largest_time_with_the_median_beside_it(rows, words):
    # Oracle: by hand. A time that was still growing is no bound, and ranks as none.
    assert (max(worst_cases(rows)) == math.inf) == any(episode["still_growing"] for episode in rows)
    assert report.worst_in_words(rows) == words


def test_the_number_of_episodes_is_in_the_table():
    outcome = PlanOutcome.of(Request("evaders", failures=1))
    outcome.finals.append(planned(1.0, failed=2.0))
    table = printed(outcome, outcome.plans)
    assert re.search(r" 0 +0 +5 .*\n.* episodes +episodes +episodes ", table)
    assert f" {outcome.lower_bounds[5]:#.3g} " in table


ROOM = {"width": 9.0, "height": 6.0, "robots": 3, "robot_radius": 0.2, "sensor_radius": 2.5, "speed": 1.0}
CARS = ROOM | {"turning_radius": 0.5, "rogue_speed": 0.1}


def hall(**changes):
    """The task of a small hall."""
    return Request(**CARS | changes).scenario_of(3)


def test_the_worst_case_is_that_of_brute_force_and_the_largest_of_the_episodes():
    """Oracle: exact discs on fine cells in float64, from the tracks of the robots, for the worst of the episodes."""
    room = {"width": 4.0, "height": 3.0, "robots": 2, "robot_radius": 0.1, "sensor_radius": 1.2, "speed": 0.8}
    task = Request(**room, turning_radius=0.3, rogue_speed=0.3).scenario_of(2)
    best = play(Plan("hand", task, PolicySettings("partition")), Episodes(count=4))
    scenario, times = best.plan.scenario, [row["guaranteed_detection_time"] for row in best.rows]
    assert best.figures.worst_case == max(times) < math.inf
    simulation, sensors = Simulation(scenario), []
    runner = EpisodeRunner(best.plan.settings.make(scenario), simulation)
    runner.play([int(np.argmax(times))], lambda _: sensors.append(sensors_of(simulation, 1)))
    half = scenario.curve.half_width, scenario.curve.half_height
    ages = Field(np.array(sensors), half, scenario.sensing_radius, 0.3, scenario.task.step, finer=3).run()
    assert ages.max() * scenario.task.step == pytest.approx(max(times), rel=0.1)


def test_the_best_partition_of_drives_is_as_good_as_that_of_cars():
    """Law: drives of the same speed and acceleration can drive everything that cars can. Oracle: the cars' episodes."""
    times = []
    for kind in ({}, {"turning_radius": None, "robot": "differential", "acceleration": 0.945}):
        family = partitions(hall(**kind))
        times.append(play(family.plan(family.first[0]), Episodes(count=2)).figures.worst_case)
    assert times[1] <= times[0] < math.inf


def positions_of(plan, seeds):
    """Return the positions (W, T, N, 2) of the robots in episodes of a plan, played apart [m]."""
    simulation, places = Simulation(plan.scenario, len(seeds)), []
    runner = EpisodeRunner(plan.settings.make(plan.scenario, len(seeds)), simulation)
    runner.play(seeds, lambda _: places.append(simulation.robots.position.numpy()[..., :2].copy()))
    return np.stack(places[1:], axis=1)


@pytest.mark.parametrize("open_ground", [False, True])
def test_a_rectangle_has_walls_and_open_ground_needs_space_outside(open_ground):
    """Oracle: the positions of the robots in the same episodes, played apart."""
    task = hall(open=open_ground)
    best = play(Plan("hand", task, PolicySettings("kuramoto-mpcc")), Episodes(count=2))
    half = np.array([task.curve.half_width, task.curve.half_height])
    beyond = (np.abs(positions_of(best.plan, range(2))) - half).max() + 0.2
    assert task.task.boundary == ("open" if open_ground else "wall")
    assert best.figures.outside == pytest.approx(max(beyond, 0.0), abs=1e-6)
    assert (beyond > 0.1) == open_ground
    outcome = PlanOutcome(Request(**CARS, open=open_ground), scenarios={3: task})
    assert ("outside" in printed(outcome, [best])) == open_ground


def printed(outcome, plans):
    """The table of some plans."""
    console = Console(width=200, file=io.StringIO(), record=True)
    report.print_plans(console, outcome, plans)
    return console.export_text()


def test_a_scenario_has_its_own_boundary_unless_the_ground_is_open():
    walls = lissajous_env.scenario("evaders", **{"task.boundary": "wall"})
    assert Request("evaders").scenario_of(5).task.boundary == "open"
    assert Request(walls).scenario_of(5).task.boundary == "wall"
    assert Request(walls, open=True).scenario_of(5) == lissajous_env.scenario("evaders")


def test_every_family_of_a_hall_has_walls():
    """Law: each start of each family is a scenario with walls whose curve leaves room for the bodies."""
    families = families_of(hall())
    scenarios = [family.plan(start).scenario for family in families for start in family.first]
    assert len({family.name for family in families if family.first}) == 5
    for scenario in scenarios:
        assert scenario.task.boundary == "wall"
        assert scenario.driven.half_width <= scenario.curve.half_width - scenario.robot.radius


def test_a_plan_whose_bodies_come_closer_than_the_clearance_is_marked():
    """Oracle: the positions of the robots in the same episodes."""
    plan = Plan("hand", hall(), PolicySettings("partition"))
    first, second = np.triu_indices(3, 1)
    places = positions_of(plan, range(2))
    gap = np.linalg.norm(places[:, :, first] - places[:, :, second], axis=-1).min() - 0.4
    near, far = (play(plan, Episodes(count=2, clearance=gap + more)) for more in (-0.05, 0.05))
    assert far.figures.clearance == pytest.approx(gap, abs=0.02)  # between two steps they may be closer
    assert [near.figures.too_close, far.figures.too_close] == [False, True]
    outcome = PlanOutcome(Request(**CARS, clearance=2.0), scenarios={3: hall()}, finals=[far])
    assert printed(outcome, [near, far]).count("(close)") == 1
    assert any("come closer than 2 m" in sentence for sentence in report.sentences(outcome))
    assert Request(**ROOM).required_clearance == pytest.approx(0.04)


def test_plans_without_a_bound_after_failures_say_why():
    finals = [planned(5.0, failed=math.inf), planned(4.0, settled=2.0, failed=math.inf)]
    outcome = PlanOutcome.of(Request("evaders", failures=1))
    outcome.finals = finals
    (words,) = (sentence for sentence in report.sentences(outcome) if "with 1 removed" in sentence)
    assert words.startswith("No plan has a bound with 1 removed: 2 of 2 leave a gap")
    outcome.finals.append(planned(6.0, failed=7.0))
    assert not any("with 1 removed:" in sentence for sentence in report.sentences(outcome))
    first = "in which 1 robot is removed after a quarter of the episode (each robot"
    assert f"and in 5 {first}" in report.sentences(outcome)[0]
    loses_one = lissajous_env.scenario("evaders", **{"faults.lost": 1})
    for request in (Request("evaders", failures=2), Request(loses_one, failures=1)):
        outcome = dataclasses.replace(PlanOutcome.of(request), finals=finals[:2])
        assert "and in 10 in which 2 robots are removed after" in report.sentences(outcome)[0]
        assert "with 2 lost [s]" in " ".join(printed(outcome, finals).split())
        assert any("with 2 removed" in sentence for sentence in report.sentences(outcome))
    with pytest.raises(ValueError, match=r"failures must be a whole number from 0 to 2, .* got 3"):
        Request(lissajous_env.scenario("evaders-lost", **{"faults.lost": 1}), failures=3)
