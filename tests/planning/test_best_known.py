"""The best known plans: stored figures are those of episodes, and tables show them for unchanged scenarios alone."""

import math

import known
import pytest
from test_plan import planned

import baselines
import lissajous_env
from baselines.benchmark import best_known
from baselines.benchmark.statistics import number
from baselines.benchmark.table import Bounds, Table, bounds_of
from baselines.benchmark.types import as_played
from baselines.benchmark.written import latex, table_of
from baselines.planning.families import as_family
from baselines.planning.plans import Plan
from baselines.planning.rehearse import Episodes, play
from baselines.policies.settings import PolicySettings

STORED = [plan.name for plan in best_known.all_known()]


@pytest.mark.parametrize("name", STORED)
def test_the_stored_figures_are_those_of_the_episodes(name):
    """Oracle: the episodes, on the scenario as a benchmark plays it, with its own start."""
    (stored,) = (plan for plan in best_known.all_known() if plan.name == name)
    task = as_played(name.removesuffix(f"-{known.SETTLED}"))
    assert task.digest() == stored.scenario.digest()
    figures = play(as_family(task, best_known.known_plans(task)).plan({"stored": name}), Episodes()).figures
    assert figures.collisions == 0
    assert (figures.worst_case, figures.settled) == (pytest.approx(stored.worst_case), pytest.approx(stored.settled))
    assert stored.command.startswith(f"python benchmarks/known.py {name.removesuffix(f'-{known.SETTLED}')} --seconds ")


def test_the_best_known_plans_are_better_than_the_best_default():
    """Oracle: `partition`, the best default on these scenarios, evaluated on the same seeds."""
    for name in ("evaders", "evaders-fast", "evaders-lost"):
        task, bounds = as_played(name), bounds_of(as_played(name))
        figures = play(Plan("defaults", task, PolicySettings("partition")), Episodes()).figures
        assert bounds.best_known < figures.worst_case
        assert bounds.best_known_settled <= figures.settled, "on `evaders` as good as that of `partition`"
        assert bounds.worst_case <= bounds.best_known_settled <= bounds.best_known


def test_a_changed_scenario_has_no_best_known_plan():
    assert best_known.known_plans(lissajous_env.scenario("evaders"))
    for changed in ({"sensing.radius": 0.7}, {"task.duration": 50.0}, {"robot.count": 7}):
        scenario = lissajous_env.scenario("evaders", **changed)
        assert best_known.known_plans(scenario) == []
        assert not as_family(scenario, best_known.known_plans(scenario)).first
        assert math.isnan(bounds_of(scenario).best_known)


def test_the_row_stands_below_the_policies():
    """Story: a table in Markdown and one in LaTeX end with the best known worst case, and nothing else in its row."""
    task = lissajous_env.scenario("evaders")
    rows = lissajous_env.evaluate(baselines.make("still", task), task, [0])
    results = Table.of([{"policy": "still"} | row for row in rows], {"evaders": task})
    table = table_of(results)
    last, at = table["rows"][-1], table["columns"].index("guaranteed [s]")
    assert (last[0], last[1]) == ("", "*best known*")
    assert last[at] == number(results.bounds["evaders"].best_known)
    assert {cell for k, cell in enumerate(last) if k not in (1, at)} == {""}
    assert "best known &" in latex(results)
    assert "best known 2 s (second halves 1 s)" in Bounds(1.0, 1.0, 3.0, 2.0, 1.0).in_words()


def test_only_better_plans_are_stored(tmp_path, monkeypatch):
    """Story: by hand; of two goals met by one plan one folder is written; a plan that collides is never stored."""
    monkeypatch.setattr(best_known, "FOLDER", tmp_path)
    try:
        assert known.keep("evaders", [planned(0.5, 0.5, collisions=1), planned(math.inf, math.inf)], "c") == []
        assert known.keep("evaders", [planned(3.0, 2.0)], "c") == ["evaders"]
        assert known.keep("evaders", [planned(3.0, 2.0)], "c") == []
        assert known.keep("evaders", [planned(2.5, 2.2), planned(3.0, 2.0)], "d") == ["evaders", "evaders-settled"]
        ranks = {plan.name: known.ranked(plan, known.WHOLE) for plan in best_known.all_known()}
        assert ranks == {"evaders": (2.5, 2.2), "evaders-settled": (3.0, 2.0)}
    finally:
        best_known.all_known.cache_clear()
