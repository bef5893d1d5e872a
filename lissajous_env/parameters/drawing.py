"""Draw the value of a field from a range or from choices, as a `ScenarioSpace` describes them."""

from collections.abc import Callable, Mapping
from typing import Any

from lissajous_env.settings.checks import is_finite, is_whole
from lissajous_env.settings.formulas import Formula
from lissajous_env.wording import shown

Look = Callable[[str], Any]
Drawing = Callable[[float, Look], Any]
"""Function of a number in [0, 1) and of the other values, which returns the value of a field."""


def drawing(name: str, given: Any) -> Drawing:
    """Return the function that draws a value.

    Raises:
        ValueError: the draw is invalid.
    """
    if not isinstance(given, Mapping):
        return lambda at, look_up: given
    keys = set(given)
    if keys == {"formula"}:
        formula = Formula(given["formula"])
        return lambda at, look_up: formula(look_up)
    if "choices" in keys <= {"choices", "weights"}:
        return _choosing(name, given["choices"], given.get("weights"))
    if {"low", "high"} <= keys <= {"low", "high", "log", "times"}:
        return _ranging(name, **given)
    rule = "must be a value, {low, high}, also with log and times, {choices}, also with weights, or {formula}"
    raise ValueError(f"{name} {rule}, got {shown(dict(given))}")


def _choosing(name: str, choices: Any, weights: Any) -> Drawing:
    if not isinstance(choices, (list, tuple)) or not choices:
        raise ValueError(f"{name}.choices must be a list of at least one value, got {shown(choices)}")
    shares = [1.0] * len(choices) if weights is None else list(weights)
    if len(shares) != len(choices) or not all(is_finite(share) and share >= 0 for share in shares) or not sum(shares):
        raise ValueError(
            f"{name}.weights must be {len(choices)} numbers of at least 0, not all 0, got {shown(weights)}"
        )

    def choose(at: float, look_up: Look) -> Any:
        left = at * sum(shares)
        for choice, share in zip(choices, shares, strict=True):
            left -= share
            if left < 0:
                return choice
        return choices[max(place for place, share in enumerate(shares) if share)]

    return choose


def _ranging(name: str, low: Any, high: Any, log: bool = False, times: str | None = None) -> Drawing:
    if not (is_finite(low) and is_finite(high) and low <= high):
        raise ValueError(f"{name} must have finite numbers low <= high, got {shown(low)} and {shown(high)}")
    if log and low <= 0:
        raise ValueError(f"{name}.low must be above 0 with log, got {shown(low)}")
    formula = None if times is None else Formula(times)

    def draw(at: float, look_up: Look) -> Any:
        if is_whole(low) and is_whole(high):
            value = low + int(at * (high - low + 1))
        else:
            value = low * (high / low) ** at if log else low + (high - low) * at
        return value if formula is None else value * formula(look_up)

    return draw
