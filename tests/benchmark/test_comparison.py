"""Comparison of a benchmark's rows: bounds, open worst cases, paired differences, and references."""

import json
import math
import os
from typing import Any

import pytest
from rich.console import Console
from rich.text import Text

import lissajous_env
from baselines.benchmark import clairvoyant, tables
from baselines.benchmark.bounds import mean_time_bound
from baselines.benchmark.comparison import compare, complete, with_derived
from baselines.benchmark.running import run
from baselines.benchmark.shown_columns import OVER_LOWER_BOUND, SHOWN
from baselines.benchmark.statistics import summarize
from baselines.benchmark.types import Benchmark
from lissajous_env.episodes.limits import mean_time_limit
from lissajous_env.world.columns import COLUMNS, OPEN

INTRUDERS = {"intruders": lissajous_env.scenario("intruders")}


def rows(policy, scenario="intruders", first=0, **columns):
    for k, values in enumerate(zip(*columns.values(), strict=True)):
        numbers = dict.fromkeys(COLUMNS, 1.0) | dict(zip(columns, values, strict=True))
        yield {"scenario": scenario, "policy": policy, "episode": first + k, "seed": first + k} | numbers


def printed(call, *given, width=200):
    console = Console(width=width, record=True, file=open(os.devnull, "w"))  # noqa: SIM115
    left_out = call(console, *given)
    return console.export_text(), left_out


def test_over_the_limit_is_the_mean_over_the_bound():
    # Oracle: by hand; the interquartile mean of these would be 2.
    limit = mean_time_limit(INTRUDERS["intruders"])
    cells = compare(list(rows("a", detection_time_mean=[2.0, 2.0, 2.0, 2.0, 12.0])), INTRUDERS).cells
    of = cells["intruders"]["a"][OVER_LOWER_BOUND.name]
    assert of.mean == pytest.approx(4 / limit)
    assert of.mean_low < of.mean < of.mean_high
    assert tables.in_words(of)[0] == f"{4 / limit:.3g}"


def test_no_ratio_to_a_limit_that_says_nothing():
    scenario = lissajous_env.scenario("experiment")
    assert mean_time_limit(scenario) == 0
    assert math.isnan(mean_time_bound(scenario))
    (row,) = with_derived(rows("a", "experiment", detection_time_mean=[1.0]), {"experiment": scenario})
    assert math.isnan(row[OVER_LOWER_BOUND.name])


def test_a_guarantee_that_is_open_is_a_lower_bound_and_never_best():
    more = {
        "guaranteed_detection_time": [3.0, 59.7, 4.0, 50.0],
        "unseen_at_end": [2.0, 59.7, 1.0, 50.0],
        OPEN.name: [0, 1, 0, 1],
    }
    closed = {"guaranteed_detection_time": [9.0] * 4, "unseen_at_end": [1.0] * 4, OPEN.name: [0] * 4}
    cells = compare([*rows("a", **more), *rows("b", **closed)], INTRUDERS).cells["intruders"]
    text, _ = printed(tables.print_policies, Text("t"), cells, SHOWN)
    words = text.split()
    assert words[words.index(">") + 1] == "59.7"
    assert "2 open" in text
    assert "9*" in words


def test_a_guarantee_that_nobody_follows_has_no_column():
    nothing: dict[str, Any] = dict.fromkeys(("guaranteed_detection_time", "unseen_at_end", OPEN.name), [math.nan] * 2)
    cells = compare(list(rows("a", **nothing)), INTRUDERS).cells["intruders"]
    assert "guaranteed" not in printed(tables.print_policies, Text("t"), cells, SHOWN)[0]


def test_an_open_guarantee_loses_seed_by_seed():
    # Story: the reference clears the place in 5 s; the other was at 4 s when its episode of 6 s ended, and not done.
    ours = rows("open", guaranteed_detection_time=[4.0] * 4, unseen_at_end=[4.0] * 4, guarantee_open=[1] * 4)
    closed = {"unseen_at_end": [1.0] * 4, "guarantee_open": [0] * 4}
    theirs = rows("kuramoto-mpcc", guaranteed_detection_time=[5.0] * 4, **closed)
    reference, policies = compare([*ours, *theirs], INTRUDERS).against["intruders"]
    assert reference == "kuramoto-mpcc"
    assert list(policies) == ["open"]
    assert policies["open"]["guaranteed_detection_time"].better == 0


def test_only_seeds_that_both_have_are_compared():
    played = [*rows("a", detection_time_mean=[1.0, 5.0, 1.0]), *rows("b", first=1, detection_time_mean=[2.0, 2.0, 2.0])]
    reference, policies = compare(played, INTRUDERS).against["intruders"]
    assert reference == "a"  # the first, as the paper's method is not played
    pair = policies["b"]["detection_time_mean"]
    assert (pair.n, pair.better, pair.difference) == (2, 0.5, -1.0)
    assert compare(played, INTRUDERS, "b").against["intruders"][0] == "b"


def test_what_is_no_policy_stands_last_in_brackets_and_is_never_best_nor_the_reference():
    seer = rows(clairvoyant.NAME, detection_time_mean=[0.1, 0.1])
    played = [*seer, *rows("slow", detection_time_mean=[3.0, 3.0]), *rows("fast", detection_time_mean=[2.0, 2.0])]
    comparisons = compare(played, INTRUDERS, clairvoyant.NAME)
    assert comparisons.against["intruders"][0] == "slow"
    text, _ = printed(tables.print_policies, Text("t"), comparisons.cells["intruders"], SHOWN)
    words = [line.split()[0] for line in text.splitlines()[4:] if line.strip()]
    names = [word for word in words if word in ("slow", "fast", "(clairvoyant)")]
    assert names == ["slow", "fast", "(clairvoyant)"]
    assert "2*" in text.split()
    assert "0.100*" not in text.split()


def test_a_narrow_terminal_keeps_the_most_important_columns():
    numbers = {"guaranteed_detection_time": [3.0, 4.0], "unseen_at_end": [1.0, 1.0], "detection_time_mean": [1.0, 2.0]}
    cells = compare(list(rows("a", **numbers)), INTRUDERS).cells["intruders"]
    order = [each.name for each in SHOWN]
    assert order[:6] == ["detection_time_mean", OVER_LOWER_BOUND.name, "guaranteed_detection_time", "collisions",
                         "sensed_fraction", "distance_mean"]  # fmt: skip
    _, left_out = printed(tables.print_policies, Text("t"), cells, SHOWN, width=70)
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
    assert {names: [*of] for names, of in complete(played, scenarios).items()} == {"rough, evaders": ["a"]}
    assert complete(played[:2], scenarios) == {}
