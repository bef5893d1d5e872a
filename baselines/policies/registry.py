"""The registry of policies: entries by name, filters by the suffix of a name, and loaders of policies in folders.

A policy is named by its entry or by its folder. The suffix of a filter, such as `-safe`, may follow either. Users may
also give `module:factory` or an object of Python (`as_factory`).
"""

import contextlib
import inspect
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

from baselines.policies.as_cars import AsCars
from baselines.policies.base import Filter, Filtered, Policy
from baselines.policies.safety.proved import Proved
from baselines.policies.safety.safe import Safe
from lissajous_env import identity
from lissajous_env.episodes.evaluation import ActingPolicy, FunctionPolicy, acts
from lissajous_env.identity import OWN_PACKAGES
from lissajous_env.parameters import rogues
from lissajous_env.parameters.named import build as build_scenario
from lissajous_env.parameters.named import denotes_scenario
from lissajous_env.parameters.robot_models import MODELS, model_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.plugins import ByValue, Registry, import_attribute
from lissajous_env.settings.checks import whole_number
from lissajous_env.wording import few_of, nearest, require

Factory = Callable[[Scenario, int, Any], ActingPolicy]
"""Function that makes a policy: `factory(scenario, num_worlds, device)`."""


@dataclass(frozen=True)
class Entry:
    """Entry of the registry: a registered policy or that of a folder, with or without a filter.

    `entry(scenario, num_worlds, device)` makes the policy. An entry can be pickled with factories of notebooks.
    `register` describes the fields without a description.
    """

    name: str
    kind: str | None
    factory: Callable[..., Any]
    made_for: tuple[str, ...] = ()
    about: str = ""
    steered_by: str = "rule"
    on_request: bool = False
    filter: type[Filter] | None = None
    """Class of the filter; None for none."""

    def __reduce__(self) -> tuple:
        return Entry, (self.name, self.kind, ByValue(self.factory), *list(vars(self).values())[3:])

    def __call__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu") -> Policy:
        """Make the policy; a policy of cars drives robots of another model through `AsCars`."""
        self.check(scenario)
        if self.kind not in (None, scenario.actuation):
            policy: Policy = AsCars(self, scenario, num_worlds, device)
        else:
            policy = self.factory(scenario, num_worlds, device)
            policy.name = split_suffix(self.name)[0]
            if self.filter is not None:
                policy = Filtered(policy, self.filter)
        policy.name = self.name
        return policy

    def check(self, scenario: Scenario) -> None:
        """Raise ValueError if the policy is for another kind of robot than that of a scenario."""
        if not self.drives(scenario.actuation):
            rule = f"policy for {scenario.name} must drive robots of kind {scenario.actuation}"
            if not self.drives(None):
                rule = f"policy must drive robots of kind car to be wrapped by {split_suffix(self.name)[1]}"
            hint = nearest(self.name, names(scenario))
            raise ValueError(f"{rule}, got {self.name}, which drives kind {self.kind}{hint}")

    def filtered(self, suffix: str) -> "Entry":
        """Return the entry with the filter of a suffix; a policy for all kinds of robots then drives cars alone."""
        filter = _FILTERS[suffix]
        about = f"{self.name} {filter.about}."
        return replace(self, name=self.name + suffix, kind=self.kind or "car", about=about, filter=filter)

    def drives(self, kind: str | None) -> bool:
        """Return whether the policy drives robots of a kind, as they are or through `AsCars`.

        Without a kind, return whether it drives any robots: a filter requires cars.
        """
        if self.filter is not None and self.kind != "car":
            return False
        if kind is None or self.kind in (None, kind):
            return True
        are_like_cars = self.kind == "car" and kind != _VELOCITY and model_of(kind).as_car is not None
        return are_like_cars and self.steered_by == "rule" and (self.filter is None or self.filter.as_car)


class Loader(NamedTuple):
    """Functions for the policies in folders of one kind."""

    make: Callable[..., Policy]
    """`make(folder, scenario, num_worlds, device)` returns the policy."""
    own_scenario: Callable[[str], Scenario]
    """`own_scenario(folder)` returns the scenario of the policy."""
    fingerprint: Callable[[str], dict[str, str]]
    """`fingerprint(folder)` returns what identifies the policy, as `fingerprint_of` does."""


