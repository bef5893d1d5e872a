"""The registry of policies by name, with those that other packages add."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from baselines.policies.as_cars import AsCars
from baselines.policies.base import Policy
from baselines.policies.model_files import how_to_play
from lissajous_env import here
from lissajous_env import scenario as make_scenario
from lissajous_env.by_value import ByValue, replaces
from lissajous_env.identity import parts_of
from lissajous_env.parameters.named import build as build_scenario
from lissajous_env.parameters.robot_models import model_of, robot_kinds
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.plugins import EntryPoints
from lissajous_env.settings.checks import whole_number
from lissajous_env.wording import few_of, nearest, shown


@dataclass(frozen=True)
class _Entry:
    kind: str | None
    factory: Callable[..., Any]
    made_for: tuple[str, ...]
    about: str
    learned: bool
    on_request: bool

    def __reduce__(self) -> tuple:
        return _Entry, (self.kind, ByValue(self.factory), *list(vars(self).values())[2:])


_REGISTRY: dict[str, _Entry] = {}
_WRAPPERS: dict[str, "_Wrapper"] = {}
_BROUGHT = EntryPoints("lissajous_env.policies", "policies", lambda register_theirs: register_theirs())
_REGISTER = "register", "register_policy", "register_coordinator"
"""Names of the functions that add policies."""


class _Wrapper(NamedTuple):
    """Wrapper of policies for robots of one kind, and whether it serves robots that move like cars."""

    kind: str
    wrap: Callable[[Policy], Policy]
    about: str
    as_car: bool


class _Opener(NamedTuple):
    """Functions for the policies in folders of one kind."""

    make: Callable[..., Policy]
    home: Callable[[str], Scenario]
    parts: Callable[[str], dict[str, str]]


_OPENERS: dict[str, _Opener] = {}
"""Openers of policies in folders, by the file that such a folder contains."""


def register(
    name: str,
    kind: str | None = None,
    factory: Callable[..., Policy] | None = None,
    made_for: tuple[str, ...] = (),
    about: str = "",
    learned: bool = False,
    on_request: bool = False,
) -> Any:
    """Register a policy. Without `factory`, return a decorator, as in `@register("mine", kind="car")`.

    Args:
        name: Name of the policy.
        kind: Kind of robots that the policy drives; by default the factory's `kind`, or that of the class of a partial
            one; a policy without a kind drives all.
        factory: Function or class, called as `factory(scenario, num_worlds, device)`, that returns the policy.
        made_for: Names of the scenarios on which a benchmark plays the policy by default; all if empty.
        about: Description in one line; by default the first line of the factory's docstring.
        learned: True for a learned policy, which cannot be a base of others.
        on_request: True if a benchmark plays the policy only if it is named.

    Returns:
        The factory.

    Raises:
        ValueError: another policy has the name. The same policy may be registered again, and a cell of a notebook that
            is run again replaces its policy.
    """
    add = partial(_added, name, kind, tuple(made_for), about, learned, on_request)
    return add if factory is None else add(factory)


def _added(
    name: str,
    kind: str | None,
    made_for: tuple[str, ...],
    about: str,
    learned: bool,
    on_request: bool,
    factory: Any,
) -> Any:
    if not isinstance(name, str) or not name:
        raise ValueError(f"name of a policy must be a word, got {name!r}")
    made_by = _function_of(factory)
    kind = getattr(made_by, "kind", None) if kind is None else kind
    if kind not in (None, *robot_kinds()):
        raise ValueError(f"kind of {name} must be one of {few_of(robot_kinds(), kind)}, or None, got {shown(kind)}")
    if not callable(factory):
        raise ValueError(f"factory of {name} must be callable, got {shown(factory)}")
    about = about or ("" if isinstance(factory, partial) else factory.__doc__ or "")
    entry = _Entry(kind, factory, made_for, about.partition("\n")[0], learned, on_request)
    plain, suffix = _parted(name)
    if suffix or any(name + each in _REGISTRY for each in _WRAPPERS):
        raise ValueError(f"name of a policy must be new, got {name}; {suffix or 'a suffix'} marks a wrapped {plain}")
    before = _REGISTRY.get(name, entry)
    if not _alike(before, entry) and not replaces(_function_of(factory), _function_of(before.factory)):
        raise ValueError(f"name of a policy must be new, got {name}, which {before.factory!r} has")
    _REGISTRY[name] = entry
    return factory


def _function_of(factory: Any) -> Any:
    return factory.func if isinstance(factory, partial) else factory


def _alike(one: _Entry, other: _Entry) -> bool:
    def told(entry: _Entry) -> tuple:
        made = entry.factory
        parts = (made.func, made.args, made.keywords) if isinstance(made, partial) else (made,)
        return entry.kind, entry.made_for, entry.learned, entry.on_request, parts

    return told(one) == told(other)


def register_wrapper(
    suffix: str, kind: str, wrapper: Callable[[Policy], Policy], about: str, as_car: bool = False
) -> None:
    """Register a wrapped version of every policy for robots of `kind`, under its name with a suffix.

    `about` continues the description after the name of the policy, as in "with the collision filter". With `as_car`, a
    wrapper of cars also serves robots of other models that move like cars.

    Raises:
        ValueError: another wrapper has the suffix.
    """
    added = _Wrapper(kind, wrapper, about, as_car)
    if _WRAPPERS.get(suffix, added) != added:
        raise ValueError(f"suffix of a wrapper must be new, got {shown(suffix)}")
    _WRAPPERS[suffix] = added


def register_opener(
    opener: Callable[..., Policy],
    home: Callable[..., Scenario],
    parts: Callable[[str], dict[str, str]],
    file: str = "checkpoint.json",
) -> None:
    """Make folders that contain a certain file names of policies, which `make` accepts.

    Args:
        opener: Function `opener(folder, scenario, num_worlds, device)` that returns the policy in a folder.
        home: Function `home(folder)` that returns the scenario of the policy.
        parts: Function `parts(folder)` that returns the parts of the policy, as `parts` does.
        file: Name of the file. A folder without any such file is passed to the opener that was registered last.
    """
    _OPENERS[file] = _Opener(opener, home, parts)


def home(folder: str) -> Scenario:
    """Return the scenario that the policy in a folder was made for.

    Raises:
        ValueError: there is no policy in it, or its scenario cannot be made.
    """
    _BROUGHT.load()
    inside = _folder_of(folder)[0]
    return _opener_of(inside).home(inside)


def describe(name: str) -> dict[str, Any]:
    """Return a registered policy in plain values: name, robot kind (None: any), made_for, learned, description."""
    plain, suffix = unwrapped(name)
    entry = _registry()[plain]
    about = f"{plain} {_WRAPPERS[suffix].about}." if suffix else entry.about
    return {
        "name": name,
        "kind": _kinds()[name],
        "made_for": list(entry.made_for),
        "learned": entry.learned,
        "description": about,
    }


def bring(name: str) -> None:
    """Import the module of the current folder that registers a policy of a name, where there is none of it yet.

    Raises:
        ValueError: the module cannot be imported.
    """
    if name not in _kinds():
        here.load_module_of(name, "policy", *_REGISTER)


def registered_here() -> list[tuple[str, str]]:
    """Return the names that modules of the current folder register, each with its module."""
    return list(here.registered_here(*_REGISTER))


def meant_here(name: str) -> list[str]:
    """Return candidates for an unknown name: folders of policies beside it, and policies of the modules here."""
    folders = [folder for file in _OPENERS for folder in here.folders_beside(name, file)]
    return [*folders, *(each for each, _ in registered_here())]


def parts(name: str) -> dict[str, str]:
    """Return the parts that identify a policy among those of the same name: `lissajous_env.identity.parts_of`."""
    folder, suffix = _folder_of(name) if is_folder(name) else ("", unwrapped(name)[1])
    inside = _opener_of(folder).parts(folder) if folder else parts_of(_registry()[unwrapped(name)[0]].factory)
    wrapper = parts_of(_WRAPPERS[suffix].wrap) if suffix else {}
    return inside | {f"{suffix} {part}": each for part, each in wrapper.items()}


def is_folder(name: str) -> bool:
    """Return whether a name is that of a folder that a policy may be in, with or without the suffix of a wrapper."""
    return name not in _kinds() and bool(_OPENERS) and _is_directory(_folder_of(name)[0])


def _opener_of(folder: str) -> _Opener:
    """Return the opener of the policy in a folder."""
    for file, opener in _OPENERS.items():
        if Path(folder, file).is_file():
            return opener
    return [*_OPENERS.values()][-1]


def _folder_of(name: str) -> tuple[str, str]:
    """Return the folder that a name stands for, and the suffix of the wrapper ("" for none)."""
    for suffix in _WRAPPERS:
        plain = str(name).removesuffix(suffix)
        if plain != str(name) and not _is_directory(name) and _is_directory(plain):
            return plain, suffix
    return name, ""


def _is_directory(name: str) -> bool:
    try:
        return Path(name).is_dir()
    except OSError:  # no name of a file can be as long
        return False


def made_for(name: str, scenario: str) -> bool:
    """Return whether a benchmark plays a policy on a scenario by default."""
    entry = _registry().get(unwrapped(name)[0])
    return entry is None or (not entry.on_request and (not entry.made_for or scenario in entry.made_for))


def ships(name: str) -> bool:
    """Return whether a policy is one of ours, and not one that a user or another package registered."""
    entry = _registry().get(unwrapped(name)[0])
    made = _function_of(entry.factory) if entry is not None else None
    return getattr(made, "__module__", "").partition(".")[0] in ("baselines", "training")


def is_specialist(name: str) -> bool:
    """Return whether a policy was made for particular scenarios."""
    entry = _registry().get(unwrapped(name)[0])
    return entry is not None and bool(entry.made_for)


def is_classical(name: str) -> bool:
    """Return whether a name is that of a registered classical policy, wrapped or not."""
    entry = _registry().get(unwrapped(name)[0])
    return entry is not None and name in _kinds() and not entry.learned


def sent(name: str) -> _Entry | None:
    """Return what a process without the user's registrations needs to make this policy, for `remember`."""
    return _registry().get(unwrapped(name)[0])


