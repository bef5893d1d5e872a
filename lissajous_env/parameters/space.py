"""A distribution of scenarios: fields drawn from ranges and choices by a seed, with splits that share no scenario."""

import functools
import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from lissajous_env.parameters.overriding import by_field, overridden
from lissajous_env.parameters.scenario import PARTS, Scenario
from lissajous_env.settings.checks import LAST_SEED, is_finite, is_whole, whole_number
from lissajous_env.settings.formulas import Formula
from lissajous_env.wording import nearest, shown

SPLITS = {"train": 0.8, "validation": 0.1, "test": 0.1}
"""Share of the seeds that belong to each split."""
_OTHERS = "variables", "scale"
"""Tables of a draw beside the parts of a scenario."""
_SCALE = "length", "time"
_MOST_TRIES = 1000
"""Limit on the draws for one scenario that rules reject."""
_Look = Callable[[str], Any]
_Drawing = Callable[[float, _Look], Any]
"""Function of a number in [0, 1) and of the other values, which returns the value of a field."""


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
        draw: For each part of a scenario, a mapping from fields to their draws. A draw is

            * `{"low": 1.0, "high": 2.0}`, a uniform number, or a whole number, both ends included, if both are of type
              int; with `"log": True`, its logarithm is uniform; with `"times": FORMULA`, it is multiplied by the
              formula's value;
            * `{"choices": [...]}`, one of the values, with `"weights": [...]` not all equally often;
            * `{"formula": FORMULA}`, the value of a `lissajous_env.settings.formulas.Formula` of fields;
            * any other value, which is used unchanged.

            Under the key `choices`, a part itself has a list of mappings, of which one is drawn: fields that belong
            together. `variables` are numbers for formulas. `scale` may draw `length` and `time`, by which
            `Scenario.scaled` finally multiplies all lengths and times. Formulas can use every other value that is
            drawn, in any order.
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
        if not isinstance(self.base, Scenario):
            raise ValueError(f"base of a space must be a Scenario, got {shown(self.base)}")
        object.__setattr__(self, "require", tuple(self.require))
        _ = self._rules
        for name in self.shifts:
            if name in SPLITS:
                raise ValueError(f"a shift must not have the name of a split, got {name}")
            if not self.given:  # a given value may violate the rules in a shift that is not used
                self.shifted(name)
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
            made = self._drawn(seed, attempt)
            broken = next((rule.text for rule in self._rules if not rule(functools.partial(_property, made))), None)
            if broken is None:
                return made
            violated.append(broken)
        most = max(set(violated), key=violated.count)
        rule = f"must be met by one of {_MOST_TRIES} draws"
        raise ValueError(f"require {rule} for seed {seed} of {self.name}, got none; most often violated: {most}")

    def split_of(self, seed: int) -> str:
        """Return the split to which a seed belongs: `train`, `validation` or `test`."""
        at, above = self._uniform("split", seed), 0.0
        for name, share in SPLITS.items():
            above += share
            if at < above:
                return name
        return name

    def seeds(self, split: str) -> Iterator[int]:
        """Return an iterator over the seeds of a split in ascending order; all seeds for a shift.

        Raises:
            ValueError: there is neither a split nor a shift of this name.
        """
        if split in self.shifts:
            return iter(range(LAST_SEED + 1))
        if split not in SPLITS:
            words = f"split must be one of {', '.join([*SPLITS, *self.shifts])}"
            raise ValueError(f"{words}, got {shown(split)}{nearest(split, [*SPLITS, *self.shifts])}")
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
        if shift not in self.shifts:
            words = f"shift must be one of {', '.join(self.shifts) or 'none'}"
            raise ValueError(f"{words}, got {shown(shift)}{nearest(shift, self.shifts)}")
        draw = {part: dict(given) for part, given in self.draw.items()}
        for part, other in self.shifts[shift].items():
            draw[part] = draw.get(part, {}) | dict(other)
        return replace(self, name=f"{self.name}-{shift}", draw=draw, shifts={})

    def overridden(self, overrides: Mapping[str, Any]) -> "ScenarioSpace":
        """Return the space in which fields have given values instead of being drawn, in its shifts too.

        All other fields of a seed's scenario remain as they are, unless they follow from a given one by a formula.
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
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @functools.cached_property
    def _rules(self) -> tuple[Formula, ...]:
        return tuple(map(Formula, self.require))

    @functools.cached_property
    def _drawings(self) -> dict[str, _Drawing]:
        """The drawing of each field by its dotted name; `PART.choices` draws several fields."""
        drawings = {}
        for part, given_fields in self.draw.items():
            if part not in PARTS and part not in _OTHERS:
                known = [*PARTS, *_OTHERS]
                raise ValueError(f"draw must name one of {', '.join(known)}, got {shown(part)}{nearest(part, known)}")
            if not isinstance(given_fields, Mapping):
                raise ValueError(f"draw.{part} must be a mapping from fields to draws, got {shown(given_fields)}")
            left = dict(given_fields)
            if part == "scale" and (other := set(left) - set(_SCALE)):
                raise ValueError(f"draw.scale must contain length or time, got {shown(min(other))}")
            if part in PARTS and "choices" in left:
                together = {name: left.pop(name) for name in ("choices", "weights") if name in left}
                drawings[f"{part}.choices"] = _drawing(f"draw.{part}", together)
            for name, given in left.items():
                drawings[f"{part}.{name}"] = _drawing(f"draw.{part}.{name}", given)
        return drawings

    def _drawn(self, seed: int, attempt: int) -> Scenario:
        values: dict[str, Any] = {}
        begun: list[str] = []

        def value_of(name: str) -> Any:
            if name not in values:
                if name in begun:
                    raise ValueError(f"{name}, which depends on itself")
                begun.append(name)
                values[name] = self._drawings[name](self._uniform(f"{attempt}/{name}", seed), look_up)
            return values[name]

        def look_up(name: str) -> Any:
            if name in self.given:
                return self.given[name]
            for known in (name, f"variables.{name}"):
                if known in self._drawings:
                    return value_of(known)
            part, _, what = name.partition(".")
            together = value_of(f"{part}.choices") if f"{part}.choices" in self._drawings else {}
            return together[what] if what in together else _property(self.base, name)

        changed: dict[str, Any] = {}
        for name in self._drawings:
            part, _, what = name.partition(".")
            if part in PARTS:
                together = value_of(name) if what == "choices" else {what: value_of(name)}
                changed |= {f"{part}.{each}": value for each, value in together.items()}
        changed.update(self.given)
        scale = {name: value_of(f"scale.{name}") for name in _SCALE if f"scale.{name}" in self._drawings}
        try:
            made = overridden(self.base, changed).scaled(**scale)
        except ValueError as error:
            raise type(error)(f"seed {seed} of {self.name}: {error}") from error
        return replace(made, name=f"{self.name}-{seed}", description=f"Scenario {seed} of {self.name}.")

    def _uniform(self, what: str, seed: int) -> float:
        """Return a number in [0, 1) that depends on the space's name, the seed and the purpose alone."""
        digest = hashlib.sha256(f"{self.name}/{seed}/{what}".encode()).digest()
        return int.from_bytes(digest[:8]) / 2**64


