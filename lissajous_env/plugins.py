"""What users and other packages bring: `module:attribute`, of the current folder too, and entry points."""

import functools
import importlib
import os
import sys
import types
import warnings
from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from lissajous_env.siblings import load_entry_point
from lissajous_env.wording import nearest, where_raised


def import_attribute(reference: str, rule: str) -> Any:
    """Import `module:attribute`; a module in the current folder is found too.

    Args:
        reference: Names of the module and of what is in it, as `my_module:mine` or `package.module:Class.method`.
        rule: What the message says that it must be.

    Raises:
        ValueError: it cannot be loaded; the message says why, and where that was raised.
    """
    module, _, attribute = reference.partition(":")
    try:
        if not module or not attribute or module.startswith("."):
            raise ValueError("both must be names")
        return functools.reduce(getattr, attribute.split("."), import_module(module))
    except (Exception, SystemExit) as error:
        hint = ""
        if isinstance(error, AttributeError) and isinstance(error.obj, types.ModuleType):
            hint = nearest(error.name, vars(error.obj))
        elif isinstance(error, ModuleNotFoundError) and error.name == module:
            hint = nearest(module, (path.stem for path in Path().glob("*.py")))
        raise ValueError(f"{rule} that can be loaded, got {reference!r}: {where_raised(error)}{hint}") from error


def import_module(module: str) -> types.ModuleType:
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


class EntryPoints:
    """What other packages bring under one group of entry points, loaded when it is first asked for.

    One that cannot be loaded is a warning with its name, and the others are there all the same.

    Args:
        group: Name of the group.
        things: What it brings, as messages call it.
        take: Called with what an entry point names, in the order of their names; a module alone is only imported.
    """

    def __init__(self, group: str, things: str, take: Callable[[Any], Any]):
        self.group, self.things, self.take = group, things, take
        self.broken: list[str] = []
        """What is wrong with those that could not be loaded, in words."""
        self._asked = False

    def load(self) -> None:
        """Load what has not been loaded."""
        if self._asked:
            return
        self._asked = True  # at once: what is loaded may ask for names itself
        for entry in sorted(entry_points(group=self.group), key=lambda entry: entry.name):
            try:
                brought = load_entry_point(entry)
                if not isinstance(brought, types.ModuleType):
                    self.take(brought)
            except (Exception, SystemExit) as error:
                words = f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0]}"
                named = f"the {self.things} of the entry point {entry.name} ({entry.value})"
                self.broken.append(f"{named} cannot be loaded: {words}")
                warnings.warn(self.broken[-1], RuntimeWarning, stacklevel=2)
