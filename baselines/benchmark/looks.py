"""A colour and a mark for each policy, or other thing of a kind, in a picture.

The first seven colours are those of Okabe and Ito (Color Universal Design, 2008) without yellow, which is too pale for
a line on white, and with a softer black; the other six were chosen to be as far from them, and from each other, as can
be. No two of the thirteen are one to a reader without red, green or blue cones, and the first thirteen looks differ in
their marks as well. More things than that share a colour or a mark, never both.
"""

import zlib
from collections.abc import Iterable
from typing import Any, NamedTuple

from baselines.benchmark import clairvoyant
from baselines.policies.registry import unwrapped

BLUE, ORANGE, GREEN, PINK, RED = "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00"
SKY, DARK = "#56B4E9", "#333333"
VIOLET, INDIGO, BROWN, OLIVE, PLUM, LILAC = "#962DFF", "#3C2DA5", "#692D00", "#B4B469", "#5A1E69", "#9678FF"
COLOURS = (BLUE, ORANGE, GREEN, PINK, RED, SKY, VIOLET, DARK, INDIGO, BROWN, OLIVE, PLUM, LILAC)
MARKS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", "p", ">", "h", "d")
_LOOKS = len(COLOURS) * len(MARKS)

_FIXED = (
    "kuramoto-mpcc", "open-loop-mpcc", "consensus-mpcc", "sweep", "laps", "learned-intruders", "learned-rough",
    "random", "kuramoto", "open-loop", "consensus", clairvoyant.NAME,
)  # fmt: skip
"""Policies of the standard comparison, without the filter, in the order of their looks."""

STYLE: dict[Any, Any] = {
    "font.size": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#8a8a8a",
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "xtick.color": "#444444",
    "ytick.color": "#222222",
    "legend.frameon": False,
    "savefig.dpi": 150,
    "savefig.facecolor": "white",
}
"""Style of all pictures, for matplotlib."""


class Look(NamedTuple):
    """Colour and mark of one of several things."""

    colour: str
    mark: str


def look(place: int) -> Look:
    """Return the look of the thing at a place from 0 in a list; places less than 169 apart have different ones."""
    lap, colour = divmod(place, len(COLOURS))
    return Look(COLOURS[colour], MARKS[(colour + lap) % len(MARKS)])


def looks_of(played: Iterable[str]) -> dict[str, Look]:
    """Return how each policy is drawn; one with a filter is drawn as the same without.

    The standard ones always look the same. Any other has a place by its name, too, and moves on from it only where the
    look, or as long as there are free ones the colour, is that of another that is drawn.
    """
    policies = list(played)
    plain = dict.fromkeys(unwrapped(policy)[0] for policy in policies)
    look_of = {policy: look(_FIXED.index(policy)) for policy in plain if policy in _FIXED}
    for policy in sorted(each for each in plain if each not in look_of):
        first = zlib.crc32(policy.encode())
        places = [look((first + k) % _LOOKS) for k in range(_LOOKS)]
        colours = {each.colour for each in look_of.values()}
        free = [each for each in places if each not in look_of.values()] or places
        look_of[policy] = next((each for each in free if each.colour not in colours), free[0])
    return {policy: look_of[unwrapped(policy)[0]] for policy in policies}
