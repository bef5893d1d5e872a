"""Override fields of a scenario, by dotted or nested names."""

import dataclasses
from collections.abc import Container, Mapping
from typing import Any

from lissajous_env.parameters.scenario import PARTS, Scenario
from lissajous_env.settings.parts import Robot
from lissajous_env.wording import nearest, shown

_OF_THE_NUMBER = "ring", "p", "alpha"
"""Fields of the formation that are valid only for the number of robots for which they were set."""
_SHORT = {"rogues": "targets.rogues"}
"""Short names of fields."""


class UnknownSettingError(ValueError, TypeError):
    """Error for a field that no part of a scenario has.

    It is a `ValueError`, like that of every invalid setting, and a `TypeError`, like that of an unexpected keyword
    argument: some libraries probe which keywords an environment accepts and handle only the latter.
    """


def by_field(overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return overrides by dotted names, each part by its fields; what is no field remains as it is."""
    found: dict[str, Any] = {}
    for key, value in overrides.items():
        name = _SHORT.get(key, key)
        if name in PARTS and isinstance(value, PARTS[name]):
            value = {each.name: getattr(value, each.name) for each in dataclasses.fields(value)}
        is_part = name in PARTS and isinstance(value, Mapping)
        found |= {f"{name}.{field}": one for field, one in value.items()} if is_part else {name: value}
    return found


def overridden(base: Scenario, overrides: Mapping[str, Any]) -> Scenario:
    """Return a scenario with fields overridden; `lissajous_env.scenario` documents overrides and errors."""
    whole: dict[str, Any] = {}
    changed: dict[str, dict[str, Any]] = {}
    for key, value in overrides.items():
        part, dot, field = _SHORT.get(key, key).partition(".")
        if key == "extensions":
            whole[key] = value
            continue
        if part not in PARTS:
            # TorchRL recognizes an optional keyword by Python's own words at the end.
            raise UnknownSettingError(
                f"override must name one of {', '.join(PARTS)}, got {key!r}{_nearest_field(key)} "
                f"(unexpected keyword argument {key!r})"
            )
        if not dot and isinstance(value, PARTS[part]):
            whole[part] = value
            continue
        if not dot and not isinstance(value, Mapping):
            raise ValueError(f"override {part} must be a mapping or a {PARTS[part].__name__}, got {shown(value)}")
        fields = {field: value} if dot else dict(value)
        known = [f.name for f in dataclasses.fields(PARTS[part])]
        for field_name in fields:
            if field_name not in known:
                rule = f"override must name a field of {part} ({', '.join(known)})"
                hint = nearest(str(field_name), known) or _nearest_field(str(field_name))
                raise UnknownSettingError(f"{rule}, got {part}.{field_name}{hint}")
        changed.setdefault(part, {}).update(fields)
    given = {f"{part}.{name}" for part, fields in changed.items() for name in fields}
    given |= {f"{part}.{field.name}" for part in whole if part in PARTS for field in dataclasses.fields(PARTS[part])}
    try:
        for part, fields in changed.items():
            before = whole.get(part, getattr(base, part))
            whole[part] = dataclasses.replace(before, **(_one_limit(before, fields) if part == "robot" else fields))
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
    field = {each.name: each for each in dataclasses.fields(PARTS[part])}.get(name) if part in PARTS else None
    if field is None or dotted in given or getattr(getattr(base, part), name) == field.default:
        return ""
    return f"; it comes from the scenario {base.name}: change it too, {dotted}={field.default!r} is the default"


def _nearest_field(key: str) -> str:
    """Return "; did you mean task.duration?" for `duration` or a similar name."""
    dotted = [f"{part}.{field.name}" for part, each in PARTS.items() for field in dataclasses.fields(each)]
    if "." in key:
        return nearest(key, dotted)
    if there := [each for each in dotted if each.endswith(f".{key}")]:
        return f"; did you mean {' or '.join(there)}?"
    return nearest(key, PARTS) or nearest(key, (each.partition(".")[2] for each in dotted))
