"""Warp's C++ header, parsed once for all kernels that are compiled with the same options.

Warp keeps a parsed header for each thread that compiles and each set of compiler flags. To make one takes three times
as long as to parse the header for one module alone, so it pays for flags of many modules only, and only when all
threads share it.
"""

import contextlib
import functools
import threading
from collections.abc import Callable, Iterator

from lissajous_env.device.compilation import MOTION, OPTIONS

_COMMON = {OPTIONS["cpu_compiler_flags"], MOTION["cpu_compiler_flags"]}
"""Compiler flags of many modules."""

_making = {flags: threading.Lock() for flags in _COMMON}
"""Each held by the thread that makes the header for these flags."""
_made: set[str] = set()
"""Flags for which there is a header."""


class _Compiling(threading.local):
    """Compilation of a thread: if it is of a module of this project, and if with a header that was parsed before."""

    ours, with_header = False, False


_compiling = _Compiling()


def share_headers(folder_of_thread: Callable[[], str | None]) -> Callable[[], str | None]:
    """Return a function that returns the folder of parsed headers of the calling thread; None for a module without one.

    Modules of this project use the folder of the thread that was first to compile one.
    """
    making = threading.Lock()
    common = functools.cache(folder_of_thread)

    def folder() -> str | None:
        if not _compiling.ours:
            return folder_of_thread()
        with making:
            return common() if _compiling.with_header else None

    return folder


@contextlib.contextmanager
def sharing_header(flags: str) -> Iterator[None]:
    """Compile a module of this project that has these compiler flags, with the common header where that pays.

    Other threads that compile with the same flags wait until the first module is compiled, and with it the header.
    """
    _compiling.ours, _compiling.with_header = True, flags in _COMMON
    try:
        if not _compiling.with_header or flags in _made:
            yield
        else:
            with _making[flags]:
                yield
                _made.add(flags)
    finally:
        _compiling.ours = False
