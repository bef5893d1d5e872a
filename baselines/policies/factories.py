"""Policies by what a person gives for one: a name, a folder, `module:factory`, or an object of Python."""

import difflib
import functools
import importlib
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from typing import Any, cast

from baselines.policies import registry
from lissajous_env import scenarios
from lissajous_env.episodes.evaluation import ActingPolicy
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import shown

Factory = Callable[[Scenario, int, Any], ActingPolicy]
"""Makes a policy: `factory(scenario, num_worlds, device)`."""


def told_apart(names: Sequence[str]) -> tuple[tuple[str, ...], str]:
    """Scenarios and the one policy among some names, whatever their order; what names a scenario is one.

    Raises:
        ValueError: there is no policy among them, more than one, no scenario, or a name that is neither.
    """
    others = [name for name in names if name not in scenarios()]
    unknown = [name for name in others if not _may_be_policy(name)]
    if len(others) > 1 and unknown:
        # One of them may be the policy; of the others none is.
        wrong = unknown[0]
        known = [*scenarios(), *registry.names()]
        nearest = difflib.get_close_matches(wrong, known, n=1, cutoff=0.0)[0]
        raise ValueError(
            f"scenario must be one of {', '.join(scenarios())}, got {wrong!r}; did you mean {nearest}?\n"
            "(nor is it a policy: a name that `lissajous policies` lists, a checkpoint's folder, or module:factory)"
        )
    if len(others) > 1:
        raise ValueError(f"policy must be one alone, got {', '.join(others)}")
    if not others:
        raise ValueError(f"policy must be given beside the scenario, got {', '.join(names)}")
    if len(names) == 1:
        raise ValueError(f"scenario must be given beside the policy, one of {', '.join(scenarios())}; got {names[0]!r}")
    return tuple(name for name in names if name in scenarios()), others[0]


def as_factory(policy: Any, name: str) -> Factory:
    """Return what makes a policy, of a factory (class, function, partial) or of a policy that was made already.

    Raises:
        ValueError: it is neither.
    """
    if not isinstance(policy, type) and _acts(policy):
        made_already = cast(ActingPolicy, policy)
        return lambda *_: made_already
    if not callable(policy):
        raise ValueError(
            f"policy {name} must be a policy or factory(scenario, num_worlds, device), got {shown(policy)}"
        )

    def make(scenario: Scenario, num_worlds: int, device: Any) -> ActingPolicy:
        made: Any = policy(scenario, num_worlds, device)
        if not _acts(made) or isinstance(made, type):
            raise ValueError(f"policy {name} must be made with reset, act and num_worlds, got {shown(made)}")
        return made

    return make


def named(name: str) -> Factory:
    """Return what makes the policy of a registered name, of a checkpoint's folder, or of `module:factory`.

    Raises:
        ValueError: a module or a factory that cannot be loaded.
    """
    return as_factory(_imported(name), name) if is_imported(name) else functools.partial(_registered, name)


def is_imported(name: str) -> bool:
    """Whether a name is `module:factory`."""
    return ":" in name and name not in registry.names() and not registry.is_folder(name)


def is_ones_own(name: str) -> bool:
    """Whether a name is none that is registered, but a folder or `module:factory`."""
    return is_imported(name) or registry.is_folder(name)


def where_raised(error: BaseException) -> str:
    """Put an error into one line, with the place in which it was raised."""
    words = str(error).strip().partition("\n")[0]
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({os.path.basename(frames[-1].filename)}, line {frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}{f': {words}' if words else ''}{place}"


def _may_be_policy(name: str) -> bool:
    return name in registry.names() or is_ones_own(name)


def _acts(policy: Any) -> bool:
    return all(hasattr(policy, part) for part in ("act", "reset", "num_worlds"))


def _registered(name: str, scenario: Scenario, num_worlds: int, device: Any) -> ActingPolicy:
    return registry.make(name, scenario, num_worlds, device)


def _imported(name: str) -> Any:
    module, _, attribute = name.partition(":")
    try:
        if not module or not attribute or module.startswith("."):
            raise ValueError("both must be names")
        found = _import_from_here(module)
        return functools.reduce(getattr, attribute.split("."), found)
    except (Exception, SystemExit) as error:
        raise ValueError(
            f"policy must be module:factory that can be loaded, got {name!r}: {where_raised(error)}"
        ) from error


def _import_from_here(module: str) -> Any:
    """Import a module, of the current folder too; what it imports later is looked for there last."""
    try:
        here = os.getcwd()
    except OSError:  # the folder was removed
        return importlib.import_module(module)
    if here in sys.path or "" in sys.path:
        return importlib.import_module(module)
    sys.path.insert(0, here)
    try:
        return importlib.import_module(module)
    finally:
        sys.path.remove(here)
        sys.path.append(here)
