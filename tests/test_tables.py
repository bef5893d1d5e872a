"""The scripts that make the README's tables: what a table says is what its rows hold."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

import table
import trainings

import lissajous_env
from baselines.benchmark.comparison import compare
from baselines.benchmark.rows import NUMBER_COLUMNS
from baselines.benchmark.statistics import interquartile_mean, two_level_interval


def rows(policy, times, scenario="intruders"):
    for k, time in enumerate(times):
        numbers = dict.fromkeys(NUMBER_COLUMNS, 0.5) | {"detection_time_mean": time}
        yield {"scenario": scenario, "policy": policy, "episode": k, "seed": k} | numbers


def test_the_table_says_what_the_rows_hold():
    scenario = lissajous_env.scenario("intruders")
    played = [*rows("kuramoto-mpcc", [4.0] * 4), *rows("laps", [2.0, 2.0, 2.0, 6.0]), *rows("clairvoyant", [1.0] * 4)]
    told = table.as_rows(compare(played, {"intruders": scenario}), [scenario])
    assert [row["policy"] for row in told if row["privileged"]] == ["clairvoyant"]
    laps = told[1]["columns"]
    assert laps["detection_time_mean"]["value"] == 2.0
    assert told[1]["sooner"]["value"] == 0.75
    assert told[0]["sooner"] is None
    lines = table.markdown(table.as_table(told, [scenario])).splitlines()
    assert lines[0].startswith("| scenario | policy | detection [s] | over limit |")
    assert "| `intruders`, limit 0.582 s | `kuramoto-mpcc` | 4 |" in lines[2]
    assert lines[3].startswith("|  | `laps` | 2 (2\N{EN DASH}6) |")
    assert lines[4].startswith("|  | *(clairvoyant)* | 1 |")
    assert len({line.count("|") for line in lines}) == 1


def test_the_table_plays_policies_that_there_are_where_they_were_not_made_for():
    import baselines

    assert set(table.POLICIES) <= set(baselines.names())
    made = {scenario.name: scenario for scenario in table.scenarios()}
    assert made["intruders-inside"].targets.entry == "inside"
    assert {"team", "intruders", "rough", "rough-lost", "redundant"} <= set(made)


def test_trainings_are_judged_together_and_alone():
    # Oracle: by hand, and the two-level interval of the same numbers.
    rng = np.random.default_rng(0)
    times = rng.uniform(1, 3, (3, 8))
    reference = list(rows("kuramoto-mpcc", [2.5] * 8))
    judged = trainings.judged([list(rows(f"training {k}", each)) for k, each in enumerate(times)], reference)
    of = judged["detection_time_mean"]
    assert of["value"] == pytest.approx(interquartile_mean(times.ravel()))
    assert of["interval"] == two_level_interval(times)
    assert of["better"] == pytest.approx((times < 2.5).mean())
    assert [each["iqm"] for each in of["trainings"]] == pytest.approx([interquartile_mean(each) for each in times])
    assert judged["collisions"]["statistic"] == "mean"
    assert judged["sensed_fraction"]["better"] == 0.5
    assert trainings.judged([list(rows("alone", times[0]))], reference)["collisions"]["interval"] is None


def test_episodes_of_a_training_that_are_there_are_not_played_again(tmp_path, monkeypatch):
    monkeypatch.setattr(trainings.subprocess, "run", lambda *_, **__: pytest.fail("trained again"))
    kept = list(rows("learned", [1.0, 2.0]))
    (tmp_path / "seed-0-1000.json").write_text(json.dumps(kept))
    assert trainings.scored(tmp_path, "intruders", 0, 1000, 2, ()) == kept
    with pytest.raises(BaseException, match="trained again"):
        trainings.scored(tmp_path, "intruders", 0, 1000, 3, ())