def remember(name: str, entry: _Entry | None) -> None:
    """Register what `sent` returned in another process, unless this process has a policy of the name."""
    if entry is not None:
        _registry().setdefault(unwrapped(name)[0], entry)


def _registry() -> dict[str, _Entry]:
    _BROUGHT.load()
    return _REGISTRY


def _kinds() -> dict[str, str | None]:
    """Return the kind of robot that each policy drives, by name; the wrapped ones come last."""
    plain = {name: entry.kind for name, entry in _registry().items()}
    kinds = dict(plain)
    for suffix, wrapper in _WRAPPERS.items():
        kinds |= {name + suffix: wrapper.kind for name, drives in plain.items() if drives in (None, wrapper.kind)}
    return kinds


def _drives(name: str, drives: str | None, kind: str) -> bool:
    """Return whether a policy, made for a kind or all, drives robots of a kind, by itself or as if they were cars."""
    if drives in (None, kind):
        return True
    plain, suffix = _parted(name)
    as_cars = drives == "car" and model_of(kind).as_car is not None
    return as_cars and not _registry()[plain].learned and (not suffix or _WRAPPERS[suffix].as_car)


def unwrapped(name: str) -> tuple[str, str]:
    """Return the name of the wrapped policy, and the suffix of the wrapper ("" for none)."""
    _BROUGHT.load()
    return _parted(name)


