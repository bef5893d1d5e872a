"""Planning: the printed plans are the best ones, the folders reproduce their figures, and refusals name the reason."""

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
from baselines.planning.families.defaults import default_policies, included
from baselines.planning.planner import Outcome
from baselines.planning.plans import Figures, Plan, Planned, pareto_optimal, t_interval
from baselines.planning.rehearse import BEST, CONFIRMED, Episodes
from baselines.planning.request import Request
from baselines.planning.search import Search
from baselines.policies.settings import PolicySettings
from lissajous_env.episodes.guarantee import worst_undetected_times

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
    assert best.collisions == 0
    for name in default_policies(task):
        rows = lissajous_env.evaluate(baselines.make(name, task, BEST), task, range(BEST))
        if not any(row["collisions"] for row in rows):
            worst = math.inf if any(row["guarantee_open"] for row in rows) else max(
                row["guaranteed_detection_time"] for row in rows
            )  # fmt: skip
            assert best.worst_case <= worst, name


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
        count = len(each["rows"])
        assert count == (BEST if k == 1 else CONFIRMED)
        rows = evaluated(capsys, out / str(k), "--episodes", count)
        figures, made = each["figures"], lissajous_env.scenario(str(out / str(k) / "scenario.toml"))
        at = made.task.duration / 4
        failed = [
            evaluated(capsys, out / str(k), "--episodes", 1, "--seed", i, "--set", f"faults.removed=(({i},{at}),)")[0]
            for i in range(5)
        ]
        assert figures["worst_case"] == worst_of(rows)
        ages = worst_undetected_times(baselines.make(out / str(k), made, count), made, range(count))
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
        report = self._report
        self._report = lambda: interrupt() if len(self.looks) > 8 else None
        try:
            looked(self, threads)
        finally:
            self._report = report

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

    outcome = baselines.plan(small, plans=24, on_progress=on_progress)
    assert outcome.interrupted
    assert len(outcome.finals) >= 1
    assert calls == sorted(calls)


def test_the_fewest_robots_that_guarantee_a_time(capsys):
    """Story: three robots guarantee a generous time; the search ends with them."""
    hall = HALL | {"turning_radius": 0.5}
    line = [word for name, value in hall.items() for word in (f"--{name.replace('_', '-')}", value)]
    code, said, _ = called(capsys, "plan", *line, "--robots", "3:4", "--guarantee", 120, "--plans", 24, "--json")
    found = json.loads(said)
    assert (code, found["fewest_robots"]) == (0, 3)
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


def test_the_out_folder_is_checked_before_the_search(tmp_path, capsys):
    (tmp_path / report.FIGURES).write_text("mine")
    code, _, said = called(capsys, "plan", "evaders", "--out", tmp_path)
    assert code == 2
    assert "plans.json" in said
    assert (tmp_path / report.FIGURES).read_text() == "mine"


def test_the_interval_of_the_detection_time_is_that_of_student():
    # Oracle: by hand; for four values t is 3.1824, and the standard deviation of 1, 2, 3, 4 is 1.29099.
    low, high = t_interval([1.0, 2.0, 3.0, math.nan, 4.0])
    assert (low, high) == pytest.approx((2.5 - 3.1824 * 1.29099 / 2, 2.5 + 3.1824 * 1.29099 / 2), abs=1e-4)
    assert math.isnan(t_interval([1.0])[0])


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
