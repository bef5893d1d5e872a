"""Planning: the printed plans are the best ones, the folders reproduce their figures, and refusals name the reason."""

import dataclasses
import itertools
import json
import math
import re

import numpy as np
import pytest
from command_line import called
from hypothesis import given, settings
from hypothesis import strategies as st

import baselines
import lissajous_env
from baselines.planning import report
from baselines.planning.budget import Budget
from baselines.planning.families import FAMILIES
from baselines.planning.families.defaults import default_policies, included
from baselines.planning.families.lissajous import curves_of, formations
from baselines.planning.family import Family
from baselines.planning.planner import Outcome
from baselines.planning.plans import Figures, Plan, Planned, dominates, pareto_optimal, t_interval
from baselines.planning.rehearse import CONFIRMED, Episodes, play
from baselines.planning.request import Request
from baselines.planning.search import Search
from baselines.policies.patience import StoppedError, patience
from baselines.policies.settings import PolicySettings
from lissajous_env.console.cli import main
from lissajous_env.console.terminal import make_console
from lissajous_env.episodes.guarantee import worst_undetected_times
from lissajous_env.theory import geometry

SMALL = """
base = "evaders"
[robot]
radius = 0.06
[sensing]
radius = 0.8
[task]
duration = 12.0
contamination = [36, 16]
"""
HALL = {"width": 20.0, "height": 12.0, "robot_radius": 0.2, "sensor_radius": 5.0, "speed": 1.5, "rogue_speed": 0.2}


