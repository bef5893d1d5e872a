"""Scenarios and spaces of scenarios by name, TOML file or `module:attribute`, with any field overridden.

What begins with the name of a space or with the path of its file continues with a part, after `-` or `:` for a name and
after `:` for a file: SEED or SHIFT-SEED is a scenario, SPLIT a split or a shift, and SPLIT:COUNT its first scenarios.
"""

import itertools
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import pettingzoo

from lissajous_env import plugins
from lissajous_env.parameters.assumptions import violations, warn_of_violations
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import (
    NAMES,
    SUFFIX,
    included_scenarios,
    overridden,
    read_toml,
    scenario_of_table,
)
from lissajous_env.parameters.space import ScenarioSpace, space_of_table
from lissajous_env.plugins import Registry
from lissajous_env.settings.checks import whole_number
from lissajous_env.settings.task import MOST_STEPS
from lissajous_env.wording import nearest, require, shown, where_raised

_INCLUDED = included_scenarios()
_INCLUDED_SPACES = {path.stem: str(path) for path in sorted(Path(__file__).parent.glob(f"*-v*{SUFFIX}"))}
"""Files of the included spaces, by name."""
_FILE = re.compile(rf"(.*?\{SUFFIX})(?::(.+))?", re.IGNORECASE | re.DOTALL)
"""Path of a file, which need not exist, and perhaps a part of a space after a colon."""
_SEED = re.compile(r"(?:(.+)-)?(\d+)")
"""Perhaps a shift, and a seed."""
_FIRST, _MOST = 32, 10_000
"""Default number of scenarios that represent a split, and its limit."""
_violated_beside_policies: set[str] = set()
"""Violated assumptions of scenarios in folders of policies, which matter only if a policy uses the formation."""
_POLICY_FILE = "policy.toml"
"""Name of the file with the policy in such a folder."""
ENTRIES = Registry(
    "scenario",
    NAMES,
    lambda entry: isinstance(entry, str) or entry.name in (*_INCLUDED, *_INCLUDED_SPACES),
    "lissajous_env.scenarios",
    lambda entry: entry() if callable(entry) else register_scenario(entry),
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
    beside_file = os.path.join(os.path.dirname(_text(name)), _POLICY_FILE)
    if _FILE.fullmatch(_text(name)) and os.path.isfile(beside_file):
        _violated_beside_policies.update(violations(variant))
    elif overrides or name not in _INCLUDED:
        warn_of_violations(variant, _violated_beside_policies)
    return variant


def build(name: str | os.PathLike | Scenario, /, **overrides: Any) -> Scenario:
    """Make a scenario like `scenario`, without warnings, for callers that report violated assumptions themselves."""
    base = name if isinstance(name, Scenario) else _named(name)
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


def _text(name: Any) -> str:
    return os.fspath(name) if isinstance(name, (str, os.PathLike)) else ""


class Reference(NamedTuple):
    """Meaning of a name: a scenario, a space, or a part of a space; neither for an unknown name."""

    scenario: Scenario | None = None
    space: ScenarioSpace | None = None
    split: str = ""
    """Split or shift of the space; empty for the space itself."""
    count: str = ""
    """Number of scenarios of the split, as it was written; empty for none."""
    start: str = ""
    """Beginning of the names of scenarios of the space, such as `watch-v1-` and `lab.toml:`."""

    @classmethod
    def parse(cls, name: Any) -> "Reference":
        """Return the meaning of a registered name, of a file, or of a part of a space, as this module describes them.

        Raises:
            ValueError: the name begins with that of a file that cannot be read, or the seed is not valid.
        """
        text = _text(name)
        if match := _FILE.fullmatch(text):
            begin, part, mark, entry = match[1], match[2] or "", ":", _in_file(match[1])
        else:
            if ":" not in text and text not in ENTRIES:
                ENTRIES.load()  # scenarios of other packages, at last
            spaces = [known for known, entry in ENTRIES.items() if not isinstance(entry, Scenario)]
            begins = [known for known in spaces if text.startswith((f"{known}-", f"{known}:"))]
            begin = text if text in ENTRIES else max(begins, key=len, default="")
            if isinstance(entry := ENTRIES.get(begin), str):
                entry = ENTRIES[begin] = _in_file(entry)
            part, mark = text[len(begin) + 1 :], "-"
        if not isinstance(entry, ScenarioSpace):
            return cls() if part else cls(entry)
        seed = _SEED.fullmatch(part)
        if seed and (not seed[1] or seed[1] in entry.shifts):
            return cls((entry.shifted(seed[1]) if seed[1] else entry).sample(int(seed[2])))
        split, _, count = part.partition(":")
        return cls(None, entry, split, count, f"{begin}{mark}")

    def first(self, count: int) -> list[str]:
        """Return the names of the first scenarios of the split, by default `train`, or of the shift of the space.

        Raises:
            ValueError: the space has no such split or shift.
        """
        assert self.space is not None
        start = f"{self.start}{self.split}-" if self.split in self.space.shifts else self.start
        return [f"{start}{seed}" for seed in itertools.islice(self.space.seeds(self.split or "train"), count)]


def denotes_scenario(name: str) -> bool:
    """Return True for a registered name, also SPACE-SEED, and for FILE.toml and FILE.toml:SEED, which are not read."""
    if match := _FILE.fullmatch(name):
        return not match[2] or _SEED.fullmatch(match[2]) is not None
    return Reference.parse(name).scenario is not None


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
    _, space, split, count, _ = Reference.parse(name)
    known = scenario_spaces()
    if space is None or count or split not in ("", *space.shifts):
        raise ValueError(f"space must be one of {', '.join(known)}, got {shown(name)}{nearest(name, known)}")
    return space.shifted(split) if split else space


def space_and_split(name: Any) -> tuple[ScenarioSpace, str] | None:
    """Return the space and the split, by default `train`, that a name denotes; None for the name of anything else.

    Raises:
        ValueError: the space has no such split or shift.
    """
    if isinstance(name, ScenarioSpace):
        return name, "train"
    reference = Reference.parse(name)
    if reference.space is None:
        return None
    rule = "must be one scenario or a space, because only commands that play several take SPACE:SPLIT:COUNT"
    require(not reference.count, "scenario", rule, name)
    reference.first(1)
    return reference.space, reference.split or "train"


def expanded(names: Iterable[str]) -> tuple[str, ...]:
    """Return names of scenarios, with SPACE:SPLIT, or SPACE:SPLIT:COUNT, replaced by the first scenarios of the split.

    SPACE is a name of `scenario_spaces()` or a TOML file, SPLIT is a split or a shift; COUNT is 32 by default.

    Raises:
        ValueError: there is no such space or split.
    """
    single: list[str] = []
    for name in names:
        reference = Reference.parse(name) if ":" in name else Reference()
        count = reference.count or str(_FIRST)
        if not 1 <= (int(count) if count.isdecimal() else 0) <= _MOST:
            raise ValueError(f"{name} must end in a number from 1 to {_MOST}, got {count!r}")
        single += [name] if reference.space is None else reference.first(int(count))
    return tuple(single)


def _in_file(path: str) -> Scenario | ScenarioSpace:
    """Return the scenario or the space of a file; its default name is that of the file, not that of its base."""
    table = read_toml(path)
    hint = "" if "name" in table else '; the file may contain another name, as in name = "lab"'
    name = table.setdefault("name", os.path.basename(path)[: -len(SUFFIX)])
    try:
        if isinstance(name, str) and not re.fullmatch(NAMES[0], name):
            raise ValueError(f"name of a scenario must be {NAMES[1]}, got {shown(name)}{hint}")
        return (space_of_table if "draw" in table else scenario_of_table)(table, _registered)
    except ValueError as error:
        raise type(error)(f"{path}: {error}") from error


def _registered(name: str) -> Scenario:
    """Return the scenario of a registered name, such as the base in a file, which causes no import and no reading."""
    is_elsewhere = ":" in name or _FILE.fullmatch(name) is not None
    require(not is_elsewhere, "base", "must be the name of a scenario, not of a file or a module", name)
    reference = Reference.parse(name)
    if reference.scenario is None and reference.space is None:
        raise ENTRIES.unknown(name, "scenarios", scenarios())
    return _named(name)


def _named(name: Any) -> Scenario:
    """Return the scenario of a name; the error for an unknown one suggests scenarios and files, or parts of them."""
    reference, text = Reference.parse(name), _text(name)
    if reference.space is not None:
        space_and_split(name)  # raises for an unknown split
        rule = f"scenario must be one scenario (commands that play several accept SPACE:SPLIT), got the space {text}"
        raise ValueError(f"{rule}; choose one of its scenarios, as {reference.first(1)[0]}")
    if reference.scenario is None and ":" not in text:
        beside = {f"{Path(file).stem}-": file for file in plugins.files_beside(name, SUFFIX)}
        parts = [f"{file}:{text.removeprefix(begin)}" for begin, file in beside.items() if text.startswith(begin)]
        raise ENTRIES.unknown(text or name, "scenarios", scenarios(), [*beside.values(), *parts])
    return reference.scenario or _imported(text)


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
