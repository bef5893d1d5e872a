"""Extensions by users: every file and command of docs/extending.md works in an empty folder, against an oracle."""

import json
import os
import pickle
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import baselines
import lissajous_env
from baselines.policies import registry
from lissajous_env.console import cli
from lissajous_env.episodes.evaluation import evaluate
from lissajous_env.parameters import named
from lissajous_env.plugins import import_attribute

DOCS = Path(__file__).resolve().parents[2] / "docs" / "extending.md"
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", DOCS.read_text(encoding="utf-8"), flags=re.DOTALL)
FILES = {body.splitlines()[0].removeprefix("# "): body for language, body in BLOCKS if language != "bash"}
COMMANDS = [line for language, body in BLOCKS if language == "bash" for line in body.splitlines()]
REGISTER_IDS = named.register_ids
OURS = "from lissajous_env.console.cli import main; main()"


def call(line, folder, **environment):
    """Run a command line in a folder as the installed script does, which does not look for modules beside itself."""
    program, *arguments = line.split()
    start = [sys.executable, "-P", "-c", OURS] if program == "lissajous" else [sys.executable]
    env = {**os.environ, "OMP_NUM_THREADS": "1", **environment}
    return subprocess.run([*start, *arguments], capture_output=True, text=True, timeout=120, cwd=folder, env=env)


def imported(reference):
    return import_attribute(reference, "it must be there")


def write_files(folder):
    for name, body in FILES.items():
        (folder / name).write_text(body)


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A folder with the files of the docs, but for the package's."""
    folder = tmp_path_factory.mktemp("home")
    write_files(folder)
    (folder / "pyproject.toml").unlink()
    return folder


@pytest.fixture
def here(home, monkeypatch):
    """This process in that folder; what is registered meanwhile is forgotten."""
    monkeypatch.chdir(home)
    monkeypatch.setattr(named, "register_ids", lambda name, **_: None)  # Gymnasium forgets none
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield home
    for name in [name for name in sys.modules if name.startswith("my_")]:
        del sys.modules[name]


def test_the_docs_keep_what_they_promise():
    # Oracle: one short file for each door, and a command for each that is no package's.
    assert len(FILES) == sum(language != "bash" for language, _ in BLOCKS) == 19
    assert {name: len(body.splitlines()) for name, body in FILES.items() if len(body.splitlines()) > 30} == {}
    for name in set(FILES) - {"pyproject.toml", "use_corridor.py"}:
        module = name.removesuffix(".py")
        assert any(form in line for line in COMMANDS for form in (name, f"{module}:", f"--import {module}")), name
    assert not subprocess.run(["bash", "-n", "-c", "\n".join(COMMANDS)]).returncode  # the shell can read them


@pytest.fixture(scope="module")
def ended(home):
    """Exit code and what was said on stderr of each command of the docs, by its line: one process runs them in turn."""
    (home / "commands.json").write_text(json.dumps(COMMANDS))
    program = subprocess.run([sys.executable, "-P", "-c", IN_TURN], capture_output=True, text=True, cwd=home)
    (home / "commands.json").unlink()
    return json.loads(program.stdout.splitlines()[-1])


IN_TURN = """
import contextlib, io, json, runpy, shlex, sys
from lissajous_env.console.cli import main
ended = {}
for line in json.load(open("commands.json")):
    said, code = io.StringIO(), 0
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        try:
            program, *arguments = shlex.split(line)
            main(arguments) if program == "lissajous" else runpy.run_path(arguments[0], run_name="__main__")
        except SystemExit as end:
            code = end.code
        except Exception as error:
            code = repr(error)
    ended[line] = code, said.getvalue()
print(json.dumps(ended))
"""


@pytest.mark.long
@pytest.mark.parametrize("line", COMMANDS)
def test_the_commands_of_the_docs_run(line, home, ended):
    if "my_memory" in line:
        pytest.importorskip("torch")
    if "my_model" in line or " train " in line:
        pytest.importorskip("stable_baselines3")
    code, said = ended[line]
    assert not code, said
    assert not re.search("Traceback|Warning|error", said), said
    if "--out" in line:
        assert (home / line.rpartition("--out ")[2]).exists()


