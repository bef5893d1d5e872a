"""Objects with Warp arrays that can be copied and pickled at any time: made anew, then filled from the original.

Structs, devices and recorded launches of Warp can be neither copied nor pickled. So a copy is constructed like the
original, by its class with the same arguments, and thereby has Warp objects of its own. Then everything else is copied
from the original: the contents of Warp arrays, and other attributes by value. Functions, work, and objects that only
Warp can create are left as constructed.
"""

import ctypes
import functools
import types
from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.by_value import PROMPT, ByValue
from lissajous_env.device.work import Work
from lissajous_env.wording import few_of

_AS_MADE = (
    types.FunctionType, types.BuiltinFunctionType, types.MethodType, types.ModuleType, type, functools.partial, Work
)  # fmt: skip
_MADE_WITH = "_made_with"


class Copyable:
    """Base class of objects that `copy.deepcopy` and `pickle` copy as described above, without code in subclasses."""

    def __new__(cls, *args: Any, **more: Any) -> Any:
        """Keep the arguments, with which a copy is made again."""
        made = super().__new__(cls)
        # A device is not picklable, its name is.
        named = [[str(each) if isinstance(each, wp.Device) else each for each in values]
                 for values in (args, more.values())]  # fmt: skip
        made.__dict__[_MADE_WITH] = tuple(named[0]), dict(zip(more, named[1], strict=True))
        return made

    def save_state(self) -> dict[str, np.ndarray]:
        """Copy every array of the object to the host, by name."""
        return {name: np.array(array.numpy() if _is_warp_array(array) else array) for name, array in _arrays(self)}

    def load_state(self, saved: dict[str, np.ndarray]) -> None:
        """Restore what `save_state` returned, in an object that was made alike.

        Raises:
            ValueError: an array is missing, unknown, or has another shape or type; nothing has changed then.
        """
        own = dict(_arrays(self))
        for name, array in own.items():
            wanted = array.numpy() if _is_warp_array(array) else array
            got = f"shape {saved[name].shape} of {saved[name].dtype}" if name in saved else "none"
            if got != f"shape {wanted.shape} of {wanted.dtype}":
                raise ValueError(
                    f"saved state must contain {name} of shape {wanted.shape} of {wanted.dtype}, got {got}"
                )
        if unknown := sorted(saved.keys() - own.keys()):
            raise ValueError(
                f"saved state must contain only the arrays of {type(self).__name__}, got {few_of(unknown)}"
            )
        for name, array in own.items():
            if _is_warp_array(array):
                array.assign(saved[name])
            else:
                np.copyto(array, saved[name])

    def __reduce__(self) -> tuple:
        args, more = self.__dict__[_MADE_WITH]
        cls = ByValue(type(self)) if type(self).__module__ in PROMPT else type(self)
        return _make_again, (cls, args, more), _contents(self)

    def __setstate__(self, contents: dict[Any, Any]) -> None:
        _fill(self, contents, type(self).__name__)


class _Array(np.ndarray):
    """Content of a Warp array."""


class _Part(dict):
    """Contents of an object that contains objects of Warp."""


def _make_again(cls: type, args: tuple, more: dict[str, Any]) -> Any:
    return cls(*args, **more)


def _contents(owner: Any, within: tuple[int, ...] = ()) -> _Part:
    """Return the contents of an object, list, tuple or dict, without those that the original's class creates."""
    held = _Part()
    for key, value in _entries(owner):
        if _is_warp_array(value):
            held[key] = value.numpy().copy().view(_Array)
        elif isinstance(value, Copyable) or not _needs_making(value):
            held[key] = value
        elif not _stays(value) and id(value) not in within:
            held[key] = _contents(value, (*within, id(owner)))
    return held


def _fill(owner: Any, contents: dict[Any, Any], name: str) -> None:
    """Give an object that was made anew the contents of the original."""
    made = dict(_entries(owner))
    for key, value in contents.items():
        current: Any = made.get(key)
        if isinstance(value, _Array):
            if not _is_warp_array(current) or current.numpy().shape != value.shape:
                raise TypeError(
                    f"{name} must make {key}, a Warp array of shape {value.shape}, in __init__ to be copied"
                )
            current.assign(np.asarray(value))
        elif isinstance(value, _Part):
            if type(current).__module__ == "builtins" and not isinstance(current, (list, tuple, dict)):
                raise TypeError(f"{name} must make {key}, which contains objects of Warp, in __init__ to be copied")
            _fill(current, value, f"{name}.{key}")
        elif isinstance(value, np.ndarray) and isinstance(current, np.ndarray) and _can_take(current, value):
            np.copyto(current, value)  # it may be a view of a Warp array
        elif isinstance(owner, (list, dict)):
            owner[key] = value
        elif not isinstance(owner, tuple):
            setattr(owner, key, value)


def _arrays(owner: Any, prefix: str = "", within: tuple[int, ...] = ()) -> Iterator[tuple[str, Any]]:
    """Return, by name, the arrays of an object and of its contents that can change while it works."""
    for key, value in sorted(_entries(owner), key=lambda entry: str(entry[0])):
        if isinstance(value, (wp.array, np.ndarray)):
            yield f"{prefix}{key}", value
        elif id(value) not in within and (isinstance(value, Copyable) or _needs_making(value)):
            yield from _arrays(value, f"{prefix}{key}.", (*within, id(owner)))


def _entries(owner: Any) -> list[tuple[Any, Any]]:
    if isinstance(owner, (list, tuple)):
        return list(enumerate(owner))
    held = owner if isinstance(owner, dict) else getattr(owner, "__dict__", {})
    return [] if _stays(owner) else [(key, value) for key, value in held.items() if key != _MADE_WITH]


def _needs_making(value: Any, within: tuple[int, ...] = ()) -> bool:
    """Return whether a value is Warp's, a function, or contains one."""
    if _is_warp_array(value) or _stays(value):
        return True
    if isinstance(value, np.ndarray) or id(value) in within:
        return False
    copies_itself = type(value).__reduce__ is not object.__reduce__
    if copies_itself and not isinstance(value, (Copyable, list, tuple, dict)):
        return False
    return any(_needs_making(each, (*within, id(value))) for _, each in _entries(value))


def _stays(value: Any) -> bool:
    if isinstance(value, _AS_MADE):
        return True
    of_warp = type(value).__module__.partition(".")[0] == "warp"
    return of_warp and not isinstance(value, (wp.array, ctypes.Array))  # vectors and matrices are values


def _is_warp_array(value: Any) -> bool:
    return isinstance(value, wp.array)


def _can_take(current: np.ndarray, value: np.ndarray) -> bool:
    return current.shape == value.shape and current.dtype == value.dtype and current.flags.writeable
