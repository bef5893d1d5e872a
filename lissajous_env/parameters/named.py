"""Make scenarios from a name, a TOML file or `module:attribute`, with any field overridden."""

import dataclasses
import os
import re
import warnings
from collections.abc import Container, Iterable, Mapping
from functools import cache
from typing import Any

import numpy as np

from lissajous_env import here
from lissajous_env.parameters.assumptions import AssumptionWarning, violations
from lissajous_env.parameters.ids import register_ids
from lissajous_env.parameters.scenario import PARTS, Scenario
from lissajous_env.parameters.scenario_file import SUFFIX, read_scenario_file
from lissajous_env.parameters.shipped import SHIPPED
from lissajous_env.plugins import EntryPoints, import_attribute
from lissajous_env.settings.parts import Robot
from lissajous_env.wording import nearest, shown, where_raised

_SHIPPED = {each.name: each for each in SHIPPED}
_REGISTERED: dict[str, Scenario] = {}
"""Scenarios of users and of other packages, by name."""
_reported: set[str] = set()
"""Violated assumptions about which this process has already warned."""

_OF_THE_NUMBER = "ring", "p", "alpha"
"""Fields of the formation that are valid only for the number of robots for which they were set."""
_MOST_STEPS = 2**20
"""Limit on the steps of an episode."""
_SHORT = {"rogues": "targets.rogues"}
"""Short names of fields."""


class UnknownSettingError(ValueError, TypeError):
    """Error for a field that no part of a scenario has.

    It is a `ValueError`, like that of every invalid setting, and a `TypeError`, like that of an unexpected keyword
    argument: some libraries probe which keywords an environment accepts and handle only the latter.
    """


def scenarios() -> tuple[str, ...]:
    """Return the names of the shipped scenarios, then those of the registered ones in alphabetical order."""
    _BROUGHT.load()
    return (*_SHIPPED, *sorted(_REGISTERED))


def register_scenario(made: Scenario) -> Scenario:
    """Register a scenario, so that every command and environment accepts its name, and return it.

    Gymnasium and PettingZoo then make it as `lissajous/NAME-v0`.

    Raises:
        ValueError: the argument is no scenario, its name is invalid, or a different scenario has that name.
    """
    if not isinstance(made, Scenario):
        raise ValueError(f"scenario must be a Scenario to be registered, got {shown(made)}")
    _check_name(made.name)
    _warn(made)
    if (there := _SHIPPED.get(made.name) or _REGISTERED.get(made.name)) is None:
        _REGISTERED[made.name] = made
        register_ids(made.name)
    elif there != made:
        raise ValueError(f"name of a scenario must be new, got {made.name}, which another one has")
    return made


def scenario(name: str | os.PathLike | Scenario, /, **overrides: Any) -> Scenario:
    """Make a scenario, with any field overridden.

    Args:
        name: A name of `scenarios()`, or one that a module of the current folder registers; a TOML file, as
            `lissajous_env.parameters.scenario_file` describes it; `module:attribute`, a `Scenario` or a function
            without arguments that returns one; or a `Scenario`.
        **overrides: Dotted (`**{"curve.a": 11}`) or nested (`curve={"a": 11}`, `curve=Curve(...)`) fields. Where they
            change the number of robots, `formation.ring`, `p` and `alpha` are derived anew unless they are given too.

    Raises:
        UnknownSettingError: an unknown field; the message suggests the closest match.
        ValueError: an unknown scenario, one that cannot be read or loaded, or an invalid value.

    Warns:
        AssumptionWarning: the scenario violates an assumption of the paper in a way that no shipped scenario does; each
            violation is reported once per process. `lissajous_env.parameters.assumptions.violations` lists all.
    """
    made = build(name, **overrides)
    if overrides or name not in _SHIPPED:
        _warn(made)
    return made


def build(name: str | os.PathLike | Scenario, /, **overrides: Any) -> Scenario:
    """Make a scenario like `scenario`, without warnings, for callers that report violated assumptions themselves."""
    made = name if isinstance(name, Scenario) else _found(name)
    return _overridden(made, overrides) if overrides else made


def registered_scenario(name: Any) -> Scenario:
    """Return the scenario of a name without loading a file or module, as is safe for names read from files.

    Raises:
        ValueError: there is no such scenario; the message suggests the closest match.
    """
    if isinstance(name, str):
        if name not in _SHIPPED and name not in _REGISTERED:
            _BROUGHT.load()
        if made := _SHIPPED.get(name) or _REGISTERED.get(name):
            return made
    raise unknown_scenario(name)


def unknown_scenario(name: Any, others: Iterable[str] = ()) -> ValueError:
    """Return the error for an unknown scenario, which suggests the closest match among scenarios and `others`."""
    known = scenarios()
    hint = nearest(name, [*known, *others])
    words = f"scenario must be one of the {len(known)} that `lissajous scenarios` lists, got {shown(name)}{hint}"
    return ValueError("; ".join([words, *_BROUGHT.broken]))


