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
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from lissajous_env.here import beside
from lissajous_env.parameters.extensions import Extension
from lissajous_env.parameters.overriding import overridden
from lissajous_env.parameters.registry import NAMES
from lissajous_env.parameters.scenario import PARTS, Scenario
from lissajous_env.storage.files import read_bytes
from lissajous_env.wording import nearest, shown

SUFFIX = ".toml"
_TEXTS = dict.fromkeys(("name", "description", "base"), (str, "text"))
_OF_SCENARIO = {**_TEXTS, "extensions": (list, "a list"), **dict.fromkeys(PARTS, (dict, "a table"))}
"""Type, also in words, of the values of a scenario's file."""
OF_SPACE = {**_TEXTS, "require": (list, "a list"), "draw": (dict, "a table"), "shift": (dict, "a table")}
"""Type, also in words, of the values of a space's file."""
_LARGEST = 1 << 16
"""Size of a file [bytes]."""


def read_toml(path: str, largest: int = _LARGEST) -> dict[str, Any]:
    """Read a TOML file of at most `largest` bytes, following links.

    Raises:
        ValueError: it is missing, no plain file, above this size, or no TOML; the message names it.
    """
    try:
        # Some editors write a byte order mark.
        return tomllib.loads(read_bytes(os.path.realpath(path), largest).decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        hint = "" if os.path.exists(path) else nearest(path, beside(path, SUFFIX))
        raise ValueError(f"{path} must be a TOML file that can be read: {error}{hint}") from error


def is_file(name: Any) -> bool:
    """Return True for the path of a TOML file, which need not exist."""
    return isinstance(name, (str, os.PathLike)) and os.fspath(name).lower().endswith(SUFFIX)


def name_in_file(table: Mapping[str, Any], path: str) -> str:
    """Return the name of a scenario or space in a file, by default that of the file.

    Raises:
        ValueError: the name is invalid.
    """
    name = table.get("name", os.path.basename(path)[: -len(SUFFIX)])
    if isinstance(name, str) and not re.fullmatch(NAMES[0], name):
        hint = "" if "name" in table else '; the file may contain another name, as in name = "lab"'
        raise ValueError(f"name of a scenario must be {NAMES[1]}, got {shown(name)}{hint}")
    return name


def check_keys(table: Mapping[str, Any], known: Mapping[str, tuple[type, str]]) -> None:
    """Check the keys of a file, and the types of their values.

    Raises:
        ValueError: a key is unknown, or a value has another type.
    """
    for key, value in table.items():
        if key not in known:
            raise ValueError(f"file must contain {', '.join(known)}, got {key!r}{nearest(key, known)}")
        kind, words = known[key]
        if not isinstance(value, kind):
            raise ValueError(f"{key} must be {words}, got {type(value).__name__}")


def scenario_from(table: Mapping[str, Any], name: str, base_of: Callable[[str], Scenario]) -> Scenario:
    """Make the scenario of a file from its table.

    Args:
        table: Keys and values of the file.
        name: Name if the table contains none.
        base_of: Function that returns the scenario of a name.

    Raises:
        ValueError: a key, a value or the base is unknown or invalid.
    """
    check_keys(table, _OF_SCENARIO)
    base = base_of(table["base"]) if "base" in table else Scenario()
    made = overridden(base, {key: value for key, value in table.items() if key not in _TEXTS})
    return dataclasses.replace(made, name=table.get("name", name), description=table.get("description", ""))


@cache
def included_scenarios() -> dict[str, Scenario]:
    """Return the included scenarios by name, from `shipped.toml`."""
    scenarios: dict[str, Scenario] = {}
    for name, table in read_toml(str(Path(__file__).with_name("shipped.toml"))).items():
        scenarios[name] = scenario_from(table, name, scenarios.__getitem__)
    return scenarios


def scenario_of(plain: Mapping[str, Any], extensions: Iterable[Extension] = ()) -> Scenario:
    """Make a scenario from the values of `Scenario.to_dict` after JSON, without importing anything.

    Args:
        plain: The values, with lists and with infinity as a word; their extensions are ignored.
        extensions: The scenario's extensions.

    Raises:
        ValueError: a part or a field is unknown, or a value is invalid; the message names it.
    """
    if not isinstance(plain, Mapping):
        raise ValueError(f"scenario must be a table of its parts, got {type(plain).__name__}")
    words = {key: plain[key] for key in ("name", "description") if key in plain}
    parts = {key: value for key, value in plain.items() if key not in (*words, "extensions")}
    made = overridden(Scenario(), _with_infinity(parts))
    return dataclasses.replace(made, **words, extensions=tuple(extensions))


def _with_infinity(value: Any) -> Any:
    """Return a value of JSON with the words `inf` and `-inf` as numbers."""
    if isinstance(value, Mapping):
        return {key: _with_infinity(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_with_infinity(entry) for entry in value]
    return float(value) if value in ("inf", "-inf") else value


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
