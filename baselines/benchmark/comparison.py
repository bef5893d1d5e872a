"""What the score rows of a benchmark say once they are put beside each other: statistics, references, limits."""

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from baselines.benchmark import clairvoyant
from baselines.benchmark.rows import numbers_of
from baselines.benchmark.statistics import Paired, Statistics, paired, summarize
from lissajous_env.episodes.guarantee import guaranteed_time
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory.limits import guaranteed_time_limit, mean_time_limit

OVER_LIMIT = "over_limit"
"""Column: the mean detection time over `mean_time_limit`, which bounds an expectation, so that the mean counts."""
OPEN = "guarantee_open"
"""Column: 1 where a rogue can still be unseen at the end that was so for the longest time, so that the guaranteed time
is a lower bound."""
COMPARED = {"detection_time_mean": -1, "guaranteed_detection_time": -1, "collisions": -1, "sensed_fraction": 1}
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
    """Rows with the columns that are made of others: `OVER_LIMIT` and, where a guarantee is followed, `OPEN`."""
    told, limits = [], {name: limit_of(scenario) for name, scenario in scenarios.items()}
    for row in rows:
        more = {OVER_LIMIT: row["detection_time_mean"] / limits[row["scenario"]]}
        if "unseen_at_end" in row:
            longest = row["guaranteed_detection_time"]
            more[OPEN] = math.nan if longest != longest else float(0 < longest == row["unseen_at_end"])
        told.append(row | more)
    return told


def statistics(rows: Iterable[dict[str, Any]]) -> Cells:
    """Statistics of every column for each policy on each scenario, in the order in which the rows name them."""
    return {
        scenario: {
            policy: {column: summarize([row[column] for row in played]) for column in numbers_of(played[0])}
            for policy, played in policies.items()
        }
        for scenario, policies in _grouped(rows).items()
    }


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

    A guarantee that is open is worse than any that is not, and two that are open are equal.
    """
    found: Against = {}
    for scenario, policies in _grouped(rows).items():
        wanted = [name for name in (against, *_REFERENCES, *policies) if name in policies and name != clairvoyant.NAME]
        if wanted and len(policies) > 1:
            theirs = {row["seed"]: row for row in policies[wanted[0]]}
            found[scenario] = (
                wanted[0],
                {
                    policy: _compared([(row, theirs[row["seed"]]) for row in played if row["seed"] in theirs])
                    for policy, played in policies.items()
                    if policy != wanted[0]
                },
            )
    return found


def _compared(pairs: Sequence[tuple[dict[str, Any], dict[str, Any]]]) -> dict[str, Paired]:
    return {
        column: paired(
            [_worth(ours, column) for ours, _ in pairs], [_worth(other, column) for _, other in pairs], better
        )
        for column, better in COMPARED.items()
    }


def _worth(row: dict[str, Any], column: str) -> float:
    if column == "guaranteed_detection_time" and row.get(OPEN) == 1:
        return np.inf
    return row.get(column, np.nan)


def _grouped(rows: Iterable[dict[str, Any]]) -> dict[str, dict[str, list[dict[str, Any]]]]:
    episodes: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for row in rows:
        episodes.setdefault(row["scenario"], {}).setdefault(row["policy"], []).append(row)
    return episodes
