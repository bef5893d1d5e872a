"""What a scenario brings of its own: terms of the reward, columns of the score, entries of the observation, a motion.

Each is a function of a `lissajous_env.world.view.WorldView`, NumPy views of the state, or a Warp kernel over the
structs of `lissajous_env.world.state`, which runs as a stage among those of `lissajous_env.world.stages`:

    @lissajous_env.reward_term(weight=-0.1)
    def near_wall(world):
        return abs(world.robots.position[..., 0]) > world.scenario.curve.half_width - 0.2

A scenario names them in `extensions`: as the object itself, as `module:name`, or as a table with its settings, such as
{"place": "module:name", "weight": -0.5}. Then every environment, every command and every adapter has them. A kernel
takes what it needs by the names of its parameters, and `value_out` for its result.
"""

import dataclasses
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import warp as wp

from lissajous_env.identity import parts_of
from lissajous_env.plugins import import_attribute
from lissajous_env.wording import few_of, nearest, shown

REDUCTIONS = ("mean", "sum", "max", "min", "last")
LARGEST = 1e30
"""Largest number that an extension may bring, its weight included: sums of some of them are finite in 32 bits."""


@dataclass(frozen=True)
class Extension:
    """Something that a scenario brings."""

    name: str
    """Name of the function or kernel."""
    run: Any
    """`run(world)`, or a Warp kernel."""
    place: str
    """Where it can be imported from, as `module:name`."""

    def __post_init__(self) -> None:
        if not callable(self.run) and not isinstance(self.run, wp.Kernel):
            raise ValueError(f"{self.kind} must be a function or a Warp kernel, got {shown(self.run)}")
        if not re.fullmatch(r"[a-z][a-z0-9_]{0,62}", self.name):
            raise ValueError(f"name of a {self.kind} must be of small letters, digits and _, got {shown(self.name)}")

    @property
    def kind(self) -> str:
        """What it is, in words."""
        return re.sub(r"(?<=.)([A-Z])", r" \1", type(self).__name__).lower()

    @property
    def about(self) -> str:
        """What it does, in a line."""
        function = self.run.func if isinstance(self.run, wp.Kernel) else self.run
        return (function.__doc__ or "").strip().partition("\n")[0]

    def to_dict(self) -> dict[str, Any]:
        """Plain values that tell it from another one: its settings, and the parts of its function."""
        plain = {each.name: getattr(self, each.name) for each in dataclasses.fields(self) if each.name != "run"}
        return {"kind": self.kind, **plain, "parts": parts_of(self.run)}

    @property
    def settings(self) -> dict[str, Any]:
        """What a scenario may set, by name: such as the weight of a term of the reward."""
        made_of = {field.name for field in dataclasses.fields(Extension)}
        return {each.name: getattr(self, each.name) for each in dataclasses.fields(self) if each.name not in made_of}

    def __reduce__(self) -> tuple:
        return load_extension, (self.place, self.settings)


@dataclass(frozen=True)
class RewardTerm(Extension):
    """A term of the reward: (W, N) numbers of each step, times a weight; a robot that was removed gets none."""

    weight: float = 1.0
    """What the numbers are multiplied by."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.weight, (int, float)) and abs(self.weight) <= LARGEST):
            rule = f"must be a number from -{LARGEST:g} to {LARGEST:g}"
            raise ValueError(f"weight of {self.name} {rule}, got {shown(self.weight)}")


@dataclass(frozen=True)
class ScoreColumn(Extension):
    """A column of the score: (W,) numbers of each step, made into one of the episode."""

    reduce: str = "mean"
    """How: one of `REDUCTIONS`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.reduce not in REDUCTIONS:
            raise ValueError(f"reduce of {self.name} must be one of {', '.join(REDUCTIONS)}, got {shown(self.reduce)}")