def bring_scenario(name: str) -> None:
    """Import the module in the current folder that registers a scenario, unless the scenario is known already.

    Raises:
        ValueError: the module cannot be imported.
    """
    if not _is_known(name):
        here.load_module_of(name, "scenario", "register_scenario")


def _is_known(name: str) -> bool:
    # Scenarios of other packages are loaded last, for names that are in neither table.
    return name in _SHIPPED or name in _REGISTERED or name in scenarios()


def meant_here(name: Any) -> list[str]:
    """Return candidates for a mistyped scenario: files beside it, and scenarios that modules here register."""
    return [*here.beside(name, SUFFIX), *(each for each, _ in here.registered_here("register_scenario"))]


def is_scenario_file(name: Any) -> bool:
    """Return True if a scenario is given as the path of a file."""
    return isinstance(name, str) and name.lower().endswith(SUFFIX)


def with_cycles(made: Scenario, max_cycles: int | None) -> Scenario:
    """Return a scenario whose episodes last `max_cycles` steps instead of `task.duration`; None changes nothing.

    Raises:
        ValueError: not a whole number from 1 to 2^20.
    """
    if max_cycles is None:
        return made
    whole = isinstance(max_cycles, (int, np.integer)) and not isinstance(max_cycles, bool)
    if not whole or not 1 <= max_cycles <= _MOST_STEPS:
        raise ValueError(f"max_cycles must be a whole number from 1 to {_MOST_STEPS}, got {shown(max_cycles)}")
    return scenario(made, **{"task.duration": int(max_cycles) * made.task.step})


def _warn(made: Scenario) -> None:
    """Warn about violated assumptions not yet reported in this process and not violated by a shipped scenario."""
    if new := [words for words in violations(made) if words not in _reported and words not in _violated_on_purpose()]:
        _reported.update(new)
        warnings.warn(f"scenario {made.name}: {'; '.join(new)}", AssumptionWarning, stacklevel=3)


@cache
def _violated_on_purpose() -> frozenset[str]:
    return frozenset(words for each in SHIPPED for words in violations(each))


def _found(name: Any) -> Scenario:
    given = os.fspath(name) if isinstance(name, os.PathLike) else name
    if is_scenario_file(given):
        return _of_file(given)
    if isinstance(given, str) and ":" in given:
        return _imported(given)
    if isinstance(given, str):
        bring_scenario(given)
        if not _is_known(given):
            raise unknown_scenario(given, meant_here(given))
    return registered_scenario(given)


def _of_file(path: str) -> Scenario:
    """Make the scenario of a file; its default name is that of the file, not that of its base."""
    given = read_scenario_file(path)
    words = {"name": os.path.basename(path)[: -len(SUFFIX)], "description": ""}
    words |= {key: given.pop(key) for key in words if key in given}
    try:
        base = registered_scenario(given.pop("base")) if "base" in given else Scenario()
        _check_name(words["name"])
        return dataclasses.replace(_overridden(base, given), **words)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _imported(reference: str) -> Scenario:
    made = import_attribute(reference, "scenario must be module:attribute")
    rule = f"scenario {reference} must be a Scenario, or a function without arguments that returns one"
    if callable(made):
        try:
            made = made()
        except (Exception, SystemExit) as error:
            raise ValueError(f"{rule}, got {where_raised(error)}") from error
    if not isinstance(made, Scenario):
        raise ValueError(f"{rule}, got {shown(made)}")
    return made


def _register_brought(brought: Any) -> None:
    """Register the object of an entry point: a scenario, or a function that registers some."""
    if isinstance(brought, Scenario):
        register_scenario(brought)
    else:
        brought()


_BROUGHT = EntryPoints("lissajous_env.scenarios", "scenarios", _register_brought)


def _check_name(name: str) -> None:
    """Raise ValueError for a name that is invalid in an id, or that denotes a file or a module."""
    if not re.fullmatch(r"\w[\w.-]{0,98}", name) or is_scenario_file(name):
        rule = f"must be a word of letters, digits, _, - and . that does not end in {SUFFIX}"
        raise ValueError(f"name of a scenario {rule}, got {shown(name)}")


def _nearest_field(key: str) -> str:
    """Return "; did you mean task.duration?" for `duration` or a similar name."""
    dotted = [f"{part}.{field.name}" for part, each in PARTS.items() for field in dataclasses.fields(each)]
    if "." in key:
        return nearest(key, dotted)
    if there := [each for each in dotted if each.endswith(f".{key}")]:
        return f"; did you mean {' or '.join(there)}?"
    return nearest(key, PARTS) or nearest(key, (each.partition(".")[2] for each in dotted))


def _overridden(base: Scenario, overrides: Mapping[str, Any]) -> Scenario:
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
