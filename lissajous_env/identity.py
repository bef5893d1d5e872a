"""Identify code by its sources and the values that it uses, so that results of different code are never mixed.

A name does not suffice: the source of a module changes, and so do values that a function has captured. `parts_of`
returns parts by name, each with a short value or a digest, which are the same in every process.
"""

import ast
import contextlib
import dataclasses
import functools
import hashlib
import importlib.util
import inspect
import sys
import sysconfig
import types
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

OURS = ("lissajous_env", "baselines", "training")
"""Packages of this distribution, identified by their version."""
MODULE = "module "
"""Prefix of the names of parts that are the source of a module."""
_PLAIN = (str, int, float, complex, bool, bytes, type(None))
_LONGEST = 40


def parts_of(value: Any) -> dict[str, str]:
    """Return the parts of a function, class, partial, Warp kernel or other object, which determine its behaviour.

    The parts of a module are its source and those of the modules that it imports, unless installed. A function in a
    script or at a prompt has its own source and the objects to which it refers. Values in closures, defaults, partials
    and attributes are added. Objects of libraries have only arrays and `state_dict`.
    """
    parts: dict[str, str] = {}
    _collect(value, "", parts, ())
    return parts


def _collect(value: Any, at: str, parts: dict[str, str], within: tuple[int, ...]) -> None:
    """Add the parts of a value; their names begin with `at`."""
    if id(value) in within:
        return
    within = (*within, id(value))
    if isinstance(value, functools.partial):
        _collect(value.func, at, parts, within)
        values = {f"argument {k}": each for k, each in enumerate(value.args)} | value.keywords
    elif isinstance(value, types.MethodType):
        _collect(value.__self__, at, parts, within)
        values = {"method": value.__func__}
    elif isinstance(value, types.ModuleType):
        values = _sources(value)
    elif isinstance(function := getattr(value, "func", value), types.FunctionType):  # that of a Warp kernel
        values = _code(function, parts, at) | _captured(function)
    elif isinstance(value, type):
        values = _class(value, parts, at)
    elif isinstance(value, _PLAIN):
        values = {"": value}
    elif callable(value) and hasattr(value, "__name__"):  # of a library
        values = {"": f"{_module_of(value)}:{value.__name__}"}
    else:
        values = _class(type(value), parts, at) | _state(value)
    for name, each in values.items():
        place = f"{at} {name}".strip() if not name.startswith(MODULE) else name
        if _has_parts(each):
            _collect(each, place, parts, within)
        else:
            parts[place] = _short(each, within)


def _has_parts(value: Any) -> bool:
    return not isinstance(value, _PLAIN) and (callable(value) or _is_own(_module_of(type(value))))


def _module_of(value: Any) -> str:
    try:
        return str(getattr(value, "__module__", ""))
    except Exception:  # lazily loaded modules
        return ""


def _class(cls: type, parts: dict[str, str], at: str) -> dict[str, Any]:
    """Return the sources of a class, the values captured by its methods, and its attributes."""
    found = _code(cls, parts, at)
    if _module_of(cls).partition(".")[0] in OURS or not _is_own(_module_of(cls)):
        return found
    for function in _functions(cls):
        found |= {f"{function.__name__} {name}": each for name, each in _captured(function).items() if each is not cls}
    plain = {name: each for name, each in vars(cls).items() if name[0] != "_" and isinstance(each, _PLAIN)}
    bases = [base for base in cls.__bases__ if _is_own(_module_of(base))]
    return found | plain | {f"base {base.__name__}": base for base in bases}


def _code(made: Any, parts: dict[str, str], at: str) -> dict[str, Any]:
    """Return the sources of a function or class, and add its name to the parts."""
    place, module = _module_of(made), sys.modules.get(_module_of(made))
    parts[f"{at} code".strip()] = f"{place}:{made.__qualname__}"
    if place.partition(".")[0] in OURS or (isinstance(made, type) and module is not None and _is_installed(module)):
        return {}
    if module is not None and place != "__main__" and getattr(module, "__file__", None):
        return _sources(module)
    functions = [made] if isinstance(made, types.FunctionType) else _functions(made)
    named = {name: each for function in functions for name, each in _globals(function).items()}
    return {"source": _source(made, functions)} | {f"global {name}": named[name] for name in sorted(named)}


def _sources(module: types.ModuleType) -> dict[str, Any]:
    """Return digests of the sources of a module and of the imported modules that are not installed."""
    found, waiting = {}, [(module.__name__, str(module.__file__))]
    while waiting:
        name, file = waiting.pop()
        if MODULE + name in found or not Path(file).is_file():
            continue
        source = Path(file).read_bytes()
        found[MODULE + name] = _digest(source)
        waiting += [(each, file) for each in _imports(source, name) if (file := _own_file(each))]
    return dict(sorted(found.items()))


def _imports(source: bytes, module: str) -> set[str]:
    """Return the names of the modules that a module may import."""
    try:
        nodes = list(ast.walk(ast.parse(source)))
    except (SyntaxError, ValueError):  # not Python source
        return set()
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            base = module.split(".")[: -node.level] if node.level else []
            origin = ".".join([*base, *(node.module or "").split(".")]).strip(".")
            names |= {origin, *(f"{origin}.{alias.name}" for alias in node.names)}
    return names


