"""Imports run one way between packages and folders, without circles of modules; the core runs without the extras."""

import ast
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
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


def graph_of(root, packages):
    """The modules that each module of some packages imports, wherever in it, annotations included, by name."""
    paths = {
        ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path
        for package in packages
        for path in (root / package).rglob("*.py")
    }
    graph = {name: set() for name in paths}
    for name, path in paths.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                graph[name] |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                inside = {alias.name: f"{node.module}.{alias.name}" for alias in node.names}
                graph[name] |= {each if each in paths else node.module for each in inside.values()}
        graph[name] &= paths.keys()
    return graph


def circle_in(graph):
    """Some circle of a graph, as a -> b -> a; empty where there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return " -> ".join(reversed(error.args[1]))
    return ""


def without(graph, arrows):
    return {name: {other for other in others if (name, other) not in arrows} for name, others in graph.items()}


def test_no_circle_of_modules():
    # Oracle: the graph of all imports, in functions and for annotations too, sorted topologically.
    graph = graph_of(ROOT, PACKAGES)
    assert len(graph) > 100
    assert circle_in(graph) == ""


def test_a_circle_is_found_wherever_its_imports_stand(tmp_path):
    # Story: a imports b in a function, b imports c for annotations, c imports a from its package.
    files = {
        "__init__": "",
        "a": "def f():\n    import ours.b",
        "b": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from ours.c import C",
        "c": "from ours import a",
    }
    (tmp_path / "ours").mkdir()
    for name, text in files.items():
        (tmp_path / "ours" / f"{name}.py").write_text(text)
    graph = graph_of(tmp_path, ["ours"])
    assert set(circle_in(graph).split(" -> ")) == {"ours.a", "ours.b", "ours.c"}
    assert circle_in(without(graph, {("ours.c", "ours.a")})) == ""


def folder_graphs(graph, root):
    """For each folder of a package that contains folders: which of these import which, subfolders included.

    Modules that lie directly in the folder are left out: they combine its folders, or are shared by them.
    """
    graphs = {}
    for name, others in graph.items():
        for other in others:
            here, there = name.split("."), other.split(".")
            depth = next((k for k, (a, b) in enumerate(zip(here, there, strict=False)) if a != b), 0)
            pair = ".".join(here[: depth + 1]), ".".join(there[: depth + 1])
            if depth and all((root / each.replace(".", "/")).is_dir() for each in pair):
                arrows = graphs.setdefault(".".join(here[:depth]), {})
                arrows.setdefault(pair[0], set()).add(pair[1])
    return graphs


def test_no_circle_of_folders():
    # Oracle: the graph of all imports, its modules merged by folder, sorted topologically.
    graphs = folder_graphs(graph_of(ROOT, ["lissajous_env"]), ROOT)
    assert "lissajous_env.settings" in graphs["lissajous_env"]["lissajous_env.parameters"]
    assert [circle for graph in graphs.values() if (circle := circle_in(graph))] == []


def test_a_circle_of_folders_is_found(tmp_path):
    # Story: no module is in a circle, but a.b.one imports a.c.two and a.c.one imports a.b.two.
    for name, text in {"b/one": "import a.c.two", "b/two": "", "c/one": "from a.b import two", "c/two": ""}.items():
        path = tmp_path / "a" / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    graph = graph_of(tmp_path, ["a"])
    assert circle_in(graph) == ""
    assert set(circle_in(folder_graphs(graph, tmp_path)["a"]).split(" -> ")) == {"a.b", "a.c"}
    assert circle_in(folder_graphs(without(graph, {("a.c.one", "a.b.two")}), tmp_path)["a"]) == ""


def clashes(root, packages):
    """Names that a package binds to something of its own, though one of its modules has them."""
    found = []
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
                    each.id for each in ast.walk(node) if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store)
                }
            found += [f"{here}.{name}" for name in sorted(names & modules)]
    return found


def test_no_name_is_a_module_and_something_else():
    # Oracle: what each package binds, by its source, beside its files.
    assert clashes(ROOT, PACKAGES) == []


def test_a_clash_of_names_is_found(tmp_path):
    # Story: a package has modules a, b and c, takes a from b, makes its own c, and takes b as the module that it is.
    (tmp_path / "ours").mkdir()
    for name, text in {
        "a": "",
        "b": "a = 1",
        "c": "",
        "__init__": "from ours import b\nfrom ours.b import a\nc = 2",
    }.items():
        (tmp_path / "ours" / f"{name}.py").write_text(text)
    assert clashes(tmp_path, ["ours"]) == ["ours.a", "ours.c"]


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
