"""The command `lissajous`: output and exit codes; one process of its own, for Ctrl-C."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest
from command_line import called

import baselines
import lissajous_env
from lissajous_env.console import cli
from lissajous_env.parameters import named
from lissajous_env.parameters.robot_models import MODELS
from lissajous_env.world.columns import NAMES

BENCHMARK = ("benchmark", "--scenarios", "failure", "--policies", "kuramoto", "still", "--episodes", 3, "--batch", 2)


def refusal_of(capsys, *arguments):
    """Return the one line on stderr that says what was wrong with a command."""
    code, out, error = called(capsys, *arguments)
    (line,) = [line for line in error.splitlines() if not line.startswith("Warp CUDA")]
    assert (code, out) == (2, "")
    assert line.startswith("error: ")
    return line


def test_scenarios_of_a_split_are_listed_with_the_score_of_their_task(capsys):
    listed = json.loads(called(capsys, "scenarios", "watch-v1:test:2", "--json")[1])
    assert [entry["name"] for entry in listed] == list(named.expanded(["watch-v1:test:2"]))
    assert [entry["score"] for entry in listed] == ["observed_fraction"] * 2


@pytest.mark.parametrize("width", [80, 120])
def test_scenarios_lists_each_one(width, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(width))
    _, out, _ = called(capsys, "scenarios")
    for name in lissajous_env.scenarios():
        scenario = lissajous_env.scenario(name).resolve()
        # Oracle: (8), by hand. What the sensors of these do not guarantee is printed as no bound.
        short = name.startswith(("intruders", "evaders", "hall", "watch", "intercept", "hotspots"))
        bound = "-" if short else f"{scenario.detection_time_bound:.3g}"
        (line,) = re.findall(rf"^{name} +\d.*$", out, re.MULTILINE)
        assert {str(scenario.num_robots), scenario.robot.kind, bound} <= set(line.split())
    assert all(len(line) <= width for line in out.splitlines() if not line.startswith("Columns that do not fit"))


@pytest.mark.parametrize(("arguments", "words"), [
    (["benchmrk"], "did you mean benchmark?"),
    (["run", "failure", "kuramoto", "--set", "task.duration=-3"], "must be from 0.001 to 100000000 [s], got -3"),
    (["evaluate", "failure", "kuramoto", "--set", "name=evil"], "override must name one of curve"),
    (["evaluate", "failure", "kuramoto", "--set", "curve.a=" + "-" * 100_000 + "1"], "--set curve.a must be given"),
    (["guarantee", "ideal", "watch"], "task.action of watch must be control for a policy that follows the curve"),
    (["guarantee", "ideal", "ideal"], "scenarios must differ in name, got 2 of ideal"),
    (["evaluate", "failure", "kuramoto", "--out", "nowhere/rows.csv"], "out must be in an existing folder"),
    (["evaluate", "failure", "kuramoto", "--out", "."], "out must end in .csv, got ."),
    (["evaluate", "failure", ""], "got ''"),
    (["evaluate"], "names must be scenarios and then a policy, got nothing"),
    (["evaluate", "failure", "all"], "policy must be the name of one policy, got 'all'"),
    (["exploit", "monitoring-v1:train:2", "kuramoto-mpcc"], "one scenario must be given, got monitoring-v1-"),
    (["evaluate", "still"], "scenario must be given before the policy"),
    (["evaluate", "failure", "knot"], "policy must be given after the scenario, got failure, knot"),
    (["evaluate", "failure", "stil"], "got 'stil'; did you mean still?"),
    (["evaluate", "failure", "failure", "kuramoto"], "scenarios must differ in name, got 2 of failure"),
    (["evaluate", "failure", "x\udcff"], "got 'x"),
    (["evaluate", "failure", "nowhere:Policy"], "got 'nowhere:Policy': ModuleNotFoundError"),
    (["evaluate", "failure", "os:sep"], "policy os:sep must be a policy or factory(scenario, num_worlds, device)"),
    (["evaluate", "x[/b]/7"], "folder of a policy must exist, got 'x[/b]/7'"),
    (["run", "failure", "kuramoto", "--device", "tpu"], "device must be one of"),
    (["replay", "nowhere.npz", "--out", "x.gif", "--speed", "1e-9"], "speed must be from 0.01 to 1000, got 1e-09"),
    (["replay", "nowhere.npz", "--out", "x.gif", "--fps", "nan"], "fps must be from 0.1 to 50, got nan"),
    (["run", "failure", "kuramoto", "--out", "film.mov"], "must end in .html or .mp4 or .gif"),
    (["replay", "nowhere.npz"], "nowhere.npz"),
])  # fmt: skip
def test_bad_input_is_one_clear_line_and_exit_code_2(arguments, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert words in refusal_of(capsys, *arguments)
    assert not list(tmp_path.iterdir())


def test_benchmark_prints_a_table_and_resumes(tmp_path, capsys):
    first = called(capsys, *BENCHMARK, "--set", "task.duration=2", "--out", tmp_path)
    again = called(capsys, *BENCHMARK, "--set", "task.duration=2.0", "--out", tmp_path)
    assert first[0] == again[0] == 0
    assert "failure kuramoto: played, " in first[2]
    assert "played" not in again[2]  # there was nothing left to play
    assert again[1].startswith(first[1].partition("Interquartile")[0])
    assert "6 of 6 episodes were already in" in again[1]
    assert "kuramoto" in first[1]
    assert (tmp_path / "episodes.csv").read_text().splitlines()[0] == ",".join(NAMES)
    assert called(capsys, *BENCHMARK, "--set", "task.duration=3", "--out", tmp_path)[0] == 2


@pytest.mark.parametrize(("command", "ending"), [
    (lambda: True, (0, "")), (lambda: 3, (3, "")), (lambda: sys.exit("no end"), (1, "error: no end\n")),
    (lambda: exec("raise RuntimeError('a\\nb')"), (1, "error: RuntimeError: a (<string>, line 1);")),
])  # fmt: skip
def test_a_command_of_another_package_ends_with_its_exit_code_or_reason(command, ending, monkeypatch, capsys):
    monkeypatch.setattr(cli, "commands", lambda: {"mine": SimpleNamespace(load=lambda: command)})
    code, _, error = called(capsys, "mine")
    assert (code, error.partition(" set ")[0]) == ending


def test_a_policy_that_raises_ends_with_exit_code_1(tmp_path, capsys, monkeypatch):
    (tmp_path / "broken.py").write_text("def policy(scenario, num_worlds, device):\n    raise RuntimeError('no')\n")
    monkeypatch.chdir(tmp_path)
    arguments = ["--scenarios", "failure", "--policies", "broken:policy", "still", "--episodes", "1", "--out", "out"]
    code, out, error = called(capsys, "benchmark", *arguments)
    assert code == 1
    assert "broken:policy failed on failure: RuntimeError: no (broken.py, line 2)" in out
    assert error.splitlines()[-1].startswith("error: broken:policy on failure failed; ")
    assert len((tmp_path / "out" / "episodes.jsonl").read_text().splitlines()) == 1


def test_evaluate_prints_statistics_and_writes_the_rows(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("failure", "still"):  # a folder of results may have the name of its scenario
        (tmp_path / name).mkdir()
    fields = ("--set", "task.duration=2", "targets.count=7", "targets.arrival_rate=0")
    file = tmp_path / "rows.csv"
    code, out, _ = called(capsys, "evaluate", "failure", "still", "--episodes", 3, *fields, "--out", file)
    assert code == 0
    assert re.search(r"^targets +(interquartile mean +)?7 ", out, re.MULTILINE)  # by the width of the terminal
    rows = list(csv.DictReader(file.read_text().splitlines()))
    assert [(row["policy"], row["seed"], row["targets"]) for row in rows] == [("still", str(k), "7") for k in range(3)]


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_ends_with_130_and_says_how_to_go_on(tmp_path):
    arguments = ["benchmark", "--scenarios", "failure", "--policies", "still", "--episodes", "100000", "--batch", "1"]
    command = [sys.executable, "-m", "lissajous_env", *arguments, "--out", str(tmp_path)]
    episodes = tmp_path / "episodes.jsonl"
    deadline = time.monotonic() + 60
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as process:
        try:
            while time.monotonic() < deadline and not (episodes.exists() and episodes.stat().st_size):
                time.sleep(0.02)
            process.send_signal(signal.SIGINT)
            _, error = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 130
    assert "Traceback" not in error
    assert f"finished episodes are stored in {tmp_path}; run the same command again to resume" in error
    assert episodes.read_text().endswith("\n")


def test_run_and_replay_make_files_and_need_no_display(tmp_path, capsys, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("MPLBACKEND", "module://matplotlib_inline.backend_inline")  # that of a notebook
    monkeypatch.chdir(tmp_path)
    short = ("run", "failure", "kuramoto", "--seed", "3", "--set", "task.duration=1")
    code, shown, error = called(capsys, *short)
    assert code == 0
    assert "there is no display" in error
    assert called(capsys, *short, "--out", "episode.npz")[0] == 0
    assert "MPLBACKEND" not in os.environ
    assert called(capsys, "replay", "episode.npz", "--out", "film.gif")[0] == 0
    assert (tmp_path / "film.gif").read_bytes().startswith(b"GIF89a")
    assert "there is no display" in refusal_of(capsys, "replay", "episode.npz")
    (tmp_path / "page.html").touch()
    assert "not of a page, which browsers open" in refusal_of(capsys, "replay", "page.html")
    # Oracle: the same episode through `evaluate`, as `run` prints it.
    scenario = lissajous_env.scenario("failure", **{"task.duration": 1.0})
    (row,) = lissajous_env.evaluate(baselines.make("kuramoto", scenario), scenario, seeds=[3])
    assert re.search(rf"^min_separation +{row['min_separation']:.3f}$", shown, re.MULTILINE)
    (tmp_path / "episode.npz").write_bytes((tmp_path / "episode.npz").read_bytes()[:1000])
    assert "episode.npz" in refusal_of(capsys, "replay", "episode.npz", "--out", "film.gif")


@pytest.mark.parametrize(("arguments", "words"), [
    (["benchmark", "--epsiodes", "3"], "--epsiodes"),
    (["plan", "evaders", "--robots", "8:3"], "robots must be a number or a range such as 3:8, from 2 to 64, got"),
    (["train", "--steps", "0"], "training.steps must be a whole number from 1 to 1000000000000000, got 0"),
    (["run"], "--help"),
    (["scenarios", "--episodes"], "--episodes"),
    (["evaluate", "failure", "still", "--episodes", "few"], "'few'"),
    (["train", "--noise", "nan"], "noise must be from 1e-06 to 10, got nan"),
])  # fmt: skip
def test_an_invalid_command_line_ends_with_exit_code_2_and_names_the_option(arguments, words, capsys):
    code, out, error = called(capsys, *arguments)
    assert (code, out) == (2, "")
    assert words in " ".join(error.replace("│", " ").split())  # lines of the frame are joined
    assert f"lissajous {arguments[0]} --help" in error


def test_policies_lists_what_drives_a_scenario_and_what_each_one_is(capsys):
    code, out, _ = called(capsys, "policies", "failure", "--json")
    listed = {policy["name"]: policy for policy in json.loads(out)}
    assert (code, tuple(listed)) == (0, baselines.names("failure"))
    everything = json.loads(called(capsys, "policies", "--json")[1])
    by = {policy["name"]: policy["steered_by"] for policy in everything}
    assert {name for name in by if by[name] == "network"} == {"learned-watch", "learned-intercept"}
    assert (by["kuramoto"], by["portfolio"], by["portfolio-safe"]) == ("rule", "plan", "plan")
    assert [policy["name"] for policy in everything] == list(baselines.names())
    assert all(policy["description"] and policy["kind"] in (None, *MODELS, "velocity") for policy in everything)
    table = called(capsys, "policies")[1]
    for policy in everything:
        assert re.search(rf"^{policy['name']} +({policy['kind'] or 'any'}) ", table, re.MULTILINE)
    assert "module:factory, where factory(scenario" in " ".join(table.split())  # and no little picture of a factory
    assert called(capsys, "policies", "faliure")[0] == 2


SHORT = ["--episodes", "2", "--set", "task.duration=1"]


@pytest.mark.parametrize("arguments", [
    ["scenarios"], ["policies"], ["plan", "perturbation", "--plans", "4"],
    ["evaluate", "failure", "still", *SHORT],
    ["run", "failure", "still", "--set", "task.duration=1"],
    ["benchmark", "--scenarios", "failure", "--policies", "still", "kuramoto", *SHORT, "--out", "results"],
], ids=lambda arguments: arguments[0])  # fmt: skip
def test_json_is_all_that_is_on_stdout_and_quiet_says_nothing(arguments, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = called(capsys, *arguments, "--json")
    assert code == 0
    assert json.loads(out, parse_constant=pytest.fail)
    assert called(capsys, *arguments, "--quiet") == (0, "", "")
    code, out, error = called(capsys, *arguments, "--quiet", "--json")
    assert (code, error) == (0, "")
    assert json.loads(out)
