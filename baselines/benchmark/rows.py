"""What a score row must be, column by column: what is read from a file is held to it as what is written."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lissajous_env.world.score import COLUMNS

TEXT_COLUMNS = ("scenario", "policy")
NUMBER_COLUMNS = tuple(name for name in COLUMNS if name not in (*TEXT_COLUMNS, "episode", "seed"))
"""Columns of every score row that statistics are made of."""


@dataclass(frozen=True)
class _Rule:
    """What a number of a score row may be."""

    words: str
    holds: Callable[[Any], bool]
    empty: str = ""
    """What null means; null is refused where it means nothing."""


def _is_whole(value: Any) -> bool:
    return type(value) is int and 0 <= value < 2**63


def _is_finite(value: Any) -> bool:
    # A whole number may be beyond the range of every float.
    return type(value) in (int, float) and abs(value) <= 1e300


def _is_positive(value: Any) -> bool:
    return _is_finite(value) and value >= 0


def _is_share(value: Any) -> bool:
    return _is_finite(value) and 0 <= value <= 1


def _is_flag(value: Any) -> bool:
    return type(value) in (int, float) and value in (0, 1)


_NO_TARGET = "no target appeared"
_RULES = {
    **dict.fromkeys(("episode", "seed", "targets", "collisions"), _Rule("a whole number of at least 0", _is_whole)),
    "detected_fraction": _Rule("from 0 to 1", _is_share, _NO_TARGET),
    "detected_within_bound": _Rule("from 0 to 1", _is_share, "no target was there for T_max or found"),
    **dict.fromkeys(
        ("detection_time_mean", "detection_time_p95", "detection_time_max"),
        _Rule("at least 0 [s]", _is_positive, _NO_TARGET),
    ),
    **dict.fromkeys(("contact_time", "outside_time"), _Rule("at least 0 [s]", _is_positive)),
    "min_separation": _Rule("at least 0 [m]", _is_positive, "one robot alone"),
    **dict.fromkeys(("coverage_time", "coverage_time_each"), _Rule("at least 0 [s]", _is_positive, "never")),
    **dict.fromkeys(("idleness_mean", "idleness_max"), _Rule("at least 0 [s]", _is_positive, "no grid")),
    **dict.fromkeys(
        ("lateral_error_mean", "lateral_error_max", "tracking_error_mean", "tracking_error_max"),
        _Rule("at least 0 [m]", _is_positive),
    ),
    "spacing_factor": _Rule("at least 0", _is_positive, "no Lissajous curve"),
    "phase_error": _Rule("at least 0 [rad]", _is_positive),
    "recovery_time": _Rule("at least 0 [s]", _is_positive, "never, or never off"),
    "distance_mean": _Rule("at least 0 [m]", _is_positive),
    "speed_max": _Rule("at least 0 [m/s]", _is_positive),
    "smoothness": _Rule("at least 0", _is_positive, "one step alone"),
    "sensed_fraction": _Rule("from 0 to 1", _is_share, "no grid"),
    **dict.fromkeys(
        ("guaranteed_detection_time", "unseen_at_end", "contaminated_age_mean"),
        _Rule("at least 0 [s]", _is_positive, "contamination is not followed"),
    ),
    "guarantee_open": _Rule("a flag, 0 or 1", _is_flag, "contamination is not followed"),
    "guarantee_recovery_time": _Rule("at least 0 [s]", _is_positive, "never"),
    "return_mean": _Rule("a finite number", _is_finite),
}

_BROUGHT = _Rule("a finite number", _is_finite, "none")


def numbers_of(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Columns of a score row that statistics are made of, with those that its scenario brings."""
    return NUMBER_COLUMNS + tuple(name for name in row if name not in COLUMNS)


def what_is_wrong(row: Mapping[str, Any], brought: Sequence[str] = ()) -> str | None:
    """Say by which rule something is no score row, as JSON holds one; None where it is.

    `brought` names the columns that the scenario brings, after ours.
    """
    if tuple(row) != (*COLUMNS, *brought):
        return "must have the columns of a score row"
    for name in TEXT_COLUMNS:
        if not isinstance(row[name], str):
            return f"must hold a word as {name}, got {row[name]!r}"
    for name in ("episode", "seed", *NUMBER_COLUMNS, *brought):
        rule, given = _RULES.get(name, _BROUGHT), row[name]
        if not (given is None and rule.empty) and not rule.holds(given):
            empty = f" or null ({rule.empty})" if rule.empty else ""
            number = "" if rule.words.startswith("a ") else "a number "
            return f"must hold {number}{rule.words}{empty} as {name}, got {short(given)}"
    return None


def short(value: Any) -> str:
    """Put a value into a few words, however large it is."""
    try:
        words = repr(value)
    except (ValueError, RecursionError):  # a whole number of more digits than Python prints, or deep nesting
        return f"a {type(value).__name__} too long to print"
    return words if len(words) <= 60 else f"{words[:60]}..."
