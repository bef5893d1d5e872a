"""The results table: bounds, open worst cases, paired differences, worst episodes and references."""

import json
import math
import os
from typing import Any

import pytest
from rich.console import Console
from rich.text import Text

import lissajous_env
from baselines.benchmark import tables
from baselines.benchmark.bounds import bounds_of
from baselines.benchmark.running import run
from baselines.benchmark.shown import OVER_LOWER_BOUND, SHOWN, in_words, lines_of, with_numbers
from baselines.benchmark.statistics import summarize
from baselines.benchmark.table import Table, groups
from baselines.benchmark.types import Benchmark
from lissajous_env.episodes.limits import mean_time_limit
from lissajous_env.world.columns import COLUMNS, OPEN

INTRUDERS = {"intruders": lissajous_env.scenario("intruders")}


def rows(policy, scenario="intruders", first=0, **columns):
    for k, values in enumerate(zip(*columns.values(), strict=True)):
        numbers = dict.fromkeys(COLUMNS, 1.0) | dict(zip(columns, values, strict=True))
        yield {"scenario": scenario, "policy": policy, "episode": first + k, "seed": first + k} | numbers


def shown(table, width=200):
    """Return the text of a table of the scenario, and the columns that do not fit."""
    console = Console(width=width, record=True, file=open(os.devnull, "w"))  # noqa: SIM115
    columns = with_numbers(table.estimates["intruders"], SHOWN)
    left_out = tables.print_lines(console, Text("t"), columns, lines_of(table.estimates["intruders"], columns))
    return console.export_text(), left_out


def test_over_the_limit_is_the_mean_over_the_bound():
    # Oracle: by hand; the interquartile mean of these would be 2.
    limit = mean_time_limit(INTRUDERS["intruders"])
    cells = Table.of(rows("a", detection_time_mean=[2.0, 2.0, 2.0, 2.0, 12.0]), INTRUDERS).estimates
    of = cells["intruders"]["a"][OVER_LOWER_BOUND.name]
    assert of.mean == pytest.approx(4 / limit)
    assert of.mean_low < of.mean < of.mean_high
    assert in_words(of)[0] == f"{4 / limit:.3g}"


def test_no_ratio_to_a_limit_that_says_nothing():
    scenario = lissajous_env.scenario("experiment")
    assert mean_time_limit(scenario) == 0
    assert math.isnan(bounds_of(scenario).mean_time)
    (row,) = Table.of(rows("a", "experiment", detection_time_mean=[1.0]), {"experiment": scenario}).rows
    assert math.isnan(row[OVER_LOWER_BOUND.name])


def test_a_guarantee_that_is_open_is_a_lower_bound_and_never_best():
    more = {
        "guaranteed_detection_time": [3.0, 59.7, 4.0, 50.0],
        "unseen_at_end": [2.0, 59.7, 1.0, 50.0],
        OPEN.name: [0, 1, 0, 1],
    }
    closed = {"guaranteed_detection_time": [9.0] * 4, "unseen_at_end": [1.0] * 4, OPEN.name: [0] * 4}
    text, _ = shown(Table.of([*rows("a", **more), *rows("b", **closed)], INTRUDERS))
    words = text.split()
    assert words[words.index(">") + 1] == "59.7"
    assert "2 of 4 open" in text
    assert "9*" in words


def test_a_guarantee_that_nobody_follows_has_no_column():
    nothing: dict[str, Any] = dict.fromkeys(("guaranteed_detection_time", "unseen_at_end", OPEN.name), [math.nan] * 2)
    assert "guaranteed" not in shown(Table.of(rows("a", **nothing), INTRUDERS))[0]


def test_an_open_guarantee_loses_seed_by_seed():
    # Story: the reference clears the place in 5 s; the other was at 4 s when its episode of 6 s ended, and not done.
    ours = rows("open", guaranteed_detection_time=[4.0] * 4, unseen_at_end=[4.0] * 4, guarantee_open=[1] * 4)
    # A third one was at its worst, 6 s, at the end of its episode: longer than the reference, however it goes on.
    late = rows("growing", guaranteed_detection_time=[6.0] * 4, unseen_at_end=[6.0] * 4, guarantee_open=[0] * 4)
    closed = {"unseen_at_end": [1.0] * 4, "guarantee_open": [0] * 4}
    theirs = rows("kuramoto-mpcc", guaranteed_detection_time=[5.0] * 4, **closed)
    against = Table.of([*ours, *late, *theirs], INTRUDERS).against["intruders"]
    assert against.reference == "kuramoto-mpcc"
    better = {name: of["guaranteed_detection_time"].better for name, of in against.policies.items()}
    assert better == {"open": 0, "growing": 0}


