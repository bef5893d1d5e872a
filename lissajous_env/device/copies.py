"""Objects with Warp arrays that can be copied and pickled at any time: made anew, then filled from the original.

Structs, devices and recorded launches of Warp can be neither copied nor pickled. So a copy is constructed like the
original, by its class with the same arguments, and thereby has Warp objects of its own. Then it receives the arrays of
the original, and other attributes by value, unless they contain an object that only Warp can create.
"""

import ctypes
import functools
import types
from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.locks import Turn
from lissajous_env.device.program import Program
from lissajous_env.device.warp_abi import fields_of, is_struct
from lissajous_env.device.work import Work
from lissajous_env.plugins import MAIN_MODULES, ByValue
from lissajous_env.wording import few_of

_OPAQUE = (
    types.FunctionType, types.BuiltinFunctionType, types.MethodType, types.ModuleType, type, functools.partial, Program,
    Turn, Work,
)  # fmt: skip
_ARGUMENTS = "_constructed_with"


class Stateful:
    """Base class of objects whose arrays can be saved and restored, with those of their parts."""

    def save_state(self) -> dict[str, np.ndarray]:
        """Copy every array of the object to the host, by name."""
        return {
            name: np.array(array.numpy() if isinstance(array, wp.array) else array) for name, array in _arrays(self)
        }

    def load_state(self, saved: dict[str, np.ndarray]) -> None:
        """Restore what `save_state` returned, in an object that was made alike.

        Raises:
            ValueError: an array is missing, unknown, or has another shape or type; nothing has changed then.
        """
        own = dict(_arrays(self))
        for name, array in own.items():
            values = array.numpy() if isinstance(array, wp.array) else array
            wanted = f"shape {values.shape} of {values.dtype}"
            got = f"shape {saved[name].shape} of {saved[name].dtype}" if name in saved else "none"
            if got != wanted:
                raise ValueError(f"saved state must contain {name} of {wanted}, got {got}")
        if unknown := sorted(saved.keys() - own.keys()):
            raise ValueError(
                f"saved state must contain only the arrays of {type(self).__name__}, got {few_of(unknown)}"
            )
        for name, array in own.items():
            if isinstance(array, wp.array):
                array.assign(saved[name])
            elif array.flags.writeable:
                np.copyto(array, saved[name])


class Copyable(Stateful):
    """Base class of objects that `copy.deepcopy` and `pickle` copy as described above, without code in subclasses.

    A copy by `copy.copy` has arrays of its own, and shares the other attributes.
    """

    def __new__(cls, *args: Any, **more: Any) -> Any:
        """Store the arguments, with which a copy is constructed."""
        instance = super().__new__(cls)
        instance.__dict__[_ARGUMENTS] = tuple(map(_picklable, args)), {key: _picklable(more[key]) for key in more}
        return instance

    def __reduce__(self) -> tuple:
        args, more = self.__dict__[_ARGUMENTS]
        cls = ByValue(type(self)) if type(self).__module__ in MAIN_MODULES else type(self)
        values = {
            name: value for name, value in _entries(self) if isinstance(value, Copyable) or not _is_or_has_opaque(value)
        }
        own = {name: array for name, array in self.save_state().items() if name.partition(".")[0] not in values}
        return _construct, (cls, args, more), (values, own)

    def __setstate__(self, state: tuple[dict[str, Any], dict[str, np.ndarray]]) -> None:
        values, own = state
        self.__dict__.update(values)
        self.load_state({name: array for name, array in self.save_state().items() if name not in own} | own)


def _picklable(argument: Any) -> Any:
    """Return an argument, or the name of a Warp device, which is not picklable itself."""
    return str(argument) if isinstance(argument, wp.Device) else argument


def _construct(cls: Any, args: tuple, more: dict[str, Any]) -> Any:
    return (cls.value if isinstance(cls, ByValue) else cls)(*args, **more)  # `copy.copy` does not pickle it


def _arrays(
    owner: Any, prefix: str = "", within: tuple[int, ...] = (), known: set[int] | None = None
) -> Iterator[tuple[str, Any]]:
    """Return, by name, the arrays of an object and of its contents that can change while it works.

    A Warp array is returned once, by the first of its names; public names are before others.
    """
    known = set() if known is None else known
    for key, value in sorted(_entries(owner), key=lambda entry: (str(entry[0]).startswith("_"), str(entry[0]))):
        if isinstance(value, (wp.array, np.ndarray)):
            if value.size and id(value) not in known:
                known |= {id(value)} if isinstance(value, wp.array) else set()
                yield f"{prefix}{key}", value
        elif id(value) not in within and (isinstance(value, Copyable) or _is_or_has_opaque(value)):
            yield from _arrays(value, f"{prefix}{key}.", (*within, id(owner)), known)


def _entries(owner: Any) -> list[tuple[Any, Any]]:
    if isinstance(owner, (list, tuple)):
        return list(enumerate(owner))
    if is_struct(owner):
        return list(fields_of(owner).items())
    entries: Any = owner if isinstance(owner, dict) else getattr(owner, "__dict__", {})
    if isinstance(owner, Stateful) and isinstance(state := owner.__getstate__(), dict):
        entries = state  # without views, which are made anew
    return [] if _is_opaque(owner) else [(key, value) for key, value in entries.items() if key != _ARGUMENTS]


def _is_or_has_opaque(value: Any, within: tuple[int, ...] = ()) -> bool:
    """Return whether a value is a Warp array, a view of one or `_is_opaque`, or contains such a value."""
    if isinstance(value, np.ndarray):
        while isinstance(value.base, np.ndarray):
            value = value.base
        return value.base is not None
    if isinstance(value, wp.array) or _is_opaque(value):
        return True
    copies_itself = type(value).__reduce__ is not object.__reduce__
    if id(value) in within or (copies_itself and not isinstance(value, (Copyable, list, tuple, dict))):
        return False
    return any(_is_or_has_opaque(entry, (*within, id(value))) for _, entry in _entries(value))


def _is_opaque(value: Any) -> bool:
    """Return whether the constructor of a copy creates a value anew: a function, or what only Warp creates."""
    of_warp = type(value).__module__.partition(".")[0] == "warp"
    is_value = isinstance(value, (wp.array, ctypes.Array))  # vectors and matrices are values
    return isinstance(value, _OPAQUE) or (of_warp and not is_value)
