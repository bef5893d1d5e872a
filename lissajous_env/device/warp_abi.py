"""Undocumented parts of Warp that the package uses, collected here because a new version of Warp may change them.

`tests/device/test_warp_abi.py` tests each of them; the name of a failing test names the part that changed.
"""

import ctypes
import functools
from typing import Any


def names_of_arguments(kernel: Any) -> list[str]:
    """Return the names of a kernel's parameters."""
    return [argument.label for argument in kernel.adj.args]


def is_struct(value: Any) -> bool:
    """Return whether a value is an instance of a `wp.struct`."""
    return hasattr(value, "_cls") and hasattr(value, "_ctype")


def content_of(struct: Any) -> bytes:
    """Return the bytes of an instance of a `wp.struct` as a launch reads them."""
    return bytes(struct._ctype)


def variables_of(struct: Any) -> dict[str, Any]:
    """Return the variables of a `wp.struct`, the class, by the names of its fields; `type` is that of a field."""
    return struct.vars


def fields_of(struct: Any) -> dict[str, Any]:
    """Return the values of an instance of a `wp.struct` by the names of its fields."""
    return {name: getattr(struct, name) for name in variables_of(struct._cls)}


def folder_of(module: Any, block_dim: int | None) -> str:
    """Return the name of the folder in Warp's cache where a compiled module is."""
    return module.get_module_identifier(block_dim)


class Call:
    """A launch on a CPU whose arguments are laid out once, as the compiled kernel reads them.

    It runs at once, also while a graph is captured, of which it is no part.

    Args:
        launch: Recorded launch that `wp.launch` returned.
    """

    def __init__(self, launch: Any):
        self._launch = launch  # refers to the compiled module
        self._bounds, *values = launch.params
        self._arguments = _arguments_of(tuple(map(type, values)))(*values)
        self._function = launch.hooks.forward
        self._pointers = ctypes.byref(self._bounds), ctypes.byref(self._arguments)

    def __call__(self) -> None:
        """Make the launch."""
        self._function(*self._pointers)

    @functools.cached_property
    def addresses(self) -> tuple[int, int, int]:
        """Addresses of function, bounds and arguments, good while this lives."""
        function = ctypes.cast(self._function, ctypes.c_void_p).value or 0
        return function, ctypes.addressof(self._bounds), ctypes.addressof(self._arguments)


@functools.lru_cache(maxsize=1024)
def _arguments_of(types: tuple[type, ...]) -> type[ctypes.Structure]:
    """Return the structure of arguments of these types: creating one takes longer than the rest of a `Call`."""
    fields = [(f"argument_{k}", c_type) for k, c_type in enumerate(types)]
    return type("Arguments", (ctypes.Structure,), {"_fields_": fields})