def _parted(name: str) -> tuple[str, str]:
    if name in _REGISTRY:
        return name, ""
    for suffix, wrapper in _WRAPPERS.items():
        plain = name.removesuffix(suffix)
        if plain != name and plain in _REGISTRY and _REGISTRY[plain].kind in (None, wrapper.kind):
            return plain, suffix
    return name, ""


def factory_of(name: str) -> Callable[..., Policy]:
    """Return the factory of a registered policy without its suffix."""
    return _registry()[unwrapped(name)[0]].factory


def build(name: str, factory: Callable[..., Policy], scenario: Scenario, num_worlds: int, device: Any) -> Policy:
    """Return a policy that a factory makes, under a name of the registry, and wrapped if the name has a suffix.

    A policy of cars drives the robots of another model as if they were cars.
    """
    plain, suffix = unwrapped(name)
    if _kinds()[name] not in (None, scenario.robot.kind):
        policy: Policy = AsCars(partial(build, name, factory), scenario, num_worlds, device)
        policy.name = name
        return policy
    policy = factory(scenario, num_worlds, device)
    policy.name = plain
    return wrapped(policy, suffix, name)


def wrapped(policy: Policy, suffix: str, name: str) -> Policy:
    """Return a policy under a name; one with the suffix of a wrapper is wrapped."""
    if not suffix:
        return policy
    kind = _WRAPPERS[suffix].kind
    if policy.kind not in (None, kind):
        raise ValueError(f"policy must drive robots of kind {kind} to be wrapped by {suffix}, got {name}")
    policy = _WRAPPERS[suffix].wrap(policy)
    policy.name = name
    return policy


def names(scenario: str | Scenario | None = None) -> tuple[str, ...]:
    """Return the names of the policies, or of those that can drive the robots of a scenario."""
    if scenario is None:
        return tuple(_kinds())
    made = scenario if isinstance(scenario, Scenario) else make_scenario(scenario)
    kind = made.robot.kind
    return tuple(name for name, drives in _kinds().items() if _drives(name, drives, kind))


def make(name: str, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu") -> Policy:
    """Make a policy from its name, or from the folder of a checkpoint or a plan; a suffix adds a filter.

    Raises:
        ValueError: the name is unknown (the message suggests the closest match), the policy does not fit the scenario,
            the number of worlds is below 1, or the device is not available.
    """
    num_worlds = whole_number("num_worlds", num_worlds)
    if not isinstance(name, (str, os.PathLike)):
        raise ValueError(f"policy must be a name or a folder, got {shown(name)}")
    made = build_scenario(scenario)
    if is_folder(name):
        folder, suffix = _folder_of(name)
        return wrapped(_opener_of(folder).make(folder, made, num_worlds, device), suffix, str(name))
    check(name, made)
    return build(name, factory_of(name), made, num_worlds, device)


def check(name: str, made: Scenario) -> None:
    """Raise a ValueError if the name is unknown, or if the policy is for another kind of robot."""
    bring(name)
    if name not in (known := _kinds()):
        hint = how_to_play(name) or nearest(name, [*known, *meant_here(name)])
        words = f"policy must be one of the {len(known)} that `lissajous policies` lists, got {shown(name)}{hint}"
        raise ValueError("; ".join([words, *_BROUGHT.broken]))
    if name not in names(made):
        rule = f"policy for {made.name} must drive robots of kind {made.robot.kind}"
        raise ValueError(f"{rule}, got {name}, which drives kind {known[name]}{nearest(name, names(made))}")
