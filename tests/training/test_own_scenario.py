"""Policies trained on a user's scenario: the folder contains that scenario, and every command plays it."""

import json
import sys

import pytest

pytest.importorskip("torch")

from publish import publish
from test_checkpoint import text_of, write
from test_trainer import QUIET, SMALL

import lissajous_env
import training
from baselines.policies import registry
from lissajous_env.console import cli
from lissajous_env.console.terminal import plain
from lissajous_env.parameters.rogues import ROGUES, Rogue
from lissajous_env.parameters.scenario_file import scenario_of_json
from lissajous_env.plugins import import_module
from training.learned import checkpoint
from training.settings import TrainingSettings
from training.trainer import train

MINE = """
base = "failure"
[curve]
half_width = 2.5
[faults]
schedule = [[0, 1.0, inf]]
[robot]
lateral_acceleration_max = inf
[task]
duration = 2.0
"""
EXTRAS = """
import lissajous_env
from baselines.policies.base import Policy

@lissajous_env.observation_entry(low=-4.0, high=4.0)
def doubled(world):
    return 2.0 * world.robots.position[..., 0] / world.scenario.curve.half_width

class Slow(Policy):
    def decide(self, observation):
        return 0.1 * 2.5 + 0 * observation[..., :1]

def leftwards(rows):
    return 0.0 * rows[..., :2] - 1.0
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(MINE)
    return tmp_path


def settings(**changes):
    return TrainingSettings(**SMALL | {"scenario": "mine.toml", "overrides": {}, "out": "run"} | changes)


def trained(**changes):
    train(settings(**changes), QUIET)
    return lissajous_env.scenario("mine.toml", **changes.get("overrides", {})).resolve()


def command(*arguments):
    with pytest.raises(SystemExit) as ended:
        cli.main([*map(str, arguments)])
    assert ended.value.code == 0


def test_a_folder_holds_the_scenario(here):
    # Oracle: the file, read again; the grid, which training leaves out, is there.
    wanted = trained()
    (here / "mine.toml").unlink()
    for folder in ("run", "run/best"):
        policy = training.load(folder)
        assert policy.scenario == wanted
    assert lissajous_env.evaluate(policy, policy.scenario, seeds=[3])[0]["scenario"] == "mine"


def test_every_command_plays_it(here, capsys):
    wanted = trained()
    command("evaluate", "mine.toml", "run/best", "--episodes", 2, "--json")
    named = json.loads(capsys.readouterr().out)["episodes"]
    (here / "mine.toml").rename(here / "other.toml")
    # Without a scenario it is that of the folder.
    command("evaluate", "run/best", "--episodes", 2, "--json")
    assert json.loads(capsys.readouterr().out)["episodes"] == named
    two = ("--policies", "run/best", "kuramoto")
    command("benchmark", "--scenarios", "other.toml", *two, "--episodes", 1, "--replays", "0", "--out", "results")
    publish(here / "run" / "best", "published", "how", folder=here)
    assert checkpoint.read_description(here / "policies" / "published")["made_for"] == ["mine"]
    assert training.load(here / "policies" / "published").scenario == wanted


def test_a_benchmark_leaves_out_scenarios_of_other_robots(here, capsys):
    # Story: a policy of points, on scenarios of points and of cars.
    trained()
    less = ("--episodes", 1, "--replays", "0", "--set", "task.duration=2", "--out", "results", "--json")
    command("benchmark", "--scenarios", "mine.toml", "rough", "--policies", "run/best", *less)
    assert {row["scenario"] for row in json.loads(capsys.readouterr().out)["episodes"]} == {"mine"}


def test_a_training_is_resumed_with_the_same_scenario_and_the_same_code_alone(here, monkeypatch):
    # Story: a file of the user is edited between two calls; once that is undone, the training goes on.
    (here / "my_team.py").write_text(EXTRAS)
    team = import_module("my_team")
    monkeypatch.setitem(registry.POLICIES, "slow", registry.Entry("slow", "curve", team.Slow))
    monkeypatch.setitem(ROGUES, "leftwards", Rogue("leftwards", team.leftwards))
    changes = {"base": "slow", "overrides": {"targets.rogues": "leftwards", "targets.speed_limit": 1.0}}
    trained(**changes)
    assert "module my_team" in registry.fingerprint_of(registry.resolve("run")), "a policy has the code of its base"
    codes = "the code of slow has changed; the code of rogues leftwards has changed$"
    for file, text, words in (("mine.toml", MINE, "the scenario has changed$"), ("my_team.py", EXTRAS, codes)):
        (here / file).write_text(text.replace("2.5", "2.25"))
        with pytest.raises(ValueError, match=words):
            train(settings(steps=1280, **changes), QUIET)
        (here / file).write_text(text)
    assert train(settings(steps=1280, **changes), QUIET)["curve"][-1]["steps"] >= 1280


def test_what_it_brings_is_taken_from_modules_that_are_imported_already(here, monkeypatch):
    (here / "my_extras.py").write_text(EXTRAS)
    wanted = trained(overrides={"extensions": [{"place": "my_extras:doubled", "low": -2.0}]})
    assert training.load("run").scenario == wanted
    # An extension that is given as an object is recorded as in any other process, so that a training resumes there.
    own_settings = settings(overrides={"extensions": [sys.modules["my_extras"].doubled]})
    assert " at 0x" not in str(own_settings.to_dict())
    assert own_settings.make_validation_scenarios()[0].task.grid == wanted.task.grid, "an extension may read the grid"
    # Story: another process, which has not imported it; a stranger's folder cannot make it.
    monkeypatch.delitem(sys.modules, "my_extras")
    with pytest.raises(ValueError, match="scenario mine uses my_extras:doubled: import my_extras before"):
        training.load("run")
    assert "my_extras" not in sys.modules
    __import__("my_extras")
    assert training.load("run").scenario.digest() == wanted.digest()


@pytest.mark.parametrize(
    ("part", "value", "words"),
    [
        ("curve", {"half_widht": 1.0}, "half_widht"),
        ("curve", {"half_width": -1.0}, "half_width must be"),
        ("curve", 3, "override curve must be a mapping"),
        ("robot", {"kind": "theirs"}, "robot.kind must be one of"),
        ("extensions", 0.5, "extensions of a scenario must be a list, got 0.5"),
        ("extensions", [{"place": 3}], "place of an extension must be module:name, got 3"),
        ("extensions", [3], "place of an extension must be module:name"),
    ],
)
def test_a_damaged_scenario_is_refused(here, part, value, words):
    trained()
    description = text_of(here / "run")
    description["card"]["scenario_fields"][part] = value
    write(here / "run", description)
    with pytest.raises(ValueError, match=words):
        training.load("run")


@pytest.mark.parametrize("name", lissajous_env.scenarios())
def test_plain_values_make_the_scenario(name):
    scenario = lissajous_env.scenario(name).resolve()
    assert scenario_of_json(json.loads(json.dumps(plain(scenario.to_dict()), allow_nan=False))) == scenario


def test_a_file_may_begin_with_a_byte_order_mark_and_have_any_name(tmp_path):
    text = '\ufeffname = "lab"\n[task]\nduration = 2.0\n'
    marked = tmp_path / "lab 2.toml"
    marked.write_text(text, encoding="utf-8")
    assert lissajous_env.scenario(marked).name == "lab"
    marked.write_text("[task]\nduration = 2.0\n")
    with pytest.raises(ValueError, match=r"got 'lab 2'; the file may contain another name, as in name ="):
        lissajous_env.scenario(marked)