@pytest.fixture
def small(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    return str(path)


def planned(
    worst,
    settled=1.0,
    failed=math.nan,
    detection=1.0,
    distance=1.0,
    messages="nothing",
    collisions=0,
    robots=5,
    too_close=False,
):
    figures = Figures(worst, settled, failed, detection, collisions, 0, 0.1, 0.0, too_close, distance, messages)
    scenario = lissajous_env.scenario("evaders", **{"robot.count": robots})
    return Planned(Plan("hand", scenario, PolicySettings("still")), figures, 1.0, [], [])


def test_the_best_plan_is_no_worse_than_any_default(small):
    """Oracle: every included classical policy on the same scenario and seeds, evaluated apart."""
    task = lissajous_env.scenario(small)
    search = Search(task, Episodes(), [included])
    search.run(Budget())  # it ends when the defaults have been played
    best = pareto_optimal(search.finals)[0].figures
    assert (search.unplayed, best.collisions) == (0, 0)
    for name in default_policies(task):
        rows = lissajous_env.evaluate(baselines.make(name, task, CONFIRMED), task, range(CONFIRMED))
        if not any(row["collisions"] for row in rows):
            worst = math.inf if any(row["guarantee_open"] for row in rows) else max(
                row["guaranteed_detection_time"] for row in rows
            )  # fmt: skip
            assert best.worst_case <= worst, name


def test_a_slow_machine_finds_a_plan_too(small):
    """A time that is over with the first call of the clock: one plan of each thread is looked at and played."""
    task, hours = lissajous_env.scenario(small), itertools.count(0.0, 3600.0)
    search = Search(task, Episodes(), [formations], clock=lambda: next(hours))
    search.run(Budget(seconds=1))
    assert search.looks
    assert any(not each.fails for each in search.looks) == bool(search.finals)


def test_the_same_request_gives_the_same_table_on_a_slow_machine(small, monkeypatch):
    """Law: neither the clock nor the number of cores changes a plan, a figure or their order.

    The second search has one thread, and a clock on which it takes years.
    """
    fast = baselines.plan(small, plans=40, failures=1)
    hours = itertools.count(0.0, 3600.0)
    monkeypatch.setattr("baselines.planning.search.cores", lambda: 1)
    monkeypatch.setattr(Search.__init__, "__defaults__", (*Search.__init__.__defaults__[:-1], lambda: next(hours)))
    slow = baselines.plan(small, plans=40, failures=1)
    assert (slow.looks, slow.untried) == (fast.looks, fast.untried)
    assert repr(slow.finals) == repr(fast.finals)
    assert [each.plan.key for each in slow.plans] == [each.plan.key for each in fast.plans]


def test_every_family_that_fits_is_tried_before_a_plan_is_changed(small, monkeypatch):
    """Law: when a plan is changed for the first time, all families have been tried, and every start was begun."""
    search, untried, changed = Search(lissajous_env.scenario(small), Episodes()), [], Family.changed

    def recorded(family, *given):
        untried.append(search.untried())
        return changed(family, *given)

    monkeypatch.setattr(Family, "changed", recorded)
    search.run(Budget(plans=80))
    assert untried
    assert not any(untried)


def test_the_folders_reproduce_the_printed_figures(small, tmp_path, capsys):
    """Oracle: the rows of `lissajous evaluate` for each folder alone, without failures and with each robot removed.

    The figures that the command printed are those of these rows, exactly.
    """
    out = tmp_path / "plans"
    code, said, _ = called(capsys, "plan", small, "--plans", 30, "--failures", 1, "--rows", 3, "--out", out, "--json")
    assert code == 0
    shown = json.loads(said)["plans"]
    assert 1 <= len(shown) <= 3
    assert (out / report.PICTURE).read_bytes().startswith(b"\x89PNG")
    for k, each in enumerate(shown, start=1):
        rows = evaluated(capsys, out / str(k), "--episodes", CONFIRMED)
        figures, made = each["figures"], lissajous_env.scenario(str(out / str(k) / "scenario.toml"))
        at = made.task.duration / 4
        failed = [
            evaluated(capsys, out / str(k), "--episodes", 1, "--seed", i, "--set", f"faults.removed=(({i},{at}),)")[0]
            for i in range(5)
        ]
        assert figures["worst_case"] == worst_of(rows)
        ages = worst_undetected_times(lissajous_env.policy(out / str(k), made, CONFIRMED), made, range(CONFIRMED))
        assert figures["settled"] == ("inf" if worst_of(rows) == "inf" else ages[:, made.task.steps // 2 + 1 :].max())
        assert figures["detection_time"] == pytest.approx(np.mean([row["detection_time_mean"] for row in rows]))
        assert figures["clearance"] == min(row["min_separation"] for row in rows) - 2 * made.robot.radius
        per_minute = np.mean([row["distance_mean"] for row in rows]) * 60 / made.task.duration
        assert figures["distance"] == pytest.approx(per_minute)
        assert sum(row["collisions"] for row in rows) == 0
        if not sum(row["collisions"] for row in failed):
            grew = any(row["still_growing"] for row in each["failed_rows"])
            assert figures["worst_case_failed"] == ("inf" if grew else worst_of(failed))
        else:
            assert figures["worst_case_failed"] == "inf"


def evaluated(capsys, *line):
    code, said, _ = called(capsys, "evaluate", *line, "--json")
    assert code == 0
    return json.loads(said)["episodes"]


def worst_of(rows):
    if any(row["guarantee_open"] for row in rows):
        return "inf"
    return max(row["guaranteed_detection_time"] for row in rows)


def test_the_same_plan_has_the_same_figures_again(small):
    """The law of the batch: a plan's figures do not depend on what else was played."""
    outcome = baselines.plan(small, plans=24, failures=1)
    confirmed = dataclasses.replace(outcome.request.episodes, count=CONFIRMED)
    for each in outcome.plans[:2]:
        assert repr(play(each.plan, confirmed).figures) == repr(each.figures)


numbers = st.integers(0, 3).map(float)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(numbers, numbers, numbers, numbers, numbers, st.booleans()), max_size=12))
def test_no_printed_plan_is_dominated(table):
    """Oracle: comparison of all pairs by brute force; what is left out collides, is dominated, or is a twin."""
    plans = [planned(*row, collisions=int(collides)) for *row, collides in table]
    kept = pareto_optimal(plans)
    of = [(*each.figures.objectives, 5.0) for each in plans]
    for each in kept:
        mine = (*each.figures.objectives, 5.0)
        safe = [one for one, plan in zip(of, plans, strict=True) if not plan.figures.collisions]
        assert each.figures.collisions == 0
        assert not any(all(np.array(one) <= mine) and one != mine for one in safe)
    for one, plan in zip(of, plans, strict=True):
        if plan.figures.collisions == 0:
            assert any(all(np.array((*each.figures.objectives, 5.0)) <= one) for each in kept)
    worst = [each.figures.worst_case for each in kept]
    assert worst == sorted(worst)


def test_dominance_needs_a_difference():
    assert dominates((1, 2), (1, 3))
    assert not dominates((1, 2), (1, 2))
    assert not dominates((1, 3), (2, 2))


def test_a_plan_whose_bodies_come_close_is_last_and_dominates_none():
    close, clear, worse = planned(1.0, too_close=True), planned(2.0), planned(3.0, too_close=True)
    assert pareto_optimal([worse, close, clear]) == [clear, close]


def test_a_team_of_fewer_robots_is_not_dominated():
    few, many = planned(3.0, robots=4), planned(3.0, robots=6)
    assert pareto_optimal([many, few]) == [few]
    assert len(pareto_optimal([planned(2.0, robots=6), few])) == 2


def test_ctrl_c_prints_the_best_so_far(small, capsys, monkeypatch):
    """Story: Ctrl-C during the first looks; the best are played to the end, printed, and the exit code is 130."""
    looked = Search._look

    def interrupted(self, threads):
        self._report = interrupt
        looked(self, threads)

    def interrupt():
        raise KeyboardInterrupt

    monkeypatch.setattr(Search, "_look", interrupted)
    code, said, error = called(capsys, "plan", small)
    assert code == 130
    assert "Plans for 3.6 m x 1.6 m, 5 robots" in said
    assert "interrupted; the plans above" in error


def test_ctrl_c_during_the_final_episodes_keeps_what_was_played(small, monkeypatch):
    calls = []

    def on_progress(share, outcome, search):
        calls.append(share)
        if search.finals:
            raise KeyboardInterrupt

    outcome = baselines.plan(small, on_progress=on_progress)
    assert outcome.interrupted
    assert len(outcome.finals) >= 1
    assert calls == sorted(calls)


def test_the_fewest_robots_that_guarantee_a_time(capsys):
    """Story: three robots guarantee a generous time; the search ends there, long before its time is over."""
    hall = {name.replace("_", "-"): value for name, value in HALL.items()} | {"turning-radius": 0.5}
    line = [word for name, value in hall.items() for word in (f"--{name}", value)]
    code, said, _ = called(capsys, "plan", *line, "--robots", "3:4", "--guarantee", 120, "--json")
    found = json.loads(said)
    assert code == 0
    assert found["fewest_robots"] == 3
    good = [each for each in found["plans"] if each["figures"]["worst_case"] <= 120]
    assert {each["robots"] for each in good} == {3}
    assert all(found["limits"][str(each["robots"])] <= each["figures"]["worst_case"] for each in good)
    assert any(f"{found['fewest_robots']} robots are the fewest" in word for word in found["words"])


@pytest.mark.parametrize(("failures", "fewest"), [(0, 4), (1, 5)])
def test_a_guarantee_includes_failures_if_they_are_asked_for(failures, fewest):
    # Oracle: plans made by hand.
    finals = [planned(9.0, robots=3), planned(5.0, failed=8.0, robots=4), planned(4.0, failed=5.5, robots=5)]
    finals += [planned(1.0, failed=1.0, robots=2, collisions=1)]
    outcome = Outcome(Request("evaders", failures=failures, guarantee=6.0), finals=finals)
    assert outcome.fewest_robots == fewest


def test_a_time_below_the_bound_is_refused_with_the_bound(small, capsys):
    code, said, _ = called(capsys, "plan", small, "--robots", "2", "--guarantee", 0.01, "--seconds", 1)
    assert code == 1
    assert re.search(r"2 robots cannot: the lower bound for every policy is [\d.]+ s", said)


def test_points_play_formations_alone(capsys):
    line = [word for name, value in HALL.items() for word in (f"--{name.replace('_', '-')}", value)]
    code, said, _ = called(capsys, "plan", *line, "--robots", 5, "--plans", 12)
    assert code == 0
    assert "sweep and laps drive cars, and the robots are of kind curve (give a turning radius)" in said
    assert "line-abreast drive cars" in said


def test_the_bounds_of_the_paper_are_printed_for_its_formations(capsys):
    # Oracle: (6), (7), (8) and T_max of curve (16) with five robots, as the paper prints them.
    report.print_formations(make_console(), [planned(1.0)])
    assert capsys.readouterr().out == ""
    experiment = lissajous_env.scenario("experiment")
    plan = Plan("Lissajous", experiment, PolicySettings("kuramoto-mpcc"))
    report.print_formations(make_console(), [dataclasses.replace(planned(1.0), plan=plan)])
    last = capsys.readouterr().out.split("\n")[-2].split()
    assert last == ["1", "3", ":", "2", "0.15", "1.27", "1.16", "4.19"]


def test_a_family_without_a_plan_says_why(capsys):
    # Story: bodies that fill the rectangle: (6) allows less than 1.8 m, by its closed form.
    task = Request(width=6.0, height=6.0, robots=(5, 5), robot_radius=1.8, sensor_radius=4.0, speed=1.0).task(5)
    words = formations(task).refusal
    assert re.search(r"bodies of 1.8 m must be below [\d.]+ m by \(6\)", words)
    assert curves_of(task) == []


def test_curves_of_a_formation_leave_room_and_no_gap():
    """Oracle: the distance and the coverage of the undisturbed formation, by measurement."""
    task = Request(**HALL, robots=(7, 7), turning_radius=1.0).task(7)
    curves = curves_of(task)
    assert any(curve.a + curve.b != 7 for curve in curves)
    for curve in curves:
        assert geometry.smallest_distance(curve, 7) > 2 * task.robot.radius
        assert geometry.measured_coverage_radius(curve) < task.sensing_radius


@pytest.mark.parametrize("robots", [2, 3, 4, 6, 9])
def test_every_start_of_a_formation_is_a_scenario_whose_robots_part(robots):
    task = Request(**HALL, robots=(robots, robots), turning_radius=1.0).task(robots)
    family = formations(task)
    for start in family.starts:
        made = family.plan(start).scenario
        places = np.sort(np.angle(np.exp(1j * made.alpha * made.equilibrium)))
        gaps = np.diff(np.append(places, places[0] + 2 * np.pi))
        np.testing.assert_allclose(gaps, 2 * np.pi / robots, atol=1e-6)


def test_changed_settings_stay_within_their_space():
    family = Family("any", Plan, [], {"speed": (0.5, 2.0), "lanes": [2, 4], "policy": ["a", "b"]})
    random, seen = np.random.default_rng(0), {"speed": 1.0, "lanes": 2, "policy": "a"}
    for _ in range(200):
        after = family.changed(seen, random)
        assert 0.5 <= after["speed"] <= 2.0
        assert after["lanes"] in (2, 4)
        seen = after


def test_the_task_is_in_scale_with_its_motion():
    """The law of similarity: lengths times 3 and times times 2 give the same task in that scale, but for rounding."""
    one = Request(**HALL, robots=(5, 5), turning_radius=1.0).task(5)
    scaled = {"width": 60.0, "height": 36.0, "robot_radius": 0.6, "sensor_radius": 15.0}
    other = Request(**scaled, speed=2.25, rogue_speed=0.3, robots=(5, 5), turning_radius=3.0).task(5)
    assert other.task.contamination == one.task.contamination
    assert other.formation.phase_rate * 2 == pytest.approx(one.formation.phase_rate)
    assert other.task.step == pytest.approx(min(2 * one.task.step, 1 / other.robot.drag), rel=1e-2)


def test_a_scenario_is_the_task_as_it_is():
    evaders = lissajous_env.scenario("evaders")
    assert Request(evaders).task(5) == evaders
    changed_ = Request(evaders, sensor_radius=0.7, rogue_speed=0.2).task(5)
    assert (changed_.sensing_radius, changed_.rogue_speed) == (0.7, 0.2)
    assert changed_.curve == evaders.curve
    seven = Request(evaders, robots=(7, 7)).task(7)
    assert (seven.num_robots, seven.curve.half_width, seven.robot.wheelbase) == (7, 1.8, evaders.robot.wheelbase)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({}, "width must be given without a scenario [m], got None"),
        ({"scenario": "evaders", "failures": 5}, "failures must be a whole number from 0 to 4"),
        ({"scenario": "evaders", "seconds": 0}, "seconds must be from 1 to 1000000 [s], got 0"),
        ({"scenario": "evaders", "plans": 0}, "plans must be a whole number of at least 1, got 0"),
        ({"scenario": "evaders", "plans": 9, "seconds": 5}, "plans must be omitted if seconds is given, got 9 and 5 s"),
        ({"scenario": "evaders", "speed": -1.0}, "speed must be from 0.01 to 10000 [m/s], got -1.0"),
        ({"scenario": "evaders", "rogue_speed": math.nan}, "rogue_speed must be from 0 to 100 [m/s], got nan"),
        ({"scenario": "evaders", "robots": "x"}, "robots must be a number or a pair"),
        ({"scenario": "evaders", "robots": (3, 2)}, "robots must be a number, or a range few:many, from 2 to 64"),
        ({"scenario": "evaders", "guarantee": -1.0}, "guarantee must be from 0.001 to 1000000 [s], got -1.0"),
        ({"scenario": "evaders", "acceleration": 0.8}, "acceleration must be omitted unless robots are of kind"),
        ({**HALL, "robots": 5, "robot": "differential", "turning_radius": 1.0}, "turning_radius must be omitted"),
        ({**HALL, "robots": 5, "robot": "car"}, "turning_radius must be given for robots of kind car [m], got None"),
        ({"scenario": "evaders", "clearance": -1.0}, "clearance must be from 0 to 10000 [m], got -1.0"),
        ({"scenario": "evaders", "entry": "nowhere"}, "targets.entry must be one of inside, boundary, unseen"),
    ],
)
def test_bad_input(asked, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        baselines.plan(**asked)


def test_the_out_folder_is_checked_before_the_search(tmp_path, capsys):
    (tmp_path / report.FIGURES).write_text("mine")
    code, _, said = called(capsys, "plan", "evaders", "--out", tmp_path)
    assert code == 2
    assert "plans.json" in said
    assert (tmp_path / report.FIGURES).read_text() == "mine"


def test_planning_of_a_policy_ends_with_the_search():
    """Story: a partition of forty robots takes seconds; nobody waits for it any more, and it is made when wanted."""
    task = Request(width=60.0, height=18.0, robots=(40, 40), robot_radius=0.3, sensor_radius=5.0, speed=1.5,
                   turning_radius=0.8).task(40)  # fmt: skip
    calls = itertools.count()
    with patience(lambda: next(calls) > 10), pytest.raises(StoppedError):
        PolicySettings("partition").make(task)
    assert next(calls) == 12


def test_the_interval_of_the_detection_time_is_that_of_student():
    # Oracle: by hand; for four values t is 3.1824, and the standard deviation of 1, 2, 3, 4 is 1.29099.
    low, high = t_interval([1.0, 2.0, 3.0, math.nan, 4.0])
    assert (low, high) == pytest.approx((2.5 - 3.1824 * 1.29099 / 2, 2.5 + 3.1824 * 1.29099 / 2), abs=1e-4)
    assert math.isnan(t_interval([1.0])[0])


def test_differential_drives_are_planned_for_with_their_acceleration():
    """Law: all families of cars fit them, and the task has their limits."""
    task = Request(**HALL, robots=5, robot="differential", acceleration=0.8).task(5)
    assert (task.robot.kind, task.robot.acceleration_max, task.robot.top_speed) == ("differential", 0.8, 1.5)
    assert task.task.boundary == "wall"
    families = [family_of(task) for family_of in FAMILIES]
    assert {family.name for family in families if family.starts} >= {"partition", "lines", "Lissajous", "loops"}


@pytest.mark.parametrize("robots", [4, 6])
def test_four_and_six_robots_begin_apart(robots):
    # Oracle: Lemma 1 gives them shared places in every stable equilibrium; no bodies may overlap at the start.
    task = Request(**HALL, robots=(robots, robots), turning_radius=1.0).task(robots)
    places = lissajous_env.Simulation(task).robots.position.numpy()[0, :, :2]
    first, second = np.triu_indices(robots, 1)
    assert np.linalg.norm(places[first] - places[second], axis=1).min() > 2 * task.robot.radius


def test_plans_without_a_bound_after_failures_say_why():
    finals = [planned(5.0, failed=math.inf), planned(4.0, settled=2.0, failed=math.inf)]
    outcome = Outcome.of(Request("evaders", failures=1))
    outcome.finals = finals
    (words,) = (each for each in report.sentences(outcome) if "with 1 removed" in each)
    assert words.startswith("No plan has a bound with 1 removed: 2 of 2 leave a gap")
    outcome.finals.append(planned(6.0, failed=7.0))
    assert not any("with 1 removed:" in each for each in report.sentences(outcome))
    assert (
        "and 5 in which 1 robot is removed after a quarter of the episode (each robot" in report.sentences(outcome)[0]
    )
    outcome.request = Request("evaders", failures=2)
    assert "and 10 in which 2 robots are removed after" in report.sentences(outcome)[0]


def test_a_fixed_start_is_that_of_every_plan(small):
    outcome = baselines.plan(small, plans=24, fixed_start=True)
    task = lissajous_env.scenario(small)
    assert outcome.finals
    assert {each.plan.scenario.digest() for each in outcome.finals} == {task.digest()}


def test_help_names_the_command(capsys):
    with pytest.raises(SystemExit):
        main(["plan", "--help"])
    assert "lissajous plan evaders" in capsys.readouterr().out
