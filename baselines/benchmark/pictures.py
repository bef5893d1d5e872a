"""Pictures of a benchmark, in one style: a point and its interval for each policy, one panel for each scenario."""

import io
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from baselines.benchmark.comparison import OVER_LIMIT, guarantee_of, limit_of
from baselines.benchmark.looks import Look, looks_of
from baselines.benchmark.statistics import Statistics
from baselines.benchmark.tables import number, shown_name
from baselines.policies.registry import unwrapped
from lissajous_env.parameters.scenario import Scenario

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
_POINTS = 1000
"""Steps of a curve that are drawn, or up to twice as many."""
_FOR_GOOD = 1e9
"""A time beyond every scale [s]."""
_PANEL = 3.8
"""Width of a panel [inch]."""


def draw(
    rows: Sequence[dict[str, Any]],
    cells: Mapping[str, Mapping[str, Mapping[str, Statistics]]],
    scenarios: Mapping[str, Scenario],
    curves: Mapping[str, Mapping[str, tuple[Any, Any]]],
) -> dict[str, bytes]:
    """Draw the pictures and return each as a PNG, by file name; `curves` are those of `Outcome.held_curves`."""
    if not rows:
        return {}
    looks = looks_of(dict.fromkeys(row["policy"] for row in rows))
    played, most = list(cells), max(map(len, cells.values()))

    def times(axes: Axes, name: str) -> None:
        _points(axes, {policy: of["detection_time_mean"] for policy, of in cells[name].items()}, looks, linear=0.1)
        _mark_bound(axes, scenarios[name])
        axes.set_xlabel(f"mean detection time [s]{_mark_limit(axes, scenarios[name])}")
        _name_ratios(axes, "over limit", [of[OVER_LIMIT].mean for of in cells[name].values()])

    def collisions(axes: Axes, name: str) -> None:
        _points(axes, {policy: of["collisions"] for policy, of in cells[name].items()}, looks, linear=1)
        axes.set_xlabel("collisions per episode")

    def distribution(axes: Axes, name: str) -> None:
        _steps(axes, curves.get(name, {}), looks)
        _mark_bound(axes, scenarios[name])
        axes.set_xlabel("time since the target appeared [s]")
        axes.set_ylabel("share detected")

    def guarantee(axes: Axes, name: str) -> None:
        _points(axes, {policy: of["guaranteed_detection_time"] for policy, of in cells[name].items()}, looks, linear=1)
        _mark_bound(axes, scenarios[name])
        known = [of["guaranteed_detection_time"] for of in cells[name].values()]
        for place, of in enumerate(known):
            if of.at_least:
                axes.text(of.iqm, place - 0.18, ">", ha="center", va="bottom", fontsize=8)
        axes.set_xlabel("guaranteed time [s]; >, arrow: at least")
        formation = guarantee_of(scenarios[name])[1]
        _name_ratios(axes, "over formation", [of.iqm / formation for of in known], [of.at_least for of in known])

    followed = [name for name in played if scenarios[name].task.contamination is not None]
    with rc_context(STYLE):
        drawn = {"guaranteed.png": _panels(followed, "Guaranteed detection", guarantee, most)} if followed else {}
        return drawn | {
            "detection_time.png": _panels(played, "Detection time", times, most),
            "collisions.png": _panels(played, "Collisions", collisions, most),
            "detection_time_distribution.png": _panels(
                played, "Targets detected over time (Kaplan-Meier)", distribution, legend=True
            ),
        }


def _panels(
    played: list[str], title: str, fill: Callable[[Axes, str], None], most: int = 0, legend: bool = False
) -> bytes:
    """Draw a panel for each name; `most` is the most policies that one of them lists."""
    columns = min(len(played), 3)
    rows = -(-len(played) // columns)
    height = max(2.7, 0.9 + 0.3 * most)
    layout = ConstrainedLayoutEngine(w_pad=0.12)  # room for half of a last tick's label
    figure = Figure(figsize=(max(_PANEL * columns + 0.6, 4.6), height * rows + 0.8), layout=layout)
    figure.suptitle(title, x=0.01, ha="left", fontsize=13, fontweight="bold")
    for k, name in enumerate(played):
        axes = figure.add_subplot(rows, columns, k + 1)
        axes.set_title(name)
        fill(axes, name)
    if legend:
        entries = {
            label: line for axes in figure.axes for line, label in zip(*axes.get_legend_handles_labels(), strict=True)
        }
        wide = 0.75 + 0.075 * max(map(len, entries))
        columns = max(min(len(entries), int(figure.get_figwidth() / wide)), 1)
        shown = figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=columns)
        for line in shown.get_lines():
            line.set_linewidth(3)
    else:
        meaning = "mark: interquartile mean, hollow with the collision filter", "bar: 95 % bootstrap interval"
        figure.supxlabel(("\n" if columns == 1 else "; ").join(meaning), fontsize=8.5, color="#555555")
    file = io.BytesIO()
    figure.savefig(file, format="png", metadata={"Software": None})
    return file.getvalue()


