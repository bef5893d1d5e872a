"""Stacks of threads: a kernel that is compiled with Warp's defaults uses 256 KiB of stack for tiles.

The kernels of this package do not use them (`lissajous_env.device.kernel_cache`) and run on any stack; kernels of a
user may require them.
"""

import ctypes
import threading

LEAST = 384 << 10
"""Stack of a thread that runs a user's kernels [bytes]: the tiles, and the stack that Python uses."""


def require_room() -> None:
    """Refuse a thread whose stack is too small for kernels of a user.

    Raises:
        RuntimeError: it is.
    """
    if not hasattr(_checked, "enough"):
        size = _size()
        if size < LEAST:
            raise RuntimeError(
                f"a thread must have a stack of at least {LEAST >> 10} KiB for kernels of a scenario's own, got "
                f"{size >> 10} KiB; threading.stack_size({LEAST}) sets it for threads that are started afterwards"
            )
        _checked.enough = True


_checked = threading.local()


def _size() -> int:
    """Return the size of the current thread's stack [bytes]; the least one if the system does not report it."""
    system = ctypes.CDLL(None)
    system.pthread_self.restype = ctypes.c_ulong
    attributes = ctypes.create_string_buffer(256)
    address, size = ctypes.c_void_p(), ctypes.c_size_t()
    if system.pthread_getattr_np(ctypes.c_ulong(system.pthread_self()), attributes) != 0:
        return LEAST
    system.pthread_attr_getstack(attributes, ctypes.byref(address), ctypes.byref(size))
    system.pthread_attr_destroy(attributes)
    return size.value
