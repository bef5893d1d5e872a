"""Planning: the printed plans are the best ones, the folders reproduce their figures, and interrupts lose nothing."""

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
from baselines.planning.families import default_policies, defaults, families_of
from baselines.planning.plans import Family, Figures, Plan, Planned, best_of, pareto_optimal
from baselines.planning.rehearse import BEST_EPISODES, CONFIRMING_EPISODES, Episodes, LateError, look_at, play
from baselines.planning.request import Request
from baselines.planning.search import AHEAD, PlanOutcome, Search
from baselines.policies.settings import PolicySettings
from lissajous_env.episodes.evaluation import EpisodeRunner

SMALL = """
base = "evaders"
[robot]
radius = 0.06
[sensing]
radius = 0.8
[task]
duration = 8.0
contamination = [36, 16]
"""
HALL = {"width": 20.0, "height": 12.0, "robot_radius": 0.2, "sensor_radius": 5.0, "speed": 1.5, "rogue_speed": 0.2}
REQUEST = {"plans": 14, "failures": 1, "fixed_start": True}


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenario") / "small.toml"
    path.write_text(SMALL)
    return str(path)


@pytest.fixture(scope="module")
def outcome(small):
    return baselines.plan(small, **REQUEST)


@pytest.fixture
def hours(monkeypatch):
    """A clock on which each look at it takes an hour."""
    passed = itertools.count(0.0, 3600.0)
    monkeypatch.setattr(Search.__init__, "__defaults__", (*Search.__init__.__defaults__[:-1], lambda: next(passed)))


def planned(worst, settled=1.0, failed=math.nan, detection=1.0, distance=1.0, collisions=0, robots=5, too_close=False):
    figures = Figures(worst, settled, failed, detection, collisions, 0, 0.1, 0.0, too_close, distance, "nothing")
    scenario = lissajous_env.scenario("evaders", **{"robot.count": robots})
    return Planned(Plan("hand", scenario, PolicySettings("still")), figures, [], [])


def test_the_best_plan_is_no_worse_than_any_default(small):
    """Oracle: every included classical policy on the same scenario and seeds, evaluated apart."""
    task = lissajous_env.scenario(small)
    search = Search(task, [defaults(task)])
    search.run()  # it ends when the defaults have been played
    best = pareto_optimal(search.finals)[0].figures
    assert best.collisions == 0
    for name in default_policies(task):
        rows = lissajous_env.evaluate(baselines.make(name, task, BEST_EPISODES), task, range(BEST_EPISODES))
        if not any(row["collisions"] for row in rows):
            assert best.worst_case <= float(worst_of(rows)), name


def test_the_same_request_gives_the_same_table_on_a_slow_machine(small, outcome, monkeypatch, hours):
    """Law: neither the clock nor the number of cores changes a plan, a figure or their order.

    The second search has one thread, and a clock on which it takes years.
    """
    monkeypatch.setattr("baselines.planning.search.cores", lambda: 1)
    slow = baselines.plan(small, **REQUEST)
    assert (slow.looks, slow.untried) == (outcome.looks, outcome.untried)
    assert repr(slow.finals) == repr(outcome.finals)
    assert [final.plan.key for final in slow.plans] == [final.plan.key for final in outcome.plans]


def test_a_fixed_start_is_that_of_every_plan(small, outcome):
    task = lissajous_env.scenario(small)
    assert outcome.finals
    assert {final.plan.scenario.digest() for final in outcome.finals} == {task.digest()}


