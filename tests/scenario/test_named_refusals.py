"""Invalid names, robot models, exits, long lists and --out raise named errors before any work."""

import dataclasses
import math
import os
import sys

import pytest

import lissajous_env
from lissajous_env.console.cli import main
from lissajous_env.parameters import robot_models
from lissajous_env.world.robots.point import POINT


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"name": ""}, "name of a robot model must be of letters, digits, _ and -, got ''"),
        (
            {"table": ((math.nan,),)},
            "table of robot model mine must contain rows of 1 numbers from -1 to 1, got (nan,)",
        ),
        ({"rest": (0.0,)}, "rest of robot model mine must be a function of a Robot, got (0.0,)"),
        ({"rest": lambda robot: (0.0, 0.0)}, "rest of robot model mine must contain rows of 1 numbers"),
        ({"actions": ("a", "a"), "table": ((0.0, 0.0),)}, "robot model mine must have an action of at least one"),
        ({"table": ()}, "robot model mine must have a table of at least one row"),
        ({"move": print}, "robot model mine must move by a Warp kernel"),
        ({"name": "car"}, "name of a robot model must be new, got 'car'"),
    ],
)
def test_a_model_of_robots_that_cannot_be_one(changed, words):
    # Oracle: the message, and that the table of models is as before.
    before = robot_models.robot_kinds()
    with pytest.raises(ValueError, match="robot model") as error:
        lissajous_env.register_robot_model(dataclasses.replace(POINT, **{"name": "mine"} | changed))
    assert words in str(error.value)
    assert robot_models.robot_kinds() == before


LEAVING = """
import sys, lissajous_env

@lissajous_env.reward_term()
def leaves(world): sys.exit(7)

def act(observation): sys.exit(7)

class Leaves:
    def __init__(self, scenario, num_worlds, device): sys.exit(3)
"""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["run", "ideal", "kuramoto", "--out", "a.npz", "--set", "extensions=leaving:leaves"],
            "kuramoto failed on ideal: SystemExit: 7 (leaving.py, line 5)",
        ),
        (["evaluate", "ideal", "leaving:Leaves", "--episodes", "1"], "leaving:Leaves failed on ideal: SystemExit: 3"),
    ],
)
def test_an_exit_within_ends_a_command_with_words(tmp_path, monkeypatch, capsys, arguments, words):
    # Oracle: the same, of a command that is called in this process.
    (tmp_path / "leaving.py").write_text(LEAVING)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "leaving", raising=False)
    with pytest.raises(SystemExit) as ended:
        main([*arguments, "--quiet"])
    assert ended.value.code == 1
    assert words in capsys.readouterr().err.splitlines()[-1]


def test_a_command_refuses_an_out_that_is_too_long(tmp_path, monkeypatch, capsys):
    # Oracle: exit code 2, one line, nothing there.
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(["evaluate", "ideal", "kuramoto", "--episodes", "1", "--out", f"{'x' * 300}.csv"])
    out, error = capsys.readouterr()
    assert (ended.value.code, out, len(error.splitlines())) == (2, "", 1)
    assert "File name too long" in error
    assert os.listdir(tmp_path) == []
