"""The option `--set name=value`; the value is a Python literal, which is parsed and never run."""

import ast
import math
import re
from collections.abc import Iterable
from typing import Annotated, Any

import tyro

from lissajous_env.parameters.rogues import AGENTS

Overrides = Annotated[
    tuple[tuple[str, ...], ...],
    tyro.conf.UseAppendAction,
    tyro.conf.arg(name="set", metavar="NAME=VALUE ...", help_behavior_hint=""),
]
"""Type of a command's `--set name=value ...`; `parse_overrides` reads it."""


RogueName = Annotated[str | None, tyro.conf.arg(name="rogues", metavar="NAME")]
"""Type of a command's `--rogues NAME`, a scripted rogue or the folder of a learned one."""


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
        overrides[name] = _value(name, text)
    return overrides


_PLACES = r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*(,[A-Za-z_][\w.]*:[A-Za-z_][\w.]*)*"
"""`module:name`, or several separated by commas."""


def _value(name: str, text: str) -> Any:
    if re.fullmatch(_PLACES, text):
        return text
    if re.fullmatch(r"[A-Za-z][\w-]*", text) and text not in ("None", "True", "False", "inf", "nan"):
        return text
    try:
        return _literal(ast.parse(text, mode="eval").body)
    except (ValueError, SyntaxError, TypeError, RecursionError, MemoryError):
        pass
    raise ValueError(f"--set {name} must be given a number, a word or another Python literal without nan, got {text!r}")


def _literal(node: ast.expr) -> Any:
    """Return the value of a literal; raise ValueError for any other expression."""
    if isinstance(node, ast.Constant) and isinstance(node.value, (bool, int, float, str, type(None))):
        return node.value
    if isinstance(node, ast.Name) and node.id == "inf":
        return math.inf
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.UAdd, ast.USub)):
        value = _literal(node.operand)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return -value if isinstance(node.op, ast.USub) else value
    if isinstance(node, ast.Tuple):
        return tuple(map(_literal, node.elts))
    if isinstance(node, ast.List):
        return list(map(_literal, node.elts))
    if isinstance(node, ast.Dict) and None not in node.keys:
        return {_literal(key): _literal(value) for key, value in zip(node.keys, node.values, strict=True) if key}
    raise ValueError("no literal")
