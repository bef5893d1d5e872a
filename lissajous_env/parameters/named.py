"""Make scenarios from a name, a TOML file or `module:attribute`, with any field overridden."""

import dataclasses
import itertools
import os
import re
import warnings
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from lissajous_env import here
from lissajous_env.by_value import is_called_at_prompt
from lissajous_env.parameters.assumptions import AssumptionWarning, violations
from lissajous_env.parameters.ids import add_name, register_ids
from lissajous_env.parameters.overriding import overridden
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import SUFFIX, is_space_file, read_scenario_file, read_space_file
from lissajous_env.parameters.shipped import SHIPPED
from lissajous_env.parameters.space import ScenarioSpace
from lissajous_env.plugins import EntryPoints, import_attribute
from lissajous_env.settings.checks import whole_number
from lissajous_env.wording import nearest, shown, where_raised

_SHIPPED = {each.name: each for each in SHIPPED}
_REGISTERED: dict[str, Scenario] = {}
"""Scenarios of users and of other packages, by name."""
_SPACES: dict[str, ScenarioSpace] = {}
"""Spaces of scenarios by name: those of users, and those of the package that were used."""
_SHIPPED_SPACES = {"monitoring-v1": str(Path(__file__).with_name("monitoring-v1.toml"))}
"""Files of the included spaces, by name."""
_SAMPLED = re.compile(rf"(.+\{SUFFIX}):(?:(.+)-)?(\d+)")
"""FILE.toml:SEED or FILE.toml:SHIFT-SEED, a scenario of the space in a file."""
_reported: set[str] = set()
"""Violated assumptions about which this process has already warned."""
_unused: set[str] = set()
"""Violated assumptions of scenarios in folders of policies, which matter only if a policy uses the formation."""
_POLICY = "policy.toml"
"""Name of the file with the policy in such a folder."""

_MOST_STEPS = 2**20
"""Limit on the steps of an episode."""
_SCENARIOS, _MOST_SCENARIOS = 32, 10_000
"""Default number of scenarios that represent a split, and its limit."""


def scenarios() -> tuple[str, ...]:
    """Return the names of the included scenarios, then those of the registered ones in alphabetical order."""
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
    warn_of_violations(made)
    if add_name("scenario", made, _REGISTERED, _SHIPPED, is_called_at_prompt()):
        register_ids(made.name)
    return made


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
    elif overrides or name not in _SHIPPED:
        warn_of_violations(made, _unused)
    return made


def scenario_spaces() -> tuple[str, ...]:
    """Return the names of the included and registered spaces of scenarios."""
    return tuple(dict.fromkeys([*_SHIPPED_SPACES, *sorted(_SPACES)]))


def register_scenario_space(space: ScenarioSpace) -> ScenarioSpace:
    """Register a space, so that commands and environments accept its scenarios as NAME-SEED, and return it.

    Gymnasium and PettingZoo then make environments of the space as `lissajous/NAME-v0`.

    Raises:
        ValueError: the argument is no space, its name is invalid, or a different space has that name.
    """
    if not isinstance(space, ScenarioSpace):
        raise ValueError(f"space must be a ScenarioSpace to be registered, got {shown(space)}")
    _check_name(space.name)
    if add_name("space", space, _SPACES, _SHIPPED_SPACES, is_called_at_prompt()):
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
    given = os.fspath(name) if isinstance(name, os.PathLike) else name
    if is_scenario_file(given):
        return _space_of_file(given)
    if (found := _known_space(given)) is None:
        hint = nearest(given, scenario_spaces())
        raise ValueError(f"space must be one of {', '.join(scenario_spaces())}, got {shown(given)}{hint}")
    return found


def is_space(name: Any) -> bool:
    """Return True for the name of a space of scenarios, and for a TOML file of one.

    Raises:
        ValueError: a TOML file cannot be read.
    """
    if isinstance(name, os.PathLike):
        name = os.fspath(name)
    return is_space_file(name) if is_scenario_file(name) else _known_space(name) is not None


def space_and_split(name: Any) -> tuple[ScenarioSpace, str] | None:
    """Return the space and the split that SPACE or SPACE:SPLIT denotes, or None for anything else.

    SPACE is as for `scenario_space`, SPLIT is a split or a shift, by default `train`.

    Raises:
        ValueError: the space has no such split or shift.
    """
    if isinstance(name, ScenarioSpace):
        return name, "train"
    given = os.fspath(name) if isinstance(name, os.PathLike) else name
    space, colon, split = given.partition(":") if isinstance(given, str) else ("", "", "")
    is_missing = is_scenario_file(space) and not os.path.exists(space)
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
    found: list[str] = []
    for name in names:
        space, colon, rest = name.partition(":")
        split, _, count = rest.partition(":")
        is_file = is_scenario_file(space)
        if not colon or re.fullmatch(r"(.+-)?\d+", rest) or not (is_file or _known_space(space)):
            found.append(name)
            continue
        if count and not 1 <= (int(count) if count.isdecimal() else 0) <= _MOST_SCENARIOS:
            raise ValueError(f"{space}:{split} must be followed by a number from 1 to {_MOST_SCENARIOS}, got {count!r}")
        of = scenario_space(space)
        start = space + (":" if is_file else "-") + (f"{split}-" if split in of.shifts else "")
        found += [f"{start}{seed}" for seed in itertools.islice(of.seeds(split), int(count or _SCENARIOS))]
    return tuple(found)


def build(name: str | os.PathLike | Scenario, /, **overrides: Any) -> Scenario:
    """Make a scenario like `scenario`, without warnings, for callers that report violated assumptions themselves."""
    made = name if isinstance(name, Scenario) else _found(name)
    return overridden(made, overrides) if overrides else made


