"""Score rows put beside each other: statistics, bounds, and comparisons with a reference."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from baselines.benchmark import clairvoyant
from baselines.benchmark.bounds import Bounds, bounds_of, mean_time_bound
from baselines.benchmark.ratios import (
    Profiles,
    growing,
    largest_over_scenarios,
    over_scenarios,
    profiles,
    with_ratios,
)
from baselines.benchmark.rows import Rows, by_kind, column_of, grouped, numbers_of
from baselines.benchmark.shown_columns import COMPARED, OVER_LOWER_BOUND, OVER_SCENARIOS, OVERALL, TIME_OVER_BOUND
from baselines.benchmark.statistics import Paired, Statistics, paired, summarize, summarize_largest
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import DETECTION_TIME, LARGEST, OPEN, WORST_CASE, Column

_REFERENCES = ("kuramoto-mpcc", "kuramoto")
"""The paper's method: what the others are compared with where it is played."""

Cells = dict[str, dict[str, dict[str, Statistics]]]
"""Statistics by scenario, policy and column."""
Against = dict[str, tuple[str, dict[str, dict[str, Paired]]]]
"""The reference of each scenario, and the comparison of each policy with it by column."""


@dataclass(frozen=True)
class Comparisons:
    """The results of a comparison of score rows."""

    cells: Cells
    overall: Cells
    against: Against
    bounds: dict[str, Bounds]
    """Bounds of each scenario."""
    profiles: dict[str, Profiles] = field(default_factory=dict)
    """Performance profiles of ratios over all scenarios of a robot kind, by the names of the scenarios."""


def compare(rows: Rows, scenarios: Mapping[str, Scenario], against: str | None = None) -> Comparisons:
    """Compare score rows; `against` names the reference policy where it was played."""
    told = with_derived(rows, scenarios)
    bounds = {name: bounds_of(scenario) for name, scenario in scenarios.items()}
    ratios = with_ratios(told, bounds)
    of_groups = {name: profiles(by) for name, by in complete(ratios, scenarios).items()}
    return Comparisons(statistics(told), overall(ratios, scenarios), seed_by_seed(told, against), bounds, of_groups)


def with_derived(rows: Iterable[dict[str, Any]], scenarios: Mapping[str, Scenario]) -> list[dict[str, Any]]:
    """Return rows with the column `OVER_LOWER_BOUND`."""
    bounds = {name: mean_time_bound(scenario) for name, scenario in scenarios.items()}
    return [row | {OVER_LOWER_BOUND.name: row[DETECTION_TIME.name] / bounds[row["scenario"]]} for row in rows]


def is_censored(row: Mapping[str, Any]) -> bool:
    """Return whether the worst-case undetected time of an episode that is not open was still growing at the end."""
    return row[OPEN.name] == 0 and growing(row)


def statistics(rows: Iterable[dict[str, Any]]) -> Cells:
    """Return statistics of every column for each policy on each scenario, in the order of the rows."""
    return {
        scenario: {
            policy: {column: _summarized(column, played) for column in numbers_of(played[0])}
            for policy, played in policies.items()
        }
        for scenario, policies in grouped(rows).items()
    }


def _summarized(column: str, played: Rows) -> Statistics:
    of = OVER_LOWER_BOUND if column == OVER_LOWER_BOUND.name else column_of(column)
    values, summary = [row[column] for row in played], of.summary
    if summary != LARGEST:
        return summarize(values, summary=summary)
    return summarize_largest(values, [row[OPEN.name] == 1 for row in played], [growing(row) for row in played])


def overall(rows: Rows, scenarios: Mapping[str, Scenario]) -> Cells:
    """Return statistics over all scenarios of a robot kind, stratified by scenario, of policies that played all.

    The rows have their derived columns, ratios included.
    """
    scaled = [
        row | {TIME_OVER_BOUND.name: row[DETECTION_TIME.name] / scenarios[row["scenario"]].detection_time_bound}
        for row in rows
    ]
    return {
        names: {
            policy: {of.name: _over_all(of, list(by.values())) for of in OVERALL} for policy, by in policies.items()
        }
        for names, policies in complete(scaled, scenarios).items()
    }


def _over_all(column: Column, by_scenario: Sequence[Rows]) -> Statistics:
    strata = [[row.get(column.name, math.nan) for row in rows] for rows in by_scenario]
    if column.summary == LARGEST:
        return largest_over_scenarios(*strata)
    return over_scenarios(*strata) if column in OVER_SCENARIOS else summarize(*strata, summary=column.summary)


def complete(rows: Rows, scenarios: Mapping[str, Scenario]) -> dict[str, dict[str, dict[str, Rows]]]:
    """Return the rows by names of the scenarios of a robot kind, policy and scenario, of policies that played all.

    A kind with a single scenario is left out.
    """
    found = [(next(iter(policies.values())), policies) for policies in by_kind(rows, scenarios).values()]
    return {", ".join(names): policies for names, policies in found if len(names) > 1}


def seed_by_seed(rows: Iterable[dict[str, Any]], against: str | None = None) -> Against:
    """Compare all policies of each scenario with its reference, on the seeds that both have played.

    A worst-case undetected time of an open episode is worse than any other, and two of them are equal. A time that was
    still growing at the end counts as worse than a shorter one; otherwise the two count as equal.
    """
    found: Against = {}
    for scenario, policies in grouped(rows).items():
        reference = reference_of(policies, against)
        if reference and len(policies) > 1:
            theirs = {row["seed"]: row for row in policies[reference]}
            found[scenario] = (
                reference,
                {
                    policy: _compared([(row, theirs[row["seed"]]) for row in played if row["seed"] in theirs])
                    for policy, played in policies.items()
                    if policy != reference
                },
            )
    return found


def reference_of(policies: Iterable[str], against: str | None = None) -> str:
    """Return the policy that others are compared with: `against`, the paper's method or the first; "" for none."""
    played = [policy for policy in policies if policy != clairvoyant.NAME]
    return next((name for name in (against, *_REFERENCES, *played) if name in played), "")


def _compared(pairs: Sequence[tuple[dict[str, Any], dict[str, Any]]]) -> dict[str, Paired]:
    found = {}
    for column in COMPARED:
        if column is WORST_CASE:
            known = [_worst_cases(ours, other) for ours, other in pairs]
        else:
            known = [(ours[column.name], other[column.name]) for ours, other in pairs]
        pair = paired([ours for ours, _ in known], [other for _, other in known], column.better)
        if column.summary == LARGEST:
            off = _difference_of_largest(*zip(*pairs, strict=True)) if pairs else math.nan
            pair = replace(pair, difference=off, difference_low=math.nan, difference_high=math.nan)
        found[column.name] = pair
    return found


def _difference_of_largest(ours: Rows, others: Rows) -> float:
    """Return the difference of the largest worst-case undetected times [s]; NaN if an episode shows no bound."""
    first, second = (
        max(math.inf if row[OPEN.name] == 1 else row[WORST_CASE.name] for row in rows) for rows in (ours, others)
    )
    return first - second if math.isfinite(first) and math.isfinite(second) else math.nan


def _worst_cases(ours: dict[str, Any], other: dict[str, Any]) -> tuple[float, float]:
    """Return two worst-case undetected times to compare, infinite if open; both infinite if their order is unknown."""
    first, second = (np.inf if row[OPEN.name] == 1 else row[WORST_CASE.name] for row in (ours, other))
    growing = is_censored(ours), is_censored(other)
    if growing == (True, False) and first > second:
        return np.inf, second
    if growing == (False, True) and second > first:
        return first, np.inf
    return (np.inf, np.inf) if any(growing) else (first, second)
