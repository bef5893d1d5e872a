"""Distributions of scenarios, and sequences of draws: fields are expressions of a seed, splits share no scenario."""

import bisect
import functools
import hashlib
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

from lissajous_env.parameters.scenario import PARTS, Scenario
from lissajous_env.parameters.scenario_file import FIELDS, TEXTS, by_field, check_keys, overridden
from lissajous_env.settings.checks import LAST_SEED, is_number, whole_number
from lissajous_env.settings.formulas import Formula, Names
from lissajous_env.wording import require

SPLITS = {"train": 0.8, "validation": 0.1, "test": 0.1}
"""Share of the seeds that belong to each split."""
_OF_SPACE = {**TEXTS, "require": list, "draw": dict, "shift": dict}
"""Kinds of the values of a space's file."""
_SCALE = "length", "time"
_MOST_TRIES = 1000
"""Limit on the draws for one scenario that rules reject."""
_MOST_DRAWS = 10_000
"""Limit on the draws for the next scenario of a group that fits."""
_BELOW_1 = math.nextafter(1.0, 0.0)
"""Largest number below 1, to which one that rounds to 1 is reduced."""
_RANDOM = "uniform", "log_uniform", "whole", "choice"
"""Random functions of an expression."""


def _random(function: str, at: float, *arguments: Any) -> Any:
    """Return the value of a random function for a number in [0, 1) and its arguments."""
    if function == "choice":
        return arguments[int(at * len(arguments))]
    low, high = arguments
    if low > high:
        raise ValueError(f"a range from {low:g} to {high:g}; the lower end comes first")
    if function == "log_uniform" and low <= 0:
        raise ValueError(f"a range from {low:g} for log_uniform, whose ends must be above 0")
    if function == "uniform":
        return low + (high - low) * at
    return low * (high / low) ** at if function == "log_uniform" else range(low, high + 1)[int(at * (high - low + 1))]


def _by_share(values: Sequence[Any], shares: Iterable[float], at: float) -> Any:
    """Return the value at a number in [0, 1), in which each has its share of the sum of all shares."""
    ends = list(itertools.accumulate(shares))
    return values[bisect.bisect(ends, at * ends[-1])]


