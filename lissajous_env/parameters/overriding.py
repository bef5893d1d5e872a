"""Override fields of a scenario, by dotted or nested names."""

import dataclasses
from collections.abc import Container, Mapping
from typing import Any

from lissajous_env.parameters.scenario import PARTS, Scenario
from lissajous_env.settings.robot import Robot
from lissajous_env.wording import nearest, shown

_OF_THE_NUMBER = "ring", "p", "alpha"
"""Fields of the formation that are valid only for the number of robots for which they were set."""
_SHORT = {"rogues": "targets.rogues"}
"""Short names of fields."""
_FIELDS = {f"{part}.{field.name}": field for part, kind in PARTS.items() for field in dataclasses.fields(kind)}
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
        name = _SHORT.get(key, key)
        if name in PARTS and isinstance(value, PARTS[name]):
            value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        elif name in PARTS and not isinstance(value, Mapping):
            raise ValueError(f"override {name} must be a mapping or a {PARTS[name].__name__}, got {shown(value)}")
        fields |= {f"{name}.{field}": entry for field, entry in value.items()} if name in PARTS else {name: value}
    for name in fields:
        part = name.partition(".")[0]
        if name in _FIELDS or name == "extensions":
            continue
        if part in PARTS:
            known = [field.name for field in dataclasses.fields(PARTS[part])]
            raise UnknownSettingError(
                f"override must name a field of {part} ({', '.join(known)}), got {name}{_nearest_field(name)}"
            )
        # TorchRL recognizes an optional keyword by Python's own words at the end.
        raise UnknownSettingError(
            f"override must name one of {', '.join(PARTS)}, got {name!r}{_nearest_field(name)} "
            f"(unexpected keyword argument {name!r})"
        )
    return fields


def overridden(base: Scenario, overrides: Mapping[str, Any]) -> Scenario:
    """Return a scenario with fields overridden; `lissajous_env.scenario` documents overrides and errors."""
    given = by_field(overrides)
    changed: dict[str, dict[str, Any]] = {part: {} for part in PARTS}
    for dotted in given.keys() & _FIELDS:
        part, _, name = dotted.partition(".")
        changed[part][name] = given[dotted]
    whole: dict[str, Any] = {"extensions": given["extensions"]} if "extensions" in given else {}
    try:
        changed["robot"] = _one_limit(base.robot, changed["robot"])
        whole |= {
            part: dataclasses.replace(getattr(base, part), **fields) for part, fields in changed.items() if fields
        }
        robot, curve = whole.get("robot", base.robot), whole.get("curve", base.curve)
        if (curve.a + curve.b if robot.count is None else robot.count) != base.num_robots:
            anew = {name: None for name in _OF_THE_NUMBER if f"formation.{name}" not in given}
            whole["formation"] = dataclasses.replace(whole.get("formation", base.formation), **anew)
        return dataclasses.replace(base, **whole)
    except ValueError as error:
        raise ValueError(f"{error}{_origin(str(error), base, given)}") from error


def _one_limit(robot: Robot, fields: dict[str, Any]) -> dict[str, Any]:
    """Reset `throttle_max` or `speed_max` to None where the other one, or the motor, is overridden.

    A new motor preserves the throttle of a robot that has both values, such as a resolved one.
    """
    pair = {"throttle_max", "speed_max"}
    given = pair & {name for name, value in fields.items() if value is not None}
    if len(given) == 1:
        return dict.fromkeys(pair) | fields
    both = robot.throttle_max is not None and robot.speed_max is not None
    if both and not pair & fields.keys() and {"drag", "drive", "offset"} & fields.keys():
        return fields | {"speed_max": None}
    return fields


def _origin(words: str, base: Scenario, given: Container[str]) -> str:
    """Return a hint if the field of an error was not overridden but inherited from `base`; "" otherwise."""
    dotted = words.partition(" ")[0]
    part, _, name = dotted.partition(".")
    if dotted not in _FIELDS or dotted in given or getattr(getattr(base, part), name) == _FIELDS[dotted].default:
        return ""
    default = _FIELDS[dotted].default
    return f"; it comes from the scenario {base.name}: change it too, {dotted}={default!r} is the default"


def _nearest_field(name: str) -> str:
    """Return "; did you mean task.duration?" for `duration`, `tasks.duration` or a similar name."""
    if "." in name and (hint := nearest(name, _FIELDS)):
        return hint
    last = name.rpartition(".")[2]
    if same := [dotted for dotted in _FIELDS if dotted.endswith(f".{last}")]:
        return f"; did you mean {' or '.join(same)}?"
    return nearest(last, PARTS) or nearest(last, (dotted.partition(".")[2] for dotted in _FIELDS))
