"""What the score rows of a benchmark say once they are put beside each other: statistics, references, limits."""

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from baselines.benchmark import clairvoyant
from baselines.benchmark.censoring import summarize_censored
from baselines.benchmark.rows import numbers_of
from baselines.benchmark.statistics import Paired, Statistics, paired, summarize
from lissajous_env.episodes.guarantee import guaranteed_time
from lissajous_env.episodes.limits import guaranteed_time_limit, mean_time_limit
from lissajous_env.parameters.scenario import Scenario

OVER_LIMIT = "over_limit"
"""Column: the mean detection time over `mean_time_limit`, which bounds an expectation, so that the mean counts."""
GUARANTEED, AT_END, OPEN = "guaranteed_detection_time", "unseen_at_end", "guarantee_open"
"""Columns: the longest time for which a rogue can have gone unseen, the same at the end of the episode, and 1 where the
episode shows no bound of it: `lissajous_env.world.score.is_open`."""
COMPARED = {"detection_time_mean": -1, GUARANTEED: -1, "collisions": -1, "sensed_fraction": 1}
"""Columns that are compared seed by seed, and whether more of them is better (1) or less (-1)."""
OVERALL = ("time_over_bound", "detected_within_bound", "collisions", "spacing_factor")
"""Columns that mean the same on every scenario, so that their episodes can be taken together."""
_REFERENCES = ("kuramoto-mpcc", "kuramoto")
"""The paper's method: what the others are compared with where it is played."""

Cells = dict[str, dict[str, dict[str, Statistics]]]
"""Statistics by scenario, policy and column."""
Against = dict[str, tuple[str, dict[str, dict[str, Paired]]]]
"""By scenario: the reference, and by policy and column how that compares with it."""
Rows = Sequence[dict[str, Any]]


@dataclass(frozen=True)
class Comparisons:
    """All that is said of some rows."""

    cells: Cells
    overall: Cells
    against: Against


def compare(rows: Rows, scenarios: Mapping[str, Scenario], against: str | None = None) -> Comparisons:
    """Put rows beside each other; `against` names the reference where it is played."""
    told = with_derived(rows, scenarios)
    return Comparisons(statistics(told), overall(rows, scenarios), seed_by_seed(told, against))


def limit_of(scenario: Scenario) -> float:
    """`mean_time_limit` where it says something: NaN where it is below a step, as the discs see all but everything."""
    limit = mean_time_limit(scenario)
    return limit if limit >= scenario.task.step else math.nan


@cache
def guarantee_of(scenario: Scenario) -> tuple[float, float]:
    """Lower bound of the guaranteed detection time, and that of the formation in its equilibrium [s]; NaN for none."""
    if scenario.task.contamination is None:
        return math.nan, math.nan
    formation = math.nan
    with suppress(ValueError):  # rogues that are too fast for its grid
        formation = guaranteed_time(scenario, speed=scenario.rogue_speed)
    return guaranteed_time_limit(scenario), formation


def with_derived(rows: Iterable[dict[str, Any]], scenarios: Mapping[str, Scenario]) -> list[dict[str, Any]]:
    """Return rows with the column that is made of another, `OVER_LIMIT`."""
    limits = {name: limit_of(scenario) for name, scenario in scenarios.items()}
    return [row | {OVER_LIMIT: row["detection_time_mean"] / limits[row["scenario"]]} for row in rows]


def is_censored(row: Mapping[str, Any]) -> bool:
    """Return whether the longest time of an episode that is not open was still growing at the end."""
    return row[OPEN] == 0 and 0 < row[GUARANTEED] == row[AT_END]


def statistics(rows: Iterable[dict[str, Any]]) -> Cells:
    """Return statistics of every column for each policy on each scenario, in the order in which the rows name them."""
    return {
        scenario: {
            policy: {column: _summarized(column, played) for column in numbers_of(played[0])}
            for policy, played in policies.items()
        }
        for scenario, policies in _grouped(rows).items()
    }


def _summarized(column: str, played: Rows) -> Statistics:
    values = [row[column] for row in played]
    if column != GUARANTEED:
        return summarize(values)
    return summarize_censored(values, [is_censored(row) for row in played], [row[OPEN] == 1 for row in played])


def overall(rows: Rows, scenarios: Mapping[str, Scenario]) -> Cells:
    """Statistics over all scenarios of a kind of robot, stratified by scenario, of policies that played them all."""
    cells: Cells = {}
    for kind in dict.fromkeys(scenario.robot.kind for scenario in scenarios.values()):
        group = [name for name, scenario in scenarios.items() if scenario.robot.kind == kind]
        strata: dict[str, dict[str, list[dict[str, Any]]]] = {}
        for row in rows:
            if row["scenario"] in group:
                bound = scenarios[row["scenario"]].detection_time_bound
                scaled = row | {"time_over_bound": row["detection_time_mean"] / bound}
                strata.setdefault(row["policy"], {}).setdefault(row["scenario"], []).append(scaled)
        complete = {policy: list(by.values()) for policy, by in strata.items() if len(by) == len(group)}
        if len(group) > 1 and complete:
            cells[", ".join(group)] = {
                policy: {of: summarize(*[[row[of] for row in each] for each in by]) for of in OVERALL}
                for policy, by in complete.items()
            }
    return cells


def seed_by_seed(rows: Iterable[dict[str, Any]], against: str | None = None) -> Against:
    """Compare all policies of each scenario with its reference, on the seeds that both have played.

    A guarantee that is open is worse than any that is not, and two that are open are equal. Against one that was still
    growing at the end only a longer time is decided, as worse; otherwise the two count as equal.
    """
    found: Against = {}
    for scenario, policies in _grouped(rows).items():
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
    """Return the policy that others are compared with: that asked for, the paper's method, the first; "" for none."""
    played = [policy for policy in policies if policy != clairvoyant.NAME]
    return next((name for name in (against, *_REFERENCES, *played) if name in played), "")


def _compared(pairs: Sequence[tuple[dict[str, Any], dict[str, Any]]]) -> dict[str, Paired]:
    found = {}
    for column, better in COMPARED.items():
        if column == GUARANTEED:
            known = [_guarantees(ours, other) for ours, other in pairs]
        else:
            known = [(ours[column], other[column]) for ours, other in pairs]
        found[column] = paired([ours for ours, _ in known], [other for _, other in known], better)
    return found


def _guarantees(ours: dict[str, Any], other: dict[str, Any]) -> tuple[float, float]:
    """Return two guaranteed times to compare, infinite where a time has no end or none is known."""
    first, second = (np.inf if row[OPEN] == 1 else row[GUARANTEED] for row in (ours, other))
    growing = is_censored(ours), is_censored(other)
    if growing == (True, False) and first > second:
        return np.inf, second
    if growing == (False, True) and second > first:
        return first, np.inf
    return (np.inf, np.inf) if any(growing) else (first, second)


def _grouped(rows: Iterable[dict[str, Any]]) -> dict[str, dict[str, list[dict[str, Any]]]]:
    episodes: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for row in rows:
        episodes.setdefault(row["scenario"], {}).setdefault(row["policy"], []).append(row)
    return episodes
