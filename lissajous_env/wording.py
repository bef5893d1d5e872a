"""Format values, names and errors for messages."""

import difflib
import os
import sys
import sysconfig
import traceback
from collections.abc import Iterable
from pathlib import Path
from typing import Any

_LONGEST = 160
"""Limit on the length of a formatted value."""
_ALIKE, _AS_GOOD = 0.6, 0.1
"""Least similarity of a suggestion by `difflib`, and its largest distance from the best one."""
_IMPORTS = "importlib"
"""Part of the file names of Python's import system, frozen or not."""
_INSTALLED = tuple(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib"))
"""Folders of the standard library and of installed packages."""
_PACKAGES = tuple(f"{Path(__file__).parents[1] / name}{os.sep}" for name in ("lissajous_env", "baselines", "training"))
"""Folders of the packages of this distribution."""
_MOST_NAMES, _FEW = 30, 6
"""Largest number of names that are listed in full, and number listed otherwise."""


def shown(value: Any) -> str:
    """Return the `repr` of a value on one line, shortened."""
    try:
        words = " ".join(repr(value).split())
    except Exception:  # a failing `repr`
        words = f"a {type(value).__name__}"
    return words if len(words) <= _LONGEST else f"{words[: _LONGEST - 3]}..."


def nearest(word: Any, words: Iterable[str]) -> str:
    """Return "; did you mean ...?" with at most three similar words, or "" if there is none.

    Names that begin with the word and a dot, such as `hall.toml` for `hall`, come first.
    """
    given, known = str(word), dict.fromkeys(words)
    begun = [name for name in known if given and name.startswith(f"{given}.")]
    alike = difflib.get_close_matches(given, [name for name in known if name not in begun], n=3, cutoff=_ALIKE)
    likeness = [difflib.SequenceMatcher(None, name, given).ratio() for name in alike]
    alike = [name for name, like in zip(alike, likeness, strict=True) if like > likeness[0] - _AS_GOOD]
    return f"; did you mean {' or '.join([*begun, *alike][:3])}?" if begun or alike else ""


def require(holds: Any, name: str, rule: str, got: Any, known: Iterable[str] = ()) -> None:
    """Raise ValueError with a name, its rule and the value got, unless the rule holds; suggest similar known words."""
    if not holds:
        raise ValueError(f"{name} {rule}, got {shown(got)}{nearest(got, known)}")


def few_of(names: Iterable[Any], word: Any = "") -> str:
    """Join names to a line; of many names, only those similar to `word` and the number of others."""
    known = list(dict.fromkeys(map(str, names)))
    if len(known) <= _MOST_NAMES:
        return ", ".join(known)
    near = difflib.get_close_matches(str(word)[:_LONGEST], known, n=_FEW, cutoff=0.0)
    return f"{', '.join(near)} and {len(known) - len(near):,} more"


def counted(number: int, noun: str, plural: str = "") -> str:
    """Return a number with its noun, as `1 episode` and `2,000 episodes`; by default the plural ends in s."""
    return f"{number:,} {noun if number == 1 else plural or f'{noun}s'}"


def outside() -> int:
    """Return the `stacklevel` of the caller's warning that names the first line outside of this distribution."""
    frame, level = sys._getframe(1), 1
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGES):
        frame, level = frame.f_back, level + 1
    return level


def where_raised(error: BaseException) -> str:
    """Format an error on one line, with the file and the line of the user's code that raised it.

    Positions in this package and in the import system are skipped, and so are those in installed libraries if the
    user's code is among the callers.
    """
    words = str(error).strip().partition("\n")[0]
    frames = [] if isinstance(error, SyntaxError) else traceback.extract_tb(error.__traceback__)  # names the place
    others = [frame for frame in frames if not frame.filename.startswith(_PACKAGES) and _IMPORTS not in frame.filename]
    users = [frame for frame in others if not frame.filename.startswith(_INSTALLED)] or others
    place = f" ({os.path.basename(users[-1].filename)}, line {users[-1].lineno})" if users else ""
    return f"{type(error).__name__}{f': {words}' if words else ''}{place}"
