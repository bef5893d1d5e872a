"""Imports run one way between packages and folders, without circles of modules; the core runs without the extras."""

import ast
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("lissajous_env", "baselines", "training")


def test_imports_run_one_way_between_packages_folders_and_modules():
    # Oracle: import-linter, which reads the contracts in pyproject.toml.
    done = subprocess.run(["lint-imports", "--no-cache"], capture_output=True, text=True, timeout=300, cwd=ROOT)
    num_files = sum(len([*(ROOT / package).rglob("*.py")]) for package in PACKAGES)
    assert done.returncode == 0, done.stdout
    assert f"Analyzed {num_files} files" in done.stdout  # it passes over folders without __init__.py


def clashes(root, packages):
    """Names that a package binds to something of its own, though one of its modules has them."""
    matches = []
    for init in (path for package in packages for path in (root / package).rglob("__init__.py")):
        here = ".".join(init.parent.relative_to(root).parts)
        modules = {path.stem for path in init.parent.glob("*.py")}
        modules |= {path.parent.name for path in init.parent.glob("*/*.py")}
        for node in ast.parse(init.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom):
                names = {alias.asname or alias.name for alias in node.names if node.module != here}
            elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                names = {node.name}
            else:
                names = {
                    leaf.id for leaf in ast.walk(node) if isinstance(leaf, ast.Name) and isinstance(leaf.ctx, ast.Store)
                }
            matches += [f"{here}.{name}" for name in sorted(names & modules)]
    return matches


def test_no_name_is_a_module_and_something_else():
    # Oracle: what each package binds, by its source, beside its files.
    assert clashes(ROOT, PACKAGES) == []


HEAVY = ("torch", "stable_baselines3", "torchrl", "benchmarl", "ray", "casadi", "supersuit", "jax", "numba")

PROGRAM = """
import sys
for name in {blocked!r}:
    sys.modules[name] = None  # importing it raises ImportError
import lissajous_env
env = lissajous_env.parallel_env("experiment")
env.reset(seed=1)
env.step({{agent: env.action_space(agent).sample() for agent in env.agents}})
vector = lissajous_env.vector_env("failure", 3)
vector.reset(seed=1)
vector.step(vector.action_space.sample())
import baselines
print("ran with", sorted(name for name in {late!r} if name in sys.modules))
"""


def test_the_core_runs_with_no_extra_installed():
    # Oracle: a process in which the extras cannot be imported; and what is only for pictures is not loaded before use.
    late = ("matplotlib", "pygame", "tyro", "rich", "scipy")
    program = PROGRAM.format(blocked=HEAVY, late=late)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "ran with []"


LISTS_POLICIES = """
import sys
from lissajous_env.console.cli import main
try:
    main(["policies"])
except SystemExit:
    print([name for name in ("scipy", "matplotlib") if name in sys.modules])
"""


def test_a_command_loads_no_library_that_it_does_not_use():
    command = [sys.executable, "-c", LISTS_POLICIES]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=ROOT)
    assert (done.returncode, done.stdout.splitlines()[-1]) == (0, "[]")