def test_the_programs_of_the_docs_run(here, capsys, monkeypatch):
    monkeypatch.setattr(named, "register_ids", REGISTER_IDS)
    sys.path.append(str(here))  # as Python does for a program
    for name in ("use_corridor.py", "my_function.py"):
        runpy.run_path(name, run_name="__main__")
    assert 0 < float(capsys.readouterr().out.split()[-1]) <= 1


CORRIDOR = {"curve.half_width": 2.4, "faults.schedule": ((0, 5.0, float("inf")),), "task.duration": 10.0}


@pytest.mark.parametrize("door", ["my_scenarios:corridor", "corridor.toml", Path("corridor.toml"), "corridor"])
def test_a_scenario_is_the_same_by_every_door(door, here):
    # Oracle: the included scenario with overrides. The name alone is there once something has registered it.
    if door == "corridor":
        named.scenario("my_scenarios:corridor")
    oracle = lissajous_env.scenario("failure", **CORRIDOR)
    scenario = lissajous_env.scenario(door)
    assert (scenario.name, scenario.digest()) == ("corridor", oracle.digest())
    rows = [evaluate(baselines.make("kuramoto", task, 2), task, range(2)) for task in (scenario, oracle)]
    assert str(rows[0]) == str([row | {"scenario": "corridor"} for row in rows[1]])
    assert lissajous_env.scenario(door, **{"curve.half_width": 3.0}).curve.half_width == 3.0
    assert lissajous_env.parallel_env(door).scenario.digest() == oracle.resolve().digest()
    assert baselines.names(door) == baselines.names("failure")


def test_a_file_lists_extensions_with_their_settings(here):
    # Oracle: the same scenario made in Python, and the reward, which is the term at five times its weight.
    scenario = lissajous_env.scenario("walls.toml")
    fastest, near_wall = scenario.extensions
    assert (fastest, near_wall.weight) == (imported("my_extras:fastest"), -0.5)
    assert pickle.loads(pickle.dumps(scenario)) == scenario
    plain = lissajous_env.scenario("experiment", extensions=" my_extras:near_wall ", **{"task.duration": 5.0})
    assert imported("my_extras:near_wall").weight == plain.extensions[0].weight == -0.1
    env, other = lissajous_env.parallel_env("walls.toml"), lissajous_env.parallel_env(plain)
    env.reset(seed=3), other.reset(seed=3)
    actions = {agent: np.array([0.1, 0.9], np.float32) for agent in env.agents}
    terms = np.zeros((2, 5))
    for _ in range(30):
        for row, environment in enumerate((env, other)):
            terms[row] += [info["reward_terms"][-1] for info in environment.step(actions)[-1].values()]
    assert terms[1].min() < 0
    np.testing.assert_allclose(terms[0], 5 * terms[1], rtol=1e-5)
    assert "fastest" in env.score()


def test_a_scenario_is_described_by_what_it_sets(here, capsys, monkeypatch):
    # Oracle: the fields in which it differs from the defaults, distinguished by hand.
    monkeypatch.setenv("COLUMNS", "100")
    with pytest.raises(SystemExit):
        cli.main(["scenarios", "corridor.toml"])
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    listed = {line[0] for line in lines if line and "." in line[0].rstrip(".") and len(line) > 2}
    base = {"formation.p", "formation.start", "robot.kind", "targets.arrival_rate"}
    assert listed == base | {"curve.half_width", "faults.schedule", "task.duration"}
    assert ["curve.half_width", "2.4", "1.8"] in lines
    with pytest.raises(SystemExit):
        cli.main(["scenarios", "corridor.toml", "knot", "--json"])
    entries = json.loads(capsys.readouterr().out)
    assert [(entry["name"], entry["curve"]["half_width"]) for entry in entries] == [("corridor", 2.4), ("knot", 1.8)]


