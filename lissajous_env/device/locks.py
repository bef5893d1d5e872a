"""Locks that a forked process can use: turns at an object, and the compiler's lock.

Threads do not survive a fork, but the locks that they own do. So a child renews the locks of all objects, and refuses
an object on which another thread was working. A fork waits until kernels that are being compiled are ready, because the
compiler has locks of its own.
"""

import functools
import os
import threading
import weakref
from collections.abc import Callable
from typing import Any, TypeVar

_Method = TypeVar("_Method", bound=Callable[..., Any])

COMPILING = threading.RLock()
"""Owned while kernels are compiled or loaded, which Warp cannot do twice at once, while standard error is silent, or
while helpers of `device/work.py` start."""


class Turn:
    """Turn at an object, which one thread has at a time.

    A thread waits for the turn of another thread. A thread that has the turn already would wait for itself, for example
    if a signal handler steps the simulation that it has interrupted, so an error is raised instead. So it is in a
    process that was forked while another thread had the turn, which never ends there.

    Args:
        owner: Name of the object, for messages.

    Attributes:
        lock: Lock of the thread that has the turn; a forked process replaces it.
        taken: True if the work of a turn has begun and not ended.
    """

    def __init__(self, owner: str):
        self.owner, self.lock, self.taken = owner, threading.RLock(), False
        _turns.add(self)


_turns: weakref.WeakSet[Turn] = weakref.WeakSet()
"""All turns of this process."""


def in_turn(method: _Method) -> _Method:
    """Let one thread at a time be in those methods of an object that are decorated so; the object has a `turn`.

    Raises:
        RuntimeError: the thread, or one of the parent process, is in one of them already.
    """

    @functools.wraps(method)
    def waiting(self: Any, *args: Any, **named: Any) -> Any:
        turn = self.turn
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


def _renew_locks() -> None:
    """Replace locks that a thread of the parent may own; its turn remains taken."""
    for turn in _turns:
        turn.lock = threading.RLock()


os.register_at_fork(after_in_child=_renew_locks)
os.register_at_fork(before=COMPILING.acquire, after_in_parent=COMPILING.release, after_in_child=COMPILING.release)