POLICIES = Registry(
    "policy",
    (r"(?s).+", "a word"),
    lambda entry: _is_own(entry.factory),
    "lissajous_env.policies",
)
_FILTERS: dict[str, type[Filter]] = {kind.suffix: kind for kind in (Safe, Proved)}
"""Filters, by the suffix that adds them to the name of a policy."""
LOADERS: dict[str, Loader] = {}
"""Loaders of policies in folders, by the file by which they recognise a folder."""
_VELOCITY = "velocity"
"""Kind of policies whose actions are velocities, as in `Scenario.actuation`."""
_STEERED_BY = "rule", "plan", "network"
ROBOTS, ROGUES = "robots of kind ", "rogues "
"""Beginnings of the names of models of robots and of rogues in `code_of`."""


def register(
    name: str,
    kind: str | None = None,
    factory: Callable[..., Policy] | None = None,
    made_for: tuple[str, ...] = (),
    about: str = "",
    steered_by: str = "rule",
    on_request: bool = False,
) -> Any:
    """Register a policy. Without `factory`, return a decorator, as in `@register("mine", kind="car")`.

    Args:
        name: Name of the policy, without the suffix of a filter.
        kind: Kind of robots that the policy drives, or `velocity`, as in `Policy.kind`; by default the factory's
            `kind`, or that of the class of a partial one; a policy without a kind drives all.
        factory: Function or class, called as `factory(scenario, num_worlds, device)`, that returns the policy.
        made_for: Names of the scenarios on which a benchmark plays the policy by default; all if empty.
        about: Description in one line; by default the first line of the factory's docstring.
        steered_by: `rule`, `plan` for a policy that rehearses rules and drives by the best one, or `network`. Only a
            rule can be the base of a network or a candidate of a plan, and drives robots that are like cars.
        on_request: True if a benchmark plays the policy only where it is named, by the user or in its defaults.

    Returns:
        The factory.

    Raises:
        ValueError: the name, the kind or the factory is invalid, or another policy has the name. The same factory may
            be registered again, and a cell of a notebook that is run again replaces its policy.
    """
    if factory is None:
        options = {"made_for": made_for, "about": about, "steered_by": steered_by, "on_request": on_request}
        return partial(register, name, kind, **options)
    if ending := next(filter(str(name).endswith, _FILTERS), ""):
        raise ValueError(f"name of a policy must not end in {ending}, which adds a filter, got {name}")
    origin, kinds = _origin(factory), (*MODELS, _VELOCITY)
    kind = kind_of(factory) if kind is None else kind
    rule = f"must be one of {few_of(kinds, kind)}, or None"
    require(kind in (None, *kinds), f"kind of {name}", rule, kind)
    require(callable(factory), f"factory of {name}", "must be callable", factory)
    require(steered_by in _STEERED_BY, f"steered_by of {name}", f"must be one of {', '.join(_STEERED_BY)}", steered_by)
    require(not isinstance(made_for, str), f"made_for of {name}", "must be a tuple of names of scenarios", made_for)
    before = POLICIES.get(str(name))
    if before is not None and _origin(before.factory) == origin:
        return factory
    about = about or ("" if isinstance(factory, partial) else factory.__doc__ or "")
    POLICIES.add(Entry(name, kind, factory, tuple(made_for), about.partition("\n")[0], steered_by, on_request))
    return factory


def kind_of(factory: Any) -> str | None:
    """Return the kind of robots that the policies of a factory drive, by itself or as registered; None for any."""
    origin = _origin(factory)
    registered = (entry.kind for entry in POLICIES.values() if _origin(entry.factory) == origin)
    return getattr(origin[0], "kind", None) or next(registered, None)


def _origin(factory: Any) -> tuple:
    """Return the function or class that a factory calls, and the arguments of a partial one."""
    return (factory.func, *factory.args, *factory.keywords.items()) if isinstance(factory, partial) else (factory,)


def _is_own(factory: Any) -> bool:
    """Return whether this distribution defines a factory and, of a partial one, all functions and classes in it."""
    if isinstance(factory, partial):
        return all(map(_is_own, filter(callable, (factory.func, *factory.args, *factory.keywords.values()))))
    return getattr(factory, "__module__", "").partition(".")[0] in OWN_PACKAGES