def test_only_seeds_that_both_have_are_compared():
    played = [*rows("a", detection_time_mean=[1.0, 5.0, 1.0]), *rows("b", first=1, detection_time_mean=[2.0, 2.0, 2.0])]
    against = Table.of(played, INTRUDERS).against["intruders"]
    assert against.reference == "a"  # the first, as the paper's method is not played
    pair = against.policies["b"]["detection_time_mean"]
    assert (pair.n, pair.better, pair.difference) == (2, 0.5, -1.0)
    assert Table.of(played, INTRUDERS, "b").against["intruders"].reference == "b"


def test_a_narrow_terminal_keeps_the_most_important_columns():
    numbers = {"guaranteed_detection_time": [3.0, 4.0], "unseen_at_end": [1.0, 1.0], "detection_time_mean": [1.0, 2.0]}
    order = [each.name for each in SHOWN]
    assert order[:6] == ["detection_time_mean", OVER_LOWER_BOUND.name, "guaranteed_detection_time", "collisions",
                         "sensed_fraction", "distance_mean"]  # fmt: skip
    _, left_out = shown(Table.of(rows("a", **numbers), INTRUDERS), width=70)
    assert 0 < len(left_out) < len(order)
    assert left_out == [name for name in order if name in left_out]
    assert set(left_out) == set(order[-len(left_out) :])


def test_the_summary_has_limits_and_pairs_and_another_reference_plays_nothing_again(tmp_path):
    given = {"scenarios": ("intruders",), "policies": ("laps", "still"), "episodes": 2}
    settings = Benchmark(**given, out=tmp_path, overrides={"task.duration": 5.0})
    played = run(settings, console=Console(quiet=True))
    summary = json.loads((tmp_path / "summary.json").read_text())
    scenario = lissajous_env.scenario("intruders", **{"task.duration": 5.0})
    assert summary["limits"]["intruders"] == pytest.approx(mean_time_limit(scenario))
    assert summary["against"]["intruders"]["reference"] == "laps"
    assert summary["against"]["intruders"]["policies"]["still"]["detection_time_mean"]["n"] == 2
    ratio = summary["statistics"]["intruders"]["laps"][OVER_LOWER_BOUND.name]["mean"]
    times = [row["detection_time_mean"] for row in played if row["policy"] == "laps"]
    assert ratio == pytest.approx(summarize(times).mean / summary["limits"]["intruders"])
    before = (tmp_path / "episodes.jsonl").read_bytes()
    run(
        Benchmark(**given, out=tmp_path, against="still", overrides={"task.duration": 5.0}), console=Console(quiet=True)
    )
    assert json.loads((tmp_path / "summary.json").read_text())["against"]["intruders"]["reference"] == "still"
    assert (tmp_path / "episodes.jsonl").read_bytes() == before
    with pytest.raises(ValueError, match=r"against must be one of the policies \(laps, still\), got sweep"):
        run(Benchmark(**given, out=tmp_path, against="sweep"), console=Console(quiet=True))


def test_a_scenario_without_episodes_does_not_count_over_all():
    # Story: every policy failed on the third scenario; a policy that played one of the others alone is left out.
    scenarios = {name: lissajous_env.scenario(name) for name in ("rough", "evaders", "team")}
    played = [row for of in ("rough", "evaders") for row in rows("a", of, detection_time_mean=[1.0, 2.0])]
    played += rows("b", "evaders", detection_time_mean=[3.0])
    (group,) = groups(played, scenarios)
    assert (group.name, list(group.rows)) == ("rough, evaders", ["a"])
    assert list(Table.of(played, scenarios).overall) == ["rough, evaders"]
    assert Table.of(played[:2], scenarios).overall == {}


def test_an_estimate_names_the_seed_of_its_worst_episode():
    # Story: the largest time, the smallest share, an open episode before a closed one; no order, no worst.
    more = {"guaranteed_detection_time": [3.0, 9.0, 4.0], "unseen_at_end": [1.0] * 3, OPEN.name: [0, 0, 1]}
    times, shares = [2.0, 5.0, math.nan], [0.9, 0.2, 0.5]
    played = rows("a", first=7, detection_time_mean=times, sensed_fraction=shares, speed_max=times, **more)
    of = Table.of(played, INTRUDERS).estimates["intruders"]["a"]
    names = "detection_time_mean", "sensed_fraction", "guaranteed_detection_time", "speed_max"
    assert [of[name].worst for name in names] == [8, 8, 9, None]
