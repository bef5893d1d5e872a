"""Scenarios and spaces of scenarios by name, TOML file or `module:attribute`, with any field overridden.

What begins with the name of a space or with the path of its file continues with a part, after `-` or `:` for a name and
after `:` for a file: SEED or SHIFT-SEED is a scenario, SPLIT a split or a shift, and SPLIT:COUNT its first ones.
"""

import itertools
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import gymnasium
import pettingzoo

from lissajous_env import plugins
from lissajous_env.parameters.assumptions import violations, warn_of_violations
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import (
    NAMES,
    SUFFIX,
    included_scenarios,
    is_file,
    name_in_file,
    overridden,
    read_toml,
    scenario_of_table,
)
from lissajous_env.parameters.space import ScenarioSpace, space_of_table
from lissajous_env.plugins import Registry
from lissajous_env.settings.checks import whole_number
from lissajous_env.settings.task import MOST_STEPS
from lissajous_env.wording import require, where_raised

_INCLUDED = included_scenarios()
_INCLUDED_SPACES = {path.stem: str(path) for path in sorted(Path(__file__).parent.glob(f"*-v*{SUFFIX}"))}
"""Files of the included spaces, by name."""
_OF_FILE = re.compile(rf"(.+?\{SUFFIX}):(.+)")
_SEED = re.compile(r"(?:(.+)-)?(\d+)")
_FIRST, _MOST = 32, 10_000
"""Default number of scenarios that represent a split, and its limit."""
_unreported: set[str] = set()
"""Violated assumptions of scenarios in folders of policies, which matter only if a policy uses the formation."""
_POLICY_FILE = "policy.toml"
"""Name of the file with the policy in such a folder."""


def _register_entry_point(entry: Any) -> None:
    """Register the object of an entry point: a scenario, a space, or a function that registers some."""
    if isinstance(entry, (Scenario, ScenarioSpace)):
        register_scenario(entry)
    else:
        entry()


ENTRIES = Registry(
    "scenario",
    NAMES,
    lambda entry: isinstance(entry, str) or entry.name in (*_INCLUDED, *_INCLUDED_SPACES),
    "lissajous_env.scenarios",
    _register_entry_point,
)
"""Scenarios and spaces by name; an included space that was not used yet is the path of its file."""
ENTRIES.update(_INCLUDED | _INCLUDED_SPACES)


def scenarios() -> tuple[str, ...]:
    """Return the names of the included scenarios, then those of the registered ones in alphabetical order."""
    names = [name for name, entry in ENTRIES.load().items() if isinstance(entry, Scenario)]
    return (*_INCLUDED, *sorted(set(names) - _INCLUDED.keys()))


def scenario_spaces() -> tuple[str, ...]:
    """Return the names of the included and registered spaces of scenarios."""
    names = [name for name, entry in ENTRIES.load().items() if not isinstance(entry, Scenario)]
    return (*_INCLUDED_SPACES, *sorted(set(names) - _INCLUDED_SPACES.keys()))


def register_scenario(entry: Scenario | ScenarioSpace) -> Scenario | ScenarioSpace:
    """Register a scenario, so that every command and environment accepts its name, and return it.

    Gymnasium and PettingZoo then make it as `lissajous/NAME-v0`. The scenarios of a space that is registered have the
    names NAME-SEED, and environments of the space draw them.

    Raises:
        ValueError: the argument is neither a scenario nor a space, its name is invalid, or a different one has that
            name. In a notebook, it replaces one that was registered before.
    """
    fits = isinstance(entry, (Scenario, ScenarioSpace))
    require(fits, "scenario", "must be a Scenario or a ScenarioSpace to be registered", entry)
    register_ids(ENTRIES.add(entry).name, is_space=isinstance(entry, ScenarioSpace))
    if isinstance(entry, Scenario):
        warn_of_violations(entry)
    return entry


