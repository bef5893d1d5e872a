"""The benchmark: its files, and that no kill, second process or change of settings can corrupt its results."""

import csv
import fcntl
import functools
import json
import math
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from benchmarks_in_the_small import QUIET, SHORT, lines, small
from rich.console import Console
from scipy.stats import trim_mean

import baselines
import lissajous_env
from baselines.benchmark import local, types
from baselines.benchmark.results_folder import Results
from baselines.benchmark.running import measure, run
from baselines.benchmark.statistics import refusal_of
from baselines.benchmark.types import Benchmark, cells_of
from lissajous_env.storage.folder import LIST
from lissajous_env.world.columns import COLUMNS, NAMES

SHORT_SCENARIO = lissajous_env.scenario("failure", **SHORT)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Results of the small benchmark, played without interruption, and its rows."""
    folder = tmp_path_factory.mktemp("whole")
    return folder, run(small(folder), console=QUIET)


@pytest.fixture
def copied(whole, tmp_path):
    """A copy of them."""
    return shutil.copytree(whole[0], tmp_path / "out")


def test_rows_are_those_of_evaluate(whole):
    policy = baselines.make("open-loop", SHORT_SCENARIO, num_worlds=3)
    oracle = lissajous_env.evaluate(policy, SHORT_SCENARIO, seeds=range(5))
    assert str([row for row in whole[1] if row["policy"] == "open-loop"]) == str(oracle)


def test_csv_has_the_columns_of_the_contract_and_nan_is_empty(whole):
    folder, rows = whole
    with open(folder / "episodes.csv", newline="") as file:
        table = list(csv.reader(file))
    assert tuple(table[0]) == NAMES
    assert len(table) == 1 + len(rows) == 11
    for line, row in zip(table[1:], rows, strict=True):
        assert line == ["" if value != value else str(value) for value in row.values()]
    assert "" in table[1]  # two seconds are over before any fault: no recovery


def test_summary_is_the_statistics_of_the_episodes(whole):
    folder, rows = whole
    summary = json.loads((folder / "summary.json").read_text())
    oracles = {"mean": np.mean, "largest": np.max, "interquartile mean": lambda values: trim_mean(values, 0.25)}
    for name, column in COLUMNS.items():
        values = np.array([row[name] for row in rows if row["policy"] == "kuramoto"], dtype=float)
        estimate = summary["statistics"]["failure"]["kuramoto"][name]
        known = values[~np.isnan(values)]
        assert (estimate["n"], estimate["known"], estimate["summary"]) == (5, len(known), column.summary)
        for bound, oracle in {"min": np.min, "max": np.max, "value": oracles[column.summary]}.items():
            assert estimate[bound] == (pytest.approx(float(oracle(known))) if len(known) else None)
    assert summary["references"] == {"failure": "kuramoto"}
    assert summary["seeds"] == list(range(5))
    assert summary["machine"]["cores"] == os.cpu_count()
    total = int(Path("/proc/meminfo").read_text().split()[1]) / 2**20
    assert summary["machine"]["memory_gib"] == pytest.approx(total, abs=0.1)


@pytest.mark.parametrize("torn", ['{"scenario": "fail', "\x00\x00\x00"])
def test_a_torn_last_line_is_dropped_and_its_episode_played_again(whole, copied, torn):
    first, *others = lines(copied)
    (copied / "episodes.jsonl").write_text("\n".join(others) + "\n" + torn)
    with pytest.warns(RuntimeWarning, match=r"unfinished last line of .*episodes\.jsonl was dropped"):
        run(small(copied, batch=3), console=QUIET)
    assert sorted(lines(copied)) == sorted([first, *others])
    assert (copied / "episodes.csv").read_bytes() == (whole[0] / "episodes.csv").read_bytes()


@pytest.mark.parametrize(("damaged", "words"), [
    ("", "is damaged"), ("nonsense", "is damaged"), ("[]", "is damaged"),
    ('{"scenario": 3}', "the columns of a score"), ({"policy": "sweep"}, "settings.json does not name"),
    ({"episode": 7}, "one of 5 episodes from seed 0 on, got 7"),
    ({"seed": 7}, "must be one of 5 episodes"), ({"collisions": "many"}, "collisions must be a whole number"),
])  # fmt: skip
def test_a_damaged_line_is_refused_by_file_and_number(copied, damaged, words):
    first, second, *others = lines(copied)
    line = damaged if isinstance(damaged, str) else json.dumps(json.loads(second) | damaged)
    (copied / "episodes.jsonl").write_text("\n".join([first, line, *others]) + "\n")
    with pytest.raises(ValueError, match=rf"episodes\.jsonl, line 2:? .*{words}"):
        Results(copied)
    assert lines(copied)[1] == line


@pytest.mark.parametrize(("column", "value", "words"), [
    ("targets", True, "a whole number"), ("targets", None, "a whole number"),
    ("detected_fraction", 1.01, r"from 0 to 1 or null \(no target appeared\)"),
    ("contact_time", None, r"number of at least 0 \[s\], got None"), ("return_mean", 10**400, "a finite number"),
    ("spacing_factor", [1], "a number"), ("seed", 0.0, "a whole number"), ("scenario", None, "text"),
])  # fmt: skip
def test_a_value_that_no_score_has_is_refused_by_rule_and_value(whole, column, value, words):
    row = json.loads(lines(whole[0])[0])
    assert refusal_of(row) is refusal_of(row | {"recovery_time": None}) is None
    assert re.match(rf"{column} must be .*{words}", refusal_of(row | {column: value}))


def test_other_settings_are_refused_and_both_are_shown(copied):
    before = {path.name: path.read_bytes() for path in copied.iterdir() if path.name != LIST}
    with pytest.raises(ValueError, match="other settings") as error:
        run(small(copied, seed=7, overrides={"task.duration": 3.0}), console=QUIET)
    shown = [line.strip() for line in str(error.value).splitlines()[1:]]
    assert shown == ["seed: 0 there, 7 now", "scenarios.failure.task.duration: 2.0 there, 3.0 now"]
    assert before == {path.name: path.read_bytes() for path in copied.iterdir() if path.name != LIST}


@pytest.mark.parametrize(("change", "words"), [
    ({"episodes": -1}, "must be one of -1 episodes"), ({"policies": []}, r"settings\.json is damaged"),
    ({"scenarios": {"mine": 3}}, r"settings\.json must be an undamaged .* be a table of its parts, got int"),
    ({"versions": {"lissajous-env": "0.1.0"}}, "versions.lissajous-env: '0.1.0' there"),
])  # fmt: skip
def test_settings_that_no_call_wrote_are_refused(copied, change, words):
    path = copied / "settings.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(ValueError, match=words):
        run(small(copied), console=QUIET)
    path.unlink()
    with pytest.raises(ValueError, match=r"must contain settings\.json"):
        Results(copied)


def test_scenarios_policies_and_episodes_are_added_and_nothing_is_played_twice(whole, tmp_path):
    run(small(tmp_path, policies=("kuramoto",), episodes=3), console=QUIET)
    first = lines(tmp_path)
    outcome = measure(small(tmp_path, policies=("open-loop",)), console=QUIET)
    assert (outcome.resumed, {row["policy"] for row in outcome.rows}) == (0, {"open-loop"})
    run(small(tmp_path, scenarios=("failure", "knot")), console=QUIET)
    journal = lines(tmp_path)
    assert journal[:3] == first
    assert len(journal) == len(set(journal)) == 20
    # Oracle: the same episodes, played at once; the files have all of the folder, in the order of its settings.
    assert sorted(line for line in journal if '"failure"' in line) == sorted(lines(whole[0]))
    with open(tmp_path / "episodes.csv", newline="") as file:
        table = list(csv.DictReader(file))
    places = [("failure", "kuramoto"), ("failure", "open-loop"), ("knot", "kuramoto"), ("knot", "open-loop")]
    assert [(row["scenario"], row["policy"]) for row in table] == [place for place in places for _ in range(5)]
    assert list(json.loads((tmp_path / "summary.json").read_text())["statistics"]) == ["failure", "knot"]


def test_fewer_episodes_are_the_first_of_those_there_and_another_reference_plays_nothing(whole, copied, monkeypatch):
    before = (copied / "episodes.csv").read_bytes()
    monkeypatch.setattr(local, "batches", None)
    outcome = measure(small(copied, policies=("kuramoto",), episodes=2), console=QUIET)
    assert str(outcome.rows) == str(whole[1][:2])
    assert (outcome.resumed, len(outcome.table.rows)) == (2, 10)
    assert (copied / "episodes.csv").read_bytes() == before
    assert json.loads((copied / "settings.json").read_text())["episodes"] == 5
    assert measure(small(copied, against="open-loop"), console=QUIET).table.references == {"failure": "open-loop"}


def test_a_folder_in_use_is_refused_and_free_once_its_holder_is_gone(copied):
    with open(copied / LIST, "a") as holder:
        fcntl.flock(holder, fcntl.LOCK_EX)
        with pytest.raises(ValueError, match="in use by another process"):
            run(small(copied), console=QUIET)
    run(small(copied), console=QUIET)


def broken(scenario, num_worlds, device):
    policy = baselines.make("kuramoto", scenario, num_worlds, device)
    if scenario.name == "perturbation":
        policy.act = lambda observation: 1 / 0
    return policy


def test_a_policy_that_raises_is_reported_and_the_others_go_on(tmp_path):
    settings = small(tmp_path, scenarios=("perturbation", "failure"), policies=("still",), episodes=2)
    console = Console(width=120, record=True, file=open(os.devnull, "w"))  # noqa: SIM115
    outcome = measure(settings, {"mine": broken}, console=console)
    assert [(f.scenario, f.policy) for f in outcome.failures] == [("perturbation", "mine")]
    assert "ZeroDivisionError" in console.export_text()
    played = {(row["scenario"], row["policy"]) for row in outcome.rows}
    assert played == {("perturbation", "still"), ("failure", "still"), ("failure", "mine")}
    assert json.loads((tmp_path / "summary.json").read_text())["failures"][0]["policy"] == "mine"


class Mine:
    def __init__(self, scenario, num_worlds=1, device="cpu", speed=0.0):
        self.scenario, self.num_worlds, self.speed = scenario, num_worlds, speed

    def reset(self, worlds=None):
        pass

    def act(self, observation):
        return np.full((self.num_worlds, self.scenario.num_robots, 1), self.speed, np.float32)


def test_whatever_makes_a_policy_is_one_and_a_factory_that_makes_none_is_named(tmp_path):
    half = type("HalfAPolicy", (), {"act": print, "num_worlds": 1})()
    own = {
        "class": Mine, "function": lambda *args: Mine(*args), "partial": functools.partial(Mine, speed=0.5),
        "instance": Mine(SHORT_SCENARIO), "act": lambda observation: observation[..., :1] * 0,
        "method": (lambda scale, observation: scale * observation[..., :1]).__get__(0),
    }  # fmt: skip
    wrong = {"nothing": lambda *_: None, "a class": lambda *_: Mine, "half": lambda *_: half}
    outcome = measure(small(tmp_path, policies=(), episodes=2), own | wrong, console=QUIET)
    assert {row["policy"] for row in outcome.rows} == set(own)
    assert [failure.policy for failure in outcome.failures] == list(wrong)
    words = "policy {} must be made with reset, act and num_worlds, got"
    assert all(words.format(failure.policy) in failure.error for failure in outcome.failures)
    with pytest.raises(ValueError, match="policy mine must be a policy or factory"):
        cells_of(small(tmp_path), {"mine": 3})


def test_a_score_that_is_no_number_fails_its_policy_and_is_not_kept(tmp_path, monkeypatch):
    rows = local.episodes
    spoilt = {"return_mean": math.inf}
    monkeypatch.setattr(local, "episodes", lambda *args: ([row | spoilt for row in batch] for batch in rows(*args)))
    outcome = measure(small(tmp_path, policies=("kuramoto",), episodes=1), console=QUIET)
    assert "the score of seed 0: return_mean must be a finite number, got 'inf'" in outcome.failures[0].error
    assert lines(tmp_path) == []


@pytest.mark.parametrize(("changes", "words"), [
    ({"scenarios": ("failur",)}, "did you mean failure"),
    ({"policies": ("kuramoto", "sweep")}, "robots of kind curve"),
    ({"scenarios": ("failure", "evaders")}, "one for evaders, which has robots of kind car; got kuramoto"),
    ({"address": ""}, "address must be given only with engine ray"), ({"seed": 2**31 - 2}, "seed must be"),
    ({"scenarios": ("failure", "failure")}, "got 2 of failure"), ({"replays": -1}, "replays must be a whole"),
    ({"against": "sweep"}, r"against must be one of the policies \(kuramoto, open-loop\), got sweep"),
])  # fmt: skip
def test_bad_settings_are_refused_before_anything_is_written(tmp_path, changes, words):
    with pytest.raises(ValueError, match=words):
        run(small(tmp_path / "out", **changes), console=QUIET)
    with pytest.raises(ValueError, match="scenarios must contain at least one scenario, got none"):
        run(small(tmp_path / "out"), scenarios=[], console=QUIET)
    assert not (tmp_path / "out").exists()


def test_a_named_scenario_is_played_as_in_the_standard_comparison(tmp_path):
    def contamination(**overrides):
        settings = Benchmark(("intruders",), ("still",), 1, out=tmp_path / str(len(overrides)), overrides=overrides)
        return measure(settings, console=QUIET).table.scenarios["intruders"].task.contamination

    assert contamination(**{"task.duration": 0.5}) == (108, 48)
    assert contamination(**{"task.duration": 0.5, "task.contamination": None}) is None


def test_policies_that_users_registered_are_played_beside_the_standard_ones_and_all_plays_every_one():
    baselines.register("theirs", "car", lambda scenario, num_worlds, device: None)
    names = lambda *policies, **own: [cell.policy for cell in cells_of(Benchmark(("evaders",), policies), own)]  # noqa: E731
    assert [name for name in names() if name not in types.POLICIES] == ["theirs"]
    assert {"arc-mpcc", "still", "theirs"} <= set(names("all"))
    assert names("all", mine=Mine) == [*names("all"), "mine"]
    with pytest.raises(ValueError, match="policies must contain one for failure, which has robots of kind curve"):
        cells_of(Benchmark(policies=("sweep",)), scenarios=map(lissajous_env.scenario, ("evaders", "failure")))
    driven = [cell.scenario.name for cell in cells_of(Benchmark(policies=("sweep",)))]  # one of nine has points
    assert driven == [name for name in types.SCENARIOS if lissajous_env.scenario(name).actuation == "car"]