@dataclass(frozen=True)
class ScenarioSpace:
    """A distribution of scenarios, reproducible by seed.

    Each seed belongs to one split, `train`, `validation` or `test`, by a hash of the space's name and the seed, so that
    no scenario of a split is in another. A *shift* is a space that differs from this one in some draws, for tests
    outside of the range of the training; it has the name `SPACE-SHIFT`.

    A value depends on the name of the space, the seed and the name of its field alone: a draw that is added changes no
    other value.

    Args:
        name: Name, the start of the names of its scenarios: `NAME-SEED`.
        base: Scenario with the fields that are not drawn.
        draw: For each part of a scenario, a mapping from fields to their draws. A draw that is text is an expression,
            as `lissajous_env.settings.formulas.Formula` describes it, such as
            `"log_uniform(0.8, 3.2) * curve.half_width"`, with one of these functions at most: `uniform(low, high)`;
            `log_uniform(low, high)`, whose logarithm is uniform; `whole(low, high)`, a whole number, both ends
            included; and `choice(...)` of values. Any other draw is a value, which is used unchanged.

            Under the key `choices`, a part itself has a list of mappings, of which one is drawn: values of fields that
            belong together, with `weights` not all equally often; a field's own draw replaces them. `variables` are
            numbers for expressions. `scale` may draw `length` and `time`, by which `Scenario.scaled` finally multiplies
            all lengths and times. Expressions can use every other value that is drawn, in any order, and fields of the
            base, but not their properties.
        require: Formulas of fields and properties of the scenario, such as `"sensing_radius < curve.half_height"`; a
            scenario for which one is False is drawn anew.
        shifts: For each shift, the draws that differ, in the form of `draw`.
        description: A sentence for readers.
        given: Fields that have values instead of being drawn; see `overridden`.

    Raises:
        ValueError: a draw or rule is invalid, or the scenario of seed 0 cannot be drawn.
    """

    name: str
    base: Scenario
    draw: Mapping[str, Mapping[str, Any]]
    require: tuple[str, ...] = ()
    shifts: Mapping[str, Mapping[str, Mapping[str, Any]]] = field(default_factory=dict)
    description: str = ""
    given: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require(isinstance(self.base, Scenario), "base of a space", "must be a Scenario", self.base)
        require(isinstance(self.require, (list, tuple)), "require", "must be a list of formulas", self.require)
        object.__setattr__(self, "require", tuple(self.require))
        _check_draws("draw", self.draw)
        require(isinstance(self.shifts, Mapping), "shifts", "must be a mapping from names to draws", self.shifts)
        for shift, draw in self.shifts.items():
            is_new = isinstance(shift, str) and shift not in SPLITS and not shift.isdecimal()
            require(is_new, "name of a shift", "must be text, and neither that of a split nor a number", shift)
            _check_draws(f"shift.{shift}", draw)
            if not self.given:  # a given value may violate the rules in a shift that is not used
                self.shifted(shift)
        self.sample(0)

    def sample(self, seed: int) -> Scenario:
        """Return the scenario of a seed.

        Raises:
            ValueError: the seed is not a whole number from 0 to 2^31 - 1, the drawn scenario is not valid, or a
                thousand draws violate a rule of `require`.
        """
        seed = whole_number("seed", seed, 0, LAST_SEED)
        violated: list[str] = []
        for attempt in range(_MOST_TRIES):
            scenario = self._drawn(seed, attempt)
            broken = next((rule.text for rule in self._rules if not rule(functools.partial(_property, scenario))), None)
            if broken is None:
                return scenario
            violated.append(broken)
        most = max(dict.fromkeys(violated), key=violated.count)
        rule = f"must be met by one of {_MOST_TRIES} draws"
        raise ValueError(f"require {rule} for seed {seed} of {self.name}, got none; most often violated: {most}")

    def split_of(self, seed: int) -> str:
        """Return the split to which a seed belongs: `train`, `validation` or `test`."""
        return _by_share(list(SPLITS), SPLITS.values(), self._uniform("split", seed))

    def seeds(self, split: str) -> Iterator[int]:
        """Return an iterator over the seeds of a split in ascending order; all seeds for a shift.

        Raises:
            ValueError: there is neither a split nor a shift of this name.
        """
        if split in self.shifts:
            return iter(range(LAST_SEED + 1))
        known = [*SPLITS, *self.shifts]
        require(split in known, "split", f"must be one of {', '.join(known)}", split, known)
        return (seed for seed in range(LAST_SEED + 1) if self.split_of(seed) == split)

    def scenarios(self, split: str) -> Iterator[Scenario]:
        """Return an iterator over the scenarios of a split, or of a shift, always in the same order.

        Raises:
            ValueError: there is neither a split nor a shift of this name.
        """
        space = self.shifted(split) if split in self.shifts else self
        return map(space.sample, self.seeds(split))

    def shifted(self, shift: str) -> "ScenarioSpace":
        """Return the space of a shift.

        Raises:
            ValueError: there is no such shift, or its draws are invalid.
        """
        rule = f"must be one of {', '.join(self.shifts) or 'none'}"
        require(shift in self.shifts, "shift", rule, shift, self.shifts)
        draw = {part: dict(given) for part, given in self.draw.items()}
        for part, other in self.shifts[shift].items():
            draw[part] = draw.get(part, {}) | dict(other)
        return replace(self, name=f"{self.name}-{shift}", draw=draw, shifts={})

    def overridden(self, overrides: Mapping[str, Any]) -> "ScenarioSpace":
        """Return the space in which fields have given values instead of being drawn, in its shifts too.

        All other fields of a seed's scenario remain as they are, unless they follow from a given one by an expression.
        Values are in the units in which the space is written, before `scale` multiplies lengths and times.

        Args:
            overrides: Fields by dotted or nested name, as for `lissajous_env.scenario`.

        Raises:
            UnknownSettingError: an unknown field.
            ValueError: the scenario of seed 0 cannot be drawn with these values.
        """
        return replace(self, given={**self.given, **by_field(overrides)}) if overrides else self

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields alone: what is compiled from them cannot be pickled."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}

    @functools.cached_property
    def _rules(self) -> tuple[Formula, ...]:
        return tuple(map(Formula, self.require))

    @functools.cached_property
    def _draws(self) -> dict[str, Any]:
        """Draws by dotted name, as values or functions of other values; `PART.choices` draws several fields."""
        draws, known = {}, [*PARTS, "variables", "scale"]
        for part, entries in self.draw.items():
            require(part in known, "draw", f"must name one of {', '.join(known)}", part, known)
            for name, entry in entries.items():
                require(part != "scale" or name in _SCALE, "draw.scale", "must contain length or time", name)
                dotted = f"{part}.{name}"
                if name == "weights":
                    require("choices" in entries, f"draw.{dotted}", "must be given with choices", entry)
                elif name == "choices":
                    draws[dotted] = _choice(f"draw.{part}", entry, entries.get("weights"))
                elif isinstance(entry, str):
                    draws[dotted] = draw = Formula(entry, _RANDOM)  # all random functions in it are of one number
                    rule = f"must call at most one of {', '.join(_RANDOM)}"
                    require(len(draw.called) <= 1, f"draw.{dotted}", rule, entry)
                else:
                    draws[dotted] = entry
        return draws

    def _drawn(self, seed: int, attempt: int) -> Scenario:
        begun: list[str] = []

        @functools.cache
        def value_of(name: str) -> Any:
            if name in begun:
                raise ValueError(f"{name}, which depends on itself")
            begun.append(name)
            draw = self._draws[name]
            return draw(functools.partial(look_up, name)) if callable(draw) else draw

        def look_up(drawn: str, name: str) -> Any:
            """Return the value of a name in the draw of the field `drawn`, which alone determines random numbers."""
            if name in _RANDOM:
                return functools.partial(_random, name, self._uniform(f"{attempt}/{drawn}", seed))
            if name in self.given:
                return self.given[name]
            for known in (name, f"variables.{name}"):
                if known in self._draws:
                    return value_of(known)
            part, _, field_name = name.partition(".")
            choice = value_of(f"{part}.choices") if f"{part}.choices" in self._draws else {}
            if field_name in choice:
                return choice[field_name]
            if name not in FIELDS:  # what follows from fields of the base would not follow from drawn ones
                raise ValueError(f"{name}, which is neither a field nor a variable")
            return _property(self.base, name)

        changed: dict[str, Any] = {}
        try:
            for name in sorted(self._draws, key=lambda draw: not draw.endswith(".choices")):
                part, _, field_name = name.partition(".")
                if part in PARTS:
                    chosen = value_of(name) if field_name == "choices" else {field_name: value_of(name)}
                    changed |= {f"{part}.{key}": value for key, value in chosen.items()}
            changed.update(self.given)
            scale = {name: value_of(f"scale.{name}") for name in _SCALE if f"scale.{name}" in self._draws}
            scenario = overridden(self.base, changed).scaled(**scale)
        except ValueError as error:
            raise type(error)(f"seed {seed} of {self.name}: {error}") from error
        return replace(scenario, name=f"{self.name}-{seed}", description=f"Scenario {seed} of {self.name}.")

    def _uniform(self, what: str, seed: int) -> float:
        """Return a number in [0, 1) that depends on the space's name, the seed and the purpose alone."""
        return min(_hashed(f"{self.name}/{seed}/{what}") / 2**64, _BELOW_1)