def _points(axes: Axes, of: dict[str, Statistics], looks: dict[str, Look], linear: float) -> None:
    """One line for each policy, the first on top, on a scale that is linear up to `linear`, then logarithmic."""
    for place, (policy, values) in enumerate(of.items()):
        if values.n_finite == 0:
            axes.text(0.02, place, "no number", transform=axes.get_yaxis_transform(), va="center", color="#777777")
            continue
        colour, mark = looks[policy]
        end = _end(values)
        axes.plot([values.low, end], [place, place], color=colour, lw=5, alpha=0.35, solid_capstyle="butt")
        if values.high == np.inf:
            axes.plot([end], [place], ">", color=colour, ms=5, clip_on=False)
        face = "white" if unwrapped(policy)[1] else colour
        axes.plot([values.iqm], [place], mark, color=colour, mfc=face, mew=1.5, ms=6, clip_on=False, zorder=3)
    axes.set_yticks(range(len(of)), [shown_name(policy) for policy in of])
    axes.set_ylim(len(of) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.grid(False, axis="y")
    axes.set_xscale("symlog", linthresh=linear, linscale=0.5)
    axes.set_xlim(left=-0.15 * linear)
    largest = max((_end(values) for values in of.values() if values.n_finite > 1), default=linear)
    ticks = [0.0, *(linear * 10**k for k in range(int(np.log10(max(largest / linear, 1))) + 2))]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()


def _end(values: Statistics) -> float:
    """Return where the bar of an interval ends: at the largest number where the interval has no upper end."""
    return values.max if values.high == np.inf else values.high


def _steps(axes: Axes, curves: Mapping[str, tuple[Any, Any]], looks: dict[str, Look]) -> None:
    """Share detected over time; later curves are thinner, so that equal ones all show."""
    end = 0.1
    for k, (policy, (times, share)) in enumerate(curves.items()):
        colour, mark = looks[policy]
        hollow = {"ls": (0, (3, 1)), "mfc": "white"} if unwrapped(policy)[1] else {"ls": "-"}
        marks = {"marker": mark, "ms": 6, "mew": 1.5, "markevery": (0.03 * (k % 5), 0.25)}
        line: dict[str, Any] = {"color": colour, "lw": max(4.5 - 0.8 * k, 1.2), "label": policy} | marks | hollow
        shown = slice(None, None, max(len(times) // _POINTS, 1))
        at, of = [0, *times[shown], *times[-1:]], [0, *share[shown], *share[-1:]]
        if of[-1] == 1:  # all are detected; otherwise nothing is known beyond the last that was still there
            at, of = [*at, _FOR_GOOD], [*of, 1]
        axes.step(at, of, where="post", **line)
        if len(times):
            end = max(end, times[np.searchsorted(share, 0.99 * share[-1])])
    axes.set_ylim(0, 1.03)
    axes.set_xlim(0, 1.05 * end)


def _mark_bound(axes: Axes, scenario: Scenario) -> None:
    """Draw a dashed line at T_max, where the scale reaches it."""
    bound = scenario.detection_time_bound
    if bound <= axes.get_xlim()[1]:
        axes.axvline(bound, color="#444444", lw=1, ls="--", zorder=1)
        place = {"xycoords": ("data", "axes fraction"), "xytext": (3, 3), "textcoords": "offset points"}
        name = scenario.detection_time_label.replace("T_max", "$T_{max}$")
        axes.annotate(name, (bound, 0), ha="left", va="bottom", fontsize=8.5, color="#444444", **place)


def _mark_limit(axes: Axes, scenario: Scenario) -> str:
    """Draw a dotted line at the lower bound of the mean detection time, where there is one; return what it is."""
    limit = limit_of(scenario)
    if not limit <= axes.get_xlim()[1]:
        return ""
    axes.axvline(limit, color="#444444", lw=1, ls=":", zorder=1)
    return f"; dotted: no policy below {number(limit)} s"


def _name_ratios(axes: Axes, over: str, ratios: Sequence[float], at_least: Sequence[bool] = ()) -> None:
    """Write a ratio to the right of each line that has one, and over what it is above them."""
    words: dict[str, Any] = {"transform": axes.get_yaxis_transform(), "color": "#555555", "fontsize": 8.5}
    for place, ratio in enumerate(ratios):
        if np.isfinite(ratio):
            more = "> " if at_least and at_least[place] else ""
            axes.text(1.02, place, f"{more}{number(ratio)} x", va="center", **words)
    if np.isfinite(ratios).any():
        axes.text(1.02, -0.6, over, va="bottom", **words)
