"""Work in threads whose results come in the order in which it began, the same on every machine."""

from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any

AHEAD = 8
"""Calls that are begun before the first of them has ended, whatever the number of cores."""
_TICK = 0.2
"""Time between two calls of `on_tick` [s]."""

Call = tuple[Any, Callable[[], Any]]
"""Purpose of a call, and the function that is called."""


def in_order(
    threads: ThreadPoolExecutor,
    calls: Iterator[Call],
    is_over: Callable[[], bool],
    on_tick: Callable[[], None],
    ahead: int = AHEAD,
) -> Iterator[tuple[Any, Future]]:
    """Run calls in threads, and yield what each was for with its result, in the order in which they began.

    A call is taken from the iterator when the result of the one `ahead` before it has been used, whatever the number of
    cores and their load. So what the next call depends on is the same on every machine.

    Args:
        threads: The threads.
        calls: The calls.
        is_over: Returns whether no further call begins.
        on_tick: Called now and then while a result is awaited.
        ahead: Calls that are begun before the first of them has ended.
    """
    waiting: deque[tuple[Any, Future]] = deque()
    try:
        while True:
            while len(waiting) < ahead and not is_over() and (call := next(calls, None)) is not None:
                waiting.append((call[0], threads.submit(call[1])))
            if not waiting:
                return
            while wait([waiting[0][1]], _TICK).not_done:
                on_tick()
            on_tick()
            yield waiting.popleft()
    finally:
        for _, future in waiting:
            future.cancel()
