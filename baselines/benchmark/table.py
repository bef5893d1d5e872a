"""The results table: an estimate of every column for each policy on each scenario, which all views show."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from baselines.benchmark.bounds import Bounds, bounds_of
from baselines.benchmark.shown import (
    COMPARED,
    DETECTION_OVER_BEST,
    OVER_LOWER_BOUND,
    OVER_SCENARIOS,
    OVERALL,
    TIME_OVER_BOUND,
    WORST_CASE_OVER_BEST,
    WORST_CASE_OVER_BOUND,
    column_of,
    numbers_of,
)
from baselines.benchmark.statistics import (
    Estimate,
    Paired,
    largest_over_scenarios,
    over_scenarios,
    paired,
    summarize,
    summarize_largest,
)
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import AT_END, DETECTION_TIME, LARGEST, OPEN, WORST_CASE, Column

_REFERENCES = ("kuramoto-mpcc", "kuramoto")
"""The paper's method: what the others are compared with where it is played."""

Row = Mapping[str, Any]
Rows = Sequence[dict[str, Any]]
Estimates = dict[str, dict[str, dict[str, Estimate]]]
"""Estimates by scenario, policy and column."""
Curve = tuple[Any, Any]
"""Times [s], and the share of the targets that is detected within each."""


@dataclass(frozen=True)
class Against:
    """Comparison of the policies of a scenario with one of them, on the seeds that both have played."""

    reference: str
    policies: dict[str, dict[str, Paired]]
    """By policy and column."""


@dataclass(frozen=True)
class Group:
    """The scenarios of a kind of robots, and the rows of the policies that played all of them."""

    kind: str
    rows: dict[str, dict[str, Rows]]
    """Rows by policy and scenario."""

    @property
    def scenarios(self) -> tuple[str, ...]:
        """Return the names of the scenarios."""
        return tuple(next(iter(self.rows.values())))

    @property
    def name(self) -> str:
        """Return the names of the scenarios as one."""
        return ", ".join(self.scenarios)

    def strata(self, policy: str, column: Column) -> list[np.ndarray]:
        """Return a column of the episodes of a policy, scenario by scenario; NaN where there is no number."""
        return [numbers(rows, column) for rows in self.rows[policy].values()]


@dataclass(frozen=True)
class Table:
    """The results of policies on scenarios."""

    rows: list[dict[str, Any]]
    """Score rows with their derived columns."""
    scenarios: dict[str, Scenario]
    bounds: dict[str, Bounds]
    """Bounds of each scenario."""
    estimates: Estimates
    overall: Estimates
    """Estimates over the scenarios of a group, by the name of the group, for groups of several scenarios."""
    against: dict[str, Against]
    """Comparison with the reference of each scenario."""
    curves: Mapping[str, Mapping[str, Curve]] = field(default_factory=dict)
    """Share of the targets that is detected over time, by scenario and policy."""

    @classmethod
    def of(
        cls,
        rows: Iterable[dict[str, Any]],
        scenarios: Mapping[str, Scenario],
        against: str | None = None,
        curves: Mapping[str, Mapping[str, Curve]] | None = None,
        simulates: bool = True,
    ) -> "Table":
        """Make the table of some score rows.

        Args:
            rows: Score rows.
            scenarios: Their scenarios by name.
            against: Reference policy, where it was played.
            curves: Share of the targets that is detected over time, by scenario and policy.
            simulates: False to leave out bounds that a simulation computes.
        """
        bounds = {name: bounds_of(scenario, simulates) for name, scenario in scenarios.items()}
        derived = with_derived(rows, scenarios, bounds)
        overall = {
            group.name: {
                policy: {column.name: _over_all(column, group.strata(policy, column)) for column in OVERALL}
                for policy in group.rows
            }
            for group in groups(derived, scenarios)
            if len(group.scenarios) > 1
        }
        played = grouped(derived)
        estimates = {name: {p: estimates_of(of) for p, of in by.items()} for name, by in played.items()}
        pairs = {name: compare(policies, against) for name, policies in played.items()}
        known = {name: of for name, of in pairs.items() if of is not None}
        return cls(derived, dict(scenarios), bounds, estimates, overall, known, curves or {})

    def groups(self) -> list[Group]:
        """Return the rows by kind of robots."""
        return groups(self.rows, self.scenarios)

    def references(self) -> dict[str, str]:
        """Return the policy that the others of a scenario are compared with."""
        return {name: of.reference for name, of in self.against.items()}


def numbers(rows: Iterable[Row], column: Column) -> np.ndarray:
    """Return a column of some rows; NaN where there is no number."""
    return np.array([row.get(column.name, math.nan) for row in rows], dtype=float)


def grouped(rows: Iterable[dict[str, Any]]) -> dict[str, dict[str, list[dict[str, Any]]]]:
    """Return rows by scenario and policy."""
    by: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for row in rows:
        by.setdefault(row["scenario"], {}).setdefault(row["policy"], []).append(row)
    return by


def groups(rows: Iterable[dict[str, Any]], scenarios: Mapping[str, Scenario]) -> list[Group]:
    """Return rows by kind of robots; kinds without a policy that played all scenarios with rows are left out."""
    played, kinds = grouped(rows), []
    for kind in dict.fromkeys(scenario.actuation for scenario in scenarios.values()):
        names = [name for name, scenario in scenarios.items() if name in played and scenario.actuation == kind]
        policies = [p for p in played[names[0]] if all(p in played[name] for name in names)] if names else []
        if policies:
            kinds.append(Group(kind, {policy: {name: played[name][policy] for name in names} for policy in policies}))
    return kinds


