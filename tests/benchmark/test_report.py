"""The report of a benchmark: contents and replays."""

import io
import json
import math
import re

import numpy as np
import pytest
from benchmarks_in_the_small import QUIET, furthest, rows, small
from rich.console import Console

import baselines
import lissajous_env
from baselines.benchmark import local, replays, report_page
from baselines.benchmark.running import measure, run
from baselines.benchmark.table import Table
from baselines.benchmark.types import Benchmark
from lissajous_env.episodes.recording import record
from lissajous_env.replay.contents import BRIEF, contents
from lissajous_env.world.columns import COLUMNS

HOSTILE = "</script><img src=x onerror=alert(1)>[/b]"
SHORT = {"task.duration": 4.0}
TWO = ("evaders", "failure")
GIVEN = {"policies": ("kuramoto-mpcc", "laps", "kuramoto"), "scenarios": TWO, "episodes": 4, "overrides": SHORT}


def blocks_of(folder):
    """JSON of the page's blocks, by id."""
    text = (folder / "report.html").read_text(encoding="utf-8")
    blocks = re.findall(r'<script type="application/json" id="([^"]+)">(.*?)</script>', text, re.DOTALL)
    return {name: json.loads(block) for name, block in blocks}


@pytest.fixture(scope="module")
def small_one(tmp_path_factory):
    """A small benchmark's folder, rows and the blocks of its page."""
    folder = tmp_path_factory.mktemp("report")
    return folder, run(small(folder, **GIVEN, replays=4), console=QUIET), blocks_of(folder)


def test_the_page_has_every_score_of_every_episode(small_one):
    # Oracle: the score rows, to the five digits that are stored.
    _, rows, blocks = small_one
    data = blocks["data"]
    assert data["total"] == len(rows) == 12  # failure has points, which kuramoto alone drives
    episodes = data["episodes"]
    names = [entry["name"] for entry in data["scenarios"]], [entry["name"] for entry in data["policies"]]
    for k, place in enumerate(zip(episodes["scenario"], episodes["policy"], episodes["seed"], strict=True)):
        key = names[0][place[0]], names[1][place[1]], place[2]
        (row,) = [row for row in rows if (row["scenario"], row["policy"], row["seed"]) == key]
        for column in COLUMNS:
            wanted = None if math.isnan(row[column]) else pytest.approx(row[column], rel=1e-4)
            assert episodes[column][k] == wanted, column


def test_the_page_has_all_scenarios_together_the_first_column_in_order():
    # Oracle: by hand; b detects sooner on both scenarios and collides.
    numbers = {
        "a": {"detection_time_mean": [4.0], "collisions": [0]},
        "b": {"detection_time_mean": [2.0], "collisions": [3]},
    }
    played = [
        row for policy in numbers for name in ("evaders", "team") for row in rows(policy, name, **numbers[policy])
    ]
    drives = {"robot.kind": "differential", "robot.yaw_rate_max": 5.0}
    scenarios = {name: lissajous_env.scenario(name, **drives) for name in ("evaders", "team")}
    table = Table.of(played, scenarios)
    page = report_page.page(table, table.rows, {}, {})
    (overall,) = (data := json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1]))["overall"]
    facts = overall["kind"], overall["scenarios"], overall["measures"][0]["column"]
    assert facts == ("differential drives", ["evaders", "team"], "score_over_best")
    first, second = overall["policies"]
    assert [data["policies"][policy["policy"]]["name"] for policy in (first, second)] == ["b", "a"]
    assert [policy["cells"]["score_over_best"]["words"] for policy in (first, second)] == ["1", "2"]
    assert first["cells"]["collisions"] == {"words": "3", "between": "", "value": 3.0, "known": 2, "best": False}
    assert second["cells"]["collisions"]["best"]
    assert first["cells"]["score_improvement"]["words"] == "100 %"
    best = {cell["words"] for of in data["scenarios"][0]["policies"] for cell in of["cells"].values() if cell["best"]}
    assert {"2", "0"} <= best <= {"2", "0", "1", "100 %"}, "the shorter time, no collision"


def test_columns_of_ones_own_are_in_every_table(tmp_path):
    # Story: a second call reads the scenario from the folder, without its extensions; the column stays.
    scenario = lissajous_env.scenario("failure", **SHORT, extensions=(furthest,))
    settings = Benchmark(policies=("kuramoto", "random"), episodes=2, out=tmp_path, replays=0)
    for _ in range(2):
        console = Console(record=True, file=io.StringIO(), width=110)
        run(settings, scenarios=[scenario], console=console)
        assert "furthest" in console.export_text()
        assert " furthest |" in (tmp_path / "table.md").read_text().partition("\n")[0]
        data = blocks_of(tmp_path)["data"]
        (entry,) = data["scenarios"]
        assert "furthest" in [measure["column"] for measure in entry["measures"]]
        assert all(policy["cells"]["furthest"]["value"] > 0 for policy in entry["policies"])
        column = {"name": "furthest", "title": "furthest", "listed": True, "whole": False, "open": None}
        assert column in data["columns"]


