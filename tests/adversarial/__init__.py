"""Misuse of the package as attacks that can be repeated: a module for each part that is attacked."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Attack:
    """A way to break the package, tried repeatedly with different random draws."""

    name: str
    """Title: the part that is attacked, and how."""
    promise: str
    """Property that must hold, in one sentence."""
    tries: int
    """Number of tries."""
    attempt: Callable[[np.random.Generator], str | None]
    """One try: return None if the property held, else a description; an exception is a failure."""


def held_back(call: Callable[[], object]) -> str | None:
    """Return None if `call` succeeds or raises a ValueError of one to three lines, else a description."""
    try:
        call()
    except ValueError as error:
        words = str(error)
        return None if words and words.count("\n") <= 2 else f"an error without a clear line: {words[:200]!r}"
    return None
