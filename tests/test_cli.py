"""The command `lissajous`, as a person runs it: another process, its output, its exit code."""

import csv
import os
import re
import signal
import subprocess
import sys
import time

import pytest

import baselines
import lissajous_env
from lissajous_env.cli import commands, main, parse_overrides
from lissajous_env.score import COLUMNS

BENCHMARK = (
    "benchmark",
    "--scenarios",
    "failure",
    "--policies",
    "kuramoto",
    "still",
    "--episodes",
    "3",
    "--batch",
    "2",
)


def lissajous(*arguments, width=120, **options):
    environment = os.environ | {"COLUMNS": str(width)}
    command = [sys.executable, "-m", "lissajous_env", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60, **options)


def error_of(ended):
    """The one line on stderr that says what was wrong."""
    lines = [line for line in ended.stderr.splitlines() if not line.startswith("Warp CUDA")]
    assert ended.returncode == 2
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    return lines[0]


@pytest.mark.parametrize("arguments", [(), ("--help",)])
def test_help_lists_every_command_in_one_line(arguments):
    ended = lissajous(*arguments, width=80)
    assert ended.returncode == 0
    for name in ("benchmark", "design", "evaluate", "replay", "run", "scenarios"):
        assert re.search(rf"^  {name} +[A-Z]", ended.stdout, re.MULTILINE), name
    assert all(len(line) <= 80 for line in ended.stdout.splitlines())


@pytest.mark.parametrize("name", sorted(commands()))
def test_every_command_has_help(name, capsys):
    with pytest.raises(SystemExit) as ended:
        main([name, "--help"])
    out, error = capsys.readouterr()
    assert (ended.value.code, error) == (0, "")
    assert f"usage: lissajous {name}" in out


@pytest.mark.parametrize("width", [80, 120])
def test_scenarios_lists_each_one(width):
    ended = lissajous("scenarios", width=width)
    for name in lissajous_env.scenarios():
        scenario = lissajous_env.scenario(name).resolve()
        (line,) = re.findall(rf"^{name} +\d.*$", ended.stdout, re.MULTILINE)
        assert {str(scenario.num_robots), scenario.robot.kind, f"{scenario.detection_time_bound:.3g}"} <= set(
            line.split()
        )
    assert all(len(line) <= width for line in ended.stdout.splitlines())


def test_design_prints_designs():
    ended = lissajous("design", "--half-width", "5", "--half-height", "5", "--num-robots", "15")
    assert ended.returncode == 0
    assert "T_max" in ended.stdout


def test_an_unknown_scenario_is_one_clear_line_and_exit_code_2(tmp_path):
    ended = lissajous("benchmark", "--scenarios", "falure", cwd=tmp_path)
    assert error_of(ended).endswith("got 'falure'; did you mean failure?")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["benchmrk"], "did you mean benchmark?"),
        (["benchmark", "--policies", "kuramto"], "did you mean kuramoto?"),
        (["evaluate", "kuramoto", "failure", "--set", "task.duraton=3"], "did you mean duration?"),
        (
            ["evaluate", "kuramoto", "failure", "--set", "task.duration=-3"],
            "must be from 0.001 to 100000000 [s], got -3",
        ),
        (["evaluate", "kuramoto", "failure", "--episodes", "0"], "episodes must be at least 1, got 0"),
        (["run", "failure", "kuramoto", "--out", "film.mov"], "must end in .gif"),
        (["replay", "nowhere.npz"], "nowhere.npz"),
    ],
)
def test_bad_input_is_one_clear_line_and_exit_code_2(arguments, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert words in error_of(subprocess.CompletedProcess(arguments, int(ended.value.code or 0), *capsys.readouterr()))
    assert not list(tmp_path.iterdir())


def test_benchmark_prints_a_table_and_resumes(tmp_path):
    first = lissajous(*BENCHMARK, "--set", "task.duration=2", "--out", tmp_path)
    again = lissajous(*BENCHMARK, "--set", "task.duration=2.0", "--out", tmp_path)
    assert first.returncode == again.returncode == 0
    assert "failure kuramoto: 3 episodes" in first.stderr
    assert "episodes, " not in again.stderr  # there was nothing left to play
    tables = [re.sub(r", [\d.]+ s\n", "", ended.stdout) for ended in (first, again)]
    assert tables[1].startswith(tables[0].partition("Interquartile")[0])
    assert "6 of 6 episodes were in" in tables[1]
    assert "kuramoto" in tables[0]
    with open(tmp_path / "episodes.csv", newline="") as file:
        assert tuple(next(csv.reader(file))) == COLUMNS
    refused = lissajous(*BENCHMARK, "--set", "task.duration=3", "--out", tmp_path)
    assert refused.returncode == 2
    assert re.search(r"scenarios.failure.task.duration +2\.0 +3\.0", refused.stderr)


def test_a_policy_that_raises_ends_with_exit_code_1(tmp_path):
    (tmp_path / "mine.py").write_text("def policy(scenario, num_worlds, device):\n    raise RuntimeError('broken')\n")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])}
    arguments = ["--scenarios", "failure", "--policies", "mine:policy", "still", "--episodes", "1"]
    command = [sys.executable, "-m", "lissajous_env", "benchmark", *arguments, "--out", str(tmp_path / "out")]
    ended = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60)
    assert ended.returncode == 1
    assert "mine:policy failed on failure: RuntimeError: broken" in ended.stdout
    assert len((tmp_path / "out" / "episodes.jsonl").read_text().splitlines()) == 1


