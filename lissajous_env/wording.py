"""Values and errors of others in our messages."""

import difflib
import os
import sysconfig
import traceback
from collections.abc import Iterable
from typing import Any

from lissajous_env import siblings

_LONGEST = 160
"""Letters of a value that are shown."""
_ALIKE, _AS_GOOD = 0.6, 0.1
"""Least likeness of a word that is offered, by `difflib`, and by how much it may be below the best one's."""
_IMPORTS = "importlib"
"""In the names of the files of Python's import system, frozen or not."""
_INSTALLED = tuple(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib"))
"""Folders of Python's own and of installed modules."""


_MOST_NAMES, _FEW = 30, 6
"""Names that are listed in full; of more, so many."""


def shown(value: Any) -> str:
    """Return what a value looks like, in one line and not too long: arrays fill pages."""
    try:
        words = " ".join(repr(value).split())
    except Exception:  # what cannot say what it is can still be named
        words = f"a {type(value).__name__}"
    return words if len(words) <= _LONGEST else f"{words[: _LONGEST - 3]}..."


def nearest(word: Any, words: Iterable[str]) -> str:
    """Return "; did you mean ...?" with the words that resemble a word, at most three of them; "" if none does.

    A name that begins with the whole word and a dot, as `hall.toml` with `hall`, comes before all others.
    """
    given, known = str(word), dict.fromkeys(words)
    begun = [each for each in known if given and each.startswith(f"{given}.")]
    alike = difflib.get_close_matches(given, [each for each in known if each not in begun], n=3, cutoff=_ALIKE)
    likeness = [difflib.SequenceMatcher(None, each, given).ratio() for each in alike]
    alike = [each for each, like in zip(alike, likeness, strict=True) if like > likeness[0] - _AS_GOOD]
    return f"; did you mean {' or '.join([*begun, *alike][:3])}?" if begun or alike else ""


def few_of(names: Iterable[Any], word: Any = "") -> str:
    """Put names into a line: all of them where they are few, else those nearest to a word, and how many more."""
    known = list(dict.fromkeys(map(str, names)))
    if len(known) <= _MOST_NAMES:
        return ", ".join(known)
    near = difflib.get_close_matches(str(word)[:_LONGEST], known, n=_FEW, cutoff=0.0)
    return f"{', '.join(near)} and {len(known) - len(near):,} more"


def where_raised(error: BaseException) -> str:
    """Put an error into one line, with the file and the line of the user's code in which it was raised.

    Positions in this package and in the import system are left out, and those in installed libraries where the code of
    the user is among the callers.
    """
    words = str(error).strip().partition("\n")[0]
    frames = [] if isinstance(error, SyntaxError) else traceback.extract_tb(error.__traceback__)  # that says its place
    others = [frame for frame in frames if not siblings.is_ours(frame.filename) and _IMPORTS not in frame.filename]
    own = [frame for frame in others if not frame.filename.startswith(_INSTALLED)] or others
    place = f" ({os.path.basename(own[-1].filename)}, line {own[-1].lineno})" if own else ""
    return f"{type(error).__name__}{f': {words}' if words else ''}{place}"
