"""Pictures of a benchmark, in one style: a point and its interval for each policy, one panel for each scenario."""

import io
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from baselines.statistics import Statistics
from lissajous_env.scenario import Scenario

_STYLE = {
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
# Okabe and Ito's colours, which stay apart for colour-blind readers; then further ones.
_COLOURS = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#CC79A7",
    "#D55E00",
    "#56B4E9",
    "#7F7F7F",
    "#B2A300",
    "#6A3D9A",
    "#8C564B",
)
_PANEL = 3.3
"""Width of a panel [inch]."""


def draw(
    rows: Sequence[dict[str, Any]],
    cells: Mapping[str, Mapping[str, Mapping[str, Statistics]]],
    scenarios: Mapping[str, Scenario],
) -> dict[str, bytes]:
    """Draw the pictures and return each as a PNG, by file name."""
    if not rows:
        return {}
    policies = list(dict.fromkeys(row["policy"] for row in rows))
    colour = {policy: _COLOURS[k % len(_COLOURS)] for k, policy in enumerate(policies)}
    played = list(cells)

    def times(axes: Axes, name: str) -> None:
        _points(axes, {policy: of["detection_time_mean"] for policy, of in cells[name].items()}, colour)
        _mark_bound(axes, scenarios[name])
        axes.set_xlabel("mean detection time [s]")

    def collisions(axes: Axes, name: str) -> None:
        _points(axes, {policy: of["collisions"] for policy, of in cells[name].items()}, colour, many=True)
        axes.set_xlabel("collisions per episode")

    def distribution(axes: Axes, name: str) -> None:
        for policy in cells[name]:
            values = [r["detection_time_mean"] for r in rows if r["scenario"] == name and r["policy"] == policy]
            _steps(axes, values, colour[policy], policy)
        _mark_bound(axes, scenarios[name])
        axes.set_xlabel("mean detection time [s]")
        axes.set_ylabel("share of episodes at or below")

    with rc_context(_STYLE):
        return {
            "detection_time.png": _panels(played, "Detection time", times),
            "collisions.png": _panels(played, "Collisions", collisions),
            "detection_time_distribution.png": _panels(played, "Detection time over episodes", distribution, True),
        }


def _panels(names: list[str], title: str, fill: Callable[[Axes, str], None], legend: bool = False) -> bytes:
    columns = min(len(names), 3)
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(max(_PANEL * columns + 0.6, 4.6), 2.7 * rows + 0.8), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=13, fontweight="bold")
    for k, name in enumerate(names):
        axes = figure.add_subplot(rows, columns, k + 1)
        axes.set_title(name)
        fill(axes, name)
    if legend:
        entries = {
            label: line for axes in figure.axes for line, label in zip(*axes.get_legend_handles_labels(), strict=True)
        }
        figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=min(len(entries), 6))
    else:
        figure.supxlabel("point: interquartile mean; bar: 95 % bootstrap interval", fontsize=8.5, color="#555555")
    file = io.BytesIO()
    figure.savefig(file, format="png", metadata={"Software": None})
    return file.getvalue()


def _points(axes: Axes, of: dict[str, Statistics], colour: dict[str, str], many: bool = False) -> None:
    """One line for each policy, the first on top; `many` stretches the scale at the small numbers."""
    for place, (policy, values) in enumerate(of.items()):
        if values.n_finite == 0:
            axes.text(0.02, place, "no number", transform=axes.get_yaxis_transform(), va="center", color="#777777")
            continue
        axes.plot(
            [values.low, values.high], [place, place], color=colour[policy], lw=5, alpha=0.35, solid_capstyle="butt"
        )
        axes.plot([values.iqm], [place], "o", color=colour[policy], ms=6)
    axes.set_yticks(range(len(of)), list(of))
    axes.set_ylim(len(of) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.grid(False, axis="y")
    if many:
        axes.set_xscale("symlog", linthresh=1, linscale=0.5)
        axes.set_xlim(left=-0.15)
        largest = max((values.high for values in of.values() if values.n_finite > 1), default=1)
        ticks = [0, *(10**k for k in range(int(np.log10(max(largest, 1))) + 2))]
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
        axes.minorticks_off()
    else:
        axes.set_xlim(left=0)


def _steps(axes: Axes, values: Sequence[float], colour: str, label: str) -> None:
    ordered = np.sort([value for value in values if np.isfinite(value)])
    share = np.arange(1, len(ordered) + 1) / max(len(values), 1)
    axes.step([0, *ordered], [0, *share], where="post", color=colour, lw=1.8, label=label)
    axes.set_ylim(0, 1.03)
    axes.set_xlim(left=0)


def _mark_bound(axes: Axes, scenario: Scenario) -> None:
    """A dashed line at T_max, where the scale reaches it."""
    bound = scenario.detection_time_bound
    if bound <= axes.get_xlim()[1] * 1.3:
        axes.axvline(bound, color="#444444", lw=1, ls="--")
        axes.annotate(
            "T_max", (bound, 1), xycoords=("data", "axes fraction"), xytext=(3, -2), textcoords="offset points",
            va="top", fontsize=8, color="#444444",
        )  # fmt: skip
