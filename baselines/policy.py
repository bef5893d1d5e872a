"""What a policy is, and the registry of the classical ones.

A policy sees the observation and nothing else: what the action of a robot uses is that robot's own row, its own memory
and the scenario. So any of them could run on a robot, and classical and learned ones are compared fairly.
"""

import difflib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from lissajous_env import scenario as make_scenario
from lissajous_env.device import as_device, compile_quietly, copy_in, is_torch
from lissajous_env.observation import layout
from lissajous_env.scenario import Scenario


class Policy:
    """Base of the classical policies: a batch of W worlds of N robots of one scenario, on one device.

    A subclass writes `self.action` (W, N, action_size) in `_decide`, which is called with the observation as a Warp
    array, and forgets its memory of some worlds in `_forget`.
    """

    kind: str | None = None
    """Kind of robot that the policy drives; None drives any."""

    def __init__(self, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu"):
        self.scenario = make_scenario(scenario).resolve()
        self.num_worlds, self.num_robots = num_worlds, self.scenario.num_robots
        self.device = as_device(device)
        self.name = type(self).__name__
        self.shape = (num_worlds, self.num_robots)
        self.observation_shape = (*self.shape, layout(self.scenario).size)
        self._observation = wp.zeros(self.observation_shape, dtype=wp.float32, device=self.device)
        self.action = wp.zeros((*self.shape, self.scenario.action_size), dtype=wp.float32, device=self.device)

    def reset(self, worlds: Any = None) -> None:
        """Forget what was kept of some worlds ((W,) mask or indices), or of all."""
        mask = np.zeros(self.num_worlds, dtype=bool)
        mask[slice(None) if worlds is None else worlds] = True
        self._forget(mask)

    def act(self, observation: Any) -> Any:
        """Actions (W, N, action_size) in [-1, 1] for observations (W, N, D).

        Takes a NumPy array, torch tensor or Warp array and returns the like; a Warp array that is returned is the
        policy's own and changes with the next call.

        Raises:
            ValueError: the observation has another shape.
        """
        if tuple(observation.shape) != self.observation_shape:
            raise ValueError(f"observation must have shape {self.observation_shape}, got {tuple(observation.shape)}")
        with compile_quietly():
            if isinstance(observation, wp.array):
                self._decide(observation)
                return self.action
            copy_in("observation", observation, self._observation)
            self._decide(self._observation)
            return wp.to_torch(self.action).clone() if is_torch(observation) else self.action.numpy().copy()

    def save_state(self) -> dict[str, np.ndarray]:
        """Copy what the policy keeps, its memory among it, to the host, by name."""
        return {name: array.numpy().copy() for name, array in _arrays(self)}

    def load_state(self, saved: dict[str, np.ndarray]) -> None:
        """Go on from what `save_state` returned, in a policy of the same name, scenario and number of worlds."""
        for name, array in _arrays(self):
            array.assign(saved[name])

    def _decide(self, observation: wp.array) -> None:
        raise NotImplementedError

    def _forget(self, mask: np.ndarray) -> None:
        """Forget the memory of the worlds in a mask (W,)."""


def _arrays(owner: Any, prefix: str = "") -> Iterator[tuple[str, wp.array]]:
    """Warp arrays of a policy and of what it is made of, by name: all that can change while it acts."""
    for name, value in sorted(vars(owner).items()):
        if isinstance(value, wp.array):
            yield prefix + name, value
        elif type(value).__module__.startswith("baselines.") and hasattr(value, "__dict__"):
            yield from _arrays(value, f"{prefix}{name}.")


GROUP = "lissajous_env.policies"
"""Entry points of this group name functions that `register` further policies, those of other packages."""


@dataclass(frozen=True)
class _Entry:
    kind: str | None
    factory: Callable[..., Policy]
    made_for: tuple[str, ...]
    about: str
    learned: bool


_REGISTRY: dict[str, _Entry] = {}
_WRAPPERS: dict[str, tuple[str, Callable[[Policy], Policy]]] = {}
_opener: Callable[..., Policy] | None = None


def register(
    name: str,
    kind: str | None,
    factory: Callable[..., Policy],
    made_for: tuple[str, ...] = (),
    about: str = "",
    learned: bool = False,
) -> None:
    """Add a policy.

    Args:
        name: Its name.
        kind: Kind of robots that it drives; None: any.
        factory: `factory(scenario, num_worlds, device)` makes it.
        made_for: Names of the scenarios on which a benchmark plays it without being asked to; all by default.
        about: What it is, in one line; the first line of the factory's docstring by default.
        learned: Whether its weights were learned.
    """
    about = about or (factory.__doc__ if isinstance(factory, type) else None) or ""
    _REGISTRY[name] = _Entry(kind, factory, made_for, about.partition("\n")[0], learned)


def register_wrapper(suffix: str, kind: str, wrapper: Callable[[Policy], Policy]) -> None:
    """Add every policy for robots of `kind` once more, wrapped, under its name with a suffix."""
    _WRAPPERS[suffix] = kind, wrapper


def register_opener(opener: Callable[..., Policy]) -> None:
    """Let `make` take a folder for a name: `opener(folder, scenario, num_worlds, device)` makes the policy in it."""
    global _opener
    _opener = opener


def describe(name: str) -> dict[str, Any]:
    """What a registered policy is, in plain values: name, kind of robot (None: any), made_for, learned, description."""
    plain, suffix = unwrapped(name)
    entry = _registry()[plain]
    about = f"{plain} with the collision filter under it." if suffix else entry.about
    return {
        "name": name,
        "kind": _kinds()[name],
        "made_for": list(entry.made_for),
        "learned": entry.learned,
        "description": about,
    }


def is_folder(name: str) -> bool:
    """Whether a name is none of the registry's, but a folder that a policy may be in."""
    try:
        return name not in _kinds() and _opener is not None and Path(name).is_dir()
    except OSError:  # no name of a file can be as long
        return False


def made_for(name: str, scenario: str) -> bool:
    """Whether a benchmark plays a policy on a scenario without being asked to."""
    entry = _registry().get(unwrapped(name)[0])
    return entry is None or not entry.made_for or scenario in entry.made_for


def is_specialist(name: str) -> bool:
    """Whether a policy was made for some scenarios."""
    entry = _registry().get(unwrapped(name)[0])
    return entry is not None and bool(entry.made_for)


@cache
def _load_entry_points() -> None:
    for entry in entry_points(group=GROUP):
        entry.load()()


def _registry() -> dict[str, _Entry]:
    _load_entry_points()
    return _REGISTRY


def _kinds() -> dict[str, str | None]:
    """Kind of robot that each policy drives, by name; the wrapped ones come last."""
    plain = {name: entry.kind for name, entry in _registry().items()}
    kinds = dict(plain)
    for suffix, (kind, _) in _WRAPPERS.items():
        kinds |= {name + suffix: kind for name, drives in plain.items() if drives in (None, kind)}
    return kinds


def unwrapped(name: str) -> tuple[str, str]:
    """Name of the policy inside, and the suffix of what wraps it ("" for nothing)."""
    if name in _registry():
        return name, ""
    suffix = next((suffix for suffix in _WRAPPERS if name.endswith(suffix)), "")
    return name.removesuffix(suffix), suffix


def _build(name: str, scenario: Scenario, num_worlds: int, device: Any) -> Policy:
    plain, suffix = unwrapped(name)
    policy = _registry()[plain].factory(scenario, num_worlds, device)
    if suffix:
        policy.name = plain
        policy = _WRAPPERS[suffix][1](policy)
    policy.name = name
    return policy


def names(scenario: str | Scenario | None = None) -> tuple[str, ...]:
    """Names of the policies; with a scenario, of those that drive its robots."""
    if scenario is None:
        return tuple(_kinds())
    kind = make_scenario(scenario).robot.kind
    return tuple(name for name, drives in _kinds().items() if drives in (None, kind))


def make(name: str, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu") -> Policy:
    """Make a policy by name, or of the folder of a checkpoint.

    Raises:
        ValueError: an unknown name (the message offers the nearest), or a policy that does not fit the scenario.
    """
    made = make_scenario(scenario)
    if _opener is not None and is_folder(name):
        return _opener(name, made, num_worlds, device)
    check(name, made)
    return _build(name, made, num_worlds, device)


def check(name: str, made: Scenario) -> None:
    """Raise ValueError where `make` would: an unknown name, or a policy for another kind of robot."""
    if name not in (known := _kinds()):
        nearest = difflib.get_close_matches(str(name), known, n=1, cutoff=0.0)[0]
        raise ValueError(f"policy must be one of {', '.join(known)}, got {name!r}; did you mean {nearest}?")
    if name not in names(made):
        raise ValueError(
            f"policy for {made.name} must drive robots of kind {made.robot.kind} ({', '.join(names(made))}), got {name}"
        )
