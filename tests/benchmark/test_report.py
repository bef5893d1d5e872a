"""The report of a benchmark: contents and replays."""

import io
import json
import math
import re

import numpy as np
import pytest
from rich.console import Console

import baselines
import lissajous_env
from baselines.benchmark import local, ranking, replays, report_page
from baselines.benchmark.ranking import rankings
from baselines.benchmark.running import run
from baselines.benchmark.shown import number
from baselines.benchmark.table import Table
from baselines.benchmark.types import Benchmark
from lissajous_env.episodes.recording import record
from lissajous_env.replay.contents import BRIEF, contents
from lissajous_env.world.columns import COLUMNS

QUIET = Console(quiet=True)
HOSTILE = "</script><img src=x onerror=alert(1)>"
SHORT = {"task.duration": 4.0}
TWO = ("evaders", "failure")


def small(out, **changes):
    given = {"scenarios": TWO, "policies": ("kuramoto-mpcc", "laps", "kuramoto"), "episodes": 4, "overrides": SHORT}
    return Benchmark(**given | {"out": out, "replays": ("1", "evaders:laps:2")} | changes)


def blocks_of(folder):
    """JSON of the page's blocks, by id."""
    text = (folder / "report.html").read_text(encoding="utf-8")
    found = re.findall(r'<script type="application/json" id="([^"]+)">(.*?)</script>', text, re.DOTALL)
    return {name: json.loads(block) for name, block in found}


@pytest.fixture(scope="module")
def small_one(tmp_path_factory):
    """A small benchmark's folder, rows and the blocks of its page."""
    folder = tmp_path_factory.mktemp("report")
    return folder, run(small(folder), console=QUIET), blocks_of(folder)


def test_the_page_holds_every_score_of_every_episode(small_one):
    # Oracle: the score rows, to the five digits that are kept.
    _, rows, blocks = small_one
    data = blocks["data"]
    assert data["total"] == len(rows) == 12  # failure has points, which kuramoto alone drives
    held = data["episodes"]
    names = [each["name"] for each in data["scenarios"]], [each["name"] for each in data["policies"]]
    for k, place in enumerate(zip(held["scenario"], held["policy"], held["seed"], strict=True)):
        key = names[0][place[0]], names[1][place[1]], place[2]
        (row,) = [row for row in rows if (row["scenario"], row["policy"], row["seed"]) == key]
        for column in COLUMNS:
            wanted = None if math.isnan(row[column]) else pytest.approx(row[column], rel=1e-4)
            assert held[column][k] == wanted, column


def test_the_page_has_the_ranking_the_pairs_and_all_scenarios_together(tmp_path):
    # Oracle: the comparisons that summary.json has, and `rankings` of the rows.
    given = {"scenarios": ("evaders", "team"), "policies": ("kuramoto-mpcc", "laps", "still"), "replays": ("none",)}
    rows = run(small(tmp_path, **given), console=QUIET)
    data, summary = blocks_of(tmp_path)["data"], json.loads((tmp_path / "summary.json").read_text())
    names = [each["name"] for each in data["policies"]]
    (cars,) = data["rankings"]
    scenarios = {name: lissajous_env.scenario(name, **SHORT) for name in ("evaders", "team")}
    (oracle,) = rankings(Table.of(rows, scenarios))
    assert [names[each["policy"]] for each in cars["policies"]] == list(oracle.ranks)
    assert cars["policies"][0]["ranks"][0] == pytest.approx(oracle.overall[next(iter(oracle.ranks))], rel=1e-4)
    overall = summary["overall"]["evaders, team"]
    place = [measure["column"] for measure in cars["measures"]].index("collisions")
    for each in cars["policies"]:
        assert each["overall"][place][0] == number(overall[names[each["policy"]]]["collisions"]["mean"])
    for scenario in data["scenarios"]:
        pairs = summary["against"][scenario["name"]]["policies"]
        titles = [column["title"] for column in scenario["against"]["columns"]]
        assert titles[0] == "detection [s]"
        for each in scenario["against"]["policies"]:
            of = pairs[names[each["policy"]]]["detection_time_mean"]
            assert each["pairs"][0]["better"][0] == pytest.approx(of["better"])
            assert each["pairs"][0]["difference"].lstrip("+") == number(of["difference"])


