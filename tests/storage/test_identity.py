"""Digests of users' code: a folder has results of one version of each module."""

import dataclasses
import functools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import lissajous_env
from baselines.benchmark.running import run
from baselines.benchmark.types import Benchmark
from baselines.policies import registry
from lissajous_env.identity import fingerprint
from lissajous_env.parameters import robot_models
from lissajous_env.world.robots.point import POINT

QUIET = Console(quiet=True)
SHORT = {"task.duration": 1.0, "faults.schedule": ()}

MODULE = """
import lissajous_env, numpy as np
def half():
    return 0.5
class Mine:
    def __init__(self, scenario, num_worlds, device):
        self.num_worlds, self.shape = num_worlds, (num_worlds, scenario.num_robots, scenario.action_size)
    reset = lambda self, worlds=None: None
    def act(self, observation):
        return np.full(self.shape, half(), dtype=np.float32)
@lissajous_env.score_column(reduce="max")
def fast(world):
    return half() * world.robots.speed.max(axis=1)
"""


def command(folder, *arguments, seed="0"):
    environment = os.environ | {"PYTHONPATH": str(Path(lissajous_env.__file__).parents[1]), "PYTHONHASHSEED": seed}
    words = [sys.executable, "-m", "lissajous_env", *arguments]
    return subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


def benchmark(folder, episodes, *more, seed="0"):
    words = ["benchmark", "--scenarios", "failure", "--policies", "my_module:Mine", "--episodes", str(episodes)]
    changed = [f"{name}={value}" for name, value in SHORT.items()]
    return command(folder, *words, "--out", "out", "--replays", "0", "--quiet", "--set", *changed, *more, seed=seed)


@pytest.mark.long
@pytest.mark.parametrize("more", [[], ["extensions=my_module:fast"]])
def test_a_folder_contains_one_version_of_a_module(tmp_path, more):
    # Oracle: exit codes, and the episodes that are on the disk; another hash seed changes nothing.
    file = tmp_path / "my_module.py"
    file.write_text(MODULE)
    assert benchmark(tmp_path, 1, *more).returncode == 0
    same = benchmark(tmp_path, 2, *more, seed="7")
    assert (same.returncode, same.stderr) == (0, "")
    file.write_text(MODULE.replace("return 0.5", "return 0.4"))
    refused = benchmark(tmp_path, 3, *more)
    assert refused.returncode == 2
    first, *table = refused.stderr.splitlines()
    words = "error: out contains results of the same name with other code; choose another --out or undo the change"
    assert first == words
    assert any(".module my_module" in line for line in table)
    assert len((tmp_path / "out" / "episodes.jsonl").read_text().splitlines()) == 2
    file.write_text(MODULE)
    assert benchmark(tmp_path, 3, *more).returncode == 0


class Still:
    """A policy that does nothing."""

    def __init__(self, scenario, num_worlds, device, speed=0.0):
        self.num_worlds, self.actions = num_worlds, np.full((num_worlds, scenario.num_robots, 1), speed, np.float32)

    func, reset = np.tanh, lambda self, worlds=None: None

    def act(self, observation):
        """Return the same actions."""
        return self.actions


def test_whatever_makes_a_policy_is_identified_by_its_module():
    # Oracle: the name of this file's module and a digest of the file.
    scenario = lissajous_env.scenario("failure")
    policies = Still(scenario, 1, "cpu"), Still, functools.partial(Still, speed=0.5), lambda observation: observation
    for policy in policies:
        parts = registry.fingerprint_of(registry.as_factory(policy, "mine"))
        assert parts["code"].startswith(f"{__name__}:")
        assert set(parts) - {"argument speed"} == {"code", f"module {__name__}"}
    speeds = 0.5, 0.4, np.full(2000, 0.4), np.full(2000, 0.4 + 1e-12), *(lissajous_env.Faults(lost=k) for k in (1, 2))
    variants = [*(functools.partial(Still, speed=speed) for speed in speeds), policies[0].act, policies[0].reset]
    for text in (MODULE, "\n" + MODULE, MODULE.replace("half(), dtype", "0.4, dtype")):  # as cells, which have no file
        exec(text, cell := {"__name__": "__main__"})
        variants.append(cell["Mine"])
    assert len({str(fingerprint(value)) for value in variants}) == len(variants) - 1  # not their place
    # Code of this distribution is identified by its version.
    assert set(registry.fingerprint_of(registry.as_factory("kuramoto"))) == {"code", "argument 0 code"}


def test_a_folder_contains_one_version_of_a_model_of_robots_and_of_a_rogue(tmp_path, monkeypatch):
    # Oracle: a model of the same name with another kernel is refused, and a rogue with another rule.
    settings = Benchmark(("failure",), (), 1, batch=1, out=tmp_path, replays=0)
    still = {"still": lambda observation: np.zeros((*observation.shape[:2], 1), dtype=np.float32)}
    fields = {"robot.kind": "mine", "task.duration": 1.0, "targets.count": 2, "targets.rogues": "mine"}
    scenario = lambda: lissajous_env.scenario("ideal", **fields)  # noqa: E731
    lissajous_env.rogue("mine")(lambda rows: np.zeros((*rows.shape[:2], 2), dtype=np.float32))
    robot_models.register_robot_model(dataclasses.replace(POINT, name="mine"))
    run(settings, still, [scenario()], QUIET)
    monkeypatch.setattr("lissajous_env.identity.fingerprint", lambda kernel: {"code": "elsewhere:move"})
    with pytest.raises(ValueError, match=r"(?s)played\.robots of kind mine.*played\.rogues mine"):
        run(settings, still, [scenario()], QUIET)
