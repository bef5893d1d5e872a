"""Registries: dictionaries from names to scenarios, spaces, robot models and rogues that users and packages add."""

import re
import sys
from collections.abc import Container
from typing import Any

from lissajous_env.wording import shown


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
    return not hasattr(sys.modules["__main__"], "__file__")