def with_derived(
    rows: Iterable[dict[str, Any]], scenarios: Mapping[str, Scenario], bounds: Mapping[str, Bounds]
) -> list[dict[str, Any]]:
    """Return rows with the derived columns: times over a bound, and over the best policy of the rows.

    The worst-case undetected time of an open episode is infinite. The best policy is the best on the same scenario and
    seed; where no policy has a finite time, there is no ratio.
    """
    rows = list(rows)
    best: dict[tuple[str, int], tuple[float, float]] = {}
    for row in rows:
        place = row["scenario"], row["seed"]
        time, worst_case = best.get(place, (math.inf, math.inf))
        best[place] = np.fmin(time, row[DETECTION_TIME.name]), np.fmin(worst_case, _worst_case(row))
    derived = []
    for row in rows:
        time, worst_case, bound = row[DETECTION_TIME.name], _worst_case(row), bounds[row["scenario"]]
        best_time, best_worst_case = best[row["scenario"], row["seed"]]
        ratios = {
            OVER_LOWER_BOUND.name: time / bound.mean_time,
            TIME_OVER_BOUND.name: time / scenarios[row["scenario"]].detection_time_bound,
            DETECTION_OVER_BEST.name: _ratio(time, best_time),
            WORST_CASE_OVER_BOUND.name: _ratio(worst_case, bound.worst_case),
            WORST_CASE_OVER_BEST.name: _ratio(worst_case, best_worst_case),
        }
        derived.append(row | ratios)
    return derived


def _worst_case(row: Row) -> float:
    return math.inf if row[OPEN.name] == 1 else row[WORST_CASE.name]


def _ratio(time: float, least: float) -> float:
    if math.isnan(time) or not math.isfinite(least):
        return math.nan
    return float(time / least) if least > 0 else 1.0 if time == 0 else math.inf


def is_growing(row: Row) -> bool:
    """Return whether the worst-case undetected time of an episode was still growing at its end."""
    return row[OPEN.name] == 1 or 0 < row[WORST_CASE.name] == row[AT_END.name]


def estimates_of(rows: Rows) -> dict[str, Estimate]:
    """Return the estimate of each column from the episodes of a policy on a scenario."""
    columns = [column_of(name) for name in numbers_of(rows[0])]
    return {
        column.name: _estimate(column, rows) for column in columns if column not in (*OVER_SCENARIOS, TIME_OVER_BOUND)
    }


def _estimate(column: Column, rows: Rows) -> Estimate:
    values = numbers(rows, column)
    if column.summary == LARGEST:
        is_open, growing = [row[OPEN.name] == 1 for row in rows], [is_growing(row) for row in rows]
        of, values = summarize_largest(values, is_open, growing), np.where(is_open, np.inf, values)
    else:
        of = summarize(values, summary=column.summary)
    if not column.better or np.isnan(values).all():
        return of
    return replace(of, worst=rows[int(np.nanargmin(column.better * values))]["seed"])


def _over_all(column: Column, strata: Sequence[np.ndarray]) -> Estimate:
    if column.summary == LARGEST:
        return largest_over_scenarios(*strata)
    return over_scenarios(*strata) if column in OVER_SCENARIOS else summarize(*strata, summary=column.summary)


def reference_of(policies: Iterable[str], against: str | None = None) -> str:
    """Return the policy that others are compared with: `against`, the paper's method or the first; "" for none."""
    played = [*policies]
    return next((name for name in (against, *_REFERENCES, *played) if name in played), "")


def compare(policies: Mapping[str, Rows], against: str | None) -> Against | None:
    """Compare policies with a reference, on the scenarios and seeds that both have played; None without any.

    A worst-case undetected time of an open episode is worse than any other, and two of them are equal. A time that was
    still growing at the end counts as worse than a shorter one; otherwise the two count as equal.
    """
    reference = reference_of(policies, against)
    if not reference or len(policies) < 2:
        return None
    other = {(row["scenario"], row["seed"]): row for row in policies[reference]}
    pairs = {
        policy: [(row, other[place]) for row in rows if (place := (row["scenario"], row["seed"])) in other]
        for policy, rows in policies.items()
        if policy != reference
    }
    return Against(reference, {p: {c.name: _compared(c, of) for c in COMPARED} for p, of in pairs.items()})


def _compared(column: Column, pairs: Sequence[tuple[Row, Row]]) -> Paired:
    if column is not WORST_CASE:
        first, second = (numbers([pair[k] for pair in pairs], column) for k in (0, 1))
        return paired(first, second, column.better)
    known = np.array([_worst_cases(*pair) for pair in pairs]).reshape(-1, 2)
    largest, other = (max((_worst_case(pair[k]) for pair in pairs), default=math.nan) for k in (0, 1))
    difference = largest - other if math.isfinite(largest) and math.isfinite(other) else math.nan
    of = paired(known[:, 0], known[:, 1], column.better)
    return replace(of, difference=difference, difference_low=math.nan, difference_high=math.nan)


def _worst_cases(row: Row, other: Row) -> tuple[float, float]:
    """Return two worst-case undetected times to compare, infinite if open; both infinite if their order is unknown."""
    first, second = _worst_case(row), _worst_case(other)
    growing = tuple(of[OPEN.name] == 0 and is_growing(of) for of in (row, other))
    if growing == (True, False) and first > second:
        return math.inf, second
    if growing == (False, True) and second > first:
        return first, math.inf
    return (math.inf, math.inf) if any(growing) else (first, second)
