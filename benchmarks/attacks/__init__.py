"""What strangers do to the package, as attacks that can be repeated: one module for each part that is attacked."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Attack:
    """One way to break the package, tried again and again with other draws."""

    name: str
    """A few words: what is attacked, and how."""
    promise: str
    """What must hold, in one sentence."""
    tries: int
    """How often it is tried."""
    attempt: Callable[[np.random.Generator], str | None]
    """One try with its own draws: None where the promise held, else what was seen. What it raises is a failure too."""


def held_back(call: Callable[[], object]) -> str | None:
    """None where `call` runs clean or raises a ValueError of one to three lines; else what it did instead."""
    try:
        call()
    except ValueError as error:
        words = str(error)
        return None if words and words.count("\n") <= 2 else f"an error without a clear line: {words[:200]!r}"
    return None
