"""Checked fields for frozen dataclasses: each field declares its rule, which is enforced once, at construction.

An error names the field, the rule with its unit, and the value got:
`robot.wheelbase must be from 0.001 to 10000 [m], got -1`. `help()` lists the fields with their rules.
"""

import ast
import dataclasses
import inspect
import math
import operator
import re
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

    def holds(value: Any) -> bool:
        return _is_number(value) and (
            low <= value <= high or (or_zero and value == 0) or (or_infinite and value == math.inf)
        )

    return _checked(default, rule, holds, float, units=(unit,))


def whole(default: int | None, low: int, high: int, parity: str = "") -> Any:
    """Declare a whole number from `low` to `high`, both included, which may have to be `odd` or `even`."""
    rule = f"must be {f'an {parity}' if parity else 'a'} whole number from {low} to {high}"
    rests = {"odd": (1,), "even": (0,)}.get(parity, (0, 1))
    return _checked(default, rule, lambda v: is_whole(v) and low <= v <= high and v % 2 in rests, operator.index)


def choice(default: str | None, *options: str) -> Any:
    """Declare one of a few words."""
    rule = f"must be one of {', '.join(options)}"
    return _checked(default, rule, lambda v: isinstance(v, str) and v in options, options=options)


def word(default: str | None, rule: str) -> Any:
    """Declare a non-empty word, such as a name that is looked up elsewhere."""
    return _checked(default, rule, lambda v: isinstance(v, str) and v.strip() == v != "")


def flag(default: bool) -> Any:
    """Declare a boolean."""
    return _checked(default, "must be True or False", lambda v: isinstance(v, bool))


def rows(
    default: tuple | None,
    rule: str,
    convert: Callable[[Any], Any],
    units: tuple[str, ...] = (),
) -> Any:
    """Declare a tuple of entries, each converted by `convert`, which returns None for an invalid entry.

    None is valid if it is the default. `units` are the units of an entry that is a row of numbers.
    """

    def converted(value: tuple) -> tuple:
        return tuple(convert(entry) for entry in value)

    def holds(value: Any) -> bool:
        return isinstance(value, tuple) and all(entry is not None for entry in converted(value))

    return _checked(default, rule, holds, converted, units=units)


def columns_and_rows(default: tuple[int, int] | None, most: int) -> Any:
    """Declare the columns and rows of a grid, each from 1 to `most`, or None for no grid."""

    def holds(value: Any) -> bool:
        is_pair = isinstance(value, tuple) and len(value) == 2
        return is_pair and all(is_whole(side) and 1 <= side <= most for side in value)

    return _checked(default, f"must be (columns, rows), each from 1 to {most}, or None", holds, optional=True)


class Checked:
    """Base of the frozen dataclasses: checks each declared field, then calls `_check_together`.

    Docstrings state the default of each field, except with `with_defaults=False`, for options of a command, whose
    `--help` states them by itself. `part` is the name in error messages, by default that of the class, or "" for none.
    """

    _part: ClassVar[str]

    def __init_subclass__(cls, with_defaults: bool = True, part: str | None = None, **settings: Any) -> None:
        super().__init_subclass__(**settings)
        cls._part = cls.__name__.removesuffix("Parameters").lower() if part is None else part
        cls.__doc__ = f"{inspect.cleandoc(cls.__doc__ or '')}\n\n{_fields_in_words(cls, with_defaults)}".strip()

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            rule = field.metadata
            given = getattr(self, field.name)
            if "check" not in rule or (given is None and rule["optional"]):
                continue
            value = _plain(given)
            self._require(_holds(rule["check"], value), field.name, rule["rule"])
            object.__setattr__(self, field.name, rule["convert"](value) if rule["convert"] else value)
        self._check_together()

    @property
    def part(self) -> str:
        """Name of this part in overrides and error messages, as `curve` in `curve.half_width`."""
        return self._part

    def scaled(self, length: float = 1.0, time: float = 1.0) -> Self:
        """Return a copy with all lengths multiplied by `length` and all times by `time`.

        Speeds, rates, accelerations and weights are scaled by the powers in their units.
        """
        changed = {}
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            factors = [_factor(unit, length, time) for unit in field.metadata.get("units", ())]
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


def is_whole(value: Any) -> bool:
    """Return True for a whole number of any type except bool."""
    if isinstance(value, (bool, np.bool_)):
        return False
    try:
        operator.index(value)
    except Exception:  # an array of another size or kind, or a masked one, has its own errors
        return False
    return True


