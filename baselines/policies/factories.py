"""Factories of policies from the inputs of users: a name, a folder, `module:factory`, or an object of Python."""

import contextlib
import inspect
import os
from collections.abc import Callable, Sequence
from typing import Any, cast

from baselines.policies import registry
from lissajous_env import identity
from lissajous_env.episodes.evaluation import ActingPolicy, FunctionPolicy
from lissajous_env.parameters.named import denotes_scenario, unknown_scenario
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.plugins import import_attribute
from lissajous_env.wording import few_of, require

Factory = Callable[[Scenario, int, Any], ActingPolicy]
"""Function that makes a policy: `factory(scenario, num_worlds, device)`."""


def split_scenarios_and_policy(names: Sequence[str]) -> tuple[tuple[str, ...], str]:
    """Return the scenarios of a command, and the policy after them.

    Raises:
        ValueError: the policy is not the last of the names, there is no scenario before it, or an unknown scenario.
    """
    if not names:
        raise ValueError("names must be scenarios and then a policy, got nothing")
    *scenarios, policy = names
    for name in scenarios:
        if registry.is_folder(name) or (name in registry.names() and not denotes_scenario(name)):
            words = "scenario must be given before the policy (that of a policy's folder is FOLDER/scenario.toml)"
            raise ValueError(f"{words}, got {few_of(names)}")
        if not denotes_scenario(name) and not is_imported(name):
            raise unknown_scenario(name)
    if denotes_scenario(policy) and policy not in registry.names() and not registry.is_folder(policy):
        raise ValueError(f"policy must be given after the scenario, got {few_of(names)}")
    if not scenarios:
        as_factory(policy)  # refuses a policy that does not exist
    require(scenarios, "scenario", "must be given before the policy, one that `lissajous scenarios` lists", policy)
    return tuple(scenarios), policy


def as_factory(policy: Any, name: str = "") -> Factory:
    """Return the factory of a policy.

    Args:
        policy: A registered name, a folder, `module:factory`, a factory (class, function or partial), or a policy that
            was made already. A function of one argument is a policy: `act(observation)` on NumPy arrays (W, N, D).
        name: Name of a policy that is given as an object, for errors.

    Raises:
        ValueError: it is none of these, the name is unknown, or a module or a factory cannot be loaded.
    """
    if isinstance(policy, (str, os.PathLike)):
        name = os.fspath(policy)
        if not is_imported(name):
            return registry.resolve(name)
        policy = import_attribute(name, "policy must be module:factory")
    if not isinstance(policy, type) and _acts(policy):
        instance = cast(ActingPolicy, policy)
        with contextlib.suppress(Exception):  # playing the policy raises the error again
            instance.reset()  # so that memory of earlier episodes does not change its identity
        return _identified_by(policy, lambda *_: instance)
    rule = "must be a policy or factory(scenario, num_worlds, device)"
    require(callable(policy), f"policy {name}", rule, policy)
    if inspect.isfunction(policy) and _takes_one(policy):
        return _identified_by(policy, lambda scenario, num_worlds, device: FunctionPolicy(policy, num_worlds))

    def make(scenario: Scenario, num_worlds: int, device: Any) -> ActingPolicy:
        kind = registry.kind_of(policy)
        others = kind not in (None, scenario.actuation)  # refused, or driven as cars
        factory = registry.Entry(name or getattr(policy, "__name__", str(policy)), kind, policy) if others else policy
        acting: Any = factory(scenario, num_worlds, device)
        acts = _acts(acting) and not isinstance(acting, type)
        require(acts, f"policy {name}", "must be made with reset, act and num_worlds", acting)
        return cast(ActingPolicy, acting)

    return _identified_by(policy, make)


def _identified_by(policy: Any, factory: Factory) -> Factory:
    """Return a factory with the fingerprint of the object of a user."""
    factory.__wrapped__ = policy  # type: ignore[attr-defined]
    return factory


def factory_fingerprint(factory: Factory) -> dict[str, str]:
    """Return the fingerprint of what a factory makes, as `lissajous_env.identity.fingerprint` does."""
    if isinstance(factory, registry.Entry):
        return registry.policy_fingerprint(factory.name)
    return identity.fingerprint(getattr(factory, "__wrapped__", factory))


def is_imported(name: str) -> bool:
    """Return whether a name has the form `module:factory`."""
    return ":" in name and not denotes_scenario(name) and name not in registry.names() and not registry.is_folder(name)


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
