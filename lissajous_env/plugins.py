"""Objects of users and other packages: how they are imported, registered and sent to other processes.

They are imported by `module:attribute`, by entry points, or with a module of which they register a name.
"""

import contextlib
import functools
import importlib
import os
import re
import sys
import threading
import types
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Self

import cloudpickle

from lissajous_env.wording import nearest, require, shown, where_raised

MAIN_MODULES = "__main__", "__mp_main__"
"""Names of the main module, which is another module in another process."""


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


class Registry(dict[str, Any]):
    """Objects of one kind by name: those of this package, of its users, and of other packages.

    Args:
        kind: Kind of the objects, for messages.
        names: Regular expression of valid names, and the rule in words.
        is_included: Function that returns True for the objects of this package.
        group: Group of the entry points by which other packages add objects; empty for none.
        bring: Function called with the object of each entry point in the order of the names, unless it is a module,
            which is only imported.
    """

    def __init__(
        self,
        kind: str,
        names: tuple[str, str],
        is_included: Callable[[Any], bool],
        group: str = "",
        bring: Callable[[Any], Any] = lambda function: function(),
    ):
        super().__init__()
        self.kind, self.is_included, self.group = kind, is_included, group
        self.broken: list[str] = []
        """Messages for entry points that could not be loaded."""
        self._names, self._bring, self._loaded = names, bring, not group
        self._loading: set[int] = set()

    def add(self, new: Any) -> Any:
        """Add an object under its attribute `name`, and return it; in a notebook, it may replace another one.

        Raises:
            ValueError: the name is invalid, or a different object has it that cannot be replaced.
        """
        name, (pattern, rule) = new.name, self._names
        is_name = isinstance(name, str) and re.fullmatch(pattern, name)
        require(is_name, f"name of a {self.kind}", f"must be {rule}", name)
        before = self.get(name, new)
        if before != new and (not hasattr(sys, "ps1") or self.is_included(before)):  # IPython sets it too
            raise ValueError(f"name of a {self.kind} must be new, got {shown(name)}, which another one has")
        self[name] = new
        return new

    def load(self) -> Self:
        """Load the entry points, once; one that cannot be loaded causes a warning. Return the registry.

        A thread that needs them while another one loads them loads them, too, which registers the same objects.
        """
        thread = threading.get_ident()
        if self._loaded or thread in self._loading:  # loaded code may look up names
            return self
        self._loading.add(thread)
        for entry in sorted(entry_points(group=self.group), key=lambda entry: entry.name):
            try:
                brought = entry.load()
                if not isinstance(brought, types.ModuleType):
                    self._bring(brought)
            except (Exception, SystemExit) as error:
                words = f"{type(error).__name__}: {str(error).strip().partition(chr(10))[0]}"
                self.broken.append(f"the entry point {entry.name} ({entry.value}) cannot be loaded: {words}")
                warnings.warn(self.broken[-1], RuntimeWarning, stacklevel=2)
        self._loading.discard(thread)
        self._loaded = True
        return self

    def unknown(self, name: Any, command: str, known: Collection[str], others: Iterable[str] = ()) -> ValueError:
        """Return the error for a name that is not one of the known ones, which a command lists.

        It suggests similar known names and `others`, and contains the entry points that could not be loaded.
        """
        rule = f"{self.kind} must be one of the {len(known)} that `lissajous {command}` lists"
        return ValueError("; ".join([f"{rule}, got {shown(name)}{nearest(name, [*known, *others])}", *self.broken]))


def files_beside(name: Any, suffix: str) -> list[str]:
    """Return the files with a suffix in the folder of a path, which for a mere name is the current folder."""
    try:
        paths = sorted(Path(name).parent.iterdir())
    except (OSError, ValueError, TypeError):  # missing or unreadable folder
        return []
    return [str(path) for path in paths if path.suffix == suffix and path.is_file()]


class ByValue:
    """Wrapper of a function or class that is itself again after unpickling, also where it cannot be imported.

    What modules define is only named. A process without these modules cannot unpickle it.
    """

    def __init__(self, value: Any):
        self.value = value

    def __reduce__(self) -> tuple:
        return cloudpickle.loads, (cloudpickle.dumps(self.value),)


class MissingExtraError(ValueError, ImportError):
    """Error for missing libraries of an extra; the message explains how to install them."""


@contextlib.contextmanager
def requiring(what: str, extra: str) -> Iterator[None]:
    """Let imports in a block, which something requires, raise an error that names the extra of their libraries.

    Raises:
        MissingExtraError: one of them is not installed.
    """
    try:
        yield
    except ImportError as error:
        raise MissingExtraError(
            f'{what} requires the libraries of the extra {extra} ({error}): pip install ".[{extra}]" in a checkout, '
            f'pip install "lissajous-env[{extra}]" elsewhere'
        ) from error


def of_extra(module: str, what: str, extra: str) -> Any:
    """Return a module of the libraries of an extra; see `requiring`."""
    with requiring(what, extra):
        return importlib.import_module(module)