def _hashed(text: str) -> int:
    """Return a whole number below 2^64 that depends on a text alone."""
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8])


def _property(scenario: Scenario, dotted: str) -> Any:
    """Return a number of a scenario by its dotted name, such as `robot.radius` or `num_robots`."""
    value: Any = scenario
    for name in dotted.split("."):
        value = None if name.startswith("_") else getattr(value, name, None)
    if not isinstance(value, (int, float)):
        raise ValueError(f"{dotted}, which is no number of a scenario")
    return value


def _check_draws(name: str, draw: Any) -> None:
    """Check that the draws of a space or of a shift are mappings, by the name under which they are given."""
    require(isinstance(draw, Mapping), name, "must be a mapping from parts to draws", draw)
    for part, entries in draw.items():
        require(isinstance(entries, Mapping), f"{name}.{part}", "must be a mapping from fields to draws", entries)


def space_of_table(table: Mapping[str, Any], base_of: Callable[[str], Scenario]) -> ScenarioSpace:
    """Make the space of a file from its table, as `scenario_of_table` makes a scenario."""
    check_keys(table, _OF_SPACE)
    base = base_of(table["base"]) if "base" in table else Scenario()
    rules, shifts, words = table.get("require", ()), table.get("shift", {}), table.get("description", "")
    return ScenarioSpace(table["name"], base, table["draw"], rules, shifts, words)