def test_the_folders_reproduce_the_printed_figures(small, tmp_path, capsys):
    """Oracle: the rows of `lissajous evaluate` for each folder alone, without failures and with each robot removed.

    The figures that the command printed are those of these rows, exactly.
    """
    out = tmp_path / "plans"
    code, said, _ = called(capsys, "plan", small, "--plans", 10, "--failures", 1, "--rows", 2, "--out", out, "--json")
    assert code == 0
    shown = json.loads(said)["plans"]
    assert 1 <= len(shown) <= 2
    for k, plan in enumerate(shown, start=1):
        count = len(plan["rows"])
        assert count == (BEST_EPISODES if k == 1 else CONFIRMING_EPISODES)
        rows = evaluated(capsys, out / str(k), "--episodes", count)
        figures, scenario = plan["figures"], lissajous_env.scenario(str(out / str(k) / "scenario.toml"))
        at = scenario.task.duration / 4
        failed = [
            evaluated(capsys, out / str(k), "--episodes", 1, "--seed", i, "--set", f"faults.removed=(({i},{at}),)")[0]
            for i in range(5)
        ]
        assert figures["worst_case"] == worst_of(rows)
        simulation, ages = lissajous_env.Simulation(scenario, count), []
        runner = EpisodeRunner(baselines.make(out / str(k), scenario, count), simulation)
        runner.play(range(count), lambda _, sim=simulation, into=ages: into.append(sim.contamination.age.numpy().max()))
        settled = max(ages[scenario.task.steps // 2 + 1 :]) * scenario.task.step
        assert figures["settled"] == ("inf" if worst_of(rows) == "inf" else pytest.approx(settled))
        assert figures["detection_time"] == pytest.approx(np.mean([row["detection_time_mean"] for row in rows]))
        assert figures["detection_low"] < figures["detection_time"] < figures["detection_high"]
        assert figures["clearance"] == min(row["min_separation"] for row in rows) - 2 * scenario.robot.radius
        per_minute = np.mean([row["distance_mean"] for row in rows]) * 60 / scenario.task.duration
        assert figures["distance"] == pytest.approx(per_minute)
        assert sum(row["collisions"] for row in rows) == 0
        grew = any(row["still_growing"] for row in plan["failed_rows"])
        collides = sum(row["collisions"] for row in failed) > 0
        assert figures["worst_case_failed"] == ("inf" if grew or collides else worst_of(failed))


def evaluated(capsys, *line):
    code, said, _ = called(capsys, "evaluate", *line, "--json")
    assert code == 0
    return json.loads(said)["episodes"]


def worst_of(rows):
    if any(row["guarantee_open"] for row in rows):
        return "inf"
    return max(row["guaranteed_detection_time"] for row in rows)


numbers = st.integers(0, 3).map(float)


@settings(max_examples=60)
@given(st.lists(st.tuples(numbers, numbers, numbers, numbers, numbers, st.booleans()), max_size=12))
def test_no_printed_plan_is_dominated(table):
    """Oracle: comparison of all pairs by brute force; what is left out collides, is dominated, or is a twin."""
    plans = [planned(*row, collisions=int(collides)) for *row, collides in table]
    front = pareto_optimal(plans)
    objectives = [(*plan.figures.objectives, 5.0) for plan in plans]
    for member in front:
        mine = (*member.figures.objectives, 5.0)
        safe = [one for one, plan in zip(objectives, plans, strict=True) if not plan.figures.collisions]
        assert member.figures.collisions == 0
        assert not any(all(np.array(one) <= mine) and one != mine for one in safe)
    for one, plan in zip(objectives, plans, strict=True):
        if plan.figures.collisions == 0:
            assert any(all(np.array((*member.figures.objectives, 5.0)) <= one) for member in front)
    worst = [member.figures.worst_case for member in front]
    assert worst == sorted(worst)


def test_fewer_robots_and_bodies_apart_come_first():
    few, many = planned(3.0, robots=4), planned(3.0, robots=6)
    assert pareto_optimal([many, few]) == [few]
    assert len(pareto_optimal([planned(2.0, robots=6), few])) == 2
    close, clear, worse = planned(1.0, too_close=True), planned(2.0), planned(3.0, too_close=True)
    assert pareto_optimal([worse, close, clear]) == [clear, close]
    assert best_of([planned(math.inf, detection=0.1), few]) == [few]  # without a bound


def test_a_look_ends_early_and_compares_as_a_plan_does(small):
    """Story: a plan with a bound also loses robots; beyond a cutoff it has no bound, and a collision ends it."""
    partition, brief, random = (Plan("hand", lissajous_env.scenario(small, **more), PolicySettings(name))
        for name, more in (("partition", {}), ("partition", {"task.duration": 6.0}), ("random", {})))  # fmt: skip
    cases = (partition, math.inf), (brief, 2.55), (random, math.inf)  # 2.6 s after 27 of 30 steps, the last check at 24
    whole, cut, hit = (look_at(plan, Episodes(failures=1), cutoff) for plan, cutoff in cases)
    assert whole.figures.worst_case < math.inf
    speed = np.mean([row["distance_mean"] for row in whole.rows]) / 4  # half of the episode was played
    assert whole.figures.distance == pytest.approx(60 * speed)
    assert [row["lost"] for row in whole.failed_rows] == [(robot,) for robot in range(5)]
    assert (cut.figures.worst_case, cut.figures.settled, cut.figures.worst_case_failed) == (math.inf,) * 3
    assert hit.figures.collisions > 0
    assert cut.failed_rows == hit.failed_rows == []
    first = planned(2.0, failed=5.0), planned(3.0, failed=4.0)
    assert min(first, key=lambda plan: plan.figures.by_failures) == first[1]


def test_ctrl_c_prints_the_best_so_far(small, capsys, monkeypatch):
    """Story: Ctrl-C during the first looks; the best are played to the end, printed, and the exit code is 130."""
    in_order = Search._in_order

    def interrupted(self, *given):
        for result in in_order(self, *given):
            yield result
            if len(self.looks) == 8 and not self.interrupted:
                raise KeyboardInterrupt

    monkeypatch.setattr(Search, "_in_order", interrupted)
    code, said, error = called(capsys, "plan", small)
    assert code == 130
    assert "Plans for 3.6 m x 1.6 m, 5 robots" in said
    assert "interrupted; the plans above" in error


def test_ctrl_c_during_the_final_episodes_keeps_what_was_played(small):
    calls = []

    def on_progress(share, outcome):
        calls.append(share)
        if outcome.searches[5].finals:
            raise KeyboardInterrupt

    outcome = baselines.plan(small, plans=12, on_progress=on_progress)
    assert outcome.interrupted
    assert len(outcome.finals) >= 1
    assert calls == sorted(calls)


def test_a_family_that_was_not_tried_is_named_in_the_first_line(small, capsys, hours):
    """Story: a clock on which the search ends with its first looks; what it did not try stands above the table."""
    code, said, _ = called(capsys, "plan", small, "--seconds", 1)
    first = said.splitlines()[0]
    assert code == 0  # one plan is played to the end, however slow the machine
    assert first.startswith("Not tried: ")
    assert first.endswith("more --seconds are needed.")
    assert "Lissajous" in first


def test_on_many_cores_a_search_for_a_duration_uses_results_before_it_begins_every_start(small, monkeypatch, hours):
    task, begun = lissajous_env.scenario(small), []

    def look(plan, *more):
        plan = plan if begun else Plan("hand", task, PolicySettings("random"))  # which collides
        begun.append(plan)
        return look_at(plan, *more)

    monkeypatch.setattr("baselines.planning.search.cores", lambda: 64)
    monkeypatch.setattr("baselines.planning.search.look_at", look)
    search = Search(task, families_of(task), seconds=1)
    search.run()
    assert 1 < len(search.looks) <= len(begun) == AHEAD < sum(len(family.first) for family in search.families)
    assert search.finals, "although the time was over when the first plan, which collides, had been looked at"
    for rehearse, *cutoff in ((look_at, math.inf), (play,)):
        with pytest.raises(LateError):
            rehearse(begun[0], Episodes(is_late=lambda: True), *cutoff)


def test_every_family_that_fits_is_tried_before_a_plan_is_changed(small, monkeypatch):
    """Law: when a plan is changed for the first time, every start of every family was begun."""
    scenario, changed = lissajous_env.scenario(small), []
    search = Search(scenario, families_of(scenario), plans=80)

    def recorded(family, *args):
        changed.append((search.untried(), sum(len(family.looks) + len(family.refused) for family in search.families)))
        raise KeyboardInterrupt

    monkeypatch.setattr(Family, "changed", recorded)
    search.run()
    ((untried, looks),) = changed
    assert untried == []
    assert looks >= sum(len(family.first) for family in search.families) - AHEAD - 1
    assert search.finals  # what was interrupted is played to the end


def test_the_best_plans_of_families_are_played_to_the_end_in_their_order():
    """Story: a family with the third best plan comes before that with the fourth, also if it has the worst one, too."""

    def look(name, time):
        plan = dataclasses.replace(planned(time).plan, family=name, settings=PolicySettings(name, {"time": time}))
        return dataclasses.replace(planned(time), plan=plan)

    times = {"a": (1.0, 6.0), "b": (2.0,), "c": (3.0, 8.0), "d": (4.0,)}
    families = [Family(name, looks=[look(name, time) for time in its]) for name, its in times.items()]
    ranked = Search(families[0].looks[0].plan.scenario, families).ranked()
    assert [look.figures.worst_case for look in ranked] == [1.0, 2.0, 3.0, 4.0, 6.0, 8.0]


def test_a_family_without_a_plan_says_whether_its_plans_collide_when_they_are_played_to_the_end():
    family = Family("hand", looks=[planned(1.0, too_close=True), planned(2.0)])
    search = Search(family.looks[0].plan.scenario, [family])
    assert search._cutoff() == 3 * 2.0, "plans that are too close come after all others"
    assert search.refusals()["hand"].endswith("2 without collisions, but none was simulated to the end")
    search._finals = {0: planned(1.0, collisions=2)}
    assert search.refusals()["hand"].endswith("but 1 of them collided in simulations to the end")


def test_the_fewest_robots_that_guarantee_a_time(small, capsys):
    """Story: one more robot guarantees what the lower bound denies to two; the search ends there."""
    limit = PlanOutcome.of(Request(small, robots=2)).lower_bounds[2]
    line = "plan", small, "--robots", "2:5", "--guarantee", max(10 * limit, 1.0)
    code, said, _ = called(capsys, *line, "--plans", 12, "--json")
    output = json.loads(said)
    fewest = output["fewest_robots"]
    assert code == 0
    good = [plan for plan in output["plans"] if plan["figures"]["worst_case"] <= line[-1]]
    assert {plan["robots"] for plan in good} == {fewest}
    assert list(output["refusals"]) == [str(number) for number in range(2, fewest + 1)]
    assert all(output["lower_bounds"][str(plan["robots"])] <= plan["figures"]["worst_case"] for plan in good)
    assert any(f"{fewest} robots are the fewest" in word for word in output["words"])


@pytest.mark.parametrize(("failures", "fewest"), [(0, 4), (1, 5)])
def test_a_guarantee_includes_failures_if_they_are_asked_for(failures, fewest):
    # Oracle: plans made by hand.
    finals = [planned(9.0, robots=3), planned(5.0, failed=8.0, robots=4), planned(4.0, failed=5.5, robots=5)]
    finals += [planned(1.0, failed=1.0, robots=2, collisions=1)]
    outcome = PlanOutcome(Request("evaders", failures=failures, guarantee=6.0), finals=finals)
    assert outcome.fewest_robots == fewest


def test_a_time_below_the_bound_is_refused_with_the_bound(small, capsys):
    code, said, _ = called(capsys, "plan", small, "--robots", "2", "--guarantee", 0.01, "--seconds", 1)
    assert code == 1
    assert re.search(r"2 robots cannot: the lower bound for every policy is [\d.]+ s", said)
    assert "0 plans were tried" in said


def test_a_plan_of_a_scenario_with_any_name_is_played_from_its_folder(tmp_path):
    for name, written in {"my hall": "my-hall-1", "-": "plan-1", "x" * 120: f"{'x' * 80}-1"}.items():
        plan = planned(1.0)
        object.__setattr__(plan.plan.scenario, "name", name)
        report.write(report.open_folder(tmp_path / written, 1), [plan], Episodes())
        assert lissajous_env.scenario(tmp_path / written / "1" / "scenario.toml").name == written


@pytest.mark.parametrize("name", [report.FIGURES, "12"])
def test_the_out_folder_is_checked_before_the_search(tmp_path, capsys, monkeypatch, name):
    monkeypatch.delattr(PlanOutcome, "search")
    (tmp_path / name).write_text("mine")
    code, _, said = called(capsys, "plan", "evaders", "--rows", 12, "--out", tmp_path)
    assert code == 2
    assert f"without a {name}" in said
    assert (tmp_path / name).read_text() == "mine"
