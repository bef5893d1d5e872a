"""Spaces of scenarios by name, and the scenarios and splits that names such as SPACE-SEED and SPACE:SPLIT denote.

A name begins with that of a space or with the path of its file, and continues with a part, after `-` or `:` for a name
and after `:` for a file: SEED or SHIFT-SEED is a scenario, SPLIT a split or a shift, and SPLIT:COUNT its first ones.
"""

import itertools
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from lissajous_env.parameters.registry import NAMES, SCENARIOS, SPACES, is_notebook, register, register_ids
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import (
    OF_SPACE,
    SUFFIX,
    check_keys,
    included_scenarios,
    is_file,
    name_in_file,
    read_toml,
)
from lissajous_env.parameters.space import ScenarioSpace
from lissajous_env.wording import nearest, shown

_INCLUDED = {path.stem: str(path) for path in sorted(Path(__file__).parent.glob(f"*-v*{SUFFIX}"))}
"""Files of the included spaces, by name."""
_OF_FILE = re.compile(rf"(.+?\{SUFFIX}):(.+)")
_SEED = re.compile(r"(?:(.+)-)?(\d+)")
_SCENARIOS, _MOST_SCENARIOS = 32, 10_000
"""Default number of scenarios that represent a split, and its limit."""


def scenario_spaces() -> tuple[str, ...]:
    """Return the names of the included and registered spaces of scenarios."""
    return tuple(dict.fromkeys([*_INCLUDED, *sorted(SPACES)]))


def register_scenario_space(space: ScenarioSpace) -> ScenarioSpace:
    """Register a space, so that commands and environments accept its scenarios as NAME-SEED, and return it.

    Gymnasium and PettingZoo then make environments of the space as `lissajous/NAME-v0`.

    Raises:
        ValueError: the argument is no space, its name is invalid, or a different space has that name. In a notebook, it
            replaces one that was registered before.
    """
    if not isinstance(space, ScenarioSpace):
        raise ValueError(f"space must be a ScenarioSpace to be registered, got {shown(space)}")
    register(SPACES, "space", space, NAMES, _INCLUDED, is_notebook())
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
    space, part = _split(name)
    if space is None or part not in ("", *space.shifts):
        known = scenario_spaces()
        raise ValueError(f"space must be one of {', '.join(known)}, got {shown(name)}{nearest(name, known)}")
    return space.shifted(part) if part else space


def space_and_split(name: Any) -> tuple[ScenarioSpace, str] | None:
    """Return the space and the split, by default `train`, that a name denotes; None for the name of anything else.

    Raises:
        ValueError: the space has no such split or shift.
    """
    if isinstance(name, ScenarioSpace):
        return name, "train"
    if is_file(name) and not os.path.exists(name):
        return None  # a missing scenario
    space, part = _split(name)
    if space is None or _SEED.fullmatch(part):
        return None
    next(space.seeds(part or "train"))
    return space, part or "train"


def scenario_of_space(name: Any) -> Scenario | None:
    """Return the scenario of a space that a name denotes; None for the name of anything else.

    Raises:
        ValueError: a file cannot be read.
    """
    space, part = (None, "") if is_file(name) else _split(name)
    seed = _SEED.fullmatch(part)
    if space is None or seed is None or (seed[1] and seed[1] not in space.shifts):
        return None
    return (space.shifted(seed[1]) if seed[1] else space).sample(int(seed[2]))


def denotes_part_of_file(name: str) -> bool:
    """Return True for FILE.toml:SEED and FILE.toml:SHIFT-SEED, without reading the file."""
    found = _OF_FILE.fullmatch(name)
    return found is not None and _SEED.fullmatch(found[2]) is not None


def expanded(names: Iterable[str]) -> tuple[str, ...]:
    """Return names of scenarios, with SPACE:SPLIT, or SPACE:SPLIT:COUNT, replaced by the first scenarios of the split.

    SPACE is a name of `scenario_spaces()` or a TOML file, SPLIT is a split or a shift; COUNT is 32 by default.

    Raises:
        ValueError: there is no such space or split.
    """
    single: list[str] = []
    for name in names:
        space, part = _split(name) if ":" in name else (None, "")
        split, _, count = part.partition(":")
        if space is None or _SEED.fullmatch(split):
            single.append(name)
            continue
        if count and not 1 <= (int(count) if count.isdecimal() else 0) <= _MOST_SCENARIOS:
            raise ValueError(f"{name} must end in a number from 1 to {_MOST_SCENARIOS}, got {count!r}")
        start = name[: -len(part)] if _OF_FILE.fullmatch(name) else f"{space.name}-"
        start += f"{split}-" if split in space.shifts else ""
        single += [f"{start}{seed}" for seed in itertools.islice(space.seeds(split), int(count or _SCENARIOS))]
    return tuple(single)


def _split(name: Any) -> tuple[ScenarioSpace | None, str]:
    """Return the space with which a name begins and the part that follows; no space for the name of anything else."""
    text = os.fspath(name) if isinstance(name, (str, os.PathLike)) else ""
    path, part = found.groups() if (found := _OF_FILE.fullmatch(text)) else (text, "")
    if is_file(path):
        return _in_file(path), part
    known = [space for space in scenario_spaces() if re.match(rf"{re.escape(space)}([-:]|$)", text)]
    if not known:
        return None, ""
    space = max(known, key=len)
    if space not in SPACES:
        SPACES[space] = _in_file(_INCLUDED[space])
    return SPACES[space], text[len(space) + 1 :]


def _in_file(path: str) -> Any:
    """Return the space in a file; None for the file of a scenario."""
    table = read_toml(path)
    if "draw" not in table:
        return None
    try:
        check_keys(table, OF_SPACE)
        bases, base = included_scenarios() | SCENARIOS, table.get("base")
        if base is not None and base not in bases:
            raise ValueError(f"base must be the name of a scenario, got {shown(base)}{nearest(base, bases)}")
        start = Scenario() if base is None else bases[base]
        rules, shifts, words = table.get("require", ()), table.get("shift", {}), table.get("description", "")
        return ScenarioSpace(name_in_file(table, path), start, table["draw"], rules, shifts, words)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


for _name in _INCLUDED:
    register_ids(_name, is_space=True)
