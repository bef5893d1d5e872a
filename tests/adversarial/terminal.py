"""Attacks on the command line: what can be typed, what results can have become, terminals of any width."""

import ast
import contextlib
import functools
import io
import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

import lissajous_env
from baselines.benchmark import tables
from baselines.benchmark.shown_columns import SHOWN
from baselines.benchmark.table import estimates_of, grouped
from baselines.planning import report as plan_tables
from baselines.planning.planner import Outcome
from baselines.planning.plans import Figures, Plan, Planned
from baselines.planning.request import Request
from baselines.policies.settings import PolicySettings
from lissajous_env.console.cli import main
from lissajous_env.parameters.overrides import parse_overrides
from lissajous_env.world.columns import COLUMNS as SCORES
from tests.adversarial import Attack

_WORDS = [
    "falure",
    "x[/b]",
    "[bold]",
    "\udcff",
    "a" * 100_000,
    "\x1b[2J",
    "1\n2\n3\n4\n5",
    "",
    "two words",
    "-",
    "\\[x\\",
]
_NAMES = [
    *_WORDS,
    "nowhere:thing",
    ":",
    "a:",
    ":b",
    ".a:b",
    "os:nothing",
    "os:sep",
    "broken:policy",
    "ends:policy",
    "../..",
]
_WHOLE = ["x", "1.5", "nan", "inf", "0x10", "9" * 30, "9" * 5000, "", "-1", "None"]
_REAL = ["x", "nan", "inf", "-inf", "-1", "1e400", "", "1_", "True"]
_SET = [
    "name=evil", "=", "=3", "curve.a", "x=1", "curve=5", "curve.a=" + "-" * 100_000 + "1", "curve.a=" + "(" * 100_000,
    "curve.a=" + "[" * 90 + "]" * 90, "task.duration=nan", "task.duration=-inf", "curve.a=__import__('os').abort()",
    "curve.a=10**9", "faults.schedule=((0,1,nan),)", "faults.schedule=((0,", "curve.a=1e999", "curve.a={}",
    "curve.a='[/b]'", "curve.a=[/b]", "curve.a=\udcff", "curve.a=" + "9" * 5000, "task.duration=1j", "curve.a=b''",
    "curve.a={1:2,**{}}", "description=x", "curve.a=(x for x in ())", "curve.a=\\", "curve.a=lambda:0", "robot={1:2}",
]  # fmt: skip
_FILES = ["nowhere/x.csv", "x.mov", "folder.csv", "file/x.csv", "x" * 300 + ".csv", "x", "", "folder/", "/proc/x/y.gif"]
_DEVICES = ["gpu", "cuda:99", "tpu", "", "[/b]", "-1", "\udcff"]
_GOOD = {
    "benchmark": ["--scenarios", "failure", "--policies", "still", "--out", "results"],
    "evaluate": ["failure", "still"],
    "run": ["failure", "still"],
    "train": ["--out", "results", "--steps", "1"],
    "plan": ["failure", "--seconds", "1", "--out", "results"],
    "replay": ["recording.npz"],
    "reproduce": ["fig2", "--out", "results"],
    "policies": [],
    "scenarios": [],
}
_COMMON = {"--seed": [*_WHOLE, "99999999999"], "--device": _DEVICES, "--set": _SET}
_OPTIONS = {
    "benchmark": _COMMON | {
        "--episodes": [*_WHOLE, "0", "1000000000"], "--batch": [*_WHOLE, "0", "1000000000"], "--scenarios": _NAMES,
        "--policies": _NAMES, "--engine": _WORDS, "--address": ["localhost:1", ""], "--out": ["file", "file/x", ""],
    },
    "evaluate": _COMMON | {"--episodes": [*_WHOLE, "0", "1000000000"], "--batch": [*_WHOLE, "0"], "--out": _FILES},
    "run": _COMMON | {"--out": _FILES},
    "train": _COMMON | {
        "--scenario": _NAMES, "--algorithm": _WORDS, "--steps": [*_WHOLE, "0"], "--worlds": [*_WHOLE, "0", "10000000"],
        "--learning-rate": [*_REAL, "0", "1000"], "--layers": [*_WHOLE, "0", "100000000"], "--gamma": [*_REAL, "2"],
        "--base": _NAMES, "--teacher": _NAMES, "--rivals": _NAMES, "--start": [""], "--address": [""],
        "--log-std": ["nan", "x", "1e9"], "--residual": [*_REAL, "0"], "--threads": [*_WHOLE[:-1], "0"],
    },
    "plan": {
        **{f"--{name}": [*_REAL, "0", "1e300", "1e-300"] for name in
           ("width", "height", "robot-radius", "sensor-radius", "speed", "turning-radius", "guarantee", "seconds")},
        "--rogue-speed": _REAL, "--robots": [*_WHOLE, "0", "1", "1000000", "8:3", "1:", ":"],
        "--failures": [*_WHOLE, "1000000"], "--entry": _WORDS, "--rows": ["x", "1.5", "", "-1", "0"],
        "--out": ["file", "file/x", ""], "--seed": [*_WHOLE, "99999999999"],
    },
    "replay": {"--speed": [*_REAL, "0", "1e-9", "1e9"], "--fps": [*_REAL, "0", "1e-9", "1000"], "--out": _FILES,
               "--against": _NAMES, "--seed": [*_WHOLE, "99999999999"], "--device": _DEVICES},
    "reproduce": {"--seed": [*_WHOLE, "99999999999"], "--device": _DEVICES, "--out": ["file", "file/x", ""]},
    "policies": {}, "scenarios": {},
}  # fmt: skip
_POSITIONAL = {"evaluate": _NAMES, "run": _NAMES, "policies": _NAMES, "reproduce": _NAMES, "replay": _NAMES,
               "scenarios": _NAMES, "plan": _NAMES, "benchmark": _NAMES, "train": _NAMES}  # fmt: skip


