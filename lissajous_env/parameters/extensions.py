"""Extensions of a scenario: reward terms, score columns, observation entries, and how targets enter and move.

An extension is a function of a `lissajous_env.world.extension_stages.WorldView` (NumPy views of the state), or a Warp
kernel over the structs of `lissajous_env.world.state` that runs as a stage of `lissajous_env.world.stages`:

    @lissajous_env.reward_term(weight=-0.1)
    def near_wall(world):
        return abs(world.robots.position[..., 0]) > world.scenario.curve.half_width - 0.2

A scenario lists extensions as objects, as `module:name`, or as tables with settings, such as
{"place": "module:name", "weight": -0.5}; all environments, commands and adapters then use them. The arguments of a
kernel are matched by name; its result goes to `value_out`.

An extension may remember numbers of each world: `state={"gate": (2,)}` declares arrays that are zero when an episode of
a world begins, unless a function `reset(world)` fills them.
"""

import dataclasses
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial, reduce
from typing import Any

import warp as wp

from lissajous_env.identity import fingerprint
from lissajous_env.plugins import MAIN_MODULES, ByValue, import_attribute
from lissajous_env.settings.checks import Checked, choice, is_whole, number, whole
from lissajous_env.wording import few_of, require

REDUCTIONS = ("mean", "sum", "max", "min", "last")
LARGEST = 1e30
"""Limit on the values of an extension, including the weight, so that sums are finite in 32 bits."""
_RULE = "must be objects or module:name"


