"""Locks that a forked process can use: turns at an object, and the compiler's lock.

Threads do not survive a fork, but the locks that they own do. So a child renews the lock of an object, and refuses
an object on which another thread was working. It waits for kernels that are being compiled, for at most a few seconds,
because the compiler has locks of its own.
"""

import functools
import os
import threading
from collections.abc import Callable
from typing import Any, TypeVar

_Method = TypeVar("_Method", bound=Callable[..., Any])

COMPILING = threading.RLock()
"""Owned while kernels are compiled or loaded, which Warp cannot do twice at once, or while standard error is silent."""
_forks = 0
"""Number of forks by which this process has come from the first one that imported this module."""


class Turn:
    """Turn at an object, which one thread has at a time.

    A thread waits for the turn of another thread. A thread that has the turn already would wait for itself, for example
    if a signal handler steps the simulation that it has interrupted, so an error is raised instead. So it is in a
    process that was forked while another thread had the turn, which never ends there.

    Args:
        owner: Name of the object, for messages.

    Attributes:
        lock: Lock of the thread that has the turn; a forked process replaces it, and then has more `forks`.
        taken: True if the work of a turn has begun and not ended.
    """

    def __init__(self, owner: str):
        self.owner, self.lock, self.forks, self.taken = owner, threading.RLock(), _forks, False


def in_turn(method: _Method) -> _Method:
    """Let one thread at a time be in those methods of an object that are decorated so; the object has a `turn`.

    Raises:
        RuntimeError: the thread, or one of the parent process, is in one of them already.
    """

    @functools.wraps(method)
    def waiting(self: Any, *args: Any, **named: Any) -> Any:
        turn = self.turn
        if turn.forks != _forks:  # a thread of the parent may own the lock; its turn remains taken
            turn.lock, turn.forks = threading.RLock(), _forks
        with turn.lock:
            if turn.taken:
                words = "a signal handler or an extension must not call it, nor a process that was forked meanwhile"
                raise RuntimeError(f"{turn.owner} is running: {words}")
            turn.taken = True
            try:
                return method(self, *args, **named)
            finally:
                turn.taken = False

    return waiting  # type: ignore[return-value]


def _count_fork() -> None:
    global _forks
    _forks += 1


os.register_at_fork(after_in_child=_count_fork)
os.register_at_fork(before=COMPILING.acquire, after_in_parent=COMPILING.release, after_in_child=COMPILING.release)
