"""User modules with the names of our packages: both can be used, and a warning names both paths."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import baselines
import lissajous_env
import training
from lissajous_env import siblings

ROOT = Path(__file__).resolve().parents[2]
TRAINING, BASELINES = "training/__init__.py", "baselines.py"

SCRIPT = """
import pickle, sys
{first}
import lissajous_env

scenario = lissajous_env.scenario("rough", **{{"task.duration": 0.5}})
made = [lissajous_env.policy("kuramoto-mpcc-safe", scenario, 2), lissajous_env.load("learned-intruders", scenario, 2)]
rows = [lissajous_env.evaluate(each, scenario, seeds=range(2)) for each in made]
print([row["distance_mean"] for each in rows for row in each])


class Mine(lissajous_env.Policy):
    def decide(self, observation):
        return 0.1 + self.action.numpy()


mine = pickle.loads(pickle.dumps(lissajous_env.policy("sweep", scenario)))
assert lissajous_env.evaluate(mine, scenario, seeds=[0])[0]["distance_mean"] > 0
assert lissajous_env.evaluate(Mine(scenario), scenario, seeds=[0])[0]["distance_mean"] > 0
assert "learned-intruders" in lissajous_env.policies("rough")
assert lissajous_env.import_ours("baselines.mpcc").Mpcc
{last}
"""


def run(folder, *arguments):
    env = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    return subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, cwd=folder, timeout=300, env=env
    )


def write(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("mine = 'of the user'\n")


def expected():
    """Distances that the script prints: those of this process, in which nothing is hidden."""
    scenario = lissajous_env.scenario("rough", **{"task.duration": 0.5})
    made = [baselines.make("kuramoto-mpcc-safe", scenario, 2), training.load("learned-intruders", scenario, 2)]
    rows = [lissajous_env.evaluate(each, scenario, seeds=range(2)) for each in made]
    return str([row["distance_mean"] for each in rows for row in each])


USED = "import training, baselines\nassert training.mine == baselines.mine == 'of the user'"


@pytest.mark.parametrize(
    ("first", "last"),
    [pytest.param("", USED, marks=pytest.mark.long), pytest.param(USED, USED, marks=pytest.mark.long), ("", "")],
    ids=["after", "before", "never"],
)
def test_a_script_beside_modules_of_our_names(first, last, tmp_path):
    # Story: a project has a folder training/ and a file baselines.py, and imports them before ours, after, or never.
    write(tmp_path, TRAINING, BASELINES)
    (tmp_path / "script.py").write_text(SCRIPT.format(first=first, last=last))
    ended = run(tmp_path, "script.py")
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.strip() == expected()
    for name, of in (("training", TRAINING), ("baselines", BASELINES)):
        words = f"{tmp_path / of} hides the package {name} of lissajous-env ({ROOT / name})"
        assert ended.stderr.count(words) == 1
    assert "script.py:" in ended.stderr
    assert "siblings.py:" not in ended.stderr


@pytest.mark.parametrize(
    "names",
    [
        pytest.param([TRAINING], marks=pytest.mark.long),
        pytest.param([BASELINES], marks=pytest.mark.long),
        ["training/of_mine.py"],
    ],
)
def test_one_of_them_alone(names, tmp_path):
    # A folder without __init__.py hides nothing, for a package that lies later on the path goes before it.
    write(tmp_path, *names)
    (tmp_path / "script.py").write_text(SCRIPT.format(first="", last=""))
    ended = run(tmp_path, "script.py")
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.strip() == expected()
    hidden = [name for name in ("training", "baselines") if f"the package {name} of" in ended.stderr]
    assert hidden == [name.partition("/")[0].removesuffix(".py") for name in names if name != "training/of_mine.py"]


SCRIPT_OF_ENTRY = "from lissajous_env.console.cli import main; main()"
POLICY = """
import numpy as np
import training, baselines
assert training.mine == baselines.mine == 'of the user'

def act(observation):
    return np.full((*observation.shape[:2], 1), 0.1)
"""


@pytest.mark.long
@pytest.mark.parametrize("start", [["-P", "-c", SCRIPT_OF_ENTRY], ["-m", "lissajous_env"]], ids=["script", "module"])
def test_commands_in_such_a_folder(start, tmp_path):
    # Story: the same project calls `lissajous benchmark` with a policy of its own that imports its own modules.
    write(tmp_path, TRAINING, BASELINES)
    (tmp_path / "my_policy.py").write_text(POLICY)
    played = ["--policies", "kuramoto", "my_policy:act", "--episodes", "1", "--replays", "none", "--out", "results"]
    ended = run(tmp_path, *start, "benchmark", "--scenarios", "failure", "--set", "task.duration=0.5", *played)
    assert ended.returncode == 0, ended.stderr
    assert "my_policy:act" in (tmp_path / "results" / "episodes.csv").read_text()
    warned = [line for line in ended.stderr.splitlines() if line.startswith("warning: ")]
    assert len(warned) == 2
    assert all(f"of lissajous-env ({ROOT}" in line for line in warned)
    quiet = run(tmp_path, *start, "policies", "--quiet", "--json")
    assert "learned-intruders" in quiet.stdout
    assert quiet.stderr == ""
    listed = run(tmp_path, *start, "--help").stdout
    assert "Compare policies on scenarios" in listed, "what a command does stands in its source, in our package"


def test_where_nothing_hides_them_they_have_their_names():
    assert lissajous_env.import_ours("baselines") is baselines
    assert lissajous_env.import_ours("training.learned.policy").Learned is training.Learned
    assert lissajous_env.Policy is baselines.Policy
    assert lissajous_env.register_policy is baselines.register
    assert {"Policy", "with_tracker", "policy", "load"} <= set(dir(lissajous_env))
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = lissajous_env.nothing
    with pytest.raises(ImportError, match="nothing"):
        lissajous_env.import_ours("baselines.nothing")
    with pytest.raises(ValueError, match="name must be of a module of baselines or training, got"):
        lissajous_env.import_ours("os.path")
    assert siblings.is_ours(baselines.__file__)
    assert not siblings.is_ours(os.__file__)


def test_policies_by_lissajous_env_alone(tmp_path, monkeypatch):
    # Oracle: what `baselines` and `training` return.
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine_of_siblings.py").write_text(
        "import baselines\nMine = baselines.make('sweep', 'rough').__class__\n"
    )
    assert type(lissajous_env.policy("sweep", "rough")) is type(baselines.make("sweep", "rough"))
    assert lissajous_env.policy("mine_of_siblings:Mine", "rough", 3).num_worlds == 3
    assert lissajous_env.policy("learned-intruders", "rough").card == training.load("learned-intruders").card
    folder = ROOT / "training" / "policies" / "learned-intruders"
    assert lissajous_env.policy(folder, "rough").card == lissajous_env.load(folder).card
    assert lissajous_env.policies("failure") == baselines.names("failure")
    with pytest.raises(ValueError, match="did you mean kuramoto"):
        lissajous_env.policy("kuramto", "failure")
