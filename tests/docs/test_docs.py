"""Code blocks and commands of README and docs: each runs, shortened if it is slow.

test_extending.py covers docs/extending.md; building the documentation runs the notebooks.
"""

import ast
import re
import shlex
import tomllib
from collections import Counter
from functools import cache
from pathlib import Path

import gymnasium
import pytest
import speed

import baselines
import lissajous_env
import training
from baselines.benchmark.types import Benchmark, cells_of
from benchmarks import figures
from docs.generator import concepts, design
from lissajous_env.console import cli

ROOT = figures.ROOT
PAGES = [path for path in figures.PAGES if path.name != "extending.md"]
BLOCKS = [
    (path.name, language, body)
    for path in PAGES
    for language, body in re.findall(
        r"^```(.*?)\n(.*?)^```$", path.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )
    if not language.startswith("{")
]
PYTHON = [(name, body) for name, language, body in BLOCKS if language == "python"]
SHELL = {
    page: [line for name, language, body in BLOCKS if (name, language) == (page, "") for line in body.splitlines()]
    for page in dict.fromkeys(name for name, *_ in BLOCKS)
}
OPTIONAL = {"benchmarl", "mlflow", "ray", "stable_baselines3", "torch", "torchrl", "wandb"}
NEEDS = {
    "training.trainer": "torch",
    "training.sb3": "stable_baselines3",
    "training.torchrl": "torchrl",
    "training.rllib": "ray",
}
SHORTER = {
    "benchmark": "--scenarios intruders --policies sweep laps --episodes 1",
    "evaluate": "--episodes 1",
    "plan": "--plans 6",
    "guarantee": "--radii 2 --cells 16",
    "train": "--steps 64 --worlds 8 --groups 2 --episodes 1 --rollout 4",
    "train --side": "--rogue-rounds 2 --episodes 1",
    "exploit": "--episodes 1",
}
"""Options added to a command to shorten it."""
LASTING = ("benchmark", "evaluate", "exploit", "guarantee", "replay", "run", "train")
"""Commands that run episodes, here of half a second."""
IMAGES = {
    "intruders.gif": "lissajous run intruders kuramoto-mpcc --seed 1 --set task.duration=14",
    "watch.gif": "lissajous run watch greedy-herd --seed 5",
    "learning_curve.png": "lissajous train --scenario watch --base greedy-cover`",
    "growth.png": "python benchmarks/speed.py --parts growth --against",
    "fig3.png": "lissajous reproduce fig3 fig6 fig9",
    "fig6.png": "lissajous reproduce fig3 fig6 fig9",
    "fig9.png": "lissajous reproduce fig3 fig6 fig9",
}
"""Stored pictures, each with the command that makes it."""
OPTIONS_OF_OTHERS = {"--long", "--params-file", "--ros-args"}
"""Options of pytest and of ROS 2."""


def test_every_block_is_of_a_kind_that_is_tried_here():
    assert {language for _, language, _ in BLOCKS} == {"", "python", "text", "pycon", "bibtex"}
    assert len(PYTHON) > 12
    assert sum(map(len, SHELL.values())) > 30
    assert {name for name, language, _ in BLOCKS if language == "pycon"} == {"paper.md"}, "test_reproduce.py has them"


@pytest.mark.parametrize(("page", "body"), PYTHON, ids=[f"{page}-{k}" for k, (page, _) in enumerate(PYTHON)])
def test_a_block_of_python_runs(page, body, tmp_path, monkeypatch, capsys):
    for node in ast.walk(ast.parse(body)):
        names = [node.module] if isinstance(node, ast.ImportFrom) else []
        names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        for name in names:
            for needed in {name.split(".")[0], *(extra for module, extra in NEEDS.items() if name.startswith(module))}:
                if needed in OPTIONAL:
                    pytest.importorskip(needed)
    if "benchmarl" in body:
        pytest.importorskip("benchmarl")
    monkeypatch.chdir(tmp_path)
    exec(compile(body, page, "exec"), {"__name__": "__main__"})
    assert "print(" not in body or capsys.readouterr().out.strip()


