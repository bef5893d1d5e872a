"""Find names in the current folder: modules that register them, and files.

Modules are read as text, and imported only if the requested name is registered there. The name must be a literal, as in
`register("my-policy")` or `Scenario(name="my-scenario")`.
"""

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lissajous_env.plugins import import_module
from lissajous_env.wording import where_raised


def load_module_of(name: str, thing: str, *functions: str) -> None:
    """Import the module in the current folder that registers a name, if there is one.

    Args:
        name: The name. `my-method-mpcc` may also result from the registration of `my-method`.
        thing: Kind of the named object, for messages.
        functions: Names of the registering functions.

    Raises:
        ValueError: the module cannot be imported.
    """
    starts = {name, *(name[:k] for k, letter in enumerate(name) if letter == "-")}
    for registered, module in registered_here(*functions):
        if registered in starts:
            try:
                import_module(module)
            except (Exception, SystemExit) as error:
                rule = f"{thing} {name} must be registered by a module that can be imported"
                raise ValueError(f"{rule}, got {module}.py: {where_raised(error)}") from error


def registered_here(*functions: str) -> Iterator[tuple[str, str]]:
    """Yield the names that modules in the current folder register with these functions, each with its module."""
    calls = rf"\b(?:{'|'.join(functions)})\("
    for path in _entries():
        source = ""
        if path.suffix == ".py":
            with contextlib.suppress(OSError):  # a file that cannot be read
                source = path.read_text(encoding="utf-8", errors="replace")
        if re.search(calls, source):
            for name in re.findall(rf"""(?:{calls}|\bname=)\s*["']([\w.-]+)["']""", source):
                yield name, path.stem


def beside(name: Any, suffix: str) -> list[str]:
    """Return the files with a suffix in the folder of a path, which for a mere name is the current folder."""
    return [str(path) for path in _entries(name) if path.suffix == suffix and path.is_file()]


def folders_beside(name: Any, file: str) -> list[str]:
    """Return the folders beside a path that contain a file of some name."""
    return [str(path) for path in _entries(name) if (path / file).is_file()]


def _entries(name: Any = "") -> list[Path]:
    try:
        return sorted(Path(name).parent.iterdir())
    except (OSError, ValueError, TypeError):  # missing or unreadable folder
        return []
