"""What the current folder holds that a user may mean by a name: modules that register it, and files.

Modules are read, not run, until a name that one of them registers is asked for. A name has to be written there, as in
`register("my-policy")` or `Scenario(name="my-scenario")`; one that a program makes up is not found.
"""

import ast
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from lissajous_env.plugins import import_module
from lissajous_env.wording import where_raised

_LARGEST = 1 << 20
"""Size of a module that is read [bytes]."""
_MOST = 1000
"""Files of the folder that are looked at."""


def load_module_of(name: str, thing: str, *functions: str) -> None:
    """Import the module of the current folder that registers a name, if there is one.

    Args:
        name: What was asked for. `my-method-mpcc` may also be what the registration of `my-method` brings.
        thing: What it names, as messages call it.
        functions: Names of the functions that register such things.

    Raises:
        ValueError: the module cannot be imported; the message says why.
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
    """Names that modules of the current folder register with functions of these names, each with its module's."""
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
    """Files with a suffix in the folder of a path that a user gave, the current one for a mere name."""
    return [str(path) for path in _entries(name) if path.suffix == suffix and path.is_file()]


def folders_beside(name: Any, file: str) -> list[str]:
    """Folders that hold a file of some name, beside a path that a user gave."""
    return [str(path) for path in _entries(name) if (path / file).is_file()]


def _entries(name: Any = "") -> list[Path]:
    try:
        return sorted(islice(Path(name).parent.iterdir(), _MOST))
    except (OSError, ValueError, TypeError):  # there is no such folder, or it must not be read
        return []


def _name_of(call: ast.Call) -> str:
    """Name of the function that is called, without that of its module."""
    function = call.func
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