def pick(draw: np.random.Generator, of: Any) -> Any:
    return list(of)[int(draw.integers(len(of)))]


@contextlib.contextmanager
def _workplace() -> Iterator[Path]:
    """Be in a folder that holds a few things that are not what a command takes them for."""
    before = os.getcwd()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for each in ("folder.csv", "folder", "results"):
            (folder / each).mkdir()
        for each in ("file", "recording.npz"):
            (folder / each).write_text("no folder, no recording")
        (folder / "broken.py").write_text("raise RuntimeError('[/b]')\n")
        (folder / "ends.py").write_text("raise SystemExit(0)\n")
        os.chdir(folder)
        try:
            yield folder
        finally:
            os.chdir(before)


def _wrong_line(draw: np.random.Generator) -> list[str]:
    command = pick(draw, _GOOD)
    line = [command, *_GOOD[command]]
    for _ in range(int(draw.integers(1, 4))):
        options = _OPTIONS[command]
        if options and draw.random() < 0.8:
            option = pick(draw, options)
            value = pick(draw, options[option])
            line += [f"{option}={value}"] if draw.random() < 0.3 else [option, value]
        elif draw.random() < 0.5:
            line.append(pick(draw, ["--nothing", "--set", "--json=3", "-x", "--no-json"]))
        else:
            line.insert(1, pick(draw, _POSITIONAL[command]))
    if draw.random() < 0.2:
        line.append(pick(draw, ["--json", "--quiet"]))
    return line if draw.random() < 0.95 else [pick(draw, _NAMES), *line]


def _try_line(draw: np.random.Generator) -> str | None:
    line = _wrong_line(draw)
    if "--set" in line[-1:] and len(line) < 3:
        return None
    said, out = io.StringIO(), io.StringIO()
    with _workplace() as folder, contextlib.redirect_stderr(said), contextlib.redirect_stdout(out):
        try:
            main(line)
        except SystemExit as ended:
            code = ended.code
        left = sorted(path.name for path in folder.rglob("*") if path.is_file() and path.parent.name != "__pycache__")
    lines = said.getvalue().splitlines()
    shown = " ".join(repr(word[:80]) for word in line)
    if code != 2 or not 1 <= len(lines) <= 3 or not lines[0].startswith("error: ") or out.getvalue():
        return f"{shown} ended with {code}, {len(lines)} lines: {said.getvalue()[-300:]!r} {out.getvalue()[:100]!r}"
    if left != ["broken.py", "ends.py", "file", "recording.npz"]:
        return f"{shown} left {left}"
    return None


