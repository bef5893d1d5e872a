"""Policies in modules of the current folder, called from the command line."""

import importlib.machinery
import sys

from command_line import called

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
