"""Checked fields for frozen dataclasses: a rule stands beside its field and is enforced once, at construction.

An error names the field, the rule with its unit, and the value got: `robot.wheelbase must be positive [m], got -1`.
"""

import dataclasses
import math
import operator
from collections.abc import Callable
from typing import Any


def positive(default: Any, unit: str = "") -> Any:
    """Declare a finite number above zero."""
    return _checked(default, f"must be positive{_bracket(unit)}", lambda v: _is_finite(v) and v > 0, float)


def positive_or_infinite(default: Any, unit: str = "") -> Any:
    """Declare a number above zero; infinity switches the limit off."""
    return _checked(default, f"must be positive or infinite{_bracket(unit)}", lambda v: _is_number(v) and v > 0, float)


def non_negative(default: Any, unit: str = "") -> Any:
    """Declare a finite number of at least zero."""
    return _checked(default, f"must be at least 0{_bracket(unit)}", lambda v: _is_finite(v) and v >= 0, float)


def finite(default: Any, unit: str = "") -> Any:
    """Declare any finite number."""
    return _checked(default, f"must be a finite number{_bracket(unit)}", _is_finite, float)


def fraction(default: Any) -> Any:
    """Declare a number in [0, 1]."""
    return _checked(default, "must be between 0 and 1", lambda v: _is_finite(v) and 0 <= v <= 1, float)


def spread(default: Any, below: float) -> Any:
    """Declare a number in the half-open interval [0, below)."""
    rule = f"must be at least 0 and below {below:g}"
    return _checked(default, rule, lambda v: _is_finite(v) and 0 <= v < below, float)


def within(default: Any, low: float, high: float, unit: str = "") -> Any:
    """Declare a number in the open interval (low, high)."""
    rule = f"must be between {low:g} and {high:g}, both excluded{_bracket(unit)}"
    return _checked(default, rule, lambda v: _is_finite(v) and low < v < high, float)


def whole(default: Any, at_least: int = 0, at_most: int | None = None) -> Any:
    """Declare a whole number of at least `at_least` and, where given, at most `at_most`."""
    rule = f"must be a whole number of at least {at_least}" + ("" if at_most is None else f" and at most {at_most}")
    limit = math.inf if at_most is None else at_most
    return _checked(default, rule, lambda v: _is_whole(v) and at_least <= v <= limit, operator.index)


def odd(default: Any) -> Any:
    """Declare an odd whole number of at least 1."""
    rule = "must be an odd whole number of at least 1"
    return _checked(default, rule, lambda v: _is_whole(v) and v > 0 and v % 2, operator.index)


def choice(default: str, *options: str) -> Any:
    """Declare one of a few words."""
    return _checked(default, f"must be one of {', '.join(options)}", lambda v: isinstance(v, str) and v in options)


def flag(default: bool) -> Any:
    """Declare a boolean."""
    return _checked(default, "must be True or False", lambda v: isinstance(v, bool))


def rows(default: tuple | None, rule: str, check: Callable[[Any], bool], optional: bool = False) -> Any:
    """Declare a tuple whose every entry passes `check`; `optional` also takes None, as a default of None does."""
    return _checked(default, rule, lambda v: isinstance(v, tuple) and all(check(entry) for entry in v), None, optional)


class Checked:
    """Base of the frozen dataclasses: checks each declared field, then calls `_check_together`."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            rule = field.metadata
            given = getattr(self, field.name)
            if "check" not in rule or (given is None and rule["optional"]):
                continue
            value = _plain(given)
            if not _holds(rule["check"], value):
                raise ValueError(f"{self.part}.{field.name} {rule['rule']}, got {given!r}")
            object.__setattr__(self, field.name, rule["convert"](value) if rule["convert"] else value)
        self._check_together()

    @property
    def part(self) -> str:
        """Name of this part in overrides and error messages, as `curve` in `curve.half_width`."""
        return type(self).__name__.lower()

    def _check_together(self) -> None:
        """Check rules that involve more than one field."""

    def _require(self, holds: bool, name: str, rule: str) -> None:
        if not holds:
            raise ValueError(f"{self.part}.{name} {rule}, got {getattr(self, name)!r}")


def _checked(
    default: Any,
    rule: str,
    check: Callable[[Any], Any],
    convert: Callable[[Any], Any] | None = None,
    optional: bool = False,
) -> Any:
    metadata = {"rule": rule, "check": check, "convert": convert, "optional": optional or default is None}
    return dataclasses.field(default=default, metadata=metadata)


def _holds(check: Callable[[Any], Any], value: Any) -> bool:
    try:
        return bool(check(value))
    except (TypeError, ValueError, OverflowError):  # a wrong type, or a whole number beyond all floats
        return False


def _bracket(unit: str) -> str:
    return f" [{unit}]" if unit else ""


def _is_number(value: Any) -> bool:
    return hasattr(value, "__float__") and not isinstance(value, (bool, str)) and not math.isnan(value)


def _is_finite(value: Any) -> bool:
    return _is_number(value) and math.isfinite(value)


def _is_whole(value: Any) -> bool:
    return hasattr(value, "__index__") and not isinstance(value, bool)


def _plain(value: Any) -> Any:
    """Turn NumPy scalars and arrays into Python's own numbers and tuples, which hash and go into JSON."""
    value = value.tolist() if hasattr(value, "tolist") else value
    return tuple(_plain(entry) for entry in value) if isinstance(value, (list, tuple)) else value
