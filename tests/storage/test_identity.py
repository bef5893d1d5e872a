"""Digests of code: sources, captured values and checkpoints, equal in every process."""

import dataclasses
import functools
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import baselines
import lissajous_env
from baselines.benchmark.running import run
from baselines.benchmark.types import Benchmark
from baselines.policies import registry
from lissajous_env.identity import parts_of
from lissajous_env.parameters import robot_models
from lissajous_env.world.robots.point import POINT

QUIET = Console(quiet=True)
SHORT = {"task.duration": 1.0, "faults.schedule": ()}

MODULE = """
import numpy as np
import lissajous_env
from my_numbers import SHARE

def half():
    return 0.5

class Mine:
    def __init__(self, scenario, num_worlds, device):
        self.num_worlds, self.shape = num_worlds, (num_worlds, scenario.num_robots, scenario.action_size)
    def reset(self, worlds=None):
        pass
    def act(self, observation):
        return np.full(self.shape, SHARE * half(), dtype=np.float32)

@lissajous_env.score_column("max")
def fast(world):
    return half() * world.robots.speed.max(axis=1)
"""


def command(folder, *arguments, seed="0"):
    environment = os.environ | {"PYTHONPATH": str(Path(lissajous_env.__file__).parents[1]), "PYTHONHASHSEED": seed}
    words = [sys.executable, "-m", "lissajous_env", *arguments]
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


def benchmark(folder, episodes, *more, seed="0"):
    given = ["benchmark", "--scenarios", "failure", "--policies", "my_module:Mine", "--episodes", str(episodes)]
    changed = [f"{name}={value}" for name, value in SHORT.items()]
    return command(folder, *given, "--out", "out", "--replays", "none", "--quiet", "--set", *changed, *more, seed=seed)


@pytest.mark.long
@pytest.mark.parametrize(
    ("file", "old", "new", "more"),
    [
        ("my_numbers.py", "SHARE = 1.0", "SHARE = 0.2", []),
        ("my_numbers.py", "SHARE = 1.0", "SHARE = 0.2", ["extensions=my_module:fast"]),
        ("my_module.py", "self.shape, SHARE", "self.shape, 0.3 * SHARE", []),
        ("my_module.py", "return 0.5", "return 0.4", []),
    ],
)
def test_a_folder_holds_one_version_of_a_module(tmp_path, file, old, new, more):
    # Oracle: exit codes, and the episodes that are on the disk; another hash seed changes nothing.
    (tmp_path / "my_module.py").write_text(MODULE)
    (tmp_path / "my_numbers.py").write_text("SHARE = 1.0\n")
    assert benchmark(tmp_path, 1, *more).returncode == 0
    same = benchmark(tmp_path, 2, *more, seed="7")
    assert (same.returncode, same.stderr) == (0, "")
    text = (tmp_path / file).read_text()
    assert old in text
    (tmp_path / file).write_text(text.replace(old, new))
    refused = benchmark(tmp_path, 3, *more)
    assert refused.returncode == 2
    first, *table = refused.stderr.splitlines()
    assert (
        first == "error: out contains results of the same name with other code; choose another --out or undo the change"
    )
    assert any(f".module {file[:-3]} " in line for line in table)
    assert len((tmp_path / "out" / "episodes.jsonl").read_text().splitlines()) == 2
    (tmp_path / file).write_text(text)
    assert benchmark(tmp_path, 3, *more).returncode == 0


class Scaled:
    """A policy that always does the same."""

    def __init__(self, scenario, num_worlds, device, share=0.1, weights=None):
        self.num_worlds, self.share, self.steps = num_worlds, share, 0
        self.weights = np.ones(3) if weights is None else weights
        self.shape = (num_worlds, scenario.num_robots, scenario.action_size)

    def reset(self, worlds=None):
        """Forget."""
        self.steps = 0

    def act(self, observation):
        """Return the same actions."""
        self.steps += 1
        return np.full(self.shape, self.share * self.weights.sum(), dtype=np.float32)


def captured(share):
    def make(scenario, num_worlds, device):
        return Scaled(scenario, num_worlds, device, share)

    return make


def default(share):
    def make(scenario, num_worlds, device, chosen=share):
        return Scaled(scenario, num_worlds, device, chosen)

    return make


def method_of_a_class(share):
    class Local(Scaled):
        def act(self, observation):
            return share * super().act(observation)

    return Local


def object_of(share):
    return Scaled(lissajous_env.scenario("failure"), 1, "cpu", share)


def object_with_arrays(share):
    return Scaled(lissajous_env.scenario("failure"), 1, "cpu", weights=np.full(3, share))


def acting(share):
    def act(observation):
        return np.full((*observation.shape[:2], 1), share, dtype=np.float32)

    return act


