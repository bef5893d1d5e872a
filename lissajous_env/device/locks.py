"""Locks that a forked process can use: turns at an object, and the compiler's lock.

Threads do not survive a fork, but the locks that they own do. So a child renews the locks of other threads, and refuses
an object on which another thread was working. It waits for kernels that are being compiled, for at most a few seconds,
because the compiler has locks of its own.
"""

import functools
import os
import threading
import weakref
from collections.abc import Callable
from typing import Any, TypeVar

_Method = TypeVar("_Method", bound=Callable[..., Any])

COMPILING = threading.RLock()
"""Owned while kernels are compiled or loaded, of which Warp does not bear two at once, or standard error is silent."""

_TURNS: "weakref.WeakSet[Turn]" = weakref.WeakSet()


class Turn:
    """Turn at an object, which one thread has at a time.

    A thread waits for the turn of another thread. A thread that has the turn already would wait for itself, for example
    if a signal handler steps the simulation that it has interrupted, so an error is raised instead.

    Args:
        owner: Name of the object, for messages.

    Attributes:
        lock: Lock that the thread with the turn owns.
        taken: True if the work of a turn has begun and not ended.
        lost: True if a thread of the parent process began it, so that it never ends in this process.
    """

    def __init__(self, owner: str):
        self.owner, self.lock, self.taken, self.lost = owner, threading.RLock(), False, False
        _TURNS.add(self)

    def refusal(self) -> RuntimeError:
        """Return the error of a turn that cannot begin."""
        if self.lost:
            words = "was running in another thread when this process was forked and is incomplete; make another one"
        else:
            words = "is running in this thread; a signal handler or an extension must not call it"
        return RuntimeError(f"{self.owner} {words}")


def in_turn(method: _Method) -> _Method:
    """Let one thread at a time be in those methods of an object that are decorated so; the object has a `turn`.

    Raises:
        RuntimeError: the thread is in one of them already.
    """

    @functools.wraps(method)
    def waiting(self: Any, *args: Any, **named: Any) -> Any:
        turn = self.turn
        with turn.lock:
            if turn.taken:
                raise turn.refusal()
            turn.taken = True
            try:
                return method(self, *args, **named)
            finally:
                turn.taken = False

    return waiting  # type: ignore[return-value]


def _renew() -> None:
    """Renew the locks that threads of the parent own, and mark their turns as lost."""
    COMPILING.release()
    for turn in _TURNS:
        if turn.lock.acquire(blocking=False):
            turn.lock.release()
        else:
            turn.lock, turn.lost = threading.RLock(), turn.taken


os.register_at_fork(before=COMPILING.acquire, after_in_parent=COMPILING.release, after_in_child=_renew)