def split_suffix(name: str) -> tuple[str, str]:
    """Split the name or the folder of a policy into the part before the suffix of a filter, and the suffix or "".

    The name of a registered policy stands for it, also where a folder has the same name. A folder whose own name ends
    in such a suffix is not split.
    """
    suffix = next(filter(str(name).endswith, _FILTERS), "")
    plain = str(name).removesuffix(suffix)
    return (str(name), "") if plain not in POLICIES.load() and os.path.isdir(name) else (plain, suffix)


def entry_of(name: str) -> Entry | None:
    """Return the entry of a registered policy, with or without the suffix of a filter; None if there is none."""
    plain, suffix = split_suffix(name)
    entry = POLICIES.load().get(plain)
    return entry.filtered(suffix) if entry is not None and suffix else entry


def names(scenario: str | Scenario | None = None) -> tuple[str, ...]:
    """Return the names of the policies, those with filters last, or of those that can drive a scenario's robots."""
    kind = None if scenario is None else build_scenario(scenario).actuation
    plain = [*POLICIES.load().values()]
    every = [*plain, *(entry.filtered(suffix) for suffix in _FILTERS for entry in plain)]
    return tuple(entry.name for entry in every if entry.drives(kind))


def make(name: str, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu") -> Policy:
    """Make a policy from its name, or from the folder of a checkpoint or a plan; a suffix adds a filter.

    Raises:
        ValueError: the name is unknown (the message suggests the closest match), the policy does not fit the scenario,
            the number of worlds is below 1, or the device is not available.
    """
    return resolve(name)(build_scenario(scenario), whole_number("num_worlds", num_worlds), device)


def resolve(name: str) -> Entry:
    """Return the entry of a registered policy, or of that in a folder, with or without the suffix of a filter.

    Raises:
        ValueError: the name is unknown; the message suggests the closest match.
    """
    require(isinstance(name, (str, os.PathLike)), "policy", "must be a name or a folder", name)
    if (entry := entry_of(name)) is not None:
        return entry
    plain, suffix = split_suffix(name)
    if is_folder(name):
        entry = Entry(plain, None, partial(_loader_of(plain).make, plain))
        return entry.filtered(suffix) if suffix else entry
    is_module = os.path.isfile(f"{plain.removesuffix('.py')}.py")
    require(not is_module, "policy of a module", "must be given with its factory, as module:factory", name)
    require(os.sep not in plain, "folder of a policy", "must exist", plain)
    raise POLICIES.unknown(name, "policies", names())


def is_folder(name: str) -> bool:
    """Return whether a name, without the suffix of a filter, is that of a folder and of no registered policy."""
    return bool(LOADERS) and entry_of(name) is None and os.path.isdir(split_suffix(name)[0])


def _loader_of(folder: str) -> Loader:
    for file, loader in LOADERS.items():
        if Path(folder, file).is_file():
            return loader
    within = [path.parent for file in LOADERS for path in sorted(Path(folder).glob(f"*/{file}"))]
    hint = f"; did you mean {' or '.join(map(str, within[:3]))}?" if within else ""
    raise ValueError(f"folder of a policy must contain {' or '.join(LOADERS)}, got {folder}{hint}")


def own_scenario(folder: str) -> Scenario:
    """Return the scenario that the policy in a folder was made for.

    Raises:
        ValueError: there is no policy in it, or its scenario cannot be made.
    """
    plain = split_suffix(folder)[0]
    return _loader_of(plain).own_scenario(plain)


def fingerprint_of(factory: Factory) -> dict[str, str]:
    """Return what identifies the code, or the folder, of the policies of a factory, as `identity.fingerprint` does."""
    factory = getattr(factory, "__wrapped__", factory)
    if not isinstance(factory, Entry):
        return identity.fingerprint(factory)
    plain, suffix = split_suffix(factory.name)
    parts = _loader_of(plain).fingerprint(plain) if is_folder(factory.name) else identity.fingerprint(factory.factory)
    of_filter = {} if factory.filter is None else identity.fingerprint(factory.filter)
    return parts | {f"{suffix} {part}": digest for part, digest in of_filter.items()}


def code_of(scenarios: Iterable[Scenario], factories: Mapping[str, Factory]) -> dict[str, dict[str, str]]:
    """Return what identifies the code of policies by name, and of the models of robots and the rogues of scenarios.

    Models and rogues of this package are identified by its version, which results store beside these parts.
    """
    code = {name: fingerprint_of(factory) for name, factory in factories.items()}
    for scenario in scenarios:
        model, name = MODELS[scenario.robot.kind], scenario.targets.rogues or ""
        if not MODELS.is_included(model):
            code[ROBOTS + model.name] = identity.fingerprint(model.move)
        if name and (folder := rogues.folder_of(name)) is not None:
            code[ROGUES + name] = fingerprint_of(resolve(str(folder)))
        elif name in rogues.ROGUES and not rogues.ROGUES.is_included(rogues.ROGUES[name]):
            code[ROGUES + name] = identity.fingerprint(rogues.ROGUES[name].decide)
    return code


def as_factory(policy: Any, name: str = "") -> Factory:
    """Return the factory of a policy.

    Args:
        policy: A registered name, a folder, `module:factory`, a factory (class, function or partial), or a policy that
            was made already. A function, method or other callable object of one argument is a policy:
            `act(observation)` on NumPy arrays (W, N, D).
        name: Name of a policy that is given as an object, for errors.

    Raises:
        ValueError: it is none of these, the name is unknown, or a module or a factory cannot be loaded.
    """
    if isinstance(policy, (str, os.PathLike)):
        name = os.fspath(policy)
        if not is_imported(name):
            return resolve(name)
        policy = import_attribute(name, "policy must be module:factory")
    is_policy = acts(policy)
    if is_policy:
        with contextlib.suppress(Exception):  # playing the policy raises the error again
            policy.reset()  # so that memory of earlier episodes does not change its identity
    rule = "must be a policy or factory(scenario, num_worlds, device)"
    require(is_policy or callable(policy), f"policy {name}".strip(), rule, policy)
    decides = not isinstance(policy, type) and _takes_one(policy)

    def make(scenario: Scenario, num_worlds: int, device: Any) -> ActingPolicy:
        if is_policy:
            return cast(ActingPolicy, policy)
        if decides:
            return FunctionPolicy(policy, num_worlds)
        kind = kind_of(policy)
        others = kind not in (None, scenario.actuation)  # refused, or driven as cars
        factory = Entry(name or getattr(policy, "__name__", str(policy)), kind, policy) if others else policy
        acting = factory(scenario, num_worlds, device)
        require(acts(acting), f"policy {name}", "must be made with reset, act and num_worlds", acting)
        return cast(ActingPolicy, acting)

    make.__wrapped__ = policy  # type: ignore[attr-defined]
    return make


def is_imported(name: str) -> bool:
    """Return whether a name has the form `module:factory`."""
    return ":" in name and not denotes_scenario(name) and name not in names() and not is_folder(name)


def _takes_one(function: Callable[..., Any]) -> bool:
    """Return whether a callable accepts one positional argument, and not three; False if it states no signature."""

    def takes(count: int) -> bool:
        with contextlib.suppress(TypeError, ValueError):
            return inspect.signature(function).bind(*range(count)) is not None
        return False

    return takes(1) and not takes(3)


def describe(name: str) -> dict[str, Any]:
    """Return a registered policy in plain values; its kind is None if it drives all kinds of robots."""
    entry: Any = entry_of(name)
    return {
        "name": name, "kind": entry.kind, "made_for": list(entry.made_for), "steered_by": entry.steered_by,
        "description": entry.about,
    }  # fmt: skip


def is_default_on(name: str, scenario: str) -> bool:
    """Return whether a benchmark plays a policy on a scenario by default."""
    entry = entry_of(name)
    return entry is None or (not entry.on_request and (not entry.made_for or scenario in entry.made_for))


def is_included(name: str) -> bool:
    """Return whether this package registered a policy, and not a user or another package."""
    entry = entry_of(name)
    return entry is not None and POLICIES.is_included(entry)


def is_classical(name: str) -> bool:
    """Return whether a name is that of a registered classical policy, with or without a filter."""
    entry = entry_of(name)
    return entry is not None and entry.steered_by == "rule"