@dataclass(frozen=True)
class Extension(Checked):
    """Base of the extensions of a scenario; the checked fields are its settings."""

    name: str
    """Name of the function or kernel."""
    run: Any
    """Function `run(world)` or Warp kernel."""
    place: str
    """Import path, `module:name`."""
    state: Mapping[str, tuple[int, ...]] = dataclasses.field(default_factory=dict, kw_only=True, hash=False)
    """Shapes of the arrays that it remembers of each world, by name."""
    reset: Any = dataclasses.field(default=None, kw_only=True)
    """Function `reset(world)` that fills them when an episode begins; None leaves them zero."""

    def __post_init__(self) -> None:
        runs = callable(self.run) or isinstance(self.run, wp.Kernel)
        require(runs, self.kind, "must be a function or a Warp kernel", self.run)
        is_named = re.fullmatch(r"[a-z][a-z0-9_]{0,62}", self.name)
        require(is_named, f"name of a {self.kind}", "must be of small letters, digits and _", self.name)
        called = f"the {self.kind} {self.name}"
        for name, shape in self.state.items():
            is_shape = isinstance(shape, tuple) and all(is_whole(size, 1) for size in shape)
            fits = isinstance(name, str) and name.isidentifier() and is_shape
            require(fits, f"state of {called}", "must map names to tuples of whole numbers above 0", {name: shape})
        require(self.reset is None or callable(self.reset), f"reset of {called}", "must be a function", self.reset)
        object.__setattr__(self, "part", self.name)  # as in `near_wall.weight`
        super().__post_init__()

    @classmethod
    def of(cls, run: Any = None, **settings: Any) -> Any:
        """Make an extension of a function or kernel; without one, return a decorator that does.

        Args:
            run: Function or Warp kernel.
            **settings: Settings of the kind, such as `weight`, and `state` and `reset`.

        Raises:
            ValueError: it is neither a function nor a kernel, or a setting is invalid.
        """
        if run is None:
            return partial(cls.of, **settings)
        function = _function_of(run)
        name = str(getattr(function, "__name__", run))
        place = f"{getattr(function, '__module__', '')}:{getattr(function, '__qualname__', name)}"
        return cls(name, run, place, **settings)

    @property
    def kind(self) -> str:
        """Kind in words, such as "reward term"."""
        return re.sub(r"(?<=.)([A-Z])", r" \1", type(self).__name__).lower()

    @property
    def about(self) -> str:
        """First line of the docstring of the function."""
        return (_function_of(self.run).__doc__ or "").strip().partition("\n")[0]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values that identify the extension: its settings and the parts of its function."""
        return {"kind": self.kind, "name": self.name, "place": self.place, **self.settings, "parts": self._parts}

    @cached_property
    def _parts(self) -> dict[str, str]:
        """Parts of its functions; a copy in another process, which has no source of them, brings them along."""
        return ({} if self.reset is None else fingerprint(self.reset)) | fingerprint(self.run)

    @property
    def settings(self) -> dict[str, Any]:
        """Settings by name, such as the weight of a reward term."""
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self) if field.metadata}

    def __reduce__(self) -> tuple:
        module, _, attribute = self.place.partition(":")
        at_place = reduce(lambda owner, name: getattr(owner, name, None), attribute.split("."), sys.modules.get(module))
        is_there = module not in MAIN_MODULES and getattr(at_place, "run", None) is self.run
        if not is_there and not isinstance(self.run, wp.Kernel):
            reset = self.reset and ByValue(self.reset)
            more = self.settings | {"state": self.state, "reset": reset}
            return partial(type(self), **more), (self.name, ByValue(self.run), self.place), {"_parts": self._parts}
        return load_extension, (self.place, self.settings)


@dataclass(frozen=True)
class RewardTerm(Extension):
    """Reward term: (W, N) numbers of each step, times a weight; 0 for removed robots."""

    weight: float = number(1.0, -LARGEST, LARGEST)
    """Factor of the numbers."""


@dataclass(frozen=True)
class ScoreColumn(Extension):
    """Score column: (W,) numbers of each step, reduced to one per episode."""

    reduce: str = choice("mean", *REDUCTIONS)
    """Reduction over the steps."""


@dataclass(frozen=True)
class ObservationEntry(Extension):
    """Entries appended to the observation of each robot: (W, N) or (W, N, size) numbers, clipped to a range."""

    size: int = whole(1, 1, 1024)
    """Number of entries; several are named name_0, name_1 ..."""
    low: float = number(-1.0, -LARGEST, LARGEST)
    """Least value."""
    high: float = number(1.0, -LARGEST, LARGEST)
    """Largest value."""

    def _check_together(self) -> None:
        self._require(self.low < self.high, "high", f"must be above low = {self.low}")

    @property
    def entries(self) -> tuple[str, ...]:
        """Names of the entries."""
        return (self.name,) if self.size == 1 else tuple(f"{self.name}_{k}" for k in range(self.size))


@dataclass(frozen=True)
class TargetMotion(Extension):
    """Motion of the share `targets.custom` of the targets: (W, T, 2) new positions [m] of all targets.

    Only the positions of present targets with this motion are used, clipped to the rectangle. A kernel writes
    `targets.position` itself, where `targets.motion` is CUSTOM and the status is PRESENT, or DETECTED if targets stay.
    """


@dataclass(frozen=True)
class TargetEntry(Extension):
    """Law of entry for `targets.entry = custom`: (W, T, 2) places [m] of all targets.

    Only the places of the targets that appear in this step, or at the reset, are used, clipped to the rectangle.
    """


reward_term = RewardTerm.of
score_column = ScoreColumn.of
observation_entry = ObservationEntry.of
target_motion = TargetMotion.of
target_entry = TargetEntry.of


def load_extension(place: str, settings: Mapping[str, Any] | None = None) -> Extension:
    """Import an extension by `module:name`, also from the current folder.

    Args:
        place: Import path, `module:name`.
        settings: Overridden settings, such as {"weight": -0.5}.

    Raises:
        ValueError: the object cannot be imported or is no extension, or a setting is unknown or invalid.
    """
    extension = import_attribute(place, "extension must be module:name")
    is_extension = isinstance(extension, Extension)
    require(is_extension, f"extension {place}", "must be made by reward_term, score_column, ...", extension)
    known, given = extension.settings, dict(settings or {})
    for name in given:
        rule = f"must be of {', '.join(known) or 'none, for it has none'}"
        require(name in known, f"settings of {place}", rule, name, known)
    return dataclasses.replace(extension, place=place, **given)


def as_extensions(given: Any) -> tuple[Extension, ...]:
    """Return a tuple of extensions from a sequence, or from text separated by commas.

    Each is an object, `module:name`, or a table with `place` and settings.

    Raises:
        ValueError: an entry is no extension, or two have the same name.
    """
    if isinstance(given, str):
        given = map(str.strip, given.split(","))
    elif isinstance(given, (Extension, Mapping)):
        given = (given,)
    require(isinstance(given, Iterable), "extensions", _RULE, given)
    extensions = tuple(map(_as_extension, given))
    names = [extension.name for extension in extensions]
    entries = [
        entry for extension in extensions if isinstance(extension, ObservationEntry) for entry in extension.entries
    ]
    for things, known in {"extensions": names, "entries of the observation": entries}.items():
        if twice := sorted({name for name in known if known.count(name) > 1}):
            raise ValueError(f"{things} must have different names, got {few_of(twice)} twice")
    for kind, words in ((TargetMotion, "motion"), (TargetEntry, "law of entry")):
        if sum(isinstance(extension, kind) for extension in extensions) > 1:
            raise ValueError(f"extensions must contain at most one {words} of targets, got {few_of(names)}")
    return extensions


def _as_extension(given: Any) -> Extension:
    if isinstance(given, str):
        return load_extension(given)
    if isinstance(given, Mapping):
        rule = "must contain tables with a place, as module:name"
        require(isinstance(given.get("place"), str), "extensions", rule, given)
        return load_extension(given["place"], {name: value for name, value in given.items() if name != "place"})
    require(isinstance(given, Extension), "extensions", _RULE, given)
    return given


def _function_of(run: Any) -> Any:
    return run.func if isinstance(run, wp.Kernel) else run
