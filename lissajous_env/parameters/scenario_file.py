"""Scenarios from fields by name: overrides, dotted or nested, and TOML files.

A file has a name, a description, a base scenario, and a table for each part that differs from the base:

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
import operator
import os
import tomllib
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from lissajous_env.parameters.extensions import Extension
from lissajous_env.parameters.scenario import PARTS, Scenario
from lissajous_env.plugins import files_beside
from lissajous_env.settings.parts import Robot
from lissajous_env.settings.task import without_custom_motion
from lissajous_env.storage.files import read_bytes
from lissajous_env.wording import nearest, require, shown

SUFFIX = ".toml"
NAMES = r"(?!.*\.toml$)\w[\w.-]{0,98}", "a word of letters, digits, _, - and . that does not end in .toml"
"""Names of scenarios and spaces, as a pattern and in words."""
_KINDS = {str: "text", list: "a list", dict: "a table"}
"""Kinds of the values in a file, in words."""
TEXTS = dict.fromkeys(("name", "description", "base"), str)
"""Entries that the files of scenarios and of spaces have in common."""
_OF_SCENARIO = {**TEXTS, "extensions": list, **dict.fromkeys(PARTS, dict)}
"""Kinds of the values of a scenario's file."""
_LARGEST = 1 << 16
"""Largest size of a file [bytes]."""
_OF_TEAM_SIZE = "ring", "p", "alpha"
"""Fields of the formation that are valid only for the number of robots for which they were set, else derived."""
FIELDS = {f"{part}.{field.name}": field for part, kind in PARTS.items() for field in dataclasses.fields(kind)}
"""The fields of all parts by dotted name."""


class UnknownSettingError(ValueError, TypeError):
    """Error for a field that no part of a scenario has.

    It is a `ValueError`, like that of every invalid setting, and a `TypeError`, like that of an unexpected keyword
    argument: some libraries probe which keywords an environment accepts and handle only the latter.
    """


def by_field(overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return overrides by dotted names, each part by its fields; `extensions` remains as it is.

    Raises:
        UnknownSettingError: an unknown field.
        ValueError: the override of a part is neither a mapping nor the part.
    """
    fields: dict[str, Any] = {}
    for key, value in overrides.items():
        name = "targets.rogues" if key == "rogues" else key
        if name in PARTS and isinstance(value, PARTS[name]):
            value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        elif name in PARTS and not isinstance(value, Mapping):
            raise ValueError(f"override {name} must be a mapping or a {PARTS[name].__name__}, got {shown(value)}")
        fields |= {f"{name}.{field}": entry for field, entry in value.items()} if name in PARTS else {name: value}
    for name in fields:
        if name not in FIELDS and name != "extensions":
            words = f"override must name one of {', '.join(PARTS)}, or a field, as in task.duration, got {name!r}"
            # TorchRL recognizes an optional keyword by Python's own words at the end.
            end = "" if "." in name else f" (unexpected keyword argument {name!r})"
            raise UnknownSettingError(f"{words}{_nearest_field(name)}{end}")
    return fields


def overridden(base: Scenario, overrides: Mapping[str, Any]) -> Scenario:
    """Return a scenario with fields overridden; `lissajous_env.scenario` documents overrides and errors."""
    given = by_field(overrides)
    changed: dict[str, Any] = {"extensions": given.pop("extensions")} if "extensions" in given else {}
    for part, fields in _by_part(given).items():
        derived = _limits_to_derive(base.robot, fields) if part == "robot" else {}
        changed[part] = dataclasses.replace(getattr(base, part), **fields | derived)
    robot, curve = changed.get("robot", base.robot), changed.get("curve", base.curve)
    if (curve.a + curve.b if robot.count is None else robot.count) != base.num_robots:
        derived = {name: None for name in _OF_TEAM_SIZE if f"formation.{name}" not in given}
        changed["formation"] = dataclasses.replace(changed.get("formation", base.formation), **derived)
    return dataclasses.replace(base, **changed)


def _by_part(fields: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return by part the fields that are given by dotted name."""
    parts: dict[str, dict[str, Any]] = {}
    for dotted, value in fields.items():
        part, _, name = dotted.partition(".")
        parts.setdefault(part, {})[name] = value
    return parts


def _limits_to_derive(robot: Robot, fields: Mapping[str, Any]) -> dict[str, None]:
    """Return `throttle_max` or `speed_max` as None where the other one, or the motor, is overridden.

    A new motor preserves the throttle of a robot that has both values, such as a resolved one.
    """
    pair = {"throttle_max", "speed_max"}
    given = pair & {name for name, value in fields.items() if value is not None}
    if len(given) == 1:
        return dict.fromkeys(pair - given)
    both = robot.throttle_max is not None and robot.speed_max is not None
    has_new_motor = {"drag", "drive", "offset"} & fields.keys() and not pair & fields.keys()
    return {"speed_max": None} if both and has_new_motor else {}


def _nearest_field(name: str) -> str:
    """Return "; did you mean task.duration?" for `duration`, `tasks.duration` or a similar name."""
    last = name.rpartition(".")[2]
    if same := [dotted for dotted in FIELDS if dotted.endswith(f".{last}")]:
        return f"; did you mean {' or '.join(same)}?"
    return nearest(name, FIELDS) or nearest(last, [*PARTS, *(dotted.partition(".")[2] for dotted in FIELDS)])


def read_toml(path: str, largest: int = _LARGEST) -> dict[str, Any]:
    """Read a TOML file of at most `largest` bytes, following links.

    Raises:
        ValueError: it is missing, no plain file, above this size, or no TOML; the message names it.
    """
    try:
        data = read_bytes(os.path.realpath(path) if os.path.islink(path) else path, largest)
    except ValueError as error:
        hint = "" if os.path.exists(path) else nearest(path, files_beside(path, SUFFIX))
        raise ValueError(f"{error}{hint}") from error
    try:
        return tomllib.loads(data.decode("utf-8-sig"))  # some editors write a byte order mark
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} must be a TOML file that can be read: {error}") from error