def _choice(name: str, choices: Any, weights: Any) -> Callable[[Names], Any]:
    """Return the draw of one of some mappings.

    Raises:
        ValueError: there is none, or the weights are not a number for each.
    """
    is_list = isinstance(choices, (list, tuple)) and choices and all(isinstance(choice, Mapping) for choice in choices)
    require(is_list, f"{name}.choices", "must be a list of at least one mapping from fields to values", choices)
    shares = [1.0] * len(choices) if weights is None else weights
    fits = isinstance(shares, (list, tuple)) and len(shares) == len(choices)
    fits = fits and all(is_number(share, 0) for share in shares) and sum(shares)
    require(fits, f"{name}.weights", f"must be {len(choices)} numbers of at least 0, not all 0", weights)
    return lambda names: _by_share(choices, shares, names("uniform")(0, 1))


class Draws:
    """Scenarios of a split for groups of worlds: those of a group depend on the seed and on its number alone.

    Args:
        space: The space.
        split: Split or shift from which scenarios are drawn.
        seed: Whole number from 0 to 2^31 - 1.
        change: Function that returns a drawn scenario with fields changed.
        fits: Function that returns False for scenarios to skip.
    """

    def __init__(
        self,
        space: ScenarioSpace,
        split: str,
        seed: int,
        change: Callable[[Scenario], Scenario],
        fits: Callable[[Scenario], bool],
    ):
        self.seed, self._change, self._fits = seed, change, fits
        self.split = None if split in space.shifts else split
        self.space = space.shifted(split) if split in space.shifts else space
        self._counts: dict[int, int] = {}
        """Number of draws of each group so far, those included that were not used."""

    def next(self, group: int) -> tuple[Scenario, int]:
        """Return the next scenario of a group, and a seed for its worlds.

        Raises:
            ValueError: ten thousand draws contain none that fits.
        """
        start = f"{self.space.name}/{self.seed}"
        for _ in range(_MOST_DRAWS):
            draw = self._counts[group] = self._counts.get(group, -1) + 1
            seed = _hashed(f"{start}/scenario/{group}/{draw}") % LAST_SEED
            if self.split is not None and self.space.split_of(seed) != self.split:
                continue
            if self._fits(scenario := self._change(self.space.sample(seed))):
                return scenario, _hashed(f"{start}/episodes/{group}/{draw}") % LAST_SEED // 2
        raise ValueError(f"space {self.space.name} must contain more scenarios of the largest size, got none")