@dataclass(frozen=True)
class ObservationEntry(Extension):
    """Entries at the end of each robot's row of the observation: (W, N) or (W, N, size) numbers, clipped to a range."""

    size: int = 1
    """How many entries; more than one are called name_0, name_1 ..."""
    low: float = -1.0
    """Least value."""
    high: float = 1.0
    """Largest value."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.size <= 1024:
            raise ValueError(f"size of {self.name} must be from 1 to 1024, got {shown(self.size)}")
        for name, value in (("low", self.low), ("high", self.high)):
            if not (isinstance(value, (int, float)) and abs(value) <= LARGEST):
                rule = f"must be a number from -{LARGEST:g} to {LARGEST:g}"
                raise ValueError(f"{name} of {self.name} {rule}, got {shown(value)}")
        if not self.low < self.high:
            raise ValueError(f"high of {self.name} must be above low = {self.low}, got {shown(self.high)}")

    @property
    def entries(self) -> tuple[str, ...]:
        """Names of the entries."""
        return (self.name,) if self.size == 1 else tuple(f"{self.name}_{k}" for k in range(self.size))


@dataclass(frozen=True)
class TargetMotion(Extension):
    """How the share `targets.custom` of the targets moves: (W, T, 2) new places [m] of all targets.

    Only those are taken that move so, are there and are not yet gone; a place outside the rectangle is moved to its
    edge. A kernel writes `targets.position` itself, where `targets.motion` is CUSTOM and the stage is PRESENT or FOUND.
    """


def reward_term(weight: float = 1.0) -> Callable[[Any], RewardTerm]:
    """Make a function or kernel a term of the reward; see `RewardTerm`."""
    return lambda run: RewardTerm(*_origin(run), weight=float(weight))


def score_column(reduce: str = "mean") -> Callable[[Any], ScoreColumn]:
    """Make a function or kernel a column of the score; see `ScoreColumn`."""
    return lambda run: ScoreColumn(*_origin(run), reduce=reduce)


def observation_entry(size: int = 1, low: float = -1.0, high: float = 1.0) -> Callable[[Any], ObservationEntry]:
    """Make a function or kernel entries of the observation; see `ObservationEntry`."""
    return lambda run: ObservationEntry(*_origin(run), size=size, low=float(low), high=float(high))


def target_motion(run: Any) -> TargetMotion:
    """Make a function or kernel the motion of the targets of `targets.custom`; see `TargetMotion`."""
    return TargetMotion(*_origin(run))


def load_extension(place: str, settings: Mapping[str, Any] | None = None) -> Extension:
    """Import an extension by `module:name`, also from the current folder.

    Args:
        place: Where it can be imported from.
        settings: What is set differently than it is there, such as {"weight": -0.5}.

    Raises:
        ValueError: it cannot be imported, or is none; or a setting that it does not have or that a rule forbids.
    """
    found = import_attribute(place, "extension must be module:name")
    if not isinstance(found, Extension):
        raise ValueError(f"extension {place} must be made by reward_term, score_column, ..., got {shown(found)}")
    given = dict(settings or {})
    for name, value in given.items():
        if name not in found.settings:
            rule = f"settings of {place} must be of {', '.join(found.settings) or 'none, for it has none'}"
            raise ValueError(f"{rule}, got {shown(name)}{nearest(name, found.settings)}")
        kind = type(found.settings[name])
        if not (isinstance(value, kind) or (kind is float and isinstance(value, int))) or isinstance(value, bool):
            words = {float: "a number", int: "a whole number", str: "a word"}
            raise ValueError(f"{name} of {place} must be {words[kind]}, got {shown(value)}")
        given[name] = kind(value)
    return dataclasses.replace(found, place=place, **given)


def as_extensions(given: Any) -> tuple[Extension, ...]:
    """Make a tuple of extensions, given as a sequence, or as text with commas between.

    Each is an object, `module:name`, or a table of its `place` and settings.

    Raises:
        ValueError: one of another kind, or two of the same name.
    """
    one_alone = isinstance(given, (Extension, Mapping))
    each = given.split(",") if isinstance(given, str) else (given,) if one_alone else given
    if not isinstance(each, Iterable):
        raise ValueError(f"extensions must be objects or module:name, got {shown(given)}")
    made = tuple(_loaded(one) for one in each)
    for one in made:
        if not isinstance(one, Extension):
            raise ValueError(f"extensions must be objects or module:name, got {shown(one)}")
    names = [one.name for one in made]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"extensions must have names of their own, got {few_of(twice)} twice")
    entries = [entry for one in made if isinstance(one, ObservationEntry) for entry in one.entries]
    if twice := sorted({entry for entry in entries if entries.count(entry) > 1}):
        raise ValueError(f"entries of the observation must have names of their own, got {few_of(twice)} twice")
    if sum(isinstance(one, TargetMotion) for one in made) > 1:
        raise ValueError(f"extensions must hold one motion of targets at most, got {few_of(names)}")
    return made


def _loaded(one: Any) -> Any:
    if isinstance(one, str):
        return load_extension(one)
    if not isinstance(one, Mapping):
        return one
    if not isinstance(place := one.get("place"), str):
        raise ValueError(f"extensions must hold tables with a place, as module:name, got {shown(one)}")
    return load_extension(place, {name: value for name, value in one.items() if name != "place"})


def _origin(run: Any) -> tuple[str, Any, str]:
    """Name, function or kernel, and place of what was decorated."""
    function = run.func if isinstance(run, wp.Kernel) else run
    name = str(getattr(function, "__name__", run))
    return name, run, f"{getattr(function, '__module__', '')}:{getattr(function, '__qualname__', name)}"
