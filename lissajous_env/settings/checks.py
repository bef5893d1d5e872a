"""Checked fields for frozen dataclasses: each field declares its rule, which is enforced once, at construction.

An error names the field, the rule with its unit, and the value got:
`robot.wheelbase must be from 0.001 to 10000 [m], got -1`. `help()` lists the fields with their rules.
"""

import ast
import dataclasses
import inspect
import math
import operator
import sys
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import Any, ClassVar, Self

import numpy as np

from lissajous_env.wording import require

LAST_SEED = 2**31 - 1
"""Largest seed of a world, of a draw and of a scenario of a space."""


def number(
    default: float | None, low: float, high: float, unit: str = "", or_zero: bool = False, or_infinite: bool = False
) -> Any:
    """Declare a number from `low` to `high`, both included, and on request also zero or infinity."""
    rule = "must be " + "0 or " * or_zero + f"from {low:.9g} to {high:.9g}" + " or infinite" * or_infinite
    rule += f" [{unit}]" if unit else ""
    others = [0.0] * or_zero + [math.inf] * or_infinite
    return _checked(default, rule, within(low, high, *others), units=(unit,))


def whole(default: int | None, low: int, high: int, parity: str = "") -> Any:
    """Declare a whole number from `low` to `high`, both included, which may have to be `odd` or `even`."""
    rule = f"must be {f'an {parity}' if parity else 'a'} whole number from {low} to {high}"
    rests = {"odd": (1,), "even": (0,)}.get(parity, (0, 1))
    return _checked(default, rule, lambda v: operator.index(v) if is_whole(v, low, high) and v % 2 in rests else None)


def choice(default: str | None, *options: str) -> Any:
    """Declare one of a few words."""
    rule = f"must be one of {', '.join(options)}"
    return _checked(default, rule, lambda v: v if isinstance(v, str) and v in options else None, options=options)


def word(default: str | None, rule: str) -> Any:
    """Declare a non-empty word, such as a name that is looked up elsewhere."""
    return _checked(default, rule, lambda v: v if isinstance(v, str) and v.strip() == v != "" else None)


def flag(default: bool) -> Any:
    """Declare a boolean."""
    return _checked(default, "must be True or False", lambda v: v if isinstance(v, bool) else None)


def rows(
    default: tuple | None,
    rule: str,
    read_entry: Callable[[Any], Any],
    units: tuple[str, ...] = (),
    least: int = 0,
    most: int = sys.maxsize,
    optional: bool = False,
) -> Any:
    """Declare a tuple of `least` to `most` entries, read by `read_entry`, which returns None for an invalid entry.

    None is valid if it is the default, or if `optional`. `units` are the units of an entry that is a row of numbers.
    """

    def read(value: Any) -> tuple | None:
        fits = isinstance(value, tuple) and least <= len(value) <= most
        entries = tuple(map(read_entry, value)) if fits else (None,)
        return None if None in entries else entries

    return _checked(default, rule, read, optional, units=units)


def columns_and_rows(default: tuple[int, int] | None, most: int) -> Any:
    """Declare the columns and rows of a grid, each from 1 to `most`, or None for no grid."""
    rule = f"must be (columns, rows), each from 1 to {most}, or None"
    return rows(default, rule, lambda side: side if is_whole(side, 1, most) else None, least=2, most=2, optional=True)


class Checked:
    """Base of the frozen dataclasses: checks each declared field, then calls `_check_together`.

    Docstrings state the meaning and the rule of each field; the signature states the defaults. `part` is the name in
    error messages, by default that of the class, or "" for none.
    """

    part: ClassVar[str]
    """Name of this part in overrides and error messages, as `curve` in `curve.half_width`."""

    def __init_subclass__(cls, part: str | None = None, **settings: Any) -> None:
        super().__init_subclass__(**settings)
        cls.part = cls.__name__.removesuffix("Parameters").lower() if part is None else part
        cls.__doc__ = f"{inspect.cleandoc(cls.__doc__ or '')}\n\n{_fields_in_words(cls)}".strip()

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            declared, value = field.metadata, getattr(self, field.name)
            if "rule" not in declared or (value is None and declared["optional"]):
                continue
            try:
                value = declared["read"](_plain(value))
            except (TypeError, ValueError, ArithmeticError):  # a wrong type, or a number beyond all floats
                value = None
            self._require(value is not None, field.name, declared["rule"])
            object.__setattr__(self, field.name, value)
        self._check_together()

    def scaled(self, length: float = 1.0, time: float = 1.0) -> Self:
        """Return a copy with all lengths multiplied by `length` and all times by `time`.

        Speeds, rates, accelerations and weights are scaled by the powers in their units.
        """
        changed, factor_of = {}, _factors(length, time)
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            factors = [factor_of[unit] for unit in field.metadata.get("units", ())]
            value = getattr(self, field.name)
            if value is None or all(factor == 1 for factor in factors):
                continue
            if isinstance(value, tuple):
                changed[field.name] = tuple(tuple(map(operator.mul, row, factors)) for row in value)
            else:
                changed[field.name] = value * factors[0]
        return dataclasses.replace(self, **changed)  # type: ignore[type-var]

    def _check_together(self) -> None:
        """Check rules that involve more than one field."""

    def _require(self, holds: bool, name: str, rule: str) -> None:
        require(holds, f"{self.part}.{name}" if self.part else name, rule, getattr(self, name))