@lissajous_env.score_column(reduce="max")
def furthest(world):
    """Largest distance of a robot from the middle [m]."""
    return np.abs(world.robots.position[..., 0]).max(axis=1)


def test_columns_of_ones_own_are_in_every_table(tmp_path):
    # Story: a second call reads the scenario from the folder, without its extensions; the column stays.
    scenario = lissajous_env.scenario("failure", **SHORT, extensions=(furthest,))
    settings = Benchmark(policies=("kuramoto", "random"), episodes=2, out=tmp_path, replays=("none",))
    for _ in range(2):
        console = Console(record=True, file=io.StringIO(), width=110)
        run(settings, scenarios=[scenario], console=console)
        assert "furthest" in console.export_text()
        data = blocks_of(tmp_path)["data"]
        (of,) = data["scenarios"]
        assert "furthest" in [each["column"] for each in of["measures"]]
        assert all(each["cells"]["furthest"]["value"] > 0 for each in of["policies"])
        told = {"name": "furthest", "title": "furthest", "listed": True, "whole": False, "open": None}
        assert told in data["columns"]


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
    assert ranking.worst_first(rows, {"evaders": scenario}) == [3, 1, 5, 2, 0, 4]
    assert [ranking.failed(row) for row in rows[:4]] == [
        [False, False, False], [False, True, True], [False, False, False], [True, True, True],
    ]  # fmt: skip


def test_replays_are_the_worst_the_chosen_and_their_partners(small_one):
    _, rows, blocks = small_one
    data = blocks["data"]
    scenarios = {name: lissajous_env.scenario(name, **SHORT) for name in TWO}
    ranked = [rows[k] for k in ranking.worst_first(rows, scenarios)]
    worst = {(row["scenario"], row["policy"]): row["seed"] for row in reversed(ranked)}
    wanted = {(s, p, seed) for (s, p), seed in worst.items()} | {("evaders", "laps", 2)}
    wanted |= {("evaders", "kuramoto-mpcc", seed) for s, _, seed in wanted if s == "evaders"}
    found = {
        (data["scenarios"][s]["name"], data["policies"][p]["name"], seed)
        for s, p, seed, same, _ in data["replays"].values()
        if same
    }
    assert found == wanted


def test_a_replay_is_the_episode_as_it_was_scored(small_one):
    # Oracle: the episode recorded alone, by the policy of one world.
    blocks = small_one[2]
    data = blocks["data"]
    key_of = lambda s, p, seed, *_: (data["scenarios"][s]["name"], data["policies"][p]["name"], seed)  # noqa: E731
    (name,) = [name for name, of in data["replays"].items() if key_of(*of) == ("evaders", "laps", 2)]
    scenario = lissajous_env.scenario("evaders", **SHORT)
    alone = contents(record(baselines.make("laps", scenario), scenario, 2), BRIEF)
    same = [key for key in alone if key not in ("policy", "score", "rogue")]
    assert {key: blocks[name][key] for key in same} == json.loads(json.dumps({key: alone[key] for key in same}))
    assert blocks[name]["robots"]["watched"] == 0
    assert len(json.dumps(blocks[name])) < 60_000


def test_replays_are_chosen_by_a_word_a_number_or_a_name():
    rows = [{"scenario": "a", "policy": p, "seed": seed} for seed in range(5) for p in ("x", "y")]
    of = lambda *seeds: [("a", p, seed) for p in ("x", "y") for seed in seeds]  # noqa: E731

    def keys(*asked, cells=(("a", "x"), ("a", "y"))):
        return replays.chosen(asked, rows, cells)

    assert keys("few") == keys("1") == of(0)
    assert keys("each") == of(0, 2, 4)
    assert keys("2") == of(0, 1)
    assert keys("all") == of(0, 1, 2, 3, 4)
    assert keys("none") == []
    assert keys("a:y:3", "none", "1") == [("a", "y", 3), *of(0)]
    assert keys("1", cells=[("a", "y")]) == [("a", "y", 0)]
    assert replays.with_references([("a", "y", 3)], [("a", "x"), ("a", "y")], rows, {"a": "x"}) == of(3)
    many = [{"scenario": "a", "policy": f"p{k}", "seed": 0} for k in range(20)]
    assert replays.chosen(("few",), many, [("a", f"p{k}") for k in range(20)]) == [
        ("a", f"p{k}", 0) for k in range(replays.FEW)
    ]


