"""Scenarios as TOML files: name, description, base scenario, and a table for each part that differs from the base.

    base = "failure"
    [curve]
    half_width = 2.4
    [faults]
    schedule = [[0, 5.0, inf]]

The default name is that of the file. `extensions`, before the first table, lists extensions to import:

    extensions = ["my_extras:fastest", {place = "my_extras:near_wall", weight = -0.5}]
"""

import dataclasses
import json
import os
import tomllib
from collections.abc import Mapping
from typing import Any

from lissajous_env.here import beside
from lissajous_env.parameters.scenario import PARTS, Scenario
from lissajous_env.storage.files import read_bytes
from lissajous_env.wording import nearest

SUFFIX = ".toml"
WORDS = ("name", "description", "base")
"""Keys whose values are text."""
_LARGEST = 1 << 16
"""Size of a file [bytes]."""
_MOST_DOTS = 500
"""Limit on the dots in a line: the time to parse a dotted key grows with the square of their number."""


def read_scenario_file(path: str) -> dict[str, Any]:
    """Read the keys of a scenario's file, following links; the parts are not checked yet.

    Raises:
        ValueError: it is missing, no plain file, above 64 KiB, no TOML, or has an unknown key; the message names it.
    """
    known = {**dict.fromkeys(WORDS, (str, "text")), "extensions": (list, "a list")}
    return _read("scenario", path, known | dict.fromkeys(PARTS, (dict, "a table")))


def read_space_file(path: str) -> dict[str, Any]:
    """Read the keys of the file of a `ScenarioSpace`: name, description, base, require, and the tables draw and shift.

    Raises:
        ValueError: as `read_scenario_file`.
    """
    known = {**dict.fromkeys(WORDS, (str, "text")), "require": (list, "a list")}
    return _read("space", path, known | dict.fromkeys(("draw", "shift"), (dict, "a table")))


def is_space_file(path: str) -> bool:
    """Return True for a TOML file with the table `draw`, which a space of scenarios has and a scenario has not.

    Raises:
        ValueError: it is missing, no plain file, above 64 KiB, or no TOML; the message names it.
    """
    return "draw" in _parsed("scenario", path)


def _read(what: str, path: str, known: Mapping[str, tuple[type, str]]) -> dict[str, Any]:
    given = _parsed(what, path)
    for key, value in given.items():
        if key not in known:
            raise ValueError(f"{what} {path} must contain {', '.join(known)}, got {key!r}{nearest(key, known)}")
        kind, rule = known[key]
        if not isinstance(value, kind):
            raise ValueError(f"{what} {path} must contain {key} as {rule}, got {type(value).__name__}")
    return given


def _parsed(what: str, path: str) -> dict[str, Any]:
    try:
        text = read_bytes(os.path.realpath(path), _LARGEST).decode("utf-8-sig")  # some editors write a byte order mark
        _check_dots(text)
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError(f"{what} {path} must have fewer nested levels") from None
    except ValueError as error:
        hint = "" if os.path.exists(path) else nearest(path, beside(path, SUFFIX))
        raise ValueError(f"{what} {path} must be a TOML file that can be read: {error}{hint}") from error


def as_toml(scenario: Scenario) -> str:
    """Return the text of a scenario's file: name, description and every field that differs from its default.

    Raises:
        ValueError: the scenario has extensions, or a field is None where that is not the default.
    """
    if scenario.extensions:
        raise ValueError(f"extensions must be empty for a scenario's file, got {len(scenario.extensions)}")
    lines = [
        f"name = {toml_value('name', scenario.name)}",
        f"description = {toml_value('description', scenario.description)}",
    ]
    for part in PARTS:
        fields = [(field, getattr(getattr(scenario, part), field.name)) for field in dataclasses.fields(PARTS[part])]
        changed = [(field.name, value) for field, value in fields if value != field.default]
        lines += ["", f"[{part}]"] if changed else []
        lines += [f"{name} = {toml_value(f'{part}.{name}', value)}" for name, value in changed]
    return "\n".join(lines) + "\n"


def toml_value(name: str, value: Any) -> str:
    """Format a value as TOML."""
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(toml_value(name, entry) for entry in value)}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return str(value).lower()
    if value is None:
        raise ValueError(f"{name} must not be None for a scenario's file, which cannot contain it")
    return repr(value)


def _check_dots(text: str) -> None:
    for number, line in enumerate(text.split("\n"), start=1):
        if (dots := line.count(".")) > _MOST_DOTS:
            raise ValueError(f"line {number} must contain at most {_MOST_DOTS} dots, got {dots}; break it")