def is_whole(value: Any, low: float = -math.inf, high: float = math.inf) -> bool:
    """Return True for a whole number of any type except bool that is from `low` to `high`."""
    if isinstance(value, (bool, np.bool_)):
        return False
    try:
        return low <= operator.index(value) <= high
    except Exception:  # an array of another size or kind, or a masked one, has its own errors
        return False


def is_number(value: Any, low: float = -sys.float_info.max, high: float = sys.float_info.max) -> bool:
    """Return True for a number of any type except bool that is from `low` to `high`; by default for any finite one."""
    if isinstance(value, (bool, np.bool_, str)) or not hasattr(value, "__float__"):
        return False
    try:
        return low <= float(value) <= high
    except Exception:  # a number beyond all floats, or an array
        return False


def whole_number(name: str, value: Any, low: int = 1, high: int | None = None) -> int:
    """Return a whole number as an int.

    Raises:
        ValueError: it is not a whole number of at least `low`, or, if `high` is given, from `low` to `high`.
    """
    limits = f"of at least {low}" if high is None else f"from {low} to {high}"
    fits = is_whole(value, low, math.inf if high is None else high)
    require(fits, name, f"must be a whole number {limits}", value)
    return operator.index(value)


def within(low: float, high: float, *others: float) -> Callable[[Any], float | None]:
    """Return a function that reads a number from `low` to `high`, -0.0 as 0.0, or one of `others`; None for another."""
    ranges = (low, high), *((other, other) for other in others)
    return lambda value: float(value) + 0.0 if any(is_number(value, *ends) for ends in ranges) else None


def as_robot(value: Any) -> int | None:
    """Return the index of a robot, which may be given as 1.0; None for another value."""
    return int(value) if is_number(value, 0) and float(value).is_integer() else None


def row_of(*columns: Callable[[Any], Any]) -> Callable[[Any], tuple | None]:
    """Return a function that reads a row by a function for each of its entries, and returns None for an invalid one."""

    def read(entry: Any) -> tuple | None:
        row = tuple(column(value) for column, value in zip(columns, entry, strict=True))
        return None if None in row else row

    return read


def _checked(
    default: Any,
    rule: str,
    read: Callable[[Any], Any],
    optional: bool = False,
    options: tuple[str, ...] = (),
    units: tuple[str, ...] = (),
) -> Any:
    """Declare a field by its rule and by the function that returns its value, or None for an invalid one."""
    optional = optional or default is None
    metadata = {"rule": rule, "read": read, "optional": optional, "options": options, "units": units}
    return dataclasses.field(default=default, metadata=metadata)


def _factors(length: float, time: float) -> dict[str, float]:
    """Return the factor of numbers of each unit when lengths and times are scaled; angles do not scale."""
    lengths = {"m": length, "m/s": length / time, "m/s^2": length / time**2}
    rates = {"1/s": 1 / time, "rad/s": 1 / time, "rad/s^2": 1 / time**2, "rad/sqrt(s)": 1 / math.sqrt(time)}
    return {"": 1.0, "rad": 1.0, "s": time} | lengths | rates


def _plain(value: Any) -> Any:
    """Convert NumPy scalars and arrays to Python's numbers and tuples, which can be hashed and written as JSON."""
    value = value.tolist() if hasattr(value, "tolist") else value
    return tuple(_plain(entry) for entry in value) if isinstance(value, (list, tuple)) else value


def _fields_in_words(cls: type) -> str:
    """Return the docstring's section on the fields: the string after each field, and its rule."""
    words = {name: text for base in reversed(cls.__mro__) for name, text in meanings(base).items()}
    inherited, lines = getattr(cls, "__dataclass_fields__", {}), []  # those of `cls` are not made yet
    for name, field in {**inherited, **vars(cls)}.items():
        if isinstance(field, dataclasses.Field) and "rule" in field.metadata:
            rule = field.metadata["rule"].removeprefix("must be ") + ", or None" * field.metadata["optional"]
            text = f"{words[name]}\n({rule})" if name in words else f"({rule})"
            lines.append(f"{name}: {text}".replace("\n", "\n        "))
    return "\n    ".join(["Attributes:", *lines]) if lines else ""


def meanings(cls: type) -> dict[str, str]:
    """Return the string after each field in the source of a class; empty without source."""
    try:
        return _meanings_in(inspect.getsourcefile(cls) or "").get(cls.__name__, {})
    except (OSError, TypeError, SyntaxError):
        return {}


@cache
def _meanings_in(path: str) -> dict[str, dict[str, str]]:
    """Return the string after each field of each class of a file; without its tree, which is large."""
    with open(path, encoding="utf-8") as source:
        classes = [node for node in ast.parse(source.read()).body if isinstance(node, ast.ClassDef)]
    texts: dict[str, dict[str, str]] = {node.name: {} for node in classes}
    for node in classes:
        for pair in pairwise(node.body):
            match pair:
                case (ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text)))):
                    texts[node.name][name] = inspect.cleandoc(text)
    return texts
