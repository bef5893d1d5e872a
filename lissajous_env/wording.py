"""Values and errors of others in our messages."""

import difflib
import os
import traceback
from collections.abc import Iterable
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


def nearest(word: Any, words: Iterable[str]) -> str:
    """Return "; did you mean ...?" with the nearest of some words to a word; nothing where there are none."""
    match = difflib.get_close_matches(str(word), list(words), n=1, cutoff=0.0)
    return f"; did you mean {match[0]}?" if match else ""


def where_raised(error: BaseException) -> str:
    """Put an error into one line, with the place in which it was raised."""
    words = str(error).strip().partition("\n")[0]
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({os.path.basename(frames[-1].filename)}, line {frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}{f': {words}' if words else ''}{place}"