def test_evaluate_prints_statistics_and_writes_the_rows(tmp_path):
    arguments = [
        "evaluate",
        "still",
        "failure",
        "--episodes",
        "3",
        "--set",
        "task.duration=2",
        "targets.count=7",
        "targets.arrival_rate=0",
    ]
    ended = lissajous(*arguments, "--out", tmp_path / "rows.csv")
    assert ended.returncode == 0
    assert re.search(r"^targets +7 ", ended.stdout, re.MULTILINE)
    with open(tmp_path / "rows.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["policy"], row["seed"], row["targets"]) for row in rows] == [("still", str(k), "7") for k in range(3)]


def test_ctrl_c_ends_with_130_and_says_how_to_go_on(tmp_path):
    arguments = ["benchmark", "--scenarios", "failure", "--policies", "still", "--episodes", "100000", "--batch", "1"]
    command = [sys.executable, "-m", "lissajous_env", *arguments, "--out", str(tmp_path)]
    episodes = tmp_path / "episodes.jsonl"
    deadline = time.monotonic() + 60
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    # Tests that a shell runs in the background ignore Ctrl-C, and so would their children.
    with subprocess.Popen(command, **pipes, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)) as process:
        try:
            while time.monotonic() < deadline and not (episodes.exists() and episodes.stat().st_size):
                time.sleep(0.02)
            process.send_signal(signal.SIGINT)
            _, error = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 130
    assert "Traceback" not in error
    assert f"finished episodes are kept in {tmp_path}, the same command goes on from there" in error
    assert episodes.read_text().endswith("\n")


def test_overrides_are_literals_words_and_infinity():
    given = [["curve.a=5", "task.grid=(4, 2)"], ["formation.start=random", "task.duration=inf", "robot.count=None"]]
    assert parse_overrides(given) == {
        "curve.a": 5, "task.grid": (4, 2), "formation.start": "random", "task.duration": float("inf"),
        "robot.count": None,
    }  # fmt: skip


@pytest.mark.parametrize("entry", ["curve.a", "=3", "curve.a=3 +", "curve.a=__import__('os')"])
def test_an_override_that_is_no_value_is_refused(entry):
    with pytest.raises(ValueError, match="--set"):
        parse_overrides([[entry]])


def test_run_and_replay_make_files_and_need_no_display(tmp_path):
    headless = {name: value for name, value in os.environ.items() if "DISPLAY" not in name and "SDL" not in name}
    command = [sys.executable, "-m", "lissajous_env"]

    def call(*arguments):
        given = [*command, *map(str, arguments)]
        return subprocess.run(given, capture_output=True, text=True, env=headless, cwd=tmp_path, timeout=60)

    short = ("run", "failure", "kuramoto", "--seed", "3", "--set", "task.duration=1")
    shown = call(*short)
    assert shown.returncode == 0
    assert "there is no display" in shown.stderr
    assert call(*short, "--out", "episode.npz").returncode == 0
    for name, magic in (("film.gif", b"GIF89a"), ("sheet.png", b"\x89PNG")):
        assert call("replay", "episode.npz", "--out", name).returncode == 0
        assert (tmp_path / name).read_bytes().startswith(magic)
    assert "there is no display" in error_of(call("replay", "episode.npz"))
    # Oracle: the same episode through `evaluate`, as `run` prints it.
    scenario = lissajous_env.scenario("failure", **{"task.duration": 1.0})
    (row,) = lissajous_env.evaluate(baselines.make("kuramoto", scenario), scenario, seeds=[3])
    assert re.search(rf"^min_separation +{row['min_separation']:.3f}$", shown.stdout, re.MULTILINE)
    (tmp_path / "episode.npz").write_bytes((tmp_path / "episode.npz").read_bytes()[:1000])
    assert "episode.npz" in error_of(call("replay", "episode.npz", "--out", "film.gif"))
