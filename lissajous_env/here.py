"""Find names in the current folder: modules that register them, and files.

Modules are parsed, and imported only if the requested name is registered there. The name must be a literal, as in
`register("my-policy")` or `Scenario(name="my-scenario")`.
"""

import ast
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from lissajous_env.plugins import import_module
from lissajous_env.wording import where_raised

_LARGEST = 1 << 20
"""Limit on the size of a parsed module [bytes]."""
_MOST = 1000
"""Limit on the number of files in the folder."""


def load_module_of(name: str, thing: str, *functions: str) -> None:
    """Import the module in the current folder that registers a name, if there is one.

    Args:
        name: The name. `my-method-mpcc` may also result from the registration of `my-method`.
        thing: Kind of the named object, for messages.
        functions: Names of the registering functions.

    Raises:
        ValueError: the module cannot be imported.
    """
    begun = {name, *(name[:k] for k, letter in enumerate(name) if letter == "-")}
    for given, module in registered_here(*functions):
        if given in begun:
            try:
                import_module(module)
            except (Exception, SystemExit) as error:
                rule = f"{thing} {name} must be registered by a module that can be imported"
                raise ValueError(f"{rule}, got {module}.py: {where_raised(error)}") from error


def registered_here(*functions: str) -> Iterator[tuple[str, str]]:
    """Yield the names that modules in the current folder register with these functions, each with its module."""
    for path in _entries():
        try:
            source = path.read_text(encoding="utf-8") if path.suffix == ".py" and path.stat().st_size < _LARGEST else ""
            calls = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)]
        except (OSError, ValueError, SyntaxError, RecursionError, MemoryError):
            continue
        if any(_name_of(call) in functions for call in calls):
            for call in calls:
                words = [word.value for word in call.keywords if word.arg == "name"]
                words += call.args[:1] if _name_of(call) in functions else []
                for word in words:
                    if isinstance(word, ast.Constant) and isinstance(word.value, str):
                        yield word.value, path.stem


def beside(name: Any, suffix: str) -> list[str]:
    """Return the files with a suffix in the folder of a path, which for a mere name is the current folder."""
    return [str(path) for path in _entries(name) if path.suffix == suffix and path.is_file()]


def folders_beside(name: Any, file: str) -> list[str]:
    """Return the folders beside a path that contain a file of some name."""
    return [str(path) for path in _entries(name) if (path / file).is_file()]


def _entries(name: Any = "") -> list[Path]:
    try:
        return sorted(islice(Path(name).parent.iterdir(), _MOST))
    except (OSError, ValueError, TypeError):  # missing or unreadable folder
        return []


def _name_of(call: ast.Call) -> str:
    """Return the name of the called function, without its module."""
    function = call.func
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
