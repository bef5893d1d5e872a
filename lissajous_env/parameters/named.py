"""Make scenarios from a name, a TOML file or `module:attribute`, with any field overridden."""

import os
from collections.abc import Iterable
from typing import Any

from lissajous_env import here
from lissajous_env.parameters.assumptions import violations, warn_of_violations
from lissajous_env.parameters.named_spaces import denotes_part_of_file, scenario_of_space, space_and_split
from lissajous_env.parameters.overriding import overridden
from lissajous_env.parameters.registry import NAMES, SCENARIOS, is_notebook, register, register_ids
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import (
    SUFFIX,
    included_scenarios,
    is_file,
    name_in_file,
    read_toml,
    scenario_from,
)
from lissajous_env.plugins import EntryPoints, import_attribute
from lissajous_env.settings.checks import whole_number
from lissajous_env.settings.task import MOST_STEPS
from lissajous_env.wording import nearest, shown, where_raised

_INCLUDED = included_scenarios()
_unused: set[str] = set()
"""Violated assumptions of scenarios in folders of policies, which matter only if a policy uses the formation."""
_POLICY = "policy.toml"
"""Name of the file with the policy in such a folder."""


def scenarios() -> tuple[str, ...]:
    """Return the names of the included scenarios, then those of the registered ones in alphabetical order."""
    _BROUGHT.load()
    return (*_INCLUDED, *sorted(SCENARIOS))


def register_scenario(scenario: Scenario) -> Scenario:
    """Register a scenario, so that every command and environment accepts its name, and return it.

    Gymnasium and PettingZoo then make it as `lissajous/NAME-v0`.

    Raises:
        ValueError: the argument is no scenario, its name is invalid, or a different scenario has that name. In a
            notebook, it replaces one that was registered before.
    """
    if not isinstance(scenario, Scenario):
        raise ValueError(f"scenario must be a Scenario to be registered, got {shown(scenario)}")
    if _INCLUDED.get(scenario.name) != scenario:
        register(SCENARIOS, "scenario", scenario, NAMES, _INCLUDED, is_notebook())
        warn_of_violations(scenario)
        register_ids(scenario.name)
    return scenario


def scenario(name: str | os.PathLike | Scenario, /, **overrides: Any) -> Scenario:
    """Make a scenario, with any field overridden.

    Args:
        name: A name of `scenarios()`, or one that a module of the current folder registers; a TOML file, as
            `lissajous_env.parameters.scenario_file` describes it; `module:attribute`, a `Scenario` or a function
            without arguments that returns one; a scenario of a space, as `lissajous_env.parameters.named_spaces`
            describes it; or a `Scenario`.
        **overrides: Dotted (`**{"curve.a": 11}`) or nested (`curve={"a": 11}`, `curve=Curve(...)`) fields. Where they
            change the number of robots, `formation.ring`, `p` and `alpha` are derived anew unless they are given too.

    Raises:
        UnknownSettingError: an unknown field; the message suggests the closest match.
        ValueError: an unknown scenario, one that cannot be read or loaded, or an invalid value.

    Warns:
        AssumptionWarning: the scenario violates an assumption of the paper in a way that no included scenario does;
            each violation is reported once per process. `lissajous_env.parameters.assumptions.violations` lists all.
            The scenario in the folder of a policy is not reported: the policy may not use its formation.
    """
    made = build(name, **overrides)
    if is_file(name) and os.path.isfile(os.path.join(os.path.dirname(name), _POLICY)):  # type: ignore[arg-type]
        _unused.update(violations(made))
    elif overrides or name not in _INCLUDED:
        warn_of_violations(made, _unused)
    return made


def build(name: str | os.PathLike | Scenario, /, **overrides: Any) -> Scenario:
    """Make a scenario like `scenario`, without warnings, for callers that report violated assumptions themselves."""
    made = name if isinstance(name, Scenario) else _loaded(os.fspath(name) if isinstance(name, os.PathLike) else name)
    return overridden(made, overrides) if overrides else made


def unknown_scenario(name: Any, others: Iterable[str] = ()) -> ValueError:
    """Return the error for an unknown scenario, which suggests the closest match among scenarios and `others`."""
    if isinstance(name, str) and space_and_split(name) is not None:
        rule = f"scenario must be a single scenario, got the space {name}"
        return ValueError(f"{rule}; choose one of its scenarios, as {name}{':' if is_file(name) else '-'}0")
    known = scenarios()
    hint = nearest(name, [*known, *others])
    words = f"scenario must be one of the {len(known)} that `lissajous scenarios` lists, got {shown(name)}{hint}"
    return ValueError("; ".join([words, *_BROUGHT.broken]))


def bring_scenario(name: str) -> None:
    """Import the module in the current folder that registers a scenario, unless the scenario is already registered.

    Raises:
        ValueError: the module cannot be imported.
    """
    if _known(name) is None:
        here.load_module_of(name, "scenario", "register_scenario")


def meant_here(name: Any) -> list[str]:
    """Return candidates for a mistyped scenario: files beside it, and scenarios that modules here register."""
    return [*here.beside(name, SUFFIX), *(registered for registered, _ in here.registered_here("register_scenario"))]


def denotes_scenario(name: str) -> bool:
    """Return True for a registered name, also SPACE-SEED, for the path of a file, and for FILE.toml:SEED."""
    return is_file(name) or denotes_part_of_file(name) or _known(name) is not None


def with_cycles(made: Scenario, max_cycles: int | None) -> Scenario:
    """Return a scenario whose episodes last `max_cycles` steps instead of `task.duration`; None changes nothing.

    Raises:
        ValueError: not a whole number from 1 to 2^20.
    """
    if max_cycles is None:
        return made
    steps = whole_number("max_cycles", max_cycles, 1, MOST_STEPS)
    return build(made, **{"task.duration": steps * made.task.step})


def _known(name: Any) -> Scenario | None:
    """Return the scenario of a registered name, also SPACE-SEED; None for another name."""
    if not isinstance(name, str) or ":" in name:
        return None
    if name not in _INCLUDED and name not in SCENARIOS:
        _BROUGHT.load()  # scenarios of other packages, at last
    return _INCLUDED.get(name) or SCENARIOS.get(name) or scenario_of_space(name)


def _registered(name: str) -> Scenario:
    if (made := _known(name)) is None:
        raise unknown_scenario(name)
    return made


def _loaded(name: Any) -> Scenario:
    if is_file(name):
        return _of_file(name)
    if (made := _known(name) or (scenario_of_space(name) if isinstance(name, str) else None)) is not None:
        return made
    if not isinstance(name, str) or space_and_split(name) is not None:
        raise unknown_scenario(name)
    if ":" in name:
        return _imported(name)
    bring_scenario(name)
    if (made := _known(name)) is None:
        raise unknown_scenario(name, meant_here(name))
    return made


def _of_file(path: str) -> Scenario:
    """Make the scenario of a file; its default name is that of the file, not that of its base."""
    table = read_toml(path)
    if "draw" in table:
        raise unknown_scenario(path)
    try:
        return scenario_from(table | {"name": name_in_file(table, path)}, "", _registered)
    except ValueError as error:
        raise type(error)(f"{path}: {error}") from error


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
for _name in _INCLUDED:
    register_ids(_name)
