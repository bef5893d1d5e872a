"""A colour and a mark for each policy, or other thing of a kind, in a picture.

The first six colours and the eighth are those of Okabe and Ito (Color Universal Design, 2008) without yellow, which is
too pale for a line on white, and with a softer black; the other six were chosen to be as far from them, and from each
other, as can be. No two of the thirteen look alike to a reader without red, green or blue cones, and the first thirteen
styles differ in their marks as well. More things than that share a colour or a mark, and from 170 on both.
"""

import io
from collections.abc import Iterable
from typing import Any, NamedTuple

from baselines.benchmark.types import POLICIES
from baselines.policies.registry import split_suffix

BLUE, ORANGE, GREEN, PINK, RED = "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00"
SKY, DARK = "#56B4E9", "#333333"
VIOLET, INDIGO, BROWN, OLIVE, PLUM, LILAC = "#962DFF", "#3C2DA5", "#692D00", "#B4B469", "#5A1E69", "#9678FF"
COLOURS = (BLUE, ORANGE, GREEN, PINK, RED, SKY, VIOLET, DARK, INDIGO, BROWN, OLIVE, PLUM, LILAC)
MARKS = ("o", "s", "^", "D", "v", "P", "X", "*", "<", "p", ">", "h", "d")

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
    "svg.hashsalt": "lissajous",  # the same picture makes the same file
}
"""Style of all pictures, for matplotlib."""

_UNDATED = {"png": "Software", "svg": "Date", "pdf": "CreationDate"}
"""Metadata that is left out, by format, so that the same picture makes the same file."""


def saved(figure: Any, suffix: str) -> bytes:
    """Return the file of a figure of matplotlib, the same every time."""
    file = io.BytesIO()
    figure.savefig(file, format=suffix, metadata={_UNDATED[suffix]: None})
    return file.getvalue()


class PlotStyle(NamedTuple):
    """Colour and mark of one of several things."""

    colour: str
    mark: str


def style_at(place: int) -> PlotStyle:
    """Return the style of the thing at a place from 0 in a list; places less than 169 apart have different ones."""
    lap, colour = divmod(place, len(COLOURS))
    return PlotStyle(COLOURS[colour], MARKS[(colour + lap) % len(MARKS)])


def styles_of(played: Iterable[str]) -> dict[str, PlotStyle]:
    """Return the style of each policy; one with a filter has that of the same policy without it.

    The standard policies always have the same style; the others, in the order of their names, have the next ones, first
    those with a colour of none of the standard policies that are played.
    """
    plain = {policy: split_suffix(policy)[0] for policy in played}
    standard = dict.fromkeys(split_suffix(policy)[0] for policy in POLICIES)
    styles = {name: style_at(place) for place, name in enumerate(standard)}
    others = sorted({*plain.values()} - standard.keys())
    taken = {styles[name].colour for name in standard.keys() & {*plain.values()}}
    left = map(style_at, range(len(standard), len(standard) + max(len(others), len(COLOURS))))
    styles |= zip(others, sorted(left, key=lambda style: style.colour in taken), strict=False)
    return {policy: styles[name] for policy, name in plain.items()}
