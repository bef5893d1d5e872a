"""Names of scenarios and of spaces of scenarios, and the ids under which Gymnasium and PettingZoo make them."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import pettingzoo


def register_ids(name: str, is_space: bool = False) -> None:
    """Register `lissajous/NAME-v0` with Gymnasium and PettingZoo; environments look up the scenario when made.

    Batches of a space of scenarios are made by Gymnasium itself.
    """
    of_ours, settings, making = f"lissajous/{name}-v0", {"scenario": name}, "lissajous_env.envs.making"
    vector = None if is_space else "lissajous_env.envs.gymnasium_vector:LissajousVectorEnv"
    gymnasium.register(of_ours, f"{making}:gymnasium_env", kwargs=settings, vector_entry_point=vector)
    pettingzoo.register("parallel", of_ours, f"{making}:parallel_env", kwargs=settings)
    pettingzoo.register("aec", of_ours, f"{making}:env", kwargs=settings)


_AT_PROMPT: set[tuple[str, str]] = set()
"""Kinds and names of the objects that a notebook, a prompt or a script has named, which it may name anew."""


def add_name(kind: str, new: Any, names: dict[str, Any], included: Mapping[str, Any], at_prompt: bool) -> bool:
    """Add a scenario or a space under its name.

    Args:
        kind: `scenario` or `space`, for messages.
        new: The object.
        names: Objects of users by name, to which it is added.
        included: Objects of the package by name.
        at_prompt: True if a notebook, a prompt or a script names it; a cell that is run again may replace its object.

    Returns:
        True if the name is new.

    Raises:
        ValueError: a different object has the name.
    """
    before, key = included.get(new.name) or names.get(new.name), (kind, new.name)
    if before not in (None, new) and not (at_prompt and key in _AT_PROMPT):
        raise ValueError(f"name of a {kind} must be new, got {new.name}, which another one has")
    if new.name not in included:
        names[new.name] = new
        _AT_PROMPT.update([key] if at_prompt else [])
    return before is None
