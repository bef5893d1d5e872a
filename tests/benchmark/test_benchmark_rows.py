"""Validation of the rows and settings that a benchmark finds in its folder, column by column."""

import json
import math
import shutil

import pytest
from rich.console import Console

from baselines.benchmark.running import run
from baselines.benchmark.types import Benchmark

QUIET = Console(quiet=True)


def small(out, **changes):
    given = {"scenarios": ("failure",), "policies": ("kuramoto", "open-loop"), "episodes": 5, "batch": 2}
    return Benchmark(**given | {"out": out, "overrides": {"task.duration": 2.0}} | changes)


def lines(folder):
    return (folder / "episodes.jsonl").read_text().splitlines()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Results of one episode of each policy."""
    folder = tmp_path_factory.mktemp("made")
    run(small(folder, episodes=1), console=QUIET)
    return folder


@pytest.fixture
def out(made, tmp_path):
    """A copy of them."""
    return shutil.copytree(made, tmp_path / "out")


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("targets", "NaN", "a whole number"), ("targets", "true", "a whole number"), ("targets", "null", "a whole"),
        ("detected_fraction", "1.01", "from 0 to 1 or null \\(no target appeared\\)"),
        ("contact_time", "null", r"number of at least 0 \[s\], got None"),
        ("idleness_mean", "-1", r"or null \(no grid\)"),
        ("return_mean", "1" + "0" * 400, "a finite number"), ("spacing_factor", "[1]", "a number"),
        ("seed", "0.0", "a whole number"), ("scenario", "null", "scenario must be a text"),
    ],
)  # fmt: skip
def test_a_value_that_no_score_has_is_refused_by_file_line_rule_and_value(out, column, value, words):
    row, other = lines(out)
    given = json.dumps(json.loads(row)[column])
    (out / "episodes.jsonl").write_text(row.replace(f'"{column}": {given}', f'"{column}": {value}') + f"\n{other}\n")
    with pytest.raises(ValueError, match=rf"episodes\.jsonl, line 1:? .*({words}|damaged)"):
        run(small(out, episodes=1), console=QUIET)


@pytest.mark.parametrize("empty", ["recovery_time", "coverage_time", "coverage_time_each", "detection_time_mean"])
def test_a_time_that_never_came_is_null(out, empty):
    rows = [json.loads(line) | {empty: None} for line in lines(out)]
    (out / "episodes.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    assert all(math.isnan(row[empty]) for row in run(small(out, episodes=1), console=QUIET))


@pytest.mark.parametrize(
    "change", [{"episodes": -1}, {"policies": []}, {"versions": {"lissajous-env": "0.1.0"}}, {"new": 1}]
)
def test_settings_that_this_version_did_not_write_are_refused_and_their_version_is_named(out, change):
    path = out / "settings.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    by = "0.1.0" if "versions" in change else r"\d+\.\d+"
    with pytest.raises(ValueError, match=rf"settings\.json is damaged: .*it is of .*'{by}.*, this is "):
        run(small(out, episodes=1), console=QUIET)


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("policy", "sweep", "settings.json does not name"), ("policy", "open-loop", "already contains"),
        ("episode", 7, "episode 7 of 2"), ("seed", 5, "must have seed 0"),
        ("collisions", "many", "collisions must be a whole number of at least 0"),
    ],
)  # fmt: skip
def test_an_episode_that_does_not_belong_is_refused(tmp_path, column, value, words):
    run(small(tmp_path, episodes=2), console=QUIET)
    changed = sorted((json.loads(line) for line in lines(tmp_path)), key=lambda row: row["policy"])
    changed[0][column] = value
    (tmp_path / "episodes.jsonl").write_text("".join(json.dumps(row) + "\n" for row in changed))
    with pytest.raises(ValueError, match=rf"line \d: .*{words}"):
        run(small(tmp_path, episodes=2), console=QUIET)