@pytest.mark.parametrize("page", [page for page, lines in SHELL.items() if lines])
def test_the_commands_of_a_page_run(page, tmp_path, monkeypatch, capsys):
    # In order, in one folder: a command may read what an earlier one wrote.
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    for line in SHELL[page]:
        for part in line.split(" && "):
            program = part.split()[0]
            assert program in CHECKS, line
            if (part not in _TRIED) or "--out" in part:
                CHECKS[program](part)
            _TRIED.add(part)
    capsys.readouterr()


_TRIED = set()
"""Commands that have run; one that writes nothing need not run twice."""


def check_install(line):
    (extras,) = re.findall(r"^pip install (?:\"\.\[([\w,]*)\]\"|\.)$", line)
    known = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert set(filter(None, extras.split(","))) <= set(known)


def check_python(line):
    # A program of benchmarks/ has its own tests; here only its options are checked.
    module = re.match(r"python (?:-m )?(\S+)", line)[1]
    if module == "benchmarks/speed.py":
        speed.parser().parse_args([str(ROOT) if word == "FOLDER" else word for word in shlex.split(line)[2:]])
        return
    if module == "pytest":
        assert "-m pytest -n auto --dist loadfile" in (ROOT / ".ci" / "run").read_text()
        return
    path = ROOT / (module if module.endswith(".py") else f"{module.replace('.', '/')}.py")
    path = path if path.exists() else path.with_suffix("") / "__main__.py"
    source = path.read_text(encoding="utf-8")
    if "figures.parser(" in source:
        source += (ROOT / "benchmarks" / "figures.py").read_text(encoding="utf-8")
    for option in re.findall(r"--([\w-]+)", line):
        # By argparse, or as a field or an argument of what tyro reads; every --set is `Overrides`.
        declared = rf'"--{option}"|^\W*{option.replace("-", "_")}: |\b{option.replace("-", "_")}: '
        assert re.search(declared, source, re.MULTILINE) or (option == "set" and "Overrides" in source), (line, option)


def check_site(line):
    assert line.split()[:2] == ["sphinx-build", "-W"]
    assert "sphinx-build" in (ROOT / ".ci" / "run").read_text()


def run_lissajous(line):
    """Run a command of this package, shortened and without a cluster."""
    _, command, *given = shlex.split(re.sub(r"--engine ray( --address \S+)?", "", line))
    if command == "ros":  # it waits for other nodes; test_ros_recorded.py runs them
        assert {word for word in given if word.startswith("--")} <= options_of(f"ros {given[0]}"), line
        return
    if command == "train" or any(word.startswith("runs/") for word in given):
        pytest.importorskip("stable_baselines3")
    if "--width" in given:  # a smaller hall, whose episodes are shorter
        given += ["--width", "16", "--height", "10", "--robot-radius", "0.2", "--sensor-radius", "3"]
    if command == "reproduce":
        given = ["fig2" if word == "all" else word for word in given]
    if command in LASTING and not "".join(given[:1]).endswith(".npz"):
        given = [word for word in given if not word.startswith("task.duration")]
        at = given.index("--set") + 1 if "--set" in given else len(given)
        given[at:at] = ["task.duration=1"] if "--set" in given else ["--set", "task.duration=1"]
    shorter = SHORTER.get(" ".join([command, *given[:1]]), SHORTER.get(command, ""))
    is_short = "--episodes" in given and int(given[given.index("--episodes") + 1]) <= 4
    with pytest.raises(SystemExit) as end:
        cli.main([command, *given, *([] if is_short else shorter.split())])
    assert not end.value.code, line


CHECKS = {"pip": check_install, "python": check_python, "sphinx-build": check_site, "lissajous": run_lissajous}


