"""Objects of users and other packages: how they are imported, registered and sent to other processes.

They are imported by `module:attribute`, by entry points, or with a module of which they register a name.
"""

import contextlib
import functools
import importlib
import os
import re
import sys
import types
import warnings
from collections.abc import Callable, Container
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import cloudpickle

from lissajous_env.wording import nearest, require, shown, where_raised

PROMPT = "__main__", "__mp_main__"
"""Modules that are other ones in other processes."""


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
            raise ValueError("a module and an attribute must stand around a colon")
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


def beside(name: Any, suffix: str) -> list[str]:
    """Return the files with a suffix in the folder of a path, which for a mere name is the current folder."""
    try:
        paths = sorted(Path(name).parent.iterdir())
    except (OSError, ValueError, TypeError):  # missing or unreadable folder
        return []
    return [str(path) for path in paths if path.suffix == suffix and path.is_file()]


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
    is_name = isinstance(name, str) and re.fullmatch(pattern, name)
    require(is_name, f"name of a {thing}", f"must be {rule}", name)
    if name in taken or (registry.get(name, new) != new and not replaces):
        raise ValueError(f"name of a {thing} must be new, got {shown(name)}, which another one has")
    registry[name] = new


def is_notebook() -> bool:
    """Return True in a notebook or at a prompt, where a cell that is run again registers its objects anew."""
    return hasattr(sys, "ps1")  # IPython sets it too


class ByValue:
    """Wrapper of a function or class that is itself again after unpickling, also where it cannot be imported.

    What modules define is only named. A process without these modules cannot unpickle it.
    """

    def __init__(self, value: Any):
        self.value = value

    def __reduce__(self) -> tuple:
        return cloudpickle.loads, (cloudpickle.dumps(self.value),)


def replaces(new: Any, old: Any) -> bool:
    """Return whether an object at a prompt, or in a notebook, is a new version of another: it has the same full name.

    A cell that is run again defines its functions and classes anew.
    """
    names = [(getattr(version, "__module__", None), getattr(version, "__qualname__", None)) for version in (new, old)]
    return names[0] == names[1] and names[0][0] in PROMPT and names[0][1] is not None


class MissingExtraError(ValueError, ImportError):
    """Error for missing libraries of an extra; the message explains how to install them."""


def of_extra(module: str, what: str, extra: str) -> Any:
    """Return a module of the libraries of an extra, which something requires.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise missing(what, extra, error) from error


def missing(what: str, extra: str, error: ImportError) -> MissingExtraError:
    """Return the error that names the extra to install."""
    return MissingExtraError(
        f'{what} requires the libraries of the extra {extra} ({error}): pip install ".[{extra}]" in a checkout, '
        f'pip install "lissajous-env[{extra}]" elsewhere'
    )
