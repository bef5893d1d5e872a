"""Policies by the words with which a user names them: a name, a folder, `module:factory`, or an object of Python."""

import contextlib
import functools
import inspect
from collections.abc import Callable, Sequence
from typing import Any, cast

from baselines.policies import registry
from lissajous_env.episodes.evaluation import ActingPolicy, FunctionPolicy
from lissajous_env.identity import parts_of
from lissajous_env.parameters import named as named_scenarios
from lissajous_env.parameters.named import denotes_scenario
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.plugins import import_attribute
from lissajous_env.wording import few_of, shown

Factory = Callable[[Scenario, int, Any], ActingPolicy]
"""Makes a policy: `factory(scenario, num_worlds, device)`."""


def split_scenarios_and_policy(names: Sequence[str]) -> tuple[tuple[str, ...], str]:
    """Return the scenarios, and the one policy, of some names in any order; a name of both is a scenario.

    `module:attribute` can be either: where nothing else is the policy, the last of these is.

    Raises:
        ValueError: there is no policy among them, more than one, no scenario, or a name that is neither.
    """
    for name in names:
        if not (denotes_scenario(name) or is_ones_own(name)):
            named_scenarios.bring_scenario(name)
            registry.bring(name)
    either = [name for name in names if is_imported(name)]
    policies = [name for name in names if is_policy_alone(name)] or either[-1:]
    asked = [name for name in names if name not in policies and (name in either or denotes_scenario(name))]
    unknown = [name for name in names if name not in policies and name not in asked]
    if unknown and len(policies) + len(unknown) > 1:
        # One of them may be the policy; of the others none is.
        meant = [*registry.names(), *named_scenarios.meant_here(unknown[0]), *registry.meant_here(unknown[0])]
        raise ValueError(
            f"{named_scenarios.unknown_scenario(unknown[0], meant)}\n"
            "(nor is it a policy: a name that `lissajous policies` lists, a checkpoint's folder, or module:factory)"
        )
    if len(policies) > 1:
        raise ValueError(f"exactly one policy must be given, got {few_of(policies)}")
    if not policies and not unknown:
        raise ValueError(f"policy must be given after the scenario, got {few_of(names)}")
    if not asked:
        raise ValueError(
            f"scenario must be given before the policy, one that `lissajous scenarios` lists; got {shown(names[0])}"
        )
    return tuple(asked), (policies or unknown)[0]


def as_factory(policy: Any, name: str) -> Factory:
    """Return what makes a policy, of a factory (class, function, partial) or of a policy that was made already.

    A function of one argument is the policy itself: `act(observation)` on NumPy arrays (W, N, D).

    Raises:
        ValueError: it is none of these.
    """
    if not isinstance(policy, type) and _acts(policy):
        made_already = cast(ActingPolicy, policy)
        with contextlib.suppress(Exception):  # which is told when it is played
            made_already.reset()  # its memory of earlier episodes does not make it another policy
        return _of(policy, lambda *_: made_already)
    if not callable(policy):
        raise ValueError(
            f"policy {name} must be a policy or factory(scenario, num_worlds, device), got {shown(policy)}"
        )
    if inspect.isfunction(policy) and _takes_one(policy):
        return _of(policy, lambda scenario, num_worlds, device: FunctionPolicy(policy, num_worlds))

    def make(scenario: Scenario, num_worlds: int, device: Any) -> ActingPolicy:
        made: Any = policy(scenario, num_worlds, device)
        if not _acts(made) or isinstance(made, type):
            raise ValueError(f"policy {name} must be made with reset, act and num_worlds, got {shown(made)}")
        return made

    return _of(policy, make)


def _of(policy: Any, factory: Factory) -> Factory:
    """Note in a factory the object by which `parts` identifies it."""
    factory.__wrapped__ = policy  # type: ignore[attr-defined]
    return factory


def named(name: str) -> Factory:
    """Return what makes the policy of a registered name, of a checkpoint's folder, or of `module:factory`.

    Raises:
        ValueError: a module or a factory that cannot be loaded.
    """
    if is_imported(name):
        return as_factory(import_attribute(name, "policy must be module:factory"), name)
    return functools.partial(_registered, name, registry.entry_of(name))


def parts(factory: Factory) -> dict[str, str]:
    """Name the parts that identify a policy's factory: `lissajous_env.identity.parts_of`."""
    if isinstance(factory, functools.partial) and factory.func is _registered:
        return registry.parts(factory.args[0])
    return parts_of(getattr(factory, "__wrapped__", factory))


def is_policy_alone(name: str) -> bool:
    """Return whether a name is a registered policy or a policy's folder, and no scenario."""
    return (name in registry.names() or registry.is_folder(name)) and not denotes_scenario(name)


def is_imported(name: str) -> bool:
    """Return whether a name has the form `module:factory`."""
    return ":" in name and not denotes_scenario(name) and name not in registry.names() and not registry.is_folder(name)


def is_ones_own(name: str) -> bool:
    """Return whether a name is not registered but is a folder or `module:factory`."""
    return is_imported(name) or registry.is_folder(name)


def _acts(policy: Any) -> bool:
    return all(hasattr(policy, part) for part in ("act", "reset", "num_worlds"))


def _takes_one(function: Callable[..., Any]) -> bool:
    """Return whether a function can be called with one positional argument, and not with three."""

    def takes(count: int) -> bool:
        try:
            inspect.signature(function).bind(*range(count))
        except TypeError:
            return False
        return True

    return takes(1) and not takes(3)


def _registered(name: str, sent: Any, scenario: Scenario, num_worlds: int, device: Any) -> ActingPolicy:
    registry.remember(name, sent)
    return registry.make(name, scenario, num_worlds, device)
