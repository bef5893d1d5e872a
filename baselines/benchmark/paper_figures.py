"""Figures of the results table for a paper: a panel for each column, a line for each policy.

The conventions are those of R. Agarwal et al., "Deep Reinforcement Learning at the Edge of the Statistical Precipice"
(NeurIPS 2021, the library rliable) and R. Gorsane et al., "Towards a Standardised Performance Evaluation Protocol for
Cooperative MARL" (NeurIPS 2022, marl-eval): interquartile means and probabilities of improvement with percentile
bootstrap intervals, and every episode as a dot. The probability of improvement is on the same seeds.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from baselines.benchmark.plot_styles import STYLE, PlotStyle, saved, styles_of
from baselines.benchmark.statistics import (
    DERIVED,
    IMPROVEMENT,
    OVERALL,
    SHARE_OF_SEEDS,
    Estimate,
    added_columns,
    with_numbers,
)
from baselines.benchmark.table import Estimates, Rows, Table, grouped, numbers
from baselines.policies.registry import split_suffix
from lissajous_env.world.columns import COLLISIONS, LARGEST, OPEN, SENSED, SHARE, WHOLE, WORST_CASE, Column, task_score

WIDTH = 7.16
"""Width of a figure over both columns of a paper [inch]."""
_STYLE: dict[Any, Any] = STYLE | {
    "font.size": 7.5,
    "axes.titlesize": 8,
    "axes.labelsize": 7.5,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "axes.linewidth": 0.6,
    "grid.linewidth": 0.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "savefig.dpi": 300,
    "pdf.fonttype": 42,  # fonts that journals accept and readers can search
}
_MARGINS = 0.8
"""Height of the title and the axis of a row of panels [inch]."""
_LINE = 0.17
"""Height of the line of a policy in a panel [inch]."""


def draw(table: Table, form: str) -> Iterator[tuple[str, bytes]]:
    """Draw all figures of a table and yield each as name of its file and content."""
    styles = styles_of(dict.fromkeys(row["policy"] for row in table.rows))
    with style.context(["default", _STYLE]):
        for overall in table.overall:
            figure = _figure(f"over {len(overall.scenarios)} scenarios", overall.policies, OVERALL, styles)
            yield f"overall-{overall.kind}.{form}", saved(figure, form)
        for name, rows in grouped(table.rows).items():
            policies = table.estimates[name]
            columns = dict.fromkeys((task_score(table.scenarios[name]), WORST_CASE, COLLISIONS, SENSED))
            columns = (*columns, *added_columns(policies.values()), IMPROVEMENT)
            title = f"{name}, compared with {table.references[name]}" if name in table.references else name
            yield f"scores-{name}.{form}", saved(_figure(title, policies, columns, styles, rows), form)


def _figure(
    title: str,
    policies: Estimates,
    columns: Sequence[Column],
    styles: Mapping[str, PlotStyle],
    episodes: Mapping[str, Rows] | None = None,
) -> Figure:
    """Draw the estimates of the columns with numbers, each with its interval, and the episodes as dots if given.

    Of a largest value the interval is from the median to the largest, and an open episode is an arrow.
    """
    columns = with_numbers(policies, columns)
    across = min(max(len(columns), 1), 4)
    down = -(-len(columns) // across)
    figure = Figure(figsize=(WIDTH, (_MARGINS + _LINE * len(policies)) * max(down, 1)), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.03, h_pad=0.03)  # type: ignore[union-attr]
    figure.suptitle(title, x=0.005, ha="left", fontsize=8, fontweight="bold", parse_math=False)
    for k, column in enumerate(columns):
        axes = figure.add_subplot(down, across, k + 1)
        axes.set_yticks(range(len(policies)), [name * (k % across == 0) for name in policies], parse_math=False)
        axes.set_ylim(len(policies) - 0.5, -0.5)
        drawn = []
        for place, (policy, estimates) in enumerate(policies.items()):
            if episodes is not None and column.name not in DERIVED:
                drawn += _dots(axes, place, episodes[policy], column, styles[policy].colour)
            drawn += _interval(axes, place, estimates[column.name], styles[policy], policy, episodes is None)
        _scale(axes, column, np.array(drawn))
        most = max(estimates[column.name].known for estimates in policies.values())
        heading = column.heading.replace("T_max", "$T_{max}$")
        axes.set_title(heading + (f"\nlargest of {most}" if column.summary == LARGEST else ""))
    return figure


def _dots(axes: Axes, place: int, rows: Rows, column: Column, colour: str) -> list[float]:
    """Draw every episode, and return the values."""
    values = numbers(rows, column)
    known = np.isfinite(values)
    is_open = ((numbers(rows, OPEN) == 1) & (column.summary == LARGEST))[known]
    values = values[known]
    off = place + 0.2 * np.sin(2.4 * np.arange(len(values)))  # so that equal ones show
    for shape, chosen in ((".", ~is_open), (">", is_open)):
        axes.plot(values[chosen], off[chosen], ls="none", marker=shape, ms=2.5, mew=0, color=colour, alpha=0.6)
    return values.tolist()


def _interval(axes: Axes, place: int, estimate: Estimate, style: PlotStyle, policy: str, in_words: bool) -> list[float]:
    """Draw an estimate with its interval and return its numbers; for a lower bound or infinity, words if `in_words`."""
    if estimate.at_least or not math.isfinite(estimate.value):
        words = "no bound" if estimate.summary == LARGEST else "infinite"
        words = words if estimate.known and in_words else ""
        axes.text(0.98, place, words, transform=axes.get_yaxis_transform(), ha="right", va="center", fontsize=6)
        return []
    ends = (estimate.median, estimate.value) if estimate.summary == LARGEST else (estimate.low, estimate.high)
    axes.plot(ends, [place, place], color=style.colour, lw=4, alpha=0.35, solid_capstyle="butt")
    face = "white" if split_suffix(policy)[1] else style.colour
    axes.plot([estimate.value], [place], color=style.colour, marker=style.mark, ms=4, mew=0.9, mfc=face)
    return [number for number in (estimate.value, *ends) if math.isfinite(number)]


def _scale(axes: Axes, column: Column, values: np.ndarray) -> None:
    """Set the scale of an axis: logarithmic for positive numbers that differ widely, and above 1 for large counts."""
    if column.summary == SHARE_OF_SEEDS:
        axes.set_xlim(-0.03, 1.03)
        axes.axvline(0.5, color="#444444", lw=0.8, ls="--", zorder=1)
    elif column.rule is SHARE:
        axes.set_xlim(min(0.5, values.min(initial=1.0)) - 0.03, 1.03)
    elif len(values) and values.min() > 0 and values.max() > 30 * np.median(values):
        axes.set_xscale("log")
    elif len(values) and column.rule is WHOLE and values.max() > 20:
        axes.set_xscale("symlog", linthresh=1)
        axes.set_xlim(0, values.max() * 1.1)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
