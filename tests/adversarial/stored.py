"""Attacks on the results of a benchmark: what episodes.jsonl and settings.json can have become."""

import contextlib
import functools
import json
import math
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from baselines.benchmark.running import run
from baselines.benchmark.types import Benchmark
from lissajous_env.world.columns import COLUMNS
from tests.adversarial import Attack
from tests.adversarial.terminal import pick

_QUIET = Console(quiet=True)


@functools.cache
def _results() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="lissajous-attack-"))
    run(_settings(folder), console=_QUIET)
    return folder


def _settings(folder: Path) -> Benchmark:
    changed = {"task.duration": 1.0, "faults.schedule": ((0, 0.3, math.inf),)}
    return Benchmark(("failure",), ("still", "random"), 2, out=folder, overrides=changed)


_HOSTILE = ["NaN", "Infinity", "-Infinity", "1e999", "1" + "0" * 400, "9" * 5000, "-1", "-1e-9", "1e301", "true",
            "false", '"3"', "[]", "{}", "[" * 50_000, '{"a":' * 50_000, '"[/b]"', '"\\ud800"', "2", "1.5", "3e5",
            "null", "nul"]  # fmt: skip


def _with_results(spoil: Callable[[Path], bool]) -> tuple[str, list[Any] | None]:
    """Spoil a copy of good results and go on there: the error, or the rows where there was none."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name, "results")
        shutil.copytree(_results(), folder)
        if not spoil(folder):
            return "", None
        before = (folder / "episodes.jsonl").read_bytes()
        try:
            rows = run(_settings(folder), console=_QUIET)
        except ValueError as error:
            if (folder / "episodes.jsonl").read_bytes() != before:
                return "refused, but it has changed the file", None
            return f"refused: {error}", None
        return "", rows


def _try_row(draw: np.random.Generator) -> str | None:
    line, value = int(draw.integers(3)), pick(draw, _HOSTILE)
    good = (_results() / "episodes.jsonl").read_text().splitlines()
    column = pick(draw, json.loads(good[line]))
    said = []

    def spoil(folder: Path) -> bool:
        row = json.loads(good[line])
        text = json.dumps(row).replace(f'"{column}": {json.dumps(row[column])}', f'"{column}": {value}')
        with contextlib.suppress(ValueError, RecursionError):
            if json.dumps(json.loads(text)) == json.dumps(row):
                return False
        said.append(text[:200])
        (folder / "episodes.jsonl").write_text("\n".join([*good[:line], text, *good[line + 1 :]]) + "\n")
        return True

    words, rows = _with_results(spoil)
    if not said or (words.startswith("refused: ") and "episodes.jsonl" in words and f"line {line + 1}" in words):
        return None
    if rows is not None and _is_possible(column, value):
        return None
    return f"{column} = {value[:40]}: {words[:200] or 'taken'}"


def _is_possible(column: str, value: str) -> bool:
    """Return whether the rule of a column allows a value."""
    return column in COLUMNS and COLUMNS[column].refusal(json.loads(value)) is None


def _try_settings(draw: np.random.Generator) -> str | None:
    good = json.loads((_results() / "settings.json").read_text())
    path: list[Any] = []
    inside: Any = good
    while isinstance(inside, (dict, list)) and inside and (not path or draw.random() < 0.8):
        key = pick(draw, inside if isinstance(inside, dict) else range(len(inside)))
        path, inside = [*path, key], inside[key]
    value = pick(draw, _HOSTILE)

    def spoil(folder: Path) -> bool:
        owner = good
        for key in path[:-1]:
            owner = owner[key]
        if draw.random() < 0.2:
            del owner[path[-1]]
            text = json.dumps(good)
        else:
            owner[path[-1]] = "SPOILT"
            text = json.dumps(good).replace('"SPOILT"', value)
        (folder / "settings.json").write_text(text)
        return True

    words, rows = _with_results(spoil)
    harmless = path[-1] == "description" or path[0] in ("episodes", "policies")
    if words.startswith("refused: ") or (rows is not None and harmless):
        return None
    with contextlib.suppress(ValueError, RecursionError, TypeError):
        if rows is not None and json.loads(value) == inside:
            return None
    return f"settings {path} = {value[:40]}: {words[:200] or 'taken'}"


ATTACKS = [
    Attack(
        "rows of episodes.jsonl", "A value that no score can have is rejected with its file and line.", 300, _try_row
    ),
    Attack("settings.json", "Settings that were changed are rejected.", 200, _try_settings),
]
