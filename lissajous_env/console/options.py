"""Options that commands share: types with their help, which tyro reads, and the values of `--set name=value`.

Such a value is a Python literal, which is parsed and never run.
"""

import math
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import tyro

from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.settings.formulas import Formula

ScenarioName = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SCENARIO")]
ScenarioNames = Annotated[
    tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[SCENARIO ...]", help_behavior_hint="")
]
Device = Annotated[str, tyro.conf.arg(help="device of the simulation: `cpu`, `cuda` or `cuda:k` for CUDA device k.")]
OutFile = Annotated[Path | None, tyro.conf.arg(metavar="FILE")]
OutFolder = Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")]
Overrides = Annotated[
    tuple[tuple[str, ...], ...],
    tyro.conf.UseAppendAction,
    tyro.conf.arg(
        name="set",
        metavar="NAME=VALUE ...",
        help="fields changed in every scenario, as in --set task.duration=30 targets.count=5",
        help_behavior_hint="",
    ),
]
"""Type of a command's `--set name=value ...`; `parse_overrides` reads it."""
RogueName = Annotated[
    str | None,
    tyro.conf.arg(
        name="rogues",
        metavar="NAME",
        help="rogue (adversary) that moves all targets: wander, flee, shadow, follow-gap, or hide, which requires "
        "task.contamination; a learned one, such as hide-from-sweep or a folder; or several joined by +. By default "
        "targets move as the scenario defines.",
    ),
]

_PLACE = r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*"
_WORDS = re.compile(rf"{_PLACE}(,{_PLACE})*|(?!(None|True|False|inf|nan)$)[A-Za-z][\w-]*")
"""A bare word, or `module:name`, also several separated by commas."""


def parse_overrides(groups: Iterable[Iterable[str]], rogues: str | None = None) -> dict[str, Any]:
    """Parse the arguments of `--set`, and of `--rogues`.

    A value is a Python literal (which may contain `inf`), a bare word, or `module:name`.

    Raises:
        ValueError: an entry has no name, is given twice, or has another kind of value; or the rogues are agents, whose
            actions no command has.
    """
    if rogues == AGENTS:
        raise ValueError(f"rogues of a command must be the name of a rogue, such as flee, or a folder, got {AGENTS}")
    overrides: dict[str, Any] = {} if rogues is None else {"rogues": rogues}
    for entry in (entry for group in groups for entry in tuple(group) or ("",)):
        name, equals, text = (part.strip() for part in entry.partition("="))
        if not equals or not name:
            raise ValueError(f"--set must be given as name=value, as in curve.a=5, got {entry!r}")
        if name in overrides:
            raise ValueError(f"--set must give {name} once, got {entry!r} too")
        overrides[name] = text if _WORDS.fullmatch(text) else _literal(name, text)
    return overrides


def _literal(name: str, text: str) -> Any:
    try:
        return Formula(text)({"inf": math.inf}.__getitem__)
    except ValueError:
        rule = "must be given a number, a word or another Python literal without nan"
        raise ValueError(f"--set {name} {rule}, got {text!r}") from None
