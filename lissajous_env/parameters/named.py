"""Make scenarios from a name, a TOML file or `module:attribute`, with any field overridden."""

import itertools
import os
import re
import warnings
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from lissajous_env import here
from lissajous_env.parameters.assumptions import AssumptionWarning, violations
from lissajous_env.parameters.overriding import overridden
from lissajous_env.parameters.registry import is_notebook, register, register_ids
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import (
    OF_SPACE,
    SUFFIX,
    check_keys,
    included_scenarios,
    read_toml,
    scenario_from,
)
from lissajous_env.parameters.space import ScenarioSpace
from lissajous_env.plugins import EntryPoints, import_attribute
from lissajous_env.settings.checks import whole_number
from lissajous_env.settings.task import MOST_STEPS
from lissajous_env.wording import nearest, shown, where_raised

_INCLUDED = included_scenarios()
_REGISTERED: dict[str, Scenario] = {}
"""Scenarios of users and of other packages, by name."""
_SPACES: dict[str, ScenarioSpace] = {}
"""Spaces of scenarios by name: those of users, and those of the package that were used."""
_INCLUDED_SPACES = {path.stem: str(path) for path in sorted(Path(__file__).parent.glob("*-v*.toml"))}
"""Files of the included spaces, by name."""
_NAMES = (
    rf"(?!.*\{SUFFIX}$)\w[\w.-]{{0,98}}",
    f"a word of letters, digits, _, - and . that does not end in {SUFFIX}",
)
"""Names of scenarios and spaces, as a pattern and in words."""
_SAMPLED = re.compile(rf"(.+\{SUFFIX}):(?:(.+)-)?(\d+)")
"""FILE.toml:SEED or FILE.toml:SHIFT-SEED, a scenario of the space in a file."""
_reported: set[str] = set()
"""Violated assumptions about which this process has already warned."""
_unused: set[str] = set()
"""Violated assumptions of scenarios in folders of policies, which matter only if a policy uses the formation."""
_POLICY = "policy.toml"
"""Name of the file with the policy in such a folder."""
_SCENARIOS, _MOST_SCENARIOS = 32, 10_000
"""Default number of scenarios that represent a split, and its limit."""


def scenarios() -> tuple[str, ...]:
    """Return the names of the included scenarios, then those of the registered ones in alphabetical order."""
    _BROUGHT.load()
    return (*_INCLUDED, *sorted(_REGISTERED))


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
        register(_REGISTERED, "scenario", scenario, _NAMES, _INCLUDED, is_notebook())
        warn_of_violations(scenario)
        register_ids(scenario.name)
    return scenario


