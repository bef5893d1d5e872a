"""By which policies, and other things that are alike, are told apart in a picture: a colour and a mark.

The seven colours are those of Okabe and Ito (Color Universal Design, 2008) without yellow, which is too pale for a line
on white, and with a softer black. No two of them are one to a reader without red, green or blue cones. More than seven
things that meet share colours, never colour and mark.
"""

from collections.abc import Iterable
from typing import NamedTuple

from baselines.policies.registry import names, unwrapped

BLUE, ORANGE, GREEN, PINK, RED = "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00"
SKY, DARK = "#56B4E9", "#333333"
COLOURS = (BLUE, ORANGE, GREEN, PINK, RED, SKY, DARK)
MARKS = ("o", "s", "^", "D", "v", "P", "X", "*")


class Look(NamedTuple):
    """How one of several things is drawn."""

    colour: str
    mark: str


def look(place: int) -> Look:
    """Look of the thing at a place from 0 in a list; places less than 56 apart have different ones."""
    return Look(COLOURS[place % len(COLOURS)], MARKS[place // len(COLOURS) % len(MARKS)])


def looks_of(played: Iterable[str]) -> dict[str, Look]:
    """How each policy is drawn: the same in every benchmark, whatever others are played; a filter changes nothing."""
    policies = dict.fromkeys([*names(), *played])
    plain = dict.fromkeys(unwrapped(policy)[0] for policy in policies)
    look_of = {policy: look(k) for k, policy in enumerate(plain)}
    return {policy: look_of[unwrapped(policy)[0]] for policy in policies}
