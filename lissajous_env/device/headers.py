"""Warp's C++ header, parsed once for all kernels of this project.

Warp stores a parsed header for each compiling thread and each set of compiler flags. Parsing the header takes longer
than compiling most modules, and our headers would differ only in their names, because no flag in `compilation.py`
changes how C++ is parsed. So the first header is copied for the other flags, and all threads share it.
"""

import contextlib
import functools
import threading
from collections.abc import Callable, Iterator

from lissajous_env.device.warp_abi import copy_header

_making = threading.Lock()
"""Held by the thread that makes the header."""
_made: list[str] = []
"""Flags for which there is a header; it was made with those that come first."""


class _Compiling(threading.local):
    """Compilation of a thread: the flags of a module of this project; None if it compiles none."""

    flags: str | None = None


_compiling = _Compiling()


def share_headers(folder_of_thread: Callable[[], str | None]) -> Callable[[], str | None]:
    """Return a function that returns the folder of parsed headers of the calling thread.

    Modules of this project use the folder of the thread that was first to compile one.
    """
    looking = threading.Lock()
    common = functools.cache(folder_of_thread)

    def folder() -> str | None:
        flags = _compiling.flags
        if flags is None:
            return folder_of_thread()
        with looking:
            shared = common()
            if shared is not None and _made and flags not in _made:
                copy_header(shared, _made[0], flags)
                _made.append(flags)
            return shared

    return folder


@contextlib.contextmanager
def sharing_header(flags: str) -> Iterator[None]:
    """Compile a module of this project that has these compiler flags with the common header.

    Other threads wait until the first module is compiled, and with it the header.
    """
    _compiling.flags = flags
    try:
        with contextlib.ExitStack() as first:
            if not _made:
                first.enter_context(_making)
            if _made:  # perhaps by the thread that this one has waited for
                first.close()
            yield
            if not _made:
                _made.append(flags)
    finally:
        _compiling.flags = None
