"""The style of the paper's pictures: `baselines.benchmark.plot_styles` in the paper's colours, with a footnote."""

import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from baselines.benchmark.plot_styles import BLUE, DARK, GREEN, ORANGE, PINK, RED, SKY, STYLE, saved
from lissajous_env.parameters.scenario import Curve
from lissajous_env.theory import closed_forms

Format = Literal["png", "svg", "pdf"]
"""Formats of a picture."""
GREY = "#a8a8a8"
SERIES = (BLUE, RED, GREEN, PINK, ORANGE, SKY)
"""Colours of things that are alike, as robots are."""

_SMALLER: dict[Any, Any] = {
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titleweight": "normal",
    "axes.titlelocation": "center",
    "axes.labelsize": 8.5,
    "legend.fontsize": 8,
    "savefig.dpi": 180,
}
_STYLES = ["default", STYLE | _SMALLER]


@dataclass
class Picture:
    """A picture of the paper, drawn from our simulations."""

    name: str
    """Name of its file, without the suffix."""
    title: str
    figure: Figure
    caption: str = ""
    """Description, with the choices where the paper states no value."""

    def content(self, format: Format = "png") -> bytes:
        """Return the content of the file in a format."""
        with style.context(_STYLES):
            return saved(self.figure, format)


@contextmanager
def sheet(name: str, title: str, width: float, height: float) -> Iterator[Picture]:
    """Yield a picture of a size [inch] to draw on and to caption; title and caption are drawn at the end."""
    with style.context(_STYLES):
        picture = Picture(name, title, Figure(figsize=(width, height), layout="constrained"))
        yield picture
        picture.figure.suptitle(title, x=0.008, ha="left", fontsize=10.5, fontweight="bold")
        wrapped = textwrap.fill(picture.caption, int(width * 19))
        picture.figure.supxlabel(wrapped, x=0.008, ha="left", fontsize=7.4, color="#555555", linespacing=1.35)


def name_line(axes: Axes, x: float, y: float, word: str, colour: str) -> None:
    """Write a word behind the end of a line, in its colour."""
    place: dict[str, Any] = {"xytext": (3, 0), "textcoords": "offset points", "va": "center"}
    axes.annotate(word, (x, y), fontsize=7, color=colour, annotation_clip=False, **place)


def draw_plane(axes: Axes, curve: Curve, **line: Any) -> None:
    """Draw the rectangle and the curve in it, with equal scales and without a frame."""
    A, B = curve.half_width, curve.half_height
    gamma = np.linspace(0, 2 * np.pi, 200 * max(curve.a, curve.b))
    axes.plot(*closed_forms.curve_point(curve, gamma).T, **({"color": GREY, "lw": 0.6, "zorder": 1} | line))
    axes.plot([-A, A, A, -A, -A], [-B, -B, B, B, -B], color="#bdbdbd", lw=0.8, zorder=0)
    axes.set_aspect("equal")
    axes.set_axis_off()


def draw_ring(axes: Axes, position: np.ndarray, neighbours: np.ndarray, **line: Any) -> None:
    """Draw the edges of the communication ring between robots at (N, 2) positions, in the paper's orange."""
    ends = [position[[robot, other]] for robot, others in enumerate(neighbours) for other in others[others > robot]]
    axes.add_collection(LineCollection(ends, **({"color": ORANGE, "lw": 1.1, "zorder": 2} | line)))


def mark_time(
    axes: Axes, time: float, word: str, high: float, colour: str = DARK, side: Literal["left", "right"] = "left"
) -> None:
    """Draw a dashed upright line at a time, and a word with its `side` at the line, at a share `high` of the axes."""
    axes.axvline(time, color=colour, lw=0.9, ls="--", zorder=1)
    place: dict[str, Any] = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
    place["xytext"] = (3 if side == "left" else -3, -2)
    axes.annotate(word, (time, high), ha=side, va="top", fontsize=8, color=colour, **place)
