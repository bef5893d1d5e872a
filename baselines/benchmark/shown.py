"""Contents of tables, report and figures: columns of scores, numbers derived from them, and numbers in words."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from baselines.benchmark.bounds import BEST_KNOWN, Bounds
from baselines.benchmark.statistics import SHARE_OF_SEEDS, Estimate
from lissajous_env.parameters.scenario import Faults, Scenario
from lissajous_env.world.columns import (
    COLLISIONS,
    COLUMNS,
    COVERAGE,
    DETECTION_TIME,
    FINITE,
    IDENTITY,
    LARGEST,
    MEAN,
    NAMES,
    RECOVERY,
    SEPARATION,
    WORST_CASE,
    Column,
    task_score,
)

OVER_LOWER_BOUND = Column(
    "over_lower_bound",
    "ratio of the mean detection time to a lower bound for every policy without long-range sensing",
    better=-1,
    summary=MEAN,
    place=2,
    main=True,
)
"""Derived column; the bound is one of an expectation, so that the mean counts."""
SCORE_OVER_BEST = Column(
    "score_over_best",
    "score of the task over that of the best policy on the same scenario and seed; where larger scores are better, its "
    "inverse, so that no policy is below 1",
    title="score / best",
    better=-1,
)
"""Derived column."""
WORST_CASE_OVER_BEST = Column(
    "worst_case_over_best",
    "worst-case undetected time over the shortest of a policy on the same scenario and seed",
    title="guarantee / best",
    better=-1,
    summary=LARGEST,
)
"""Derived column."""
IMPROVEMENT = Column(
    "score_improvement",
    "share of the seeds on which the policy has a better score of the task than the reference; ties count half",
    title="better",
    better=1,
    summary=SHARE_OF_SEEDS,
    place=6,
    main=True,
)
"""Derived column: the probability of improvement."""
OVERALL = (SCORE_OVER_BEST, WORST_CASE_OVER_BEST, OVER_LOWER_BOUND, COLLISIONS, IMPROVEMENT)
"""Columns with the same meaning on every scenario, so that scenarios can be combined."""
DERIVED = {column.name: column for column in OVERALL if column is not COLLISIONS}
"""Columns that `baselines.benchmark.table` adds to score rows, by name."""
SHOWN = tuple(
    sorted(
        (column for column in (*COLUMNS.values(), *DERIVED.values()) if column.place), key=lambda column: column.place
    )
)
"""Columns of tables of policies, the most important first."""
MAIN = tuple(column for column in SHOWN if column.main)

DASH, _TO = "\N{EM DASH}", "\N{EN DASH}"


def column_of(name: str) -> Column:
    """Return the column of a score row with this name, or one that describes a column of a scenario's own."""
    about = "a score column that the scenario adds"
    return COLUMNS.get(name) or DERIVED.get(name) or Column(name, about, rule=FINITE, empty="none")


