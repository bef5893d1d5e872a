"""Values of others in our messages."""

from typing import Any

_LONGEST = 160
"""Letters of a value that are shown."""


def shown(value: Any) -> str:
    """Return what a value looks like, in one line and not too long: arrays fill pages."""
    try:
        words = " ".join(repr(value).split())
    except Exception:  # what cannot say what it is can still be named
        words = f"a {type(value).__name__}"
    return words if len(words) <= _LONGEST else f"{words[: _LONGEST - 3]}..."
