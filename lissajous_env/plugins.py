"""Load objects of users and other packages: `module:attribute`, also from the current folder, and entry points."""

import contextlib
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

from lissajous_env.wording import nearest, where_raised


def import_attribute(reference: str, rule: str) -> Any:
    """Import `module:attribute`, also from the current folder.

    Args:
        reference: Module and attribute, such as `my_module:mine` or `package.module:Class.method`.
        rule: Start of the error message.

    Raises:
        ValueError: the object cannot be loaded; the message contains the reason and the line.
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
    """Import a module, also from the current folder, which is searched last."""
    search_current_folder()
    return importlib.import_module(module)


def search_current_folder() -> None:
    """Let imports search the current folder after all others, so that it hides no installed package."""
    with contextlib.suppress(OSError):  # the folder was removed
        if not {"", os.getcwd()} & set(sys.path):
            sys.path.append(os.getcwd())


class EntryPoints:
    """Objects of other packages in a group of entry points, loaded on first use.

    An entry point that cannot be loaded causes a warning; the others are loaded all the same.

    Args:
        group: Name of the group.
        things: Kind of the objects, for messages.
        register: Function called with each object in the order of the names; modules are only imported.
    """

    def __init__(self, group: str, things: str, register: Callable[[Any], Any]):
        self.group, self.things, self.register = group, things, register
        self.broken: list[str] = []
        """Messages for entry points that could not be loaded."""
        self._asked = False

    def load(self) -> None:
        """Load the entry points, once."""
        if self._asked:
            return
        self._asked = True  # at once, since loaded code may look up names
        for entry in sorted(entry_points(group=self.group), key=lambda entry: entry.name):
            try:
                brought = entry.load()
                if not isinstance(brought, types.ModuleType):
                    self.register(brought)
            except (Exception, SystemExit) as error:
                words = f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0]}"
                named = f"the {self.things} of the entry point {entry.name} ({entry.value})"
                self.broken.append(f"{named} cannot be loaded: {words}")
                warnings.warn(self.broken[-1], RuntimeWarning, stacklevel=2)