def numbers_of(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the numbers of a score row, those that its scenario adds among them."""
    return tuple(name for name in row if name not in IDENTITY)


def brought_in(rows: Iterable[Mapping[str, Any]]) -> list[Column]:
    """Return the columns that scenarios add, from score rows or from estimates by column.

    A scenario that was read from a folder no longer has its extensions, but their columns are in its rows.
    """
    known = dict.fromkeys(name for row in rows for name in row)
    return [column_of(name) for name in known if name not in (*NAMES, *DERIVED)]


def main_columns(scenario: Scenario, policies: Mapping[str, Mapping[str, Estimate]]) -> list[Column]:
    """Return the columns with numbers that every table of a scenario shows: its score, the main ones, those it adds.

    `policies` has estimates by policy and column.
    """
    columns = dict.fromkeys((task_score(scenario), *MAIN, *brought_in(policies.values())))
    return with_numbers(policies, columns)


def shown_columns(scenario: Scenario, policies: Mapping[str, Mapping[str, Estimate]]) -> list[Column]:
    """Return the main columns and all others with numbers; the recovery time is left out without a fault."""
    others = [column for column in SHOWN if column is not RECOVERY or scenario.faults != Faults()]
    return list(dict.fromkeys([*main_columns(scenario, policies), *with_numbers(policies, others)]))


def values_of_theory(column: Column, scenario: Scenario, bounds: Bounds) -> list[tuple[float, str]]:
    """Return the values that theory names for a column of a scenario, each with its label."""
    bound = scenario.detection_time_bound, scenario.detection_time_label
    lines = {
        WORST_CASE: [(bounds.in_formation, "in formation"), (bounds.best_known, "best known")],
        DETECTION_TIME: [(bounds.mean_time, "least"), bound],
        COVERAGE: [bound],
        SEPARATION: [(2 * scenario.robot.radius, "collision")],
    }.get(column, [])
    return [(value, words) for value, words in lines if math.isfinite(value)]


class Entry(NamedTuple):
    """Entry of a table: what it shows of an estimate."""

    value: str = ""
    beside: str = ""
    """Interval, or what else is beside the value."""
    is_best: bool = False

    def __str__(self) -> str:
        return f"{self.value} ({self.beside})" if self.beside else self.value


class Line(NamedTuple):
    """A line of a table: a policy, or a reference that is no competitor."""

    name: str
    entries: list[Entry]
    is_reference: bool = False
    has_failed: bool = False


def lines_of(
    policies: Mapping[str, Mapping[str, Estimate]],
    columns: Sequence[Column],
    best_known: float = math.nan,
    failed: Iterable[str] = (),
) -> list[Line]:
    """Return the lines of a table: the policies, then the best known worst-case time [s].

    Args:
        policies: Estimates by policy and column.
        columns: Columns of the table.
        best_known: `Bounds.best_known`.
        failed: Policies that raised.
    """
    best = [best_of([*policies.values()], column) for column in columns]
    lines = []
    for name in dict.fromkeys((*policies, *failed)):
        of = policies.get(name)
        entries = [
            Entry() if of is None else _entry(of.get(column.name), mark)
            for column, mark in zip(columns, best, strict=True)
        ]
        lines.append(Line(name, entries, has_failed=name in failed))
    if math.isfinite(best_known) and WORST_CASE in columns:
        known = [Entry(number(best_known)) if column is WORST_CASE else Entry() for column in columns]
        lines.append(Line(BEST_KNOWN, known, True))
    return lines


def _entry(of: Estimate | None, best: str) -> Entry:
    if of is None:
        return Entry(DASH)
    value, beside = in_words(of)
    counted = f"{of.known}/{of.n}" if 0 < of.known < of.n else ""
    return Entry(value, ", ".join(filter(None, (beside, counted))), value == best)


def best_of(policies: Sequence[Mapping[str, Estimate]], column: Column) -> str:
    """Return the best number, as shown, of the policies with most episodes that have one; "" if all agree."""
    numbers = [of[column.name] for of in policies if column.name in of]
    most = max((of.known / of.n for of in numbers), default=0)
    if not most or not column.better or len({in_words(of)[0] for of in numbers}) == 1:
        return ""
    fit = [of for of in numbers if of.known == most * of.n and not of.at_least]
    return in_words(max(fit, key=lambda of: column.better * of.value))[0] if fit else ""


def with_numbers(policies: Mapping[Any, Mapping[str, Estimate]], columns: Iterable[Column]) -> list[Column]:
    """Return the columns of which some policy has a number."""
    return [
        column for column in columns if any(column.name in of and of[column.name].known for of in policies.values())
    ]


def number(value: float) -> str:
    """Format a number with three significant digits and at most three decimals; an em dash for NaN."""
    if value != value:
        return DASH
    if value == math.inf:
        return "infinite"
    if abs(value) >= 1e7:
        return f"{value:.3g}"
    if float(value).is_integer() or abs(value) >= 100:
        return f"{value:.0f}"
    return f"{value:#.3g}" if abs(value) >= 0.9995 else f"{value:.3f}"


def in_words(of: Estimate) -> tuple[str, str]:
    """Return the number that stands for the episodes as tables show it, and its interval ("" if both ends agree).

    Beside a largest value is instead the median of the episodes, unless half of them are open, and the number of the
    episodes and of the open ones. A lower bound is written `> 59.9`, and a share of seeds in percent.
    """
    if not of.known:
        return DASH, ""
    if of.summary == SHARE_OF_SEEDS:
        return f"{100 * of.value:.0f} %", between(of.low, of.high, 100)
    if of.summary != LARGEST:
        return number(of.value), between(of.low, of.high)
    value = ("> " if of.at_least else "") + number(of.value) if math.isfinite(of.value) else "no bound"
    median = f"median {number(of.median)}" if math.isfinite(of.median) else ""
    counted = f"{of.open} of {of.known} open"
    return value, ", ".join(filter(None, (median, counted))) if of.open else f"{median}, {of.known} episodes"


def between(low: float, high: float, times: float = 1.0) -> str:
    """Return both ends of an interval as tables show them; "" for NaN, or if both read the same.

    Without an upper end it is `at least` the lower one; without either it is "".

    Args:
        low: lower end.
        high: upper end.
        times: factor by which both ends are shown, as 100 for a percentage.
    """
    if low != low or low == math.inf:
        return ""
    if high == math.inf:
        return f"at least {number(low)}"
    ends = (f"{times * low:.0f}", f"{times * high:.0f}") if times != 1 else (number(low), number(high))
    return "" if ends[0] == ends[1] else (" to " if low < 0 else _TO).join(ends)


def bounds_in_words(bounds: Bounds) -> str:
    """Return the bounds of a scenario in words, each after a comma."""
    words = f", lower bound {number(bounds.mean_time)} s" if math.isfinite(bounds.mean_time) else ""
    words += f", guaranteed at least {number(bounds.worst_case)} s" if math.isfinite(bounds.worst_case) else ""
    if math.isfinite(bounds.best_known):
        words += f", best known {number(bounds.best_known)} s (second halves {number(bounds.best_known_settled)} s)"
    if math.isnan(bounds.in_formation):
        return words
    return f"{words}, in formation " + (
        f"{number(bounds.in_formation)} s" if bounds.in_formation < math.inf else "never"
    )