_SHELL = [
    ("scenarios >&-", 0), ("scenarios 2>&-", 0), ("nothing 2>&-", 2), ("nothing >&- 2>&-", 2), ("scenarios <&-", 0),
    ("policies | head -1", None), ("scenarios > /dev/full", 1), ("nothing 2> /dev/full", 2),
    ("run $'\\xff' still", 2), ("run $'x\\n[/b]' still", 2), ("run failure still --set task.duration=1 >&- 2>&-", 0),
    ("benchmark --scenarios failure --policies $'\\xc3' --out x", 2),
    ("evaluate failure still --episodes 1 --set task.duration=1 | head -1", None),
    ("evaluate still failure --episodes 1 --set task.duration=1 --json 2>&-", 0),
    ("run failure still --set task.duration=1 --out '[b]x.gif' --quiet", 0), ("policies --json", 0),
    ("benchmark --scenarios failure --policies here:policy still --episodes 1 --set task.duration=1 --out x[/b]", 1),
    ("evaluate failure here:policy --set task.duration=1", 1), ("run failure here:nothing --set task.duration=1", 1),
    ("run failure here:Good --set task.duration=1", 0), ("--version", 0), ("-V", 0), ("", 0), ("--help", 0),
]  # fmt: skip
_HERE = """
import baselines
class Good:
    def __init__(self, scenario, num_worlds, device):
        self.made, self.num_worlds = baselines.make("still", scenario, num_worlds, device), num_worlds
    def reset(self, worlds=None): self.made.reset(worlds)
    def act(self, observation): return self.made.act(observation)
def policy(scenario, num_worlds, device): raise RuntimeError("[/b] no\\n\\nluck")
def nothing(scenario, num_worlds, device): return 3
"""
_PLACES = [
    {"LANG": "C", "LC_ALL": "C"}, {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}, {"TERM": "dumb"},
    {"NO_COLOR": "1"}, {"COLUMNS": "0"}, {"COLUMNS": "x"}, {"COLUMNS": "1"}, {"COLUMNS": "99999"}, {"FORCE_COLOR": "1"},
    {"HOME": "/dev/null/home"}, {"HOME": ""},
]  # fmt: skip


def _try_process(draw: np.random.Generator) -> str | None:
    line, wanted = _SHELL[int(draw.integers(len(_SHELL)))]
    place = pick(draw, _PLACES) | {"WARP_CACHE_PATH": _cache()}
    with _workplace() as folder:
        (folder / "here.py").write_text(_HERE)
        ended = subprocess.run(
            ["bash", "-c", f"set -o pipefail; {sys.executable} -m lissajous_env {line}"],
            capture_output=True, env=os.environ | place, timeout=120, stdin=subprocess.DEVNULL,
        )  # fmt: skip
    said = ended.stderr.decode(errors="replace")
    words = f"{line} in {place} ended with {ended.returncode}: {said[-400:]!r}"
    if "Traceback" in said or "Exception ignored" in said:
        return words
    if wanted is not None and ended.returncode != wanted:
        return words
    return words if ended.returncode and "2>" not in line and "|" not in line and "error: " not in said else None


@functools.cache
def _cache() -> str:
    """Warp's own folder, so that a process with another home compiles nothing."""
    import warp as wp

    from lissajous_env.device.devices import as_device

    as_device("cpu")
    return str(Path(str(wp.config.kernel_cache_dir)).parent)


