"""Registries: dictionaries from names to scenarios, spaces, robot models and rogues; and ids of environments."""

import re
import sys
from collections.abc import Container
from typing import Any

import gymnasium
import pettingzoo

from lissajous_env.wording import shown

SCENARIOS: dict[str, Any] = {}
"""Scenarios of users and of other packages, by name."""
SPACES: dict[str, Any] = {}
"""Spaces of scenarios by name: those of users, and those of the package that were used."""
NAMES = r"(?!.*\.toml$)\w[\w.-]{0,98}", "a word of letters, digits, _, - and . that does not end in .toml"
"""Names of scenarios and spaces, as a pattern and in words."""


def register(
    registry: dict[str, Any],
    thing: str,
    new: Any,
    names: tuple[str, str],
    taken: Container[str] = (),
    replaces: bool = False,
) -> None:
    """Add an object to a registry under its attribute `name`.

    Args:
        registry: Objects by name.
        thing: Kind of the object, for messages.
        new: The object.
        names: Regular expression of valid names, and the rule in words.
        taken: Names that are not in the registry but belong to other objects.
        replaces: True if the object may replace a different one that has its name.

    Raises:
        ValueError: the name is invalid, or a different object has it.
    """
    name, (pattern, rule) = new.name, names
    if not (isinstance(name, str) and re.fullmatch(pattern, name)):
        raise ValueError(f"name of a {thing} must be {rule}, got {shown(name)}")
    if name in taken or (registry.get(name, new) != new and not replaces):
        raise ValueError(f"name of a {thing} must be new, got {shown(name)}, which another one has")
    registry[name] = new


def is_notebook() -> bool:
    """Return True in a notebook or at a prompt, where a cell that is run again registers its objects anew."""
    return hasattr(sys, "ps1")  # IPython sets it too


def register_ids(name: str, is_space: bool = False) -> None:
    """Register `lissajous/NAME-v0` with Gymnasium and PettingZoo; environments look up the scenario when made.

    Batches of a space of scenarios are made by Gymnasium itself.
    """
    identifier, settings, module = f"lissajous/{name}-v0", {"scenario": name}, "lissajous_env.envs"
    vector = None if is_space else "lissajous_env.envs.gymnasium_vector:LissajousVectorEnv"
    if identifier not in gymnasium.registry:
        made = f"{module}.gymnasium_env:LissajousEnv"
        gymnasium.register(identifier, made, kwargs=settings, vector_entry_point=vector)
        pettingzoo.register("parallel", identifier, f"{module}.pettingzoo_env:LissajousParallelEnv", kwargs=settings)
        pettingzoo.register("aec", identifier, f"{module}.pettingzoo_env:env", kwargs=settings)