def register_ids(name: str, is_space: bool = False) -> None:
    """Register `lissajous/NAME-v0` with Gymnasium and PettingZoo; environments look up the scenario when made.

    Batches of a space of scenarios are made by Gymnasium itself.
    """
    identifier, settings, module = f"lissajous/{name}-v0", {"scenario": name}, "lissajous_env.envs"
    vector = None if is_space else f"{module}.gymnasium_vector:LissajousVectorEnv"
    if identifier not in gymnasium.registry:
        entry_point = f"{module}.gymnasium_env:LissajousEnv"
        gymnasium.register(identifier, entry_point, kwargs=settings, vector_entry_point=vector)
        pettingzoo.register("parallel", identifier, f"{module}.pettingzoo_env:LissajousParallelEnv", kwargs=settings)
        pettingzoo.register("aec", identifier, f"{module}.pettingzoo_env:env", kwargs=settings)


def scenario(name: str | os.PathLike | Scenario, /, **overrides: Any) -> Scenario:
    """Make a scenario, with any field overridden.

    Args:
        name: A name of `scenarios()`; a TOML file, as `lissajous_env.parameters.scenario_file` describes it;
            `module:attribute`, a `Scenario` or a function without arguments that returns one; a scenario of a space, as
            this module describes it; or a `Scenario`.
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
    variant = build(name, **overrides)
    if is_file(name) and os.path.isfile(os.path.join(os.path.dirname(name), _POLICY_FILE)):  # type: ignore[arg-type]
        _unreported.update(violations(variant))
    elif overrides or name not in _INCLUDED:
        warn_of_violations(variant, _unreported)
    return variant


def build(name: str | os.PathLike | Scenario, /, **overrides: Any) -> Scenario:
    """Make a scenario like `scenario`, without warnings, for callers that report violated assumptions themselves."""
    base = name if isinstance(name, Scenario) else _loaded(os.fspath(name) if isinstance(name, os.PathLike) else name)
    return overridden(base, overrides) if overrides else base


def with_cycles(base: Scenario, max_cycles: int | None) -> Scenario:
    """Return a scenario whose episodes last `max_cycles` steps instead of `task.duration`; None changes nothing.

    Raises:
        ValueError: not a whole number from 1 to 2^20.
    """
    if max_cycles is None:
        return base
    steps = whole_number("max_cycles", max_cycles, 1, MOST_STEPS)
    return build(base, **{"task.duration": steps * base.task.step})


def unknown_scenario(name: Any) -> ValueError:
    """Return the error for an unknown scenario; it suggests the closest match among scenarios and files beside it."""
    if isinstance(name, str) and space_and_split(name) is not None:
        rule = f"scenario must be a single scenario, got the space {name}"
        return ValueError(f"{rule}; choose one of its scenarios, as {name}{':' if is_file(name) else '-'}0")
    return ENTRIES.unknown(name, "scenarios", scenarios(), plugins.beside(name, SUFFIX))


def denotes_scenario(name: str) -> bool:
    """Return True for a registered name, also SPACE-SEED, and for FILE.toml and FILE.toml:SEED, which are not read."""
    part = _OF_FILE.fullmatch(name)
    if is_file(name) or (part is not None and _SEED.fullmatch(part[2])):
        return True
    return isinstance(_denoted(name)[0], Scenario)


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
    space, part = _denoted(name)
    known, is_space = scenario_spaces(), isinstance(space, ScenarioSpace) and part in ("", *space.shifts)
    require(is_space, "space", f"must be one of {', '.join(known)}", name, known)
    return space.shifted(part) if part else space  # type: ignore[union-attr,return-value]


def space_and_split(name: Any) -> tuple[ScenarioSpace, str] | None:
    """Return the space and the split, by default `train`, that a name denotes; None for the name of anything else.

    Raises:
        ValueError: the space has no such split or shift.
    """
    if isinstance(name, ScenarioSpace):
        return name, "train"
    if is_file(name) and not os.path.exists(name):
        return None  # a missing scenario
    space, part = _denoted(name)
    if not isinstance(space, ScenarioSpace):
        return None
    if ":" in part:
        rule = "must be one scenario or a space, because only commands that play several take SPACE:SPLIT:COUNT"
        raise ValueError(f"scenario {rule}; got {name}")
    next(space.seeds(part or "train"))
    return space, part or "train"


def expanded(names: Iterable[str]) -> tuple[str, ...]:
    """Return names of scenarios, with SPACE:SPLIT, or SPACE:SPLIT:COUNT, replaced by the first scenarios of the split.

    SPACE is a name of `scenario_spaces()` or a TOML file, SPLIT is a split or a shift; COUNT is 32 by default.

    Raises:
        ValueError: there is no such space or split.
    """
    single: list[str] = []
    for name in names:
        space, part = _denoted(name) if ":" in name else (None, "")
        split, _, count = part.partition(":")
        if not isinstance(space, ScenarioSpace):
            single.append(name)
            continue
        if count and not 1 <= (int(count) if count.isdecimal() else 0) <= _MOST:
            raise ValueError(f"{name} must end in a number from 1 to {_MOST}, got {count!r}")
        start = name[: -len(part)] if _OF_FILE.fullmatch(name) else f"{space.name}-"
        start += f"{split}-" if split in space.shifts else ""
        single += [f"{start}{seed}" for seed in itertools.islice(space.seeds(split), int(count or _FIRST))]
    return tuple(single)


def _denoted(name: Any) -> tuple[Scenario | ScenarioSpace | None, str]:
    """Return the scenario that a name denotes; or a space and the rest of the name, such as `test:2`; or None.

    Raises:
        ValueError: the name begins with that of a file that cannot be read.
    """
    text = os.fspath(name) if isinstance(name, (str, os.PathLike)) else ""
    path, part = match.groups() if (match := _OF_FILE.fullmatch(text)) else (text, "")
    if is_file(path):
        entry = _in_file(path)
    else:
        if ":" not in text and text not in ENTRIES:
            ENTRIES.load()  # scenarios of other packages, at last
        spaces = [known for known, entry in ENTRIES.items() if not isinstance(entry, Scenario)]
        begins = [known for known in spaces if text.startswith((f"{known}-", f"{known}:"))]
        known = text if text in ENTRIES else max(begins, key=len, default="")
        if isinstance(entry := ENTRIES.get(known), str):
            entry = ENTRIES[known] = _in_file(entry)
        part = text[len(known) + 1 :]
    seed = _SEED.fullmatch(part)
    if isinstance(entry, ScenarioSpace) and seed and (not seed[1] or seed[1] in entry.shifts):
        return (entry.shifted(seed[1]) if seed[1] else entry).sample(int(seed[2])), ""
    return (entry, part) if isinstance(entry, ScenarioSpace) or not part else (None, "")


def _in_file(path: str) -> Scenario | ScenarioSpace:
    """Return the scenario or the space of a file; its default name is that of the file, not that of its base."""
    table = read_toml(path)
    try:
        table["name"] = name_in_file(table, path)
        make = space_of_table if "draw" in table else scenario_of_table
        return make(table, _registered)
    except ValueError as error:
        raise type(error)(f"{path}: {error}") from error


def _registered(name: str) -> Scenario:
    """Return the scenario of a registered name, such as the base in a file, which causes no import and no reading."""
    entry = None if ":" in name or is_file(name) else _denoted(name)[0]
    if isinstance(entry, Scenario):
        return entry
    raise ENTRIES.unknown(name, "scenarios", scenarios())


def _loaded(name: Any) -> Scenario:
    entry = _denoted(name)[0]
    if isinstance(entry, Scenario):
        return entry
    if entry is None and isinstance(name, str) and ":" in name:
        return _imported(name)
    raise unknown_scenario(name)


def _imported(reference: str) -> Scenario:
    attribute: Any = plugins.import_attribute(reference, "scenario must be module:attribute")
    called, rule = f"scenario {reference}", "must be a Scenario, or a function without arguments that returns one"
    if callable(attribute):
        try:
            attribute = attribute()
        except (Exception, SystemExit) as error:
            raise ValueError(f"{called} {rule}, got {where_raised(error)}") from error
    require(isinstance(attribute, Scenario), called, rule, attribute)
    return attribute


for _name in (*_INCLUDED, *_INCLUDED_SPACES):
    register_ids(_name, is_space=_name in _INCLUDED_SPACES)