@cache
@cache
def options_of(command):
    """Return the options in the help of a command."""
    import contextlib
    import io

    said = io.StringIO()
    with contextlib.redirect_stdout(said), pytest.raises(SystemExit):
        cli.main([*command.split(), "--help"])
    return set(re.findall(r"--[\w-]+", said.getvalue()))


@pytest.mark.parametrize("path", figures.PAGES, ids=lambda path: path.name)
def test_commands_in_the_text_are_commands(path):
    # Story: an option is renamed, but a page still shows the old one.
    text = " ".join(path.read_text(encoding="utf-8").split())
    for command, rest in re.findall(r"`lissajous ((?:ros )?[a-z]+)([^`]*)`", text):
        assert set(re.findall(r"(?<= )--[\w-]+", rest)) <= options_of(command), (command, rest)
    for line in re.findall(r"`(?:[^`]* && )?(python (?:benchmarks/|-m (?:training|tests))[^`]*)`", text):
        check_python(line)


@pytest.mark.parametrize("path", [*figures.PAGES, ROOT / "SECURITY.md"], ids=lambda path: path.name)
def test_options_in_the_text_are_options(path):
    # Story: an option is removed, but a page still explains it.
    sources = " ".join(program.read_text(encoding="utf-8") for program in (ROOT / "benchmarks").rglob("*.py"))
    known = {*re.findall(r'"(--[\w-]+)"', sources), *OPTIONS_OF_OTHERS, *options_of("")}
    known = known.union(*map(options_of, cli.commands()))
    for words in re.findall(r"`(--[^`]*)`", path.read_text(encoding="utf-8")):
        assert set(re.findall(r"(?<!\S)--[\w-]+", words)) <= known, words


def test_the_pages_count_what_there_is():
    # Story: a policy leaves the standard comparison, or an extra goes, but the pages still have it.
    counts = Counter(cell.scenario.name for cell in cells_of(Benchmark()))
    start, faq = (" ".join((ROOT / "docs" / name).read_text().split()) for name in ("start.md", "faq.md"))
    assert f"up to {max(counts.values())} policies on each of {len(counts)} scenarios" in start
    extras = re.search(r"Which extras are there\?\*\*(.*?)Ray pins", faq)[1]
    known = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert set(re.findall(r"`(\w+)`", extras)) == set(known)


CALLS = re.findall(
    r"`((?:lissajous_env|gymnasium|baselines|training)\.[^`]+\))`", (ROOT / "docs" / "start.md").read_text()
)


@pytest.mark.parametrize(
    "call", [call for call in CALLS if "policy" not in call and "mine.zip" not in call and "/x/" not in call]
)
def test_a_call_of_the_table_works(call):
    # Story: a reader types what the table says, here with fewer worlds.
    for module, needed in NEEDS.items():
        if call.startswith(module):
            pytest.importorskip(needed)
            __import__(module + ".benchmarl" * ("benchmarl" in call))
    fewer = re.sub(r"(num_worlds|num_envs)=\d+", r"\1=2", call).replace("cuda", "cpu")
    known = {"gymnasium": gymnasium, "lissajous_env": lissajous_env, "baselines": baselines, "training": training}
    assert eval(fewer, known | {"scenario": "failure"}) is not None


def test_every_picture_is_drawn_by_the_code_or_by_a_command_that_its_page_names():
    used = {}
    for path in (*figures.PAGES, *(ROOT / "docs" / "notebooks").glob("*.md")):
        text = path.read_text(encoding="utf-8")
        for name in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text):
            used.setdefault(Path(name).name, []).append(" ".join(text.split()))
            drawn = Path(name).suffix == ".svg" and Path(name).stem in {**concepts.DRAWINGS, **design.DRAWINGS}
            assert drawn or (path.parent / name).is_file(), (path.name, name)
    images = {name for name in used if not name.endswith(".svg")}
    assert images == set(IMAGES) == {path.name for path in (ROOT / "docs").iterdir() if path.suffix in (".png", ".gif")}
    for name in images:
        assert any(IMAGES[name] in page for page in used[name]), name
