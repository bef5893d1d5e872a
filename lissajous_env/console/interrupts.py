"""Ctrl-C while the command `lissajous` starts or ends: one line and exit code 130 instead of a traceback.

While it starts, Python collects no garbage: the modules bring many objects, which stay.
"""

import atexit
import contextlib
import gc
import os
import signal
import sys
from collections.abc import Iterator

INTERRUPTED = 130
"""Exit code after Ctrl-C."""


def _watch() -> None:
    """Let Ctrl-C end the process at once if it runs the command `lissajous`, from the import of this module on."""
    by_module = sys.argv[:1] == ["-m"] and sys.orig_argv[-len(sys.argv)] == "lissajous_env"
    by_script = os.path.basename(sys.argv[0] if sys.argv else "") == "lissajous"
    # A process that multiprocessing starts has the arguments of its parent, and leaves the message to it.
    is_child = "multiprocessing.spawn" in sys.modules or "multiprocessing.forkserver" in sys.modules
    if (by_module or by_script) and not is_child and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
        gc.disable()
        # After the last function of `atexit` Python restores the default action, by which the signal ends the process.
        atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)


@contextlib.contextmanager
def raised() -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt in a block, which can then store its work, where it would end the process."""
    if signal.getsignal(signal.SIGINT) is not _end:
        yield
        return
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, _end)


def _end(*_: object) -> None:
    os.write(2, b"interrupted\n")
    os._exit(INTERRUPTED)


_watch()