def _own_file(module: str) -> str:
    """Return the file of a module of the user, or "" for other modules."""
    top = module.partition(".")[0]
    with contextlib.suppress(Exception):  # missing, or not found without importing it
        there = importlib.util.find_spec(top)
        if top not in OURS and there is not None and there.has_location and not _is_in_libraries(str(there.origin)):
            return str(getattr(importlib.util.find_spec(module), "origin", ""))
    return ""


def _is_own(module: str) -> bool:
    """Return True for the name of a module of the user, which is neither ours nor installed."""
    there = sys.modules.get(module)
    return there is not None and module.partition(".")[0] not in OURS and not _is_installed(there)


def _is_installed(module: types.ModuleType) -> bool:
    if module.__name__ == "__main__":
        return False
    file = getattr(module, "__file__", None)
    return not file or _is_in_libraries(file)


def _is_in_libraries(file: str) -> bool:
    return any(Path(file).is_relative_to(folder) for folder in _installed())


@functools.cache
def _installed() -> tuple[str, ...]:
    return tuple({sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")})


def _source(made: Any, functions: Iterable[types.FunctionType]) -> str:
    """Return a digest of the source of a function or class, or of its code if there is no source."""
    try:
        return _digest(inspect.getsource(made).encode())
    except (OSError, TypeError):
        return _digest(repr([_instructions(function.__code__) for function in functions]).encode())


def _instructions(code: types.CodeType) -> tuple:
    constants = [
        _instructions(each) if isinstance(each, types.CodeType) else _text(each, ()) for each in code.co_consts
    ]
    return code.co_code, constants, code.co_names, code.co_varnames


def _functions(cls: type) -> list[types.FunctionType]:
    made = (getattr(each, "__func__", each) for each in vars(cls).values())
    return [each for each in made if isinstance(each, types.FunctionType)]


def _globals(function: types.FunctionType) -> dict[str, Any]:
    """Return the globals that a function uses: plain values and objects of the user."""
    names = {name for code in _codes(function.__code__) for name in code.co_names}
    there = {name: function.__globals__[name] for name in names if name in function.__globals__}
    return {
        name: each
        for name, each in there.items()
        if isinstance(each, (*_PLAIN, tuple, list, dict, np.ndarray)) or _is_own(_module_of(each))
    }


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    yield code
    for each in code.co_consts:
        if isinstance(each, types.CodeType):
            yield from _codes(each)


def _captured(function: types.FunctionType) -> dict[str, Any]:
    """Return the values of a function's closure and defaults by name."""
    found: dict[str, Any] = {}
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        try:
            found[name] = cell.cell_contents
        except ValueError:  # not assigned yet
            found[name] = None
    names = function.__code__.co_varnames[: function.__code__.co_argcount]
    defaults = function.__defaults__ or ()
    return (
        found | dict(zip(names[len(names) - len(defaults) :], defaults, strict=True)) | (function.__kwdefaults__ or {})
    )


def _state(value: Any) -> dict[str, Any]:
    """Return the attributes that determine the behaviour of an object."""
    held = getattr(value, "__dict__", {})
    if made_with := held.get("_made_with"):  # its memory changes during an episode
        public = {name: each for name, each in held.items() if name[0] != "_" and isinstance(each, _PLAIN)}
        return {f"argument {k}": each for k, each in enumerate(made_with[0])} | dict(made_with[1]) | public
    if callable(weights := getattr(value, "state_dict", None)):
        return {"weights": weights()}
    if dataclasses.is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if _is_own(_module_of(type(value))):
        derived = inspect.getmembers_static(type(value), lambda each: isinstance(each, functools.cached_property))
        return {name: each for name, each in held.items() if name not in dict(derived)}
    if _module_of(type(value)).partition(".")[0] in OURS:
        return {name: each for name, each in held.items() if callable(each)}
    return {name: each for name, each in held.items()
            if name[0] != "_" and (_is_array(each) or hasattr(each, "state_dict"))}  # fmt: skip


def _short(value: Any, within: tuple[int, ...]) -> str:
    text = value if isinstance(value, str) else _text(value, within)
    return text if len(text) <= _LONGEST and text.isprintable() else _digest(text.encode(errors="replace"))


def _text(value: Any, within: tuple[int, ...]) -> str:
    """Return a text for a value that is the same in every process."""
    if isinstance(value, _PLAIN):
        return repr(value)
    if id(value) in within:
        return "..."
    within = (*within, id(value))
    if isinstance(value, Mapping):
        return f"{{{', '.join(sorted(f'{_text(k, within)}: {_text(v, within)}' for k, v in value.items()))}}}"
    if isinstance(value, (set, frozenset)):
        return f"{{{', '.join(sorted(_text(each, within) for each in value))}}}"
    if isinstance(value, (list, tuple)):
        return f"({', '.join(_text(each, within) for each in value)})"
    if _is_array(value):
        array = np.asarray(value.detach().cpu() if hasattr(value, "detach") else value)
        return f"{array.dtype} {array.shape} {_digest(np.ascontiguousarray(array).tobytes())}"
    parts: dict[str, str] = {}
    _collect(value, "", parts, within[:-1])
    return repr(sorted(parts.items()))


def _is_array(value: Any) -> bool:
    return isinstance(value, (np.ndarray, np.generic)) or (hasattr(value, "detach") and hasattr(value, "numpy"))


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]