def test_a_policy_of_ones_own_is_the_paper_s(here):
    # Oracle: the included policy, in Warp. Both round in float32, each in its own order.
    included = baselines.make("kuramoto", "failure", 2)
    mine = imported("my_policies:MyKuramoto")("failure", 2)
    simulation = lissajous_env.Simulation("failure", 2)
    for _ in range(150):
        observation = simulation.observation.numpy().copy()
        action = mine.act(observation)
        np.testing.assert_allclose(action, included.act(observation), atol=2e-6)
        simulation.step(action)
    assert type(baselines.make("my-kuramoto", "failure")) is type(mine)
    assert registry.describe("my-kuramoto")["description"].endswith("equation (1).")


def test_a_function_is_a_policy(here):
    # Oracle: the same function as a class that does all by itself.
    act = imported("my_function:wait_for_targets")

    class Whole:
        name, num_worlds = "wait_for_targets", 3

        def reset(self, worlds=None):
            pass

        def act(self, observation):
            return act(observation.numpy())

    short = lissajous_env.scenario("failure", **{"task.duration": 5.0})
    rows = lissajous_env.evaluate(act, short, seeds=range(5))
    assert str(rows) == str(evaluate(Whole(), short, range(5)))
    assert len({row["return_mean"] for row in rows}) > 1


def test_news_of_a_stopped_robot_goes_around_the_ring(here):
    # Oracle: the distance along the ring from robot 0, which fails from 5 s on: a step for each place.
    fails = {"formation.ring": (0, 1, 2, 3, 4), "faults.schedule": ((0, 5.0, float("inf")),)}
    scenario = lissajous_env.scenario("failure", **{"messages.size": 6, **fails})
    policy, simulation = imported("my_messages:News")(scenario, 2), lissajous_env.Simulation(scenario, 2)
    messages = []
    for _ in range(60):
        action = policy.act(simulation.observation.numpy())
        messages.append(np.clip(action[..., 2:], -1, 1))
        simulation.step(action)
    messages = np.array(messages)
    assert not messages[:, :, :, 1:].any(), "nobody else has stopped"
    heard_at = np.argmax(messages[:, 0, :, 0] > 0, axis=0)
    # Its last number was sent in step 50 and is heard again after step 51, by the robots that act in step 52.
    assert heard_at[1:].tolist() == [51, 52, 52, 51]
    assert messages[-1, :, 1:, 0].min() >= 0.8


@pytest.mark.long
def test_a_package_brings_both_by_name(home, tmp_path):
    # Story: the package of the docs is installed, its folder on the path, and called from another folder.
    site, elsewhere = tmp_path / "site", tmp_path / "elsewhere"
    shutil.copytree(home, site)
    about = tomllib.loads(FILES["pyproject.toml"])["project"]
    info = site / f"{about['name'].replace('-', '_')}-{about['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {about['name']}\nVersion: {about['version']}\n")
    groups = about["entry-points"] | {"lissajous_env.scenarios": about["entry-points"]["lissajous_env.scenarios"]
                                      | {"broken": "my_scenarios:gone", "thief": "my_thief:take"}}  # fmt: skip
    lines = [line for group, of in groups.items() for line in (f"[{group}]", *(f"{n} = {v}" for n, v in of.items()))]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    (site / "my_thief.py").write_text(
        "import lissajous_env\ndef take():\n    lissajous_env.register_scenario(lissajous_env.Scenario(name='knot'))\n"
    )
    elsewhere.mkdir()
    ended = call("lissajous scenarios --json", elsewhere, PYTHONPATH=str(site))
    names = [entry["name"] for entry in json.loads(ended.stdout)]
    assert (ended.returncode, names) == (0, [*lissajous_env.scenarios(), "corridor"])
    assert "the entry point broken (my_scenarios:gone) cannot be loaded: Attribute" in ended.stderr
    assert "entry point thief (my_thief:take) cannot be loaded: ValueError: name of a scenario must be" in ended.stderr
    line = "lissajous evaluate corridor my-kuramoto --episodes 1 --json --quiet"
    ended = call(line, elsewhere, PYTHONPATH=str(site))
    assert (ended.returncode, ended.stderr) == (0, "")
    assert json.loads(ended.stdout)["episodes"][0]["scenario"] == "corridor"
    assert call(line, elsewhere).returncode == 2, "without the package there is neither"