def _try_width(draw: np.random.Generator) -> str | None:
    width, names = int(draw.integers(1, 300)), ["arc-mpcc-safe", "x[/b]", "still", "a b", "[red]"]
    rows = []
    for policy in names[: int(draw.integers(1, 6))]:
        for k in range(int(draw.integers(1, 6))):
            scale = 10.0 ** draw.integers(-6, 9)
            numbers = {c: float(scale * draw.normal()) if draw.random() < 0.9 else math.nan for c in SCORES}
            rows.append({"scenario": "failure", "policy": policy, "episode": k, "seed": k} | numbers)

    def shown(columns: int) -> str:
        console = Console(width=columns, file=io.StringIO(), record=True)
        cells = {policy: estimates_of(played) for policy, played in grouped(rows)["failure"].items()}
        tables.print_lines(console, tables.Text("t"), SHOWN, tables.lines_of(cells, SHOWN))
        tables.print_scores(console, "still", "failure", next(iter(cells.values())))
        return console.export_text()

    words = set(shown(1000).split())
    cut = [
        word
        for word in shown(width).split()
        if word not in words and set(word) != {"\N{BOX DRAWINGS LIGHT HORIZONTAL}"}
    ]
    return f"at width {width}: {cut[:5]}" if cut else None


def _try_plan_width(draw: np.random.Generator) -> str | None:
    made, plans = lissajous_env.scenario("evaders"), []
    for k in range(1, int(draw.integers(2, 8))):
        numbers = [float(10.0 ** draw.integers(-6, 9) * draw.random()) for _ in range(6)]
        figures = Figures(*numbers[:4], 0, int(draw.integers(3)), *numbers[4:], "phases of ring neighbours")
        plans.append(Planned(Plan("hand", made, PolicySettings("kuramoto-mpcc"), f"{k} lanes"), figures, 0.1, [], []))
    outcome = Outcome(Request(made, failures=1), tasks={5: made})

    def shown(columns: int) -> str:
        console = Console(width=columns, file=io.StringIO(), record=True)
        plan_tables.print_plans(console, outcome, plans)
        plan_tables.print_formations(console, plans)
        return console.export_text()

    digits, width = re.compile(r"[\d.]*\d[\d.]*"), int(draw.integers(1, 250))
    cut = set(digits.findall(shown(width))) - set(digits.findall(shown(1000)))
    return f"at width {width}: {sorted(cut)[:5]}" if cut else None


def _literal(draw: np.random.Generator, depth: int = 0) -> str:
    kind = int(draw.integers(9 if depth < 4 else 6))
    if kind < 6:
        return pick(draw, ["1", "-2.5", "1e-3", "'a'", "True", "None", "inf", "nan", "x", "f()", "+3",
                            "1j", "b'a'", "a.b", "1+1", "~1", "not 1", "-'a'", "...", "f'{1}'", "[i for i in x]",
                            "-True"])  # fmt: skip
    parts = ", ".join(_literal(draw, depth + 1) for _ in range(int(draw.integers(4))))
    return [f"({parts},)" if parts else "()", f"[{parts}]", f"{{'k': {parts or '1'}}}"][kind - 6]


def _try_literal(draw: np.random.Generator) -> str | None:
    text = _literal(draw)
    try:
        wanted = ast.literal_eval(text)
        if any(isinstance(each, (complex, bytes, type(...))) for each in _leaves(wanted)):
            wanted = ValueError
    except (ValueError, SyntaxError, TypeError):
        wanted = ValueError
    if "inf" in text or re.fullmatch("[a-z]", text):
        return None
    try:
        got = parse_overrides([[f"field={text}"]])["field"]
    except ValueError:
        got = ValueError
    return None if got == wanted else f"{text}: {got!r}, not {wanted!r}"


def _leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, dict):
        value = [*value, *value.values()]
    if isinstance(value, (tuple, list)):
        for each in value:
            yield from _leaves(each)
    else:
        yield value


ATTACKS = [
    Attack(
        "command lines",
        "Every wrong command line ends with exit code 2 and one to three lines, and writes nothing.",
        1500,
        _try_line,
    ),
    Attack(
        "terminals and shells",
        "With closed streams, pipes, other locales and home folders, there is no traceback and the exit code is right.",
        24,
        _try_process,
    ),
    Attack("tables at any width", "No number and no name is cut.", 200, _try_width),
    Attack("plans at any width", "No number is cut.", 20, _try_plan_width),
    Attack(
        "values of --set",
        "A literal is read as in Python; nothing else is accepted, and no code runs.",
        2000,
        _try_literal,
    ),
]
