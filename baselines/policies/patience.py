"""An early end of long planning: computations check now and then whether their result is still wanted."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_STOPPED: ContextVar[Callable[[], bool]] = ContextVar("stopped", default=lambda: False)


class StoppedError(Exception):
    """Error that ends a computation whose result is not wanted any more."""


@contextmanager
def patience(stopped: Callable[[], bool]) -> Iterator[None]:
    """End the computations in this context when `stopped` returns True, by a StoppedError.

    It applies to the thread that enters the context, and to computations that call `check_patience`.
    """
    token = _STOPPED.set(stopped)
    try:
        yield
    finally:
        _STOPPED.reset(token)


def check_patience() -> None:
    """Raise StoppedError if the result of the running computation is not wanted any more."""
    if _STOPPED.get()():
        raise StoppedError
