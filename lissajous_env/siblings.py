"""Import the packages `baselines` and `training` of this distribution even if modules of the user hide them.

If a user's own `training/` or `baselines.py` precedes them on the path or is already imported, the packages are
imported as `lissajous_env.siblings.baselines` and `lissajous_env.siblings.training`, and import statements inside them
are redirected. Otherwise they have their plain names.
"""

import builtins
import importlib
import importlib.util
import inspect
import sys
import types
import warnings
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

NAMES = "baselines", "training"
PARENT = Path(__file__).resolve().parents[1]
"""Folder of the packages."""

__path__: list[str] = []  # makes this module a package, with the finder below
_first: list[str] = []
"""Folders that are searched first for modules of the user."""


def is_ours(file: str) -> bool:
    """Return True if a file belongs to one of our packages."""
    path = Path(file).resolve()
    return any(path.is_relative_to(PARENT / name) for name in ("lissajous_env", *NAMES))


def look_first_in(folder: str) -> None:
    """Treat a folder as the first on the path when looking for modules of the user."""
    _first.append(folder)


def import_ours(name: str) -> types.ModuleType:
    """Import our module of `baselines` or `training`, such as "training.sb3", even if another one has its name.

    Raises:
        ValueError: the name belongs to another package.
        ImportError: the module is missing, or requires a library that is not installed.
    """
    top = name.partition(".")[0]
    if top not in NAMES:
        raise ValueError(f"name must be of a module of {' or '.join(NAMES)}, got {name!r}")
    return importlib.import_module(f"{__name__}.{name}" if _is_hidden(top) else name)


def load_entry_point(entry: EntryPoint) -> Any:
    """Load the object of an entry point; entry points of this distribution load our packages."""
    if entry.module.partition(".")[0] not in NAMES or entry.dist is None or entry.dist.name != "lissajous-env":
        return entry.load()
    module = import_ours(entry.module)
    return getattr(module, entry.attr) if entry.attr else module


def _is_hidden(top: str) -> bool:
    # Our `training` would import the other `baselines`.
    return _hides(top) or (top == "training" and _hides("baselines"))


@cache
def _hides(top: str) -> bool:
    """Return True if another module has the name of one of our packages, and warn once."""
    path = sys.path
    try:
        sys.path = [*_first, *path]
        spec = importlib.util.find_spec(top)
    except ValueError:  # a module without a spec
        spec = None
    finally:
        sys.path = path
    places = [] if spec is None else [spec.origin, *(spec.submodule_search_locations or ())]
    there = [place for place in places if place is not None]
    if there and is_ours(there[0]):
        return False
    if there:
        words = f"{there[0]} hides the package {top} of lissajous-env ({PARENT / top}): `import {top}` imports yours"
        _warn(f'{words}, lissajous_env.import_ours("{top}") imports ours')
    return True


def _warn(words: str) -> None:
    """Issue a warning that points to the user's code."""
    level, frame = 1, inspect.currentframe()
    while frame is not None and (is_ours(frame.f_code.co_filename) or "importlib" in frame.f_code.co_filename):
        level, frame = level + 1, frame.f_back
    warnings.warn(words, RuntimeWarning, stacklevel=level)


class _Finder(MetaPathFinder):
    """Import finder for our packages below the name of this module."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: types.ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the spec of a module, with a loader that redirects its imports."""
        above, _, last = name.rpartition(".")
        if not name.startswith(f"{__name__}.") or (above == __name__ and last not in NAMES):
            return None
        spec = PathFinder.find_spec(name, [str(PARENT)] if above == __name__ else path)
        if spec is not None and spec.origin is not None and spec.origin.endswith(".py"):
            spec.loader = _Loader(name, spec.origin)
        return spec


class _Loader(SourceFileLoader):
    """Loader of modules whose imports of `baselines` and `training` are redirected to ours."""

    def exec_module(self, module: types.ModuleType) -> None:
        """Run the module."""
        vars(module)["__builtins__"] = vars(builtins) | {"__import__": _import}
        super().exec_module(module)


def _import(
    name: str,
    globals: Mapping[str, Any] | None = None,
    locals: Mapping[str, Any] | None = None,
    fromlist: Sequence[str] | None = (),
    level: int = 0,
) -> types.ModuleType:
    """Replace `__import__` in our modules."""
    top = name.partition(".")[0]
    if level > 0 or top not in NAMES or not _is_hidden(top):
        return builtins.__import__(name, globals, locals, fromlist or (), level)
    module = builtins.__import__(f"{__name__}.{name}", globals, locals, fromlist or ("__name__",))
    return module if fromlist else sys.modules[f"{__name__}.{top}"]


sys.meta_path.insert(0, _Finder())  # before the standard finder, which would not redirect imports