def is_finite(value: Any) -> bool:
    """Return True for a finite number of Python's, which a bool is not."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def whole_number(name: str, value: Any, low: int = 1, high: int | None = None) -> int:
    """Return a whole number as an int.

    Raises:
        ValueError: it is not a whole number of at least `low`, or, if `high` is given, from `low` to `high`.
    """
    fits = is_whole(value) and low <= operator.index(value) <= (math.inf if high is None else high)
    limits = f"of at least {low}" if high is None else f"from {low} to {high}"
    require(fits, name, f"must be a whole number {limits}", value)
    return operator.index(value)


def as_robot(value: Any) -> int:
    """Return the index of a robot, which may be given as 1.0.

    Raises:
        ValueError: the value is not a whole number of at least 0.
    """
    fits = _is_number(value) and value >= 0 and float(value).is_integer()
    require(fits, "a robot", "must be a whole number of at least 0", value)
    return int(value)


def robot_and(low: float, high: float) -> Callable[[Any], tuple[int, float] | None]:
    """Return the function that converts pairs of a robot and a number of a range."""

    def convert(entry: Any) -> tuple[int, float] | None:
        robot, value = entry
        return (as_robot(robot), float(value)) if low <= value <= high else None

    return convert


def _checked(
    default: Any,
    rule: str,
    check: Callable[[Any], Any],
    convert: Callable[[Any], Any] | None = None,
    optional: bool = False,
    options: tuple[str, ...] = (),
    units: tuple[str, ...] = (),
) -> Any:
    metadata = {"rule": rule, "check": check, "convert": convert, "optional": optional or default is None}
    metadata |= {"options": options, "units": units}
    return dataclasses.field(default=default, metadata=metadata)


def _holds(check: Callable[[Any], Any], value: Any) -> bool:
    try:
        return bool(check(value))
    except (TypeError, ValueError, ArithmeticError):  # a wrong type, or a number beyond all floats
        return False


def _factor(unit: str, length: float, time: float) -> float:
    """Return the factor of a number of this unit when lengths and times are scaled; angles do not scale."""
    above, _, below = unit.partition("/")
    return _product(above, length, time) / _product(below, length, time)


def _product(units: str, length: float, time: float) -> float:
    """Return the factor of units such as `m`, `s^2`, `sqrt(s)` or `(m s)^2`."""
    scales = {"m": length, "s": time, "rad": 1.0, "1": 1.0}
    if root := re.fullmatch(r"sqrt\((\w+)\)", units):
        return math.sqrt(scales[root[1]])
    match = re.fullmatch(r"\(?([\w ]*)\)?(?:\^(\d))?", units)
    assert match, units
    return math.prod(scales[name] for name in match[1].split()) ** int(match[2] or 1)


def _is_number(value: Any) -> bool:
    return hasattr(value, "__float__") and not isinstance(value, (bool, str)) and not math.isnan(value)


def _plain(value: Any) -> Any:
    """Convert NumPy scalars and arrays to Python's numbers and tuples, which can be hashed and written as JSON."""
    value = value.tolist() if hasattr(value, "tolist") else value
    return tuple(_plain(entry) for entry in value) if isinstance(value, (list, tuple)) else value


def _fields_in_words(cls: type, with_defaults: bool) -> str:
    """Return the docstring's section on the fields: the string after each field, its rule and perhaps its default."""
    words = {name: text for base in reversed(cls.__mro__) for name, text in meanings(base).items()}
    inherited, lines = getattr(cls, "__dataclass_fields__", {}), []  # those of `cls` are not made yet
    for name, field in {**inherited, **vars(cls)}.items():
        if isinstance(field, dataclasses.Field) and "rule" in field.metadata:
            text = "\n".join(part for part in (words.get(name, ""), _rule_in_words(field, with_defaults)) if part)
            lines.append(f"{name}: {text}".replace("\n", "\n        "))
    return "\n    ".join(["Attributes:", *lines]) if lines else ""


def _rule_in_words(field: dataclasses.Field, with_default: bool) -> str:
    rule = str(field.metadata["rule"]).removeprefix("must be ")
    default = f"; default {field.default!r}" if with_default else ""
    return f"({rule}{', or None' if field.metadata['optional'] else ''}{default})"


def meanings(cls: type) -> dict[str, str]:
    """Return the string after each field in the source of a class; empty without source."""
    try:
        tree = _parsed(inspect.getsourcefile(cls) or "")
    except (OSError, TypeError, SyntaxError):
        return {}
    body = next((node.body for node in tree.body if isinstance(node, ast.ClassDef) and node.name == cls.__name__), [])
    return {
        before.target.id: inspect.cleandoc(after.value.value)
        for before, after in pairwise(body)
        if isinstance(before, ast.AnnAssign)
        and isinstance(before.target, ast.Name)
        and isinstance(after, ast.Expr)
        and isinstance(after.value, ast.Constant)
        and isinstance(after.value.value, str)
    }


@cache
def _parsed(path: str) -> ast.Module:
    with open(path, encoding="utf-8") as source:
        return ast.parse(source.read())
