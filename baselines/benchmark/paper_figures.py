"""Figures of a comparison for a paper: performance profiles, probability of improvement, aggregates, distributions.

The conventions are those of R. Agarwal et al., "Deep Reinforcement Learning at the Edge of the Statistical Precipice"
(NeurIPS 2021, the library rliable) and R. Gorsane et al., "Towards a Standardised Performance Evaluation Protocol for
Cooperative MARL" (NeurIPS 2022, marl-eval): interquartile means, percentile bootstrap intervals stratified by scenario,
whole distributions. The probability of improvement is that of tables, on the same seeds. Times are over T_max of their
scenario, so that another policy moves no curve; the profiles of ratios to the best policy are the exception.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from baselines.benchmark.plot_styles import STYLE, saved, styles_of
from baselines.benchmark.shown import COMPARED, OVERALL, RATIOS, brought_in
from baselines.benchmark.statistics import (
    Band,
    Estimate,
    performance_profile,
    profile_over_scenarios,
)
from baselines.benchmark.table import Against, Group, Rows, Table, compare, grouped, numbers
from baselines.policies.registry import unwrapped
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import LARGEST, OPEN, SHARE, WHOLE, WORST_CASE, Column

FORMATS = ("pdf", "svg", "png")
WIDTH = 7.16
"""Width of a figure over both columns of a paper [inch]."""
_STYLE: dict[Any, Any] = STYLE | {
    "font.size": 7.5,
    "axes.titlesize": 8,
    "axes.labelsize": 7.5,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "legend.fontsize": 7,
    "axes.linewidth": 0.6,
    "grid.linewidth": 0.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "savefig.dpi": 300,
    "pdf.fonttype": 42,  # fonts that journals accept and readers can search
    "svg.hashsalt": "lissajous",
}
_VALUES = 200
"""Values at which a profile is drawn."""
_Scores = dict[Column, dict[str, list[np.ndarray]]]
"""Scores of each scenario of a group, by column and policy."""
_FIRST_ROW = 0.7
"""Height of a figure of rows beside its rows [inch]."""
_ROW = 0.17
"""Height of a row [inch]."""


def draw(table: Table, against: str | None, form: str) -> Iterator[tuple[str, bytes]]:
    """Draw all figures of a table and yield each as name of its file and content."""
    styles = styles_of(dict.fromkeys(row["policy"] for row in table.rows))
    with style.context(["default", _STYLE]):
        for group in table.groups():
            if scores := _scores(group, table.scenarios):
                yield f"profiles-{group.kind}.{form}", saved(_profiles(scores, styles), form)
                pooled = {policy: [row for rows in by.values() for row in rows] for policy, by in group.rows.items()}
                if pairs := compare(pooled, against):
                    yield f"improvement-{group.kind}.{form}", saved(_improvement(pairs, [*scores], styles), form)
                if group.name in table.overall:
                    overall = _aggregates(table.overall[group.name], styles)
                    yield f"aggregates-{group.kind}.{form}", saved(overall, form)
        for group in table.groups():
            ratios = [c for c in RATIOS if any(np.isfinite(x).any() for p in group.rows for x in group.strata(p, c))]
            if ratios and len(group.scenarios) > 1:
                yield f"ratios-{group.kind}.{form}", saved(_ratios(group, ratios, styles), form)
        for name, of in grouped(table.rows).items():
            rows = [row for episodes in of.values() for row in episodes]
            columns = [c for c in (*COMPARED, *brought_in(rows)) if np.isfinite(numbers(rows, c)).any()]
            if columns:
                yield f"distribution-{name}.{form}", saved(_distribution(name, of, columns, styles), form)


def _scores(group: Group, scenarios: Mapping[str, Scenario]) -> _Scores:
    """Return the scores of the columns with a number of every policy on every scenario, some of them finite.

    Times are over T_max, and the worst case of an open episode is infinite.
    """
    scores = {}
    for column in COMPARED:
        of = {
            policy: [_scaled_scores(rows, column, scenarios[name]) for name, rows in by.items()]
            for policy, by in group.rows.items()
        }
        every = [values for strata in of.values() for values in strata]
        if all((~np.isnan(values)).any() for values in every) and any(np.isfinite(values).any() for values in every):
            scores[column] = of
    return scores


def _scaled_scores(rows: Rows, column: Column, scenario: Scenario) -> np.ndarray:
    values = numbers(rows, column)
    if column is WORST_CASE:
        values[numbers(rows, OPEN) == 1] = np.inf
    return values / scenario.detection_time_bound if column.unit == "s" else values


def _title(column: Column) -> str:
    return f"{column.short} / $T_{{max}}$" if column.unit == "s" else column.heading


def _scaled(axes: Axes, column: Column, values: np.ndarray) -> None:
    """Set the scale of an axis for a column: logarithmic for times over T_max, nearly so for counts."""
    known = values[np.isfinite(values)]
    positive = known[known > 0]
    if column.unit == "s" and len(positive):
        low, high = max(positive.min(), positive.max() / 1e4) * 0.9, positive.max() * 1.1
        _set_log_scale(axes, (1, 2, 5) if math.log10(high / low) < 2.2 else (1,))
        axes.set_xlim(low, high)
    elif column.rule is WHOLE and known.max() > 20:
        axes.set_xscale("symlog", linthresh=1)
        axes.set_xlim(0, known.max() * 1.1)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    elif column.rule is SHARE:
        axes.set_xlim(min(0.5, known.min()) - 0.03, 1.03)


def _set_log_scale(axes: Axes, subs: tuple[int, ...] = (1, 2, 5)) -> None:
    """Set a logarithmic scale with plain numbers, at these multiples of the powers of ten."""
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=subs, numticks=9))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _draw_share(axes: Axes, policy: str, at: np.ndarray, band: Band, styles: Mapping[str, Any]) -> None:
    """Draw the share of a policy's episodes at some values, with its interval."""
    share, below, above = band
    line: dict[str, Any] = _line(policy, styles) | {"markevery": (len(at) // 8, len(at) // 4)}
    axes.plot(at, share, label=policy, **line)
    axes.fill_between(at, below, above, color=styles[policy].colour, alpha=0.15, lw=0)
    axes.set_ylim(-0.02, 1.03)


def _profiles(scores: _Scores, styles: Mapping[str, Any]) -> Figure:
    """Draw for each policy the share of the episodes of all scenarios that are at least as good as a value."""
    figure, panels = _panels([*scores], 2.35)
    for column, axes in panels.items():
        values = np.concatenate([stratum for strata in scores[column].values() for stratum in strata])
        _scaled(axes, column, values)
        low, high = (
            axes.get_xlim() if axes.get_xscale() != "linear" else (0, max(values[np.isfinite(values)].max(), 1e-9))
        )
        at = np.geomspace(low, high, _VALUES) if axes.get_xscale() == "log" else np.linspace(low, high, _VALUES)
        at = np.sort(np.concatenate([at, np.linspace(low, min(10, high), _VALUES)])) if column.rule is WHOLE else at
        for policy, strata in scores[column].items():
            _draw_share(axes, policy, at, performance_profile(strata, at, column.better), styles)
        axes.set_xlabel(f"{_title(column)} $\\tau$")
        axes.set_title(f"$P(\\mathrm{{score}} {'≤' if column.better < 0 else '≥'} \\tau)$", fontweight="normal")
    _legend(figure)
    return figure


def _ratios(group: Group, columns: Sequence[Column], styles: Mapping[str, Any]) -> Figure:
    """Draw for each policy the share of the episodes whose ratio is at most a value, each scenario counted once."""
    figure, panels = _panels(columns, 2.35)
    for column, axes in panels.items():
        every = np.concatenate([values for policy in group.rows for values in group.strata(policy, column)])
        at = np.geomspace(1.0, np.clip(np.quantile(every[np.isfinite(every)], 0.95), 2.0, 100.0), _VALUES)
        for policy in group.rows:
            _draw_share(axes, policy, at, profile_over_scenarios(group.strata(policy, column), at), styles)
        _set_log_scale(axes)
        axes.set_xlabel(f"{column.short} $\\tau$")
        axes.set_title("$P(\\mathrm{ratio} ≤ \\tau)$", fontweight="normal")
    _legend(figure)
    return figure


def _improvement(pairs: Against, columns: Sequence[Column], styles: Mapping[str, Any]) -> Figure:
    """Draw the probability that a policy is better than the reference on the same seed of a scenario."""
    others = list(pairs.policies)
    figure, panels = _panels(columns, _FIRST_ROW + _ROW * len(others) + 0.2, rows=others)
    for column, axes in panels.items():
        axes.axvline(0.5, color="#444444", lw=0.8, ls="--", zorder=1)
        for place, policy in enumerate(others):
            of = pairs.policies[policy][column.name]
            _interval(axes, place, (of.better, of.better_low, of.better_high), styles[policy], policy)
        axes.set_xlim(-0.03, 1.03)
        axes.set_title(column.short)
    figure.supxlabel(f"probability of improvement over {pairs.reference}", fontsize=7.5)
    return figure


def _aggregates(policies: Mapping[str, Mapping[str, Estimate]], styles: Mapping[str, Any]) -> Figure:
    """Draw the estimates over all scenarios with their intervals; of a largest value, a bar from the median."""
    columns = [c for c in OVERALL if any(_has_bound(of[c.name]) for of in policies.values())]
    figure, panels = _panels(columns, _FIRST_ROW + _ROW * len(policies), rows=list(policies))
    for column, axes in panels.items():
        shown = []
        for place, (policy, of) in enumerate(policies.items()):
            estimate = of[column.name]
            if _has_bound(estimate):
                ends = (estimate.median, estimate.max) if column.summary == LARGEST else estimate.interval
                _interval(axes, place, (estimate.value, *ends), styles[policy], policy)
                shown += [estimate.value, *ends]
            else:
                words = {"transform": axes.get_yaxis_transform(), "fontsize": 6, "color": "#777777"}
                axes.text(0.98, place, "no bound" if estimate.n_finite else "", ha="right", va="center", **words)
        _scaled(axes, column, np.array(shown))
        counted = max(of[column.name].n_finite for of in policies.values())
        title = column.heading.replace("T_max", "$T_{max}$")
        axes.set_title(title + (f"\nlargest of {counted}" if column.summary == LARGEST else ""))
    return figure


def _has_bound(estimate: Estimate) -> bool:
    return math.isfinite(estimate.value) and not estimate.at_least


def _distribution(name: str, of: Mapping[str, Rows], columns: Sequence[Column], styles: Mapping[str, Any]) -> Figure:
    """Draw every episode of a scenario as a dot, and the quartiles of each policy as a box.

    For a guarantee the box is from the median to the largest, which is marked; an open episode is an arrow.
    """
    policies = list(of)
    figure, panels = _panels(columns, _FIRST_ROW + _ROW * len(policies), rows=policies)
    figure.suptitle(name, x=0.005, ha="left", fontsize=8, fontweight="bold")
    for column in columns:
        axes, every = panels[column], []
        for place, policy in enumerate(policies):
            values = numbers(of[policy], column)
            known, colour = np.isfinite(values), styles[policy].colour
            is_largest = column.summary == LARGEST
            is_open = (is_largest & (numbers(of[policy], OPEN) == 1))[known]
            values = values[known]
            if not len(values):
                continue
            every.append(values)
            low, mark, high = np.quantile(values, (0.5, 1, 1) if is_largest else (0.25, 0.5, 0.75))
            axes.plot([low, high], [place, place], color=colour, lw=5, alpha=0.3, solid_capstyle="butt")
            axes.plot([mark, mark], [place - 0.28, place + 0.28], color=colour, lw=1.4)
            off = place + 0.18 * np.sin(2.4 * np.arange(len(values)))  # so that equal ones show
            dots: dict[str, Any] = {"ls": "none", "mew": 0, "color": colour, "alpha": 0.7}
            axes.plot(values[~is_open], off[~is_open], marker=".", ms=2.5, **dots)
            axes.plot(values[is_open], off[is_open], marker=">", ms=2.5, **dots)
        values = np.concatenate(every)
        if values.min() > 0 and values.max() > 30 * np.median(values):
            axes.set_xscale("log")
        if column.unit != "s":
            _scaled(axes, column, values)
        counted = f"\nlargest of {max(map(len, every))}" if column.summary == LARGEST else ""
        axes.set_title(column.heading + counted)
    return figure


def _panels(columns: Sequence[Column], height: float, rows: Sequence[str] = ()) -> tuple[Figure, dict[Column, Axes]]:
    """Make a panel for each column, four in a line; with `rows`, each is a line of every panel, the first on top."""
    across = min(len(columns), 4)
    down = -(-len(columns) // across)
    figure = Figure(figsize=(WIDTH, height * down), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.03, h_pad=0.03)  # type: ignore[union-attr]
    panels = {}
    for k, column in enumerate(columns):
        axes = figure.add_subplot(down, across, k + 1)
        if rows:
            labels = list(rows) if k % across == 0 else [""] * len(rows)
            axes.set_yticks(range(len(rows)), labels)
            axes.set_ylim(len(rows) - 0.5, -0.5)
        panels[column] = axes
    return figure, panels


def _line(policy: str, styles: Mapping[str, Any]) -> dict[str, Any]:
    colour, mark = styles[policy]
    hollow = {"mfc": "white", "ls": (0, (4, 1.5))} if unwrapped(policy)[1] else {"ls": "-"}
    return {"color": colour, "marker": mark, "ms": 3.5, "mew": 0.8, "lw": 1.1, **hollow}


def _interval(axes: Axes, place: int, share: tuple[float, float, float], style: Any, policy: str) -> None:
    middle, low, high = share
    axes.plot([low, high], [place, place], color=style.colour, lw=4, alpha=0.35, solid_capstyle="butt")
    face = "white" if unwrapped(policy)[1] else style.colour
    axes.plot([middle], [place], color=style.colour, marker=style.mark, ms=4, mew=0.9, mfc=face)


def _legend(figure: Figure) -> None:
    lines, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside lower center", ncols=min(len(labels), 5), columnspacing=1.2)