def check_keys(table: Mapping[str, Any], known: Mapping[str, type]) -> None:
    """Check the keys of a file, and the types of their values.

    Raises:
        ValueError: a key is unknown, or a value has another type.
    """
    for key, value in table.items():
        require(key in known, "key", f"must be one of {', '.join(known)}", key, known)
        if not isinstance(value, known[key]):
            raise ValueError(f"{key} must be {_KINDS[known[key]]}, got {type(value).__name__}")


def scenario_of_table(table: Mapping[str, Any], base_of: Callable[[str], Scenario]) -> Scenario:
    """Make the scenario of a file from its table.

    Args:
        table: Keys and values of the file, with a name.
        base_of: Function that returns the scenario of a name.

    Raises:
        ValueError: a key, a value or the base is unknown or invalid.
    """
    check_keys(table, _OF_SCENARIO)
    base = base_of(table["base"]) if "base" in table else Scenario()
    scenario = overridden(base, {key: value for key, value in table.items() if key not in TEXTS})
    return dataclasses.replace(scenario, name=table["name"], description=table.get("description", ""))


@cache
def included_scenarios() -> dict[str, Scenario]:
    """Return the included scenarios by name, from `shipped.toml`."""
    scenarios: dict[str, Scenario] = {}
    for name, table in read_toml(str(Path(__file__).with_name("shipped.toml"))).items():
        scenarios[name] = scenario_of_table(table | {"name": name}, scenarios.__getitem__)
    return scenarios


def scenario_of_json(plain: Mapping[str, Any], extensions: Iterable[Extension] = ()) -> Scenario:
    """Make a scenario from the values of `Scenario.to_dict` after JSON, without importing anything.

    Args:
        plain: The values, with lists and with infinity as a word; their extensions are ignored.
        extensions: The scenario's extensions; without any, it is that of `Scenario.without_extensions`.

    Raises:
        ValueError: a part or a field is unknown, or a value is invalid; the message names it.
    """
    if not isinstance(plain, Mapping):
        raise ValueError(f"scenario must be a table of its parts, got {type(plain).__name__}")
    words = {key: plain[key] for key in ("name", "description") if key in plain}
    parts = {key: value for key, value in plain.items() if key not in words} | {"extensions": tuple(extensions)}
    if not parts["extensions"] and isinstance(targets := parts.get("targets"), Mapping):
        parts["targets"] = without_custom_motion(targets)
    return dataclasses.replace(overridden(Scenario(), _with_infinity(parts)), **words)


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
    require(not scenario.extensions, "extensions", "must be empty for a scenario's file", len(scenario.extensions))
    lines = [f"{name} = {toml_value(name, getattr(scenario, name))}" for name in ("name", "description")]
    for part, changed in changed_fields(scenario).items():
        lines += ["", f"[{part}]", *(f"{name} = {toml_value(f'{part}.{name}', now)}" for name, now in changed.items())]
    return "\n".join(lines) + "\n"


def changed_fields(scenario: Scenario) -> dict[str, dict[str, Any]]:
    """Return by part the fields of a scenario that differ from their defaults; parts without one are missing."""
    values = {dotted: operator.attrgetter(dotted)(scenario) for dotted in FIELDS}
    return _by_part({dotted: value for dotted, value in values.items() if value != FIELDS[dotted].default})


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
