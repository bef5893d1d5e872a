"""Names that modules register which a command imports, and suggestions of names and files."""

import importlib.machinery
import sys

import pytest
from command_line import called

import lissajous_env
from lissajous_env.parameters import named
from lissajous_env.plugins import search_current_folder
from training.learned.card import Card

POLICIES = """
import numpy as np
import baselines

open("imported", "a").write("my_policies ")

@baselines.register("my-still", kind="curve")
class MyStill(baselines.Policy):
    def decide(self, observation):
        return np.zeros(self.action.shape)
"""
METHOD = """
import baselines
from baselines.policies.coordinators import Kuramoto

baselines.register_coordinator("my-way", Kuramoto, about="Kuramoto once more.")
"""
SCENARIOS = """
import lissajous_env
from lissajous_env import Robot, Scenario, Task

open("imported", "a").write("my_scenarios ")
short = lissajous_env.register_scenario(Scenario(name="short-one", robot=Robot(kind="curve"), task=Task(duration=0.5)))
"""
SHORT = ["--episodes", "1", "--set", "task.duration=0.5"]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A folder with modules, in which this process is; what they register is forgotten."""
    sources = {"my_policies": POLICIES, "my_method": METHOD, "my_scenarios": SCENARIOS, "my_broken": "register("}
    for name, source in sources.items():
        (tmp_path / f"{name}.py").write_text(source)
    (tmp_path / "depot.toml").write_text("base = 'failure'\n[task]\nduration = 0.5\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(named, "register_ids", lambda name, **_: None)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield tmp_path
    for name in sources:
        sys.modules.pop(name, None)


@pytest.mark.parametrize("line", [
    "evaluate failure my-still --import my_policies",
    "--import my_policies benchmark --scenarios failure --policies my-still --replays 0 --out results",
    "evaluate rough my-way-gvf-safe --import my_method",
    "evaluate short-one my-still --import my_scenarios --import my_policies",
])  # fmt: skip
def test_a_command_knows_what_an_imported_module_registers(line, folder, capsys):
    # Story: `lissajous benchmark --policies my-still`, in the folder with the module that registers it.
    code, _, error = called(capsys, *line.split(), *SHORT)
    assert code == 0, error


def test_a_name_alone_imports_nothing(folder, capsys):
    assert called(capsys, "evaluate", "failure", "my-still", *SHORT)[0] == 2
    with pytest.raises(ValueError, match="base must be a registered"):
        Card.of(lissajous_env.scenario("failure"), base="my-still")
    assert not (folder / "imported").exists()


@pytest.mark.parametrize(("module", "words"), [
    ("my_broken", "SyntaxError"),
    ("my_policy", "got 'my_policy': ModuleNotFoundError: No module named 'my_policy'"),
    ("", "must be followed by a module that can be imported, got ''"),
])  # fmt: skip
def test_a_module_that_cannot_be_imported_says_why(module, words, folder, capsys):
    code, _, error = called(capsys, "evaluate", "failure", "still", "--import", *module.split())
    assert code == 2
    assert words in error


@pytest.mark.parametrize(("line", "words"), [
    (["run", "depot", "kuramoto"], "got 'depot'; did you mean depot.toml?"),
    (["run", "depot-larger-3", "kuramoto"], "got 'depot-larger-3'; did you mean depot.toml:larger-3?"),
    (["run", "depo.toml", "kuramoto"], "depo.toml is missing; did you mean depot.toml?"),
    (["--import=my_scenarios", "scenarios", "shrt-one"], "did you mean short-one?"),
    (["--import", "my_policies", "evaluate", "failure", "my-stil"], "did you mean my-still?"),
    (["evaluate", "failure", "kuramoto-mpcc"], "got kuramoto-mpcc, which drives kind car; did you mean kuramoto?"),
    (["replay", "epsode.npz"], "there is no file epsode.npz; did you mean episode.npz?"),
    (["evaluate", "failure", "my_policies:MyStil"], "has no attribute 'MyStil'; did you mean MyStill?"),
    (["evaluate", "failure", "my_policies"], "with its factory, as module:factory, got 'my_policies'"),
    (["evaluate", "failure", "my_policy:MyStill"], "No module named 'my_policy'; did you mean my_policies?"),
    (["evaluate", "failure", "still", "--set", "duration=3"], "did you mean task.duration?"),
    (["run", "failure", "still", "--out", "a.gfi"], "got a.gfi; did you mean .gif?"),
], ids=lambda parameter: " ".join(parameter) if isinstance(parameter, list) else "")  # fmt: skip
def test_suggestions_are_what_a_user_may_mean(line, words, folder, capsys):
    (folder / "episode.npz").touch()
    (folder / "trained").mkdir()
    (folder / "trained" / "checkpoint.safetensors").touch()
    code, _, error = called(capsys, *line)
    assert code == 2
    assert words in error.splitlines()[0], error


def test_the_current_folder_hides_no_package(tmp_path, monkeypatch, capsys):
    # Story: a project has a folder training/ and a file baselines.py beside the policy that it benchmarks.
    for name in ("training/__init__.py", "baselines.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("raise AssertionError('a module of the user')\n")
    module = "import baselines\ndef make(*given):\n    return baselines.make('still', *given)\n"
    (tmp_path / "my_policy.py").write_text(module)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "my_policy", raising=False)
    search_current_folder()
    for name in ("training", "baselines"):
        assert str(tmp_path) not in importlib.machinery.PathFinder.find_spec(name).origin
    code, _, error = called(capsys, "evaluate", "failure", "my_policy:make", *SHORT, "--quiet")
    assert (code, error) == (0, "")
