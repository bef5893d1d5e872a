"""Turns: work that one thread does at a time, and for which a fork of the process waits.

A thread waits until the turn of another thread has ended. A thread that already has the turn would wait for itself, for
example if a signal handler steps the simulation that it has interrupted; an error is raised instead.

Threads do not survive a fork. So a fork waits until no thread has a turn: the child then inherits complete states and
does not wait for threads that do not exist. Work that has not ended when the time limit of the fork ends stays
unfinished in the child, which rejects it.
"""

import functools
import itertools
import os
import threading
import time
import weakref
from collections.abc import Callable
from typing import Any, TypeVar

_Class = TypeVar("_Class", bound=type)
_Method = TypeVar("_Method", bound=Callable[..., Any])

_PATIENCE = 10.0
"""Longest time for which a fork waits for the turns of other threads [s]."""
_ROUND = 0.5
"""Time after which it lets go of those that it has, lest who it waits for waits for one of them [s]."""


class Turn:
    """A turn that one thread has at a time.

    Args:
        owner: Name of the object that is used in turns, for messages.

    Attributes:
        lock: Lock that the thread with the turn owns.
        taken: True if the work of a turn has begun and not ended.
        lost: True if a thread of the parent process began it, so that it never ends in this process.
    """

    def __init__(self, owner: str):
        self.owner, self.lock, self.taken, self.lost = owner, threading.RLock(), False, False
        _TURNS[next(_NUMBERS)] = self

    def refusal(self) -> RuntimeError:
        """Return the error of a turn that cannot begin."""
        if self.lost:
            words = "was running in another thread when this process was forked and is incomplete; make another one"
        else:
            words = "is running in this thread; a signal handler or an extension must not call it"
        return RuntimeError(f"{self.owner} {words}")


_NUMBERS = itertools.count()
_TURNS: "weakref.WeakValueDictionary[int, Turn]" = weakref.WeakValueDictionary()
"""All that there are, in the order in which they were made."""


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


def with_own_locks(cls: _Class) -> _Class:
    """Let a child have locks of its own for the cached properties of a class; before Python 3.12 each has one."""

    def renew() -> None:
        for each in vars(cls).values():
            if isinstance(each, functools.cached_property) and hasattr(each, "lock"):
                each.lock = threading.RLock()  # type: ignore[attr-defined]

    os.register_at_fork(after_in_child=renew)
    return cls


_forking = threading.RLock()
_held: list[list[Turn]] = []
"""Turns that belong to forks in progress: more than one where a signal handler forks while a fork waits."""


def _all() -> list[Turn]:
    # One call of C: other threads make turns meanwhile.
    return [turn for reference in _TURNS.valuerefs() if (turn := reference()) is not None]


def _take_all() -> None:
    """Wait until no other thread has a turn, and take all turns."""
    _forking.acquire()
    until = time.monotonic() + _PATIENCE
    while True:
        # What is used inside a turn is mostly made after it: in this order who has one seldom waits for us.
        turns = _all()
        end = min(time.monotonic() + _ROUND, until)
        held = [turn for turn in turns if turn.lock.acquire(timeout=max(end - time.monotonic(), 0.0))]
        if len(held) == len(turns) or time.monotonic() >= until:
            _held.append(held)
            return
        for turn in held:
            turn.lock.release()


def _give_back() -> None:
    for turn in _held.pop():
        turn.lock.release()
    _forking.release()


def _give_back_in_child() -> None:
    for turn in set(_all()).difference(_held[-1]):
        turn.lock, turn.taken, turn.lost = threading.RLock(), True, True
    _give_back()


os.register_at_fork(before=_take_all, after_in_parent=_give_back, after_in_child=_give_back_in_child)