def scenario(name: str | os.PathLike | Scenario, /, **overrides: Any) -> Scenario:
    """Make a scenario, with any field overridden.

    Args:
        name: A name of `scenarios()`, or one that a module of the current folder registers; a TOML file, as
            `lissajous_env.parameters.scenario_file` describes it; `module:attribute`, a `Scenario` or a function
            without arguments that returns one; SPACE-SEED, a scenario of a space of `scenario_spaces()`, or
            FILE.toml:SEED or FILE.toml:SHIFT-SEED, one of the space in a file; or a `Scenario`.
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
    if _is_of_policy(name):
        _unused.update(violations(made))
    elif overrides or name not in _INCLUDED:
        warn_of_violations(made, _unused)
    return made


def build(name: str | os.PathLike | Scenario, /, **overrides: Any) -> Scenario:
    """Make a scenario like `scenario`, without warnings, for callers that report violated assumptions themselves."""
    made = name if isinstance(name, Scenario) else _loaded(_as_text(name))
    return overridden(made, overrides) if overrides else made


def registered_scenario(name: Any) -> Scenario:
    """Return the scenario of a name without loading a file or module, as is safe for names read from files.

    Raises:
        ValueError: there is no such scenario; the message suggests the closest match.
    """
    if not _is_known(name):
        raise unknown_scenario(name)
    return _INCLUDED.get(name) or _REGISTERED.get(name) or _of_space(name)  # type: ignore[return-value]


def unknown_scenario(name: Any, others: Iterable[str] = ()) -> ValueError:
    """Return the error for an unknown scenario, which suggests the closest match among scenarios and `others`."""
    if isinstance(name, str) and (space := _known_space(name)) is not None:
        return ValueError(
            f"scenario must be a single scenario, got the space {name}; choose one of its scenarios, as {space.name}-0"
        )
    known = scenarios()
    hint = nearest(name, [*known, *others])
    words = f"scenario must be one of the {len(known)} that `lissajous scenarios` lists, got {shown(name)}{hint}"
    return ValueError("; ".join([words, *_BROUGHT.broken]))


def bring_scenario(name: str) -> None:
    """Import the module in the current folder that registers a scenario, unless the scenario is already registered.

    Raises:
        ValueError: the module cannot be imported.
    """
    if not _is_known(name):
        here.load_module_of(name, "scenario", "register_scenario")


def meant_here(name: Any) -> list[str]:
    """Return candidates for a mistyped scenario: files beside it, and scenarios that modules here register."""
    return [*here.beside(name, SUFFIX), *(registered for registered, _ in here.registered_here("register_scenario"))]


def denotes_scenario(name: str) -> bool:
    """Return True for a registered name, also SPACE-SEED, for the path of a file, and for FILE.toml:SEED."""
    return _is_known(name) or _is_file(name) or _SAMPLED.fullmatch(name) is not None


def with_cycles(made: Scenario, max_cycles: int | None) -> Scenario:
    """Return a scenario whose episodes last `max_cycles` steps instead of `task.duration`; None changes nothing.

    Raises:
        ValueError: not a whole number from 1 to 2^20.
    """
    if max_cycles is None:
        return made
    steps = whole_number("max_cycles", max_cycles, 1, MOST_STEPS)
    return build(made, **{"task.duration": steps * made.task.step})


def warn_of_violations(made: Scenario, allowed: Iterable[str] = ()) -> None:
    """Warn about violated assumptions that are new in this process, not allowed, and in no included scenario."""
    known = {*_reported, *allowed, *_violated_on_purpose()}
    if new := [words for words in violations(made) if words not in known]:
        _reported.update(new)
        warnings.warn(f"scenario {made.name}: {'; '.join(new)}", AssumptionWarning, stacklevel=3)


# Spaces of scenarios.


def scenario_spaces() -> tuple[str, ...]:
    """Return the names of the included and registered spaces of scenarios."""
    return tuple(dict.fromkeys([*_INCLUDED_SPACES, *sorted(_SPACES)]))


def register_scenario_space(space: ScenarioSpace) -> ScenarioSpace:
    """Register a space, so that commands and environments accept its scenarios as NAME-SEED, and return it.

    Gymnasium and PettingZoo then make environments of the space as `lissajous/NAME-v0`.

    Raises:
        ValueError: the argument is no space, its name is invalid, or a different space has that name. In a notebook, it
            replaces one that was registered before.
    """
    if not isinstance(space, ScenarioSpace):
        raise ValueError(f"space must be a ScenarioSpace to be registered, got {shown(space)}")
    register(_SPACES, "space", space, _NAMES, _INCLUDED_SPACES, is_notebook())
    register_ids(space.name, is_space=True)
    return space


def scenario_space(name: str | os.PathLike | ScenarioSpace) -> ScenarioSpace:
    """Return a space of scenarios.

    Args:
        name: A name of `scenario_spaces()`; SPACE-SHIFT for one of its shifts; a TOML file with the fields of
            `ScenarioSpace`, in which `base` is the name of a scenario and `shift` stands for `shifts`; or a space.

    Raises:
        ValueError: there is no such space, or its file is invalid.
    """
    if isinstance(name, ScenarioSpace):
        return name
    given = _as_text(name)
    space = _space_of_file(given) if _is_file(given) else _known_space(given)
    if space is None:
        hint = nearest(given, scenario_spaces())
        raise ValueError(f"space must be one of {', '.join(scenario_spaces())}, got {shown(given)}{hint}")
    return space


def is_space(name: Any) -> bool:
    """Return True for the name of a space of scenarios, and for a TOML file of one.

    Raises:
        ValueError: a TOML file cannot be read.
    """
    given = _as_text(name)
    return "draw" in read_toml(given) if _is_file(given) else _known_space(given) is not None


def space_and_split(name: Any) -> tuple[ScenarioSpace, str] | None:
    """Return the space and the split that SPACE or SPACE:SPLIT denotes, or None for anything else.

    SPACE is as for `scenario_space`, SPLIT is a split or a shift, by default `train`.

    Raises:
        ValueError: the space has no such split or shift.
    """
    if isinstance(name, ScenarioSpace):
        return name, "train"
    given = _as_text(name)
    space, colon, split = given.partition(":") if isinstance(given, str) else ("", "", "")
    is_missing = _is_file(space) and not os.path.exists(space)
    if re.fullmatch(r"(.+-)?\d+", split) or is_missing or not is_space(space):
        return None
    of, split = scenario_space(space), split if colon else "train"
    next(of.seeds(split))
    return of, split


def expanded(names: Iterable[str]) -> tuple[str, ...]:
    """Return names of scenarios, with SPACE:SPLIT, or SPACE:SPLIT:COUNT, replaced by the first scenarios of the split.

    SPACE is a name of `scenario_spaces()` or a TOML file, SPLIT is a split or a shift; COUNT is 32 by default.

    Raises:
        ValueError: there is no such space or split.
    """
    single: list[str] = []
    for name in names:
        space, colon, rest = name.partition(":")
        split, _, count = rest.partition(":")
        if not colon or re.fullmatch(r"(.+-)?\d+", rest) or not (_is_file(space) or _known_space(space)):
            single.append(name)
            continue
        if count and not 1 <= (int(count) if count.isdecimal() else 0) <= _MOST_SCENARIOS:
            raise ValueError(f"{space}:{split} must be followed by a number from 1 to {_MOST_SCENARIOS}, got {count!r}")
        of = scenario_space(space)
        start = space + (":" if _is_file(space) else "-") + (f"{split}-" if split in of.shifts else "")
        single += [f"{start}{seed}" for seed in itertools.islice(of.seeds(split), int(count or _SCENARIOS))]
    return tuple(single)


# Names, files and modules.


def _as_text(name: Any) -> Any:
    return os.fspath(name) if isinstance(name, os.PathLike) else name


def _is_file(name: Any) -> bool:
    return isinstance(name, str) and name.lower().endswith(SUFFIX)


def _is_of_policy(name: Any) -> bool:
    """Return whether a scenario is given as the file in the folder of a policy."""
    given = _as_text(name)
    return _is_file(given) and os.path.isfile(os.path.join(os.path.dirname(given), _POLICY))


def _is_known(name: Any) -> bool:
    # Scenarios of other packages are loaded last, for names that are in neither table.
    return isinstance(name, str) and (
        name in _INCLUDED or name in _REGISTERED or name in scenarios() or _of_space(name) is not None
    )


def _loaded(name: Any) -> Scenario:
    if not isinstance(name, str):
        raise unknown_scenario(name)
    if _is_file(name):
        return _of_file(name)
    if part := _SAMPLED.fullmatch(name):
        space = scenario_space(part[1])
        return (space.shifted(part[2]) if part[2] else space).sample(int(part[3]))
    if ":" in name:
        return _imported(name)
    bring_scenario(name)
    if not _is_known(name):
        raise unknown_scenario(name, meant_here(name))
    return registered_scenario(name)


def _of_file(path: str) -> Scenario:
    """Make the scenario of a file; its default name is that of the file, not that of its base."""
    table = read_toml(path)
    if "draw" in table:
        raise ValueError(
            f"scenario must be a single scenario, got the space {path}; choose one of its scenarios, as {path}:0"
        )
    try:
        return scenario_from(table | {"name": _name_in_file(table, path)}, "", registered_scenario)
    except ValueError as error:
        raise type(error)(f"{path}: {error}") from error


def _of_space(name: str) -> Scenario | None:
    """Return the scenario SPACE-SEED of an included or registered space; None if the name has another form."""
    name, _, seed = name.rpartition("-")
    space = _known_space(name) if seed.isdecimal() else None
    return None if space is None else space.sample(int(seed))


def _known_space(name: Any) -> ScenarioSpace | None:
    """Return the included or registered space NAME, or SPACE-SHIFT; None if there is none."""
    if not isinstance(name, str):
        return None
    if name in _INCLUDED_SPACES and name not in _SPACES:
        _SPACES[name] = _space_of_file(_INCLUDED_SPACES[name])
    if name in _SPACES:
        return _SPACES[name]
    before, _, shift = name.rpartition("-")
    space = _known_space(before) if before else None
    return space.shifted(shift) if space is not None and shift in space.shifts else None


def _space_of_file(path: str) -> ScenarioSpace:
    table = read_toml(path)
    try:
        check_keys(table, OF_SPACE)
        base = registered_scenario(table["base"]) if "base" in table else Scenario()
        rules, shifts, words = table.get("require", ()), table.get("shift", {}), table.get("description", "")
        return ScenarioSpace(_name_in_file(table, path), base, table.get("draw", {}), rules, shifts, words)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _name_in_file(table: dict[str, Any], path: str) -> str:
    """Return the name of a scenario or space in a file, by default that of the file.

    Raises:
        ValueError: the name is invalid.
    """
    name = table.get("name", os.path.basename(path)[: -len(SUFFIX)])
    if isinstance(name, str) and not re.fullmatch(_NAMES[0], name):
        hint = "" if "name" in table else '; the file may contain another name, as in name = "lab"'
        raise ValueError(f"name of a scenario must be {_NAMES[1]}, got {shown(name)}{hint}")
    return name


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


@cache
def _violated_on_purpose() -> frozenset[str]:
    return frozenset(words for scenario in _INCLUDED.values() for words in violations(scenario))


def _register_brought(brought: Any) -> None:
    """Register the object of an entry point: a scenario, or a function that registers some."""
    if isinstance(brought, Scenario):
        register_scenario(brought)
    else:
        brought()


_BROUGHT = EntryPoints("lissajous_env.scenarios", "scenarios", _register_brought)
for _name in _INCLUDED:
    register_ids(_name)
for _name in _INCLUDED_SPACES:
    register_ids(_name, is_space=True)