@pytest.mark.parametrize(
    "make",
    [
        captured,
        default,
        method_of_a_class,
        object_of,
        object_with_arrays,
        acting,
        lambda share: functools.partial(Scaled, share=share),
        lambda share: functools.partial(Scaled, weights=np.full(3, share)),
        lambda share: functools.partial(captured(share)),
    ],
)
def test_a_folder_holds_one_version_of_what_a_policy_has_captured(tmp_path, make):
    # Oracle: the same values continue, others are refused, and no row is added.
    scenario = lissajous_env.scenario("failure", **SHORT)

    def play(policy, episodes):
        settings = Benchmark(("failure",), (), episodes, batch=1, out=tmp_path, replays=("none",))
        return run(settings, {"mine": policy}, [scenario], QUIET)

    policy = make(0.1)
    assert len(play(policy, 1)) == 1
    assert len(play(policy, 2)) == 2
    assert len(play(make(0.1), 3)) == 3
    with pytest.raises(ValueError, match="results of the same name with other code") as error:
        play(make(0.2), 4)
    assert "played.mine" in str(error.value)
    assert len((tmp_path / "episodes.jsonl").read_text().splitlines()) == 3


def test_extensions_of_other_captured_values_differ():
    # Oracle: digests of scenarios, which are equal where the values are.
    def term(weight, power=1):
        def near(world):
            return weight * world.robots.speed**power

        return lissajous_env.reward_term()(near)

    digests = [
        lissajous_env.scenario("ideal", extensions=[each]).digest()
        for each in (term(1.0), term(2.0), term(1.0, 2), term(1.0))
    ]
    assert digests[0] == digests[3]
    assert len(set(digests)) == 3


def test_code_without_a_source_is_told_apart_too():
    # Oracle: the code itself; what it refers to outside counts as well.
    def made(line, **outside):
        names = {"__name__": "__main__", **outside}
        exec(line, names)
        return parts_of(names["act"])

    one = made("def act(o): return gain * o", gain=1.0)
    assert one == made("def act(o): return gain * o", gain=1.0)
    assert one != made("def act(o): return gain * o", gain=2.0)
    assert one != made("def act(o): return gain + o", gain=1.0)
    assert made("act = lambda o: o in {'a', 'b', 'c'}") == made("act = lambda o: o in {'c', 'b', 'a'}")


def test_the_parts_are_the_same_in_every_process(tmp_path):
    # Oracle: two processes with other seeds of their hashes.
    (tmp_path / "mine.py").write_text(
        "class P:\n    def __init__(self): self.kinds, self.table = {'b', 'a', 'c'}, {'y': 1, 'x': {2, 3}}\n"
    )
    program = "import mine; from lissajous_env.identity import parts_of; print(parts_of(mine.P()))"
    said = {
        subprocess.run(
            [sys.executable, "-c", program],
            cwd=tmp_path,
            env=os.environ
            | {"PYTHONHASHSEED": seed, "PYTHONPATH": f"{tmp_path}:{Path(lissajous_env.__file__).parents[1]}"},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2", "3")
    }
    assert len(said) == 1
    assert "module mine" in said.pop()


def test_a_registered_policy_and_its_filter_are_told_by_their_code(monkeypatch):
    # Oracle: the names that a person looks for.
    baselines.register("constant", kind="car", factory=captured(0.1))
    one = registry.parts("constant-safe")
    monkeypatch.setattr(registry, "_REGISTRY", {k: v for k, v in registry._REGISTRY.items() if k != "constant"})
    baselines.register("constant", kind="car", factory=captured(0.2))
    other = registry.parts("constant-safe")
    assert [name for name in one if one[name] != other[name]] == ["share"]
    assert any(name.startswith("-safe") for name in one)
    # Ours are told by our version.
    assert set(registry.parts("kuramoto-mpcc").values()) == {"baselines.policies.combinations:make"} or all(
        value.startswith("baselines") for name, value in registry.parts("kuramoto-mpcc").items() if "code" in name
    )


def test_a_folder_holds_one_version_of_a_model_of_robots(tmp_path, monkeypatch):
    # Oracle: a model of the same name with other numbers is refused.
    settings = Benchmark(("failure",), (), 1, batch=1, out=tmp_path, replays=("none",))
    still = {"still": lambda observation: np.zeros((*observation.shape[:2], 1), dtype=np.float32)}
    for rows, refused in ((((-1.0,), (1.0,)), False), (((-0.5,), (1.0,)), True)):
        robot_models._MODELS.pop("mine", None)
        robot_models.register_robot_model(dataclasses.replace(POINT, name="mine", table=rows))
        scenario = lissajous_env.scenario("ideal", **{"robot.kind": "mine", "task.duration": 1.0})
        if refused:
            with pytest.raises(ValueError, match=r"played\.robots of kind mine"):
                run(settings, still, [scenario], QUIET)
        else:
            run(settings, still, [scenario], QUIET)


def test_settings_without_what_was_played_are_damaged(tmp_path):
    # Oracle: the message's words.
    settings = Benchmark(("failure",), ("still",), 1, out=tmp_path, overrides=SHORT, replays=("none",))
    run(settings, console=QUIET)
    path = tmp_path / "settings.json"
    held = json.loads(path.read_text())
    for wrong in ({}, {"still": 3}, {"still": {"code": 3}}, []):
        path.write_text(json.dumps(held | {"played": wrong}))
        with pytest.raises(ValueError, match=r"settings\.json is damaged: played is"):
            run(settings, console=QUIET)
