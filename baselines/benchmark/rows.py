"""Checks of score rows, column by column: a row that is read from a file must meet the same rules as one written."""

from collections.abc import Mapping, Sequence
from typing import Any

from lissajous_env.world.columns import COLUMNS, FINITE, IDENTITY, NAMES, WHOLE, Column


def column_of(name: str) -> Column:
    """Return the column of a score row with this name, or one that describes a column of a scenario's own."""
    return COLUMNS.get(name) or Column(name, "a score column that the scenario adds", rule=FINITE, empty="none")


def numbers_of(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the numbers of a score row, those that its scenario adds among them."""
    return tuple(name for name in row if name not in IDENTITY)


def refusal_of(row: Any, brought: Sequence[str] = ()) -> str | None:
    """Return the rule that a score row violates, as JSON represents one; None for a valid row.

    Args:
        row: the row to check.
        brought: names of the columns that the scenario adds, in their order.
    """
    if tuple(row) != (*NAMES, *brought):
        return "must have the columns of a score row"
    for name in ("scenario", "policy"):
        if not isinstance(row[name], str):
            return f"{name} must be a text, got {row[name]!r}"
    for name in ("episode", "seed"):
        if not WHOLE.accepts(row[name]):
            return f"{name} must be {WHOLE.words}, got {short(row[name])}"
    for name in (*COLUMNS, *brought):
        if wrong := column_of(name).refusal(row[name]):
            return f"{name} {wrong}, got {short(row[name])}"
    return None


def short(value: Any) -> str:
    """Return a value in a few words, however large it is."""
    try:
        words = repr(value)
    except (ValueError, RecursionError):  # a whole number of more digits than Python prints, or deep nesting
        return f"a {type(value).__name__} too long to print"
    return words if len(words) <= 60 else f"{words[:60]}..."