def _property(made: Scenario, dotted: str) -> Any:
    """Return a number of a scenario by its dotted name, such as `robot.radius` or `num_robots`."""
    names = dotted.split(".")
    try:
        value = None if any(name.startswith("_") for name in names) else functools.reduce(getattr, names, made)
    except AttributeError:
        value = None
    if not isinstance(value, (int, float)):
        raise ValueError(f"{dotted}, which is no number of a scenario")
    return value


def _drawing(name: str, given: Any) -> _Drawing:
    """Return the function that draws a value.

    Raises:
        ValueError: the draw is invalid.
    """
    if not isinstance(given, Mapping):
        return lambda at, look_up: given
    keys = set(given)
    if keys == {"formula"}:
        formula = Formula(given["formula"])
        return lambda at, look_up: formula(look_up)
    if "choices" in keys <= {"choices", "weights"}:
        return _choice(name, given["choices"], given.get("weights"))
    if {"low", "high"} <= keys <= {"low", "high", "log", "times"}:
        return _range(name, **given)
    rule = "must be a value, {low, high}, also with log and times, {choices}, also with weights, or {formula}"
    raise ValueError(f"{name} {rule}, got {shown(dict(given))}")


def _choice(name: str, choices: Any, weights: Any) -> _Drawing:
    if not isinstance(choices, (list, tuple)) or not choices:
        raise ValueError(f"{name}.choices must be a list of at least one value, got {shown(choices)}")
    shares = [1.0] * len(choices) if weights is None else list(weights)
    if len(shares) != len(choices) or not all(is_finite(share) and share >= 0 for share in shares) or not sum(shares):
        raise ValueError(
            f"{name}.weights must be {len(choices)} numbers of at least 0, not all 0, got {shown(weights)}"
        )

    def choose(at: float, look_up: _Look) -> Any:
        left = at * sum(shares)
        for choice, share in zip(choices, shares, strict=True):
            left -= share
            if left < 0:
                return choice
        return choices[max(place for place, share in enumerate(shares) if share)]

    return choose


def _range(name: str, low: Any, high: Any, log: bool = False, times: str | None = None) -> _Drawing:
    if not (is_finite(low) and is_finite(high) and low <= high):
        raise ValueError(f"{name} must have finite numbers low <= high, got {shown(low)} and {shown(high)}")
    if log and low <= 0:
        raise ValueError(f"{name}.low must be above 0 with log, got {shown(low)}")
    formula = None if times is None else Formula(times)

    def draw(at: float, look_up: _Look) -> Any:
        if is_whole(low) and is_whole(high):
            value = low + int(at * (high - low + 1))
        else:
            value = low * (high / low) ** at if log else low + (high - low) * at
        return value if formula is None else value * formula(look_up)

    return draw