def registered_scenario(name: Any) -> Scenario:
    """Return the scenario of a name without loading a file or module, as is safe for names read from files.

    Raises:
        ValueError: there is no such scenario; the message suggests the closest match.
    """
    if isinstance(name, str):
        if name not in _SHIPPED and name not in _REGISTERED:
            _BROUGHT.load()
        if made := _SHIPPED.get(name) or _REGISTERED.get(name) or _of_space(name):
            return made
    raise unknown_scenario(name)


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


def _is_known(name: str) -> bool:
    # Scenarios of other packages are loaded last, for names that are in neither table.
    return name in _SHIPPED or name in _REGISTERED or name in scenarios() or _of_space(name) is not None


def meant_here(name: Any) -> list[str]:
    """Return candidates for a mistyped scenario: files beside it, and scenarios that modules here register."""
    return [*here.beside(name, SUFFIX), *(each for each, _ in here.registered_here("register_scenario"))]


def is_scenario_file(name: Any) -> bool:
    """Return True if a scenario is given as the path of a file."""
    return isinstance(name, str) and name.lower().endswith(SUFFIX)


def _is_of_policy(name: Any) -> bool:
    """Return whether a scenario is given as the file in the folder of a policy."""
    given = os.fspath(name) if isinstance(name, os.PathLike) else name
    return is_scenario_file(given) and os.path.isfile(os.path.join(os.path.dirname(given), _POLICY))


def denotes_scenario(name: str) -> bool:
    """Return True for a registered name, also SPACE-SEED, for the path of a file, and for FILE.toml:SEED."""
    return _is_known(name) or is_scenario_file(name) or _SAMPLED.fullmatch(name) is not None


def with_cycles(made: Scenario, max_cycles: int | None) -> Scenario:
    """Return a scenario whose episodes last `max_cycles` steps instead of `task.duration`; None changes nothing.

    Raises:
        ValueError: not a whole number from 1 to 2^20.
    """
    if max_cycles is None:
        return made
    steps = whole_number("max_cycles", max_cycles, 1, _MOST_STEPS)
    return build(made, **{"task.duration": steps * made.task.step})


def warn_of_violations(made: Scenario, allowed: Iterable[str] = ()) -> None:
    """Warn about violated assumptions that are new in this process, not allowed, and in no included scenario."""
    known = {*_reported, *allowed, *_violated_on_purpose()}
    if new := [words for words in violations(made) if words not in known]:
        _reported.update(new)
        warnings.warn(f"scenario {made.name}: {'; '.join(new)}", AssumptionWarning, stacklevel=3)


@cache
def _violated_on_purpose() -> frozenset[str]:
    return frozenset(words for each in SHIPPED for words in violations(each))


def _found(name: Any) -> Scenario:
    given = os.fspath(name) if isinstance(name, os.PathLike) else name
    if is_scenario_file(given):
        if is_space_file(given):
            raise ValueError(
                f"scenario must be a single scenario, got the space {given}; choose one of its scenarios, as {given}:0"
            )
        return _of_file(given)
    if isinstance(given, str) and (part := _SAMPLED.fullmatch(given)):
        space = scenario_space(part[1])
        return (space.shifted(part[2]) if part[2] else space).sample(int(part[3]))
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
    given_in_file = "name" in given
    words |= {key: given.pop(key) for key in words if key in given}
    try:
        base = registered_scenario(given.pop("base")) if "base" in given else Scenario()
        _check_name_of_file(words["name"], given_in_file)
        return dataclasses.replace(overridden(base, given), **words)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _of_space(name: str) -> Scenario | None:
    """Return the scenario SPACE-SEED of an included or registered space; None if the name has another form."""
    space, _, seed = name.rpartition("-")
    found = _known_space(space) if seed.isdecimal() else None
    return None if found is None else found.sample(int(seed))


def _known_space(name: Any) -> ScenarioSpace | None:
    """Return the included or registered space NAME, or SPACE-SHIFT; None if there is none."""
    if name in _SHIPPED_SPACES and name not in _SPACES:
        _SPACES[name] = _space_of_file(_SHIPPED_SPACES[name])
    if name in _SPACES or not isinstance(name, str):
        return _SPACES.get(name)
    space, _, shift = name.rpartition("-")
    found = _known_space(space) if space else None
    return found.shifted(shift) if found is not None and shift in found.shifts else None


def _space_of_file(path: str) -> ScenarioSpace:
    given = read_space_file(path)
    name, base = given.get("name", os.path.basename(path)[: -len(SUFFIX)]), given.get("base")
    try:
        _check_name_of_file(name, "name" in given)
        made = Scenario() if base is None else registered_scenario(base)
        rules, shifts, words = given.get("require", ()), given.get("shift", {}), given.get("description", "")
        return ScenarioSpace(name, made, given.get("draw", {}), rules, shifts, words)
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


def _check_name_of_file(name: str, is_given: bool) -> None:
    """Raise ValueError for an invalid name, which is that of the file unless it is given there."""
    try:
        _check_name(name)
    except ValueError as error:
        hint = "" if is_given else '; the file may contain another name, as in name = "lab"'
        raise ValueError(f"{error}{hint}") from None


def _check_name(name: str) -> None:
    """Raise ValueError for a name that is invalid in an id, or that denotes a file or a module."""
    if not re.fullmatch(r"\w[\w.-]{0,98}", name) or is_scenario_file(name):
        rule = f"must be a word of letters, digits, _, - and . that does not end in {SUFFIX}"
        raise ValueError(f"name of a scenario {rule}, got {shown(name)}")
