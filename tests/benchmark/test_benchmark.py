"""The benchmark: its files, and that no kill, second process or change of settings can corrupt its results."""

import csv
import fcntl
import functools
import json
import math
import os
import re
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from rich.text import Text

import baselines
import lissajous_env
from baselines.benchmark import local, tables
from baselines.benchmark.running import measure, run
from baselines.benchmark.shown import SHOWN, lines_of
from baselines.benchmark.table import estimates_of, grouped
from baselines.benchmark.types import Benchmark
from lissajous_env.storage.folder import LIST
from lissajous_env.world.columns import COLUMNS, NAMES

QUIET = Console(quiet=True)
SHORT = {"task.duration": 2.0}
SHORT_SCENARIO = lissajous_env.scenario("failure", **SHORT)


def small(out, **changes):
    given = {"scenarios": ("failure",), "policies": ("kuramoto", "open-loop"), "episodes": 5, "batch": 2}
    return Benchmark(**given | {"out": out, "overrides": SHORT} | changes)


def estimates(played):
    return {policy: estimates_of(rows) for policy, rows in grouped(played)["failure"].items()}


def lines(folder):
    return (folder / "episodes.jsonl").read_text().splitlines()


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Results of the small benchmark, played without interruption, and its rows."""
    folder = tmp_path_factory.mktemp("whole")
    return folder, run(small(folder), console=QUIET)


def test_rows_are_those_of_evaluate(whole):
    scenario = lissajous_env.scenario("failure", **SHORT)
    policy = baselines.make("open-loop", scenario, num_worlds=3)
    oracle = lissajous_env.evaluate(policy, scenario, seeds=range(5))
    assert str([row for row in whole[1] if row["policy"] == "open-loop"]) == str(oracle)


def test_csv_has_the_columns_of_the_contract_and_nan_is_empty(whole):
    folder, rows = whole
    with open(folder / "episodes.csv", newline="") as file:
        table = list(csv.reader(file))
    assert tuple(table[0]) == NAMES
    assert len(table) == 1 + len(rows) == 11
    for line, row in zip(table[1:], rows, strict=True):
        for text, value in zip(line, row.values(), strict=True):
            assert text == ("" if value != value else str(value))
    assert "" in table[1]  # two seconds are over before any fault: no recovery


def test_summary_is_the_statistics_of_the_episodes(whole):
    folder, rows = whole
    summary = json.loads((folder / "summary.json").read_text())
    for column in COLUMNS:
        values = np.array([row[column] for row in rows if row["policy"] == "kuramoto"])
        of = summary["statistics"]["failure"]["kuramoto"][column]
        finite = values[np.isfinite(values)]
        assert (of["n"], of["n_finite"]) == (5, len(finite))
        for name, oracle in (("mean", np.mean), ("min", np.min), ("max", np.max)):
            assert of[name] == (pytest.approx(float(oracle(finite))) if len(finite) else None)
    assert summary["seeds"] == list(range(5))
    assert summary["machine"]["cores"] == os.cpu_count()
    assert summary["versions"]["numpy"] == np.__version__
    assert summary["settings"]["digests"]["failure"] == lissajous_env.scenario("failure", **SHORT).digest()


@pytest.mark.parametrize("torn", ['{"scenario": "fail', "\x00\x00\x00"])
def test_a_torn_last_line_is_dropped(whole, tmp_path, torn):
    run(small(tmp_path, episodes=2), console=QUIET)
    with open(tmp_path / "episodes.jsonl", "a") as file:
        file.write(torn)
    run(small(tmp_path), console=QUIET)
    assert sorted(lines(tmp_path)) == sorted(lines(whole[0]))
    assert (tmp_path / "episodes.csv").read_bytes() == (whole[0] / "episodes.csv").read_bytes()


@pytest.mark.parametrize("damage", ["", "nonsense", "[]", '{"scenario": 3}'])
def test_a_damaged_line_in_the_middle_is_refused_by_file_and_number(tmp_path, damage):
    run(small(tmp_path, episodes=2), console=QUIET)
    damaged = lines(tmp_path)
    damaged[1] = damage
    (tmp_path / "episodes.jsonl").write_text("\n".join(damaged) + "\n")
    with pytest.raises(ValueError, match=r"episodes\.jsonl, line 2( is damaged)?: "):
        run(small(tmp_path, episodes=2), console=QUIET)
    assert lines(tmp_path) == damaged


def test_other_settings_are_refused_and_both_are_shown(tmp_path):
    run(small(tmp_path, episodes=2), console=QUIET)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.name != LIST}
    other = small(tmp_path, episodes=2, seed=7, overrides={"task.duration": 3.0})
    with pytest.raises(ValueError, match="other settings") as error:
        run(other, console=QUIET)
    shown = [line.split() for line in str(error.value).splitlines()[1:]]
    assert shown == [["there", "now"], ["seed", "0", "7"], ["scenarios.failure.task.duration", "2.0", "3.0"]]
    assert before == {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.name != LIST}


def test_more_episodes_extend_and_another_batch_changes_nothing(whole, tmp_path):
    run(small(tmp_path, episodes=2), console=QUIET)
    run(small(tmp_path, batch=3), console=QUIET)
    assert (tmp_path / "episodes.csv").read_bytes() == (whole[0] / "episodes.csv").read_bytes()


def test_scenarios_and_policies_are_added_and_nothing_is_played_twice(whole, tmp_path):
    run(small(tmp_path, policies=("kuramoto",), episodes=3), console=QUIET)
    first = lines(tmp_path)
    outcome = measure(small(tmp_path, policies=("open-loop",), episodes=5), console=QUIET)
    assert (outcome.resumed, {row["policy"] for row in outcome.rows}) == (0, {"open-loop"})
    run(small(tmp_path, scenarios=("failure", "knot"), policies=("kuramoto", "open-loop"), episodes=5), console=QUIET)
    held = lines(tmp_path)
    assert held[:3] == first
    assert len(held) == len(set(held)) == 20
    # Oracle: the same episodes, played at once; the files hold all of the folder, in the order of its settings.
    assert sorted(line for line in held if '"failure"' in line) == sorted(lines(whole[0]))
    with open(tmp_path / "episodes.csv", newline="") as file:
        table = list(csv.DictReader(file))
    places = [("failure", "kuramoto"), ("failure", "open-loop"), ("knot", "kuramoto"), ("knot", "open-loop")]
    assert [(row["scenario"], row["policy"]) for row in table] == [place for place in places for _ in range(5)]
    assert list(json.loads((tmp_path / "summary.json").read_text())["statistics"]) == ["failure", "knot"]


def test_fewer_episodes_are_the_first_of_those_there(whole, tmp_path):
    run(small(tmp_path), console=QUIET)
    before = (tmp_path / "episodes.csv").read_bytes()
    outcome = measure(small(tmp_path, policies=("kuramoto",), episodes=2), console=QUIET)
    assert str(outcome.rows) == str(whole[1][:2])
    assert (outcome.resumed, len(outcome.table.rows)) == (2, 10)
    assert (tmp_path / "episodes.csv").read_bytes() == before
    assert json.loads((tmp_path / "settings.json").read_text())["episodes"] == 5


def test_a_folder_in_use_is_refused_and_free_once_its_holder_is_gone(tmp_path):
    run(small(tmp_path, episodes=1), console=QUIET)
    with open(tmp_path / LIST, "a") as holder:
        fcntl.flock(holder, fcntl.LOCK_EX)
        with pytest.raises(ValueError, match="in use by another process"):
            run(small(tmp_path), console=QUIET)
    run(small(tmp_path, episodes=1), console=QUIET)


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


class WithAttribute(Mine):
    num_worlds = 1


@pytest.mark.parametrize(
    "policy",
    [Mine, WithAttribute, lambda *given: Mine(*given), functools.partial(Mine, speed=0.5), Mine(SHORT_SCENARIO)],
    ids=["class", "class with an attribute", "function", "partial", "instance"],
)
def test_whatever_makes_a_policy_is_one(tmp_path, policy):
    assert len(run(small(tmp_path, policies=(), episodes=2), {"mine": policy}, console=QUIET)) == 2


@pytest.mark.parametrize("made", [None, Mine, type("HalfAPolicy", (), {"act": print, "num_worlds": 1})()])
def test_a_factory_that_makes_no_policy_is_named(tmp_path, made):
    outcome = measure(small(tmp_path, episodes=1), {"mine": lambda *_: made}, console=QUIET)
    (failed,) = outcome.failures
    assert failed.policy == "mine"
    assert "policy mine must be made with reset, act and num_worlds, got" in failed.error


def test_what_is_neither_policy_nor_factory_is_refused(tmp_path):
    with pytest.raises(ValueError, match="policy mine must be a policy or factory"):
        run(small(tmp_path), {"mine": 3}, console=QUIET)


def test_a_score_that_is_no_number_fails_its_policy_and_is_not_kept(tmp_path, monkeypatch):
    rows = local.episodes
    spoilt = {"return_mean": math.inf}
    monkeypatch.setattr(local, "episodes", lambda *given: ([row | spoilt for row in batch] for batch in rows(*given)))
    outcome = measure(small(tmp_path, policies=("kuramoto",), episodes=1), console=QUIET)
    assert "the score of seed 0: return_mean must be a finite number, got 'inf'" in outcome.failures[0].error
    assert lines(tmp_path) == []


@pytest.mark.parametrize("width", [1, 40, 60, 80, 100, 240])
@pytest.mark.parametrize("digits", [1.0, 1234.5])
def test_no_number_and_no_name_is_cut_at_any_width(width, digits):
    rng = np.random.default_rng(1)
    played = [
        {"scenario": "failure", "policy": policy, "episode": k, "seed": k}
        | {column: digits * rng.random() for column in COLUMNS}
        for policy in ("arc-mpcc-safe", "runs/x[/b]") for k in range(4)
    ]  # fmt: skip

    def shown(columns):
        console = Console(width=columns, record=True, file=open(os.devnull, "w"))  # noqa: SIM115
        of = estimates(played)
        left_out = tables.print_lines(console, Text("title"), SHOWN, lines_of(of, SHOWN))
        left_out += tables.print_scores(console, "runs/x[/b]", "failure", of["runs/x[/b]"])
        return console.export_text(), left_out

    whole, nothing = shown(400)
    text, left_out = shown(width)
    assert nothing == []
    assert bool(left_out) == (width < 240)
    assert {word.strip("\N{BOX DRAWINGS LIGHT HORIZONTAL}") for word in text.split()} <= {"", *whole.split()}
    assert {"arc-mpcc-safe", "runs/x[/b]"} <= set(text.split())
    if width >= 60:
        assert max(map(len, text.splitlines())) <= width


def test_columns_that_do_not_fit_are_in_the_file_that_is_named(tmp_path):
    console = Console(width=60, record=True, file=open(os.devnull, "w"))  # noqa: SIM115
    run(small(tmp_path, scenarios=("failure", "knot"), episodes=2), console=console)
    (line,) = (each for each in console.export_text().splitlines() if each.startswith("Columns that do not fit"))
    names, file = re.fullmatch(r"Columns that do not fit the terminal: (.*)\. They are in (\S+), .*", line).groups()
    found = json.loads(Path(file).read_text())
    tables = [of for part in ("statistics", "overall") for of in found[part].values()]
    tables += [each["policies"] for each in found["against"].values()]
    columns = {column for of in tables for policy in of.values() for column in policy}
    assert {name.split()[0] for name in names.split(", ")} <= columns


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scenarios": ("failur",)}, "did you mean failure"),
        ({"policies": ("kuramoto", "sweep")}, "robots of kind curve"),
        ({"episodes": 0}, "episodes must be at least 1"),
        ({"episodes": 10**9}, "episodes must be at most 1,000,000, got 1000000000"),
        ({"address": ""}, "address"),
        ({"seed": 2**31 - 2}, "seed must be"),
        ({"scenarios": ("failure", "failure")}, "each entry once"),
    ],
)
def test_bad_settings_are_refused_before_anything_is_written(tmp_path, changes, words):
    with pytest.raises(ValueError, match=words):
        run(small(tmp_path / "out", **changes), console=QUIET)
    assert not (tmp_path / "out").exists()
