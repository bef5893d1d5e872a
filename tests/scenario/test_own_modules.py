"""Policies in modules of the current folder, called from the command line."""

import importlib.machinery
import sys

import pytest
from command_line import called

import baselines
import lissajous_env
import training
from lissajous_env.plugins import search_current_folder


def test_the_current_folder_hides_no_package(tmp_path, monkeypatch, capsys):
    # Story: a project has a folder training/ and a file baselines.py beside the policy that it benchmarks.
    for name in ("training/__init__.py", "baselines.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("raise AssertionError('a module of the user')\n")
    (tmp_path / "my_policy.py").write_text(
        "import baselines\ndef make(*given):\n    return baselines.make('still', *given)\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "my_policy", raising=False)
    search_current_folder()
    for name in ("training", "baselines"):
        assert str(tmp_path) not in importlib.machinery.PathFinder.find_spec(name).origin
    short = ["my_policy:make", "--episodes", "1", "--set", "task.duration=1", "--quiet"]
    code, _, error = called(capsys, "evaluate", "failure", *short)
    assert (code, error) == (0, "")


def test_policies_by_lissajous_env_alone(tmp_path, monkeypatch):
    # Oracle: what `baselines` and `training` return.
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text("import baselines\nMine = baselines.make('sweep', 'rough').__class__\n")
    monkeypatch.delitem(sys.modules, "mine", raising=False)
    assert type(lissajous_env.policy("sweep", "rough")) is type(baselines.make("sweep", "rough"))
    assert lissajous_env.policy("mine:Mine", "rough", 3).num_worlds == 3
    assert lissajous_env.policy("learned-intruders", "rough").card == training.load("learned-intruders").card
    assert lissajous_env.policies("failure") == baselines.names("failure")
    assert lissajous_env.Policy is baselines.Policy
    assert lissajous_env.register_policy is baselines.register
    assert {"Policy", "with_tracker", "policy", "load"} <= set(dir(lissajous_env))
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = lissajous_env.nothing