def test_the_worst_comes_first():
    # Story: who collided and lost the guarantee stands before who only lost it, and that before the merely slow.
    scenario = lissajous_env.scenario("evaders")
    good = dict.fromkeys(COLUMNS, 1.0) | {"scenario": "evaders", "collisions": 0, "guarantee_open": 0}
    slow = good | {"guaranteed_detection_time": 30.0}
    lost = slow | {"guarantee_open": 1}
    both = lost | {"collisions": 3}
    blind = lost | {"collisions": 3, "sensed_fraction": 0.4}
    empty = good | dict.fromkeys(("guaranteed_detection_time", "detection_time_mean", "detected_fraction"), math.nan)
    rows = [good, both, slow, blind, empty, lost]
    assert report_page.worst_first(rows, {"evaders": scenario}) == [blind, both, lost, slow, good, empty]
    assert [report_page.failed(row) for row in rows[:4]] == [
        [False, False, False], [False, True, True], [False, False, False], [True, True, True],
    ]  # fmt: skip


def test_replays_are_the_worst_of_each_policy_first_and_their_partners():
    rows = [{"scenario": "a", "policy": p, "seed": seed} for seed in range(3) for p in ("x", "y")]
    both = [("a", "x"), ("a", "y")]
    assert replays.chosen(3, rows, both, {}) == [("a", "x", 0), ("a", "y", 0), ("a", "x", 1)]
    assert replays.chosen(9, rows, both[1:], {"a": "x"}) == [("a", "y", seed) for seed in range(3)]
    assert replays.chosen(0, rows, both, {"a": "x"}) == []
    assert replays.chosen(3, rows[1:], both, {"a": "x"})[:3] == [("a", "y", 0), ("a", "x", 1), ("a", "y", 1)]


def test_a_replay_is_the_episode_as_it_was_scored(small_one):
    # Oracle: the episode recorded alone, by the policy of one world.
    _, rows, blocks = small_one
    data = blocks["data"]
    scenario = lissajous_env.scenario("evaders", **SHORT)
    ranked = report_page.worst_first(rows, {"evaders": scenario, "failure": scenario})
    worst = next(row["seed"] for row in ranked if row["policy"] == "laps")
    keys = {
        (data["scenarios"][s]["name"], data["policies"][p]["name"], seed): name
        for name, (s, p, seed) in data["replays"].items()
    }
    assert {place[:2] for place in keys} == {("evaders", "kuramoto-mpcc"), ("evaders", "laps"), ("failure", "kuramoto")}
    assert ("evaders", "kuramoto-mpcc", worst) in keys
    block = blocks[keys["evaders", "laps", worst]]
    alone = contents(record(baselines.make("laps", scenario), scenario, worst), BRIEF)
    same = [key for key in alone if key not in ("policy", "score")]
    assert {key: block[key] for key in same} == json.loads(json.dumps({key: alone[key] for key in same}))
    assert block["robots"]["watched"] == 0
    assert len(json.dumps(block)) < 60_000


def test_a_second_call_makes_the_same_report_from_the_rows_alone(small_one, monkeypatch):
    folder, _, blocks = small_one
    monkeypatch.setattr(local, "batches", None)  # nothing is played for it
    (folder / "report.html").unlink()
    run(small(folder, **GIVEN, replays=4), console=QUIET)
    again = blocks_of(folder)
    assert again.keys() == blocks.keys()
    assert again | {"data": None} == blocks | {"data": None}
    assert again["data"] | {"made": 0} == blocks["data"] | {"made": 0}


def test_hostile_names_and_policies_that_cannot_be_played_again(tmp_path):
    # Story: a policy of Python is named by a script and draws numbers of its own; one refuses to be made again.
    generator, calls = np.random.default_rng(0), []

    def act(observation):
        return generator.uniform(-1, 1, (*observation.shape[:2], 1)).astype(np.float32)

    def factory(scenario, num_worlds, device):
        calls.append(num_worlds)
        if len(calls) > 1:
            raise RuntimeError("not twice")
        return baselines.make("still", scenario, num_worlds)

    console = Console(record=True, file=io.StringIO(), width=200, force_terminal=True)
    settings = small(tmp_path, policies=("kuramoto",), episodes=2, replays=8, overrides=SHORT)
    assert len(measure(settings, {HOSTILE: act, "once": factory}, None, console, console).rows) == 6
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert HOSTILE not in text
    assert "<img" not in text
    assert len(blocks_of(tmp_path)["data"]["replays"]) == 4
    said = console.export_text()
    assert "report.html plays 4 of the episodes" in said
    assert "not replayed: once on failure: RuntimeError: not twice" in said


def test_of_many_episodes_the_worst_are_listed(small_one, monkeypatch):
    folder, _, blocks = small_one
    monkeypatch.setattr(report_page, "MOST_EPISODES", 6)
    run(small(folder, **GIVEN), console=QUIET)
    data = blocks_of(folder)["data"]
    assert (data["total"], data["episodes"]["seed"]) == (12, blocks["data"]["episodes"]["seed"][:6])