@pytest.mark.parametrize("word", ["some", "-1", "evaders:laps", "evaders:laps:9", "evaders:lap:1", "team:laps:0", "²"])
def test_replays_of_what_is_not_played_are_refused_at_once(tmp_path, word):
    with pytest.raises(ValueError, match=r"replays must be none, few, each, all, a number, or SCENARIO:POLICY:SEED"):
        run(small(tmp_path / "out", replays=(word,)), console=QUIET)
    assert not (tmp_path / "out").exists()


def test_a_second_call_makes_the_same_report_from_the_rows_alone(small_one, tmp_path, monkeypatch):
    folder, _, blocks = small_one
    for name in ("settings.json", "episodes.jsonl", "detections.jsonl"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    written = [{"wrote": name} for name in ("settings.json", "episodes.jsonl", "detections.jsonl")]
    head = (folder / ".lissajous.jsonl").read_text().splitlines()[0]
    (tmp_path / ".lissajous.jsonl").write_text("\n".join([head, *map(json.dumps, written)]) + "\n")
    monkeypatch.setattr(local, "play", None)  # nothing is played for it
    run(small(tmp_path), console=QUIET)
    again = blocks_of(tmp_path)
    assert again.keys() == blocks.keys()
    assert {n: of for n, of in again.items() if n != "data"} == {n: of for n, of in blocks.items() if n != "data"}
    assert {k: v for k, v in again["data"].items() if k != "made"} == {
        k: v for k, v in blocks["data"].items() if k != "made"
    }


def test_hostile_names_and_policies_of_ones_own(tmp_path):
    # Story: a policy of Python whose name would be script, and which draws numbers of its own.
    scenario = lissajous_env.scenario("failure", **SHORT)
    generator = np.random.default_rng(0)

    def act(observation):
        return generator.uniform(-1, 1, (*observation.shape[:2], 1)).astype(np.float32)

    settings = Benchmark(("failure",), ("kuramoto",), 2, out=tmp_path, replays=("1",), overrides=SHORT)
    run(settings, {HOSTILE: act}, [scenario], QUIET)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert HOSTILE not in text
    assert "<img" not in text
    data = blocks_of(tmp_path)["data"]
    mine = [each for each in data["policies"] if each["name"] == HOSTILE]
    assert [each["named"] for each in mine] == [False]  # no command can name it
    assert sorted(same for *_, same, _ in data["replays"].values())[0] is False


def test_a_policy_that_fails_when_it_is_played_again_is_told(tmp_path):
    # Story: it plays the benchmark, and refuses to be made once more.
    made = []

    def factory(scenario, num_worlds, device):
        made.append(num_worlds)
        if len(made) > 1:
            raise RuntimeError("not twice")
        return baselines.make("still", scenario, num_worlds)

    console = Console(record=True, file=io.StringIO(), width=200)
    scenario = lissajous_env.scenario("failure", **SHORT)
    settings = Benchmark(("failure",), ("kuramoto",), 2, out=tmp_path, replays=("1",), overrides=SHORT)
    rows = run(settings, {"once": factory}, [scenario], console)
    said = console.export_text()
    assert len(rows) == 4
    assert "report.html plays 1 of the episodes" in said
    assert "not replayed: once on failure: RuntimeError" in said
    assert "not twice" in said


def test_of_many_episodes_the_worst_are_listed(small_one, tmp_path, monkeypatch):
    folder = small_one[0]
    before = blocks_of(folder)["data"]["episodes"]
    monkeypatch.setattr(report_page, "MOST_EPISODES", 6)
    run(small(tmp_path, replays=("none",)), console=QUIET)
    data = blocks_of(tmp_path)["data"]
    assert data["total"] == 12
    kept = list(zip(data["episodes"]["scenario"], data["episodes"]["policy"], data["episodes"]["seed"], strict=True))
    assert sorted(place[:2] for place in kept) == sorted(
        2 * list(dict.fromkeys(zip(before["scenario"], before["policy"], strict=True)))
    )
