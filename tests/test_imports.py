"""Which package may import which, held by reading the imports; and the core without what only extras need."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("lissajous_env", "baselines", "training")
MAY_IMPORT = {
    "lissajous_env": {"lissajous_env"},
    "baselines": {"baselines", "lissajous_env"},
    "training": {"training", "baselines", "lissajous_env"},
}


def imports_of(path):
    """(line, top-level package) of each import in a file, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name.partition(".")[0]) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno} imports relatively"
            yield node.lineno, (node.module or "").partition(".")[0]


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_run_one_way(package):
    # Oracle: training -> baselines -> lissajous_env, read from the source.
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    wrong = [
        f"{path.relative_to(ROOT)}:{line} imports {name}"
        for path in files
        for line, name in imports_of(path)
        if name in {*PACKAGES, "tests", "benchmarks"} - MAY_IMPORT[package]
    ]
    assert wrong == []


HEAVY = ("torch", "stable_baselines3", "torchrl", "benchmarl", "ray", "casadi", "supersuit", "jax", "numba")

PROGRAM = """
import sys
for name in {blocked!r}:
    sys.modules[name] = None  # importing it raises ImportError
import numpy as np
import lissajous_env
env = lissajous_env.parallel_env("experiment")
env.reset(seed=1)
env.step({{agent: env.action_space(agent).sample() for agent in env.agents}})
vector = lissajous_env.vector_env("failure", 3)
vector.reset(seed=1)
vector.step(np.zeros(vector.action_space.shape, dtype=np.float32))
import baselines
print("ran with", sorted(name for name in {late!r} if name in sys.modules))
"""


def test_the_core_runs_with_no_extra_installed():
    # Oracle: a process in which the extras cannot be imported; and what is only for pictures is not loaded before use.
    late = ("matplotlib", "pygame", "tyro", "rich")
    program = PROGRAM.format(blocked=HEAVY, late=late)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "ran with []"
