"""The results table: an estimate of every column for each policy on each scenario, and bounds, which all views show.

Ratios and comparisons with the reference are columns of the score rows, too, so one function estimates all columns.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np

from baselines.benchmark.best_known import known_plans
from baselines.benchmark.statistics import (
    IMPROVEMENT,
    OVER_LOWER_BOUND,
    OVERALL,
    SCORE_OVER_BEST,
    WORST_CASE_OVER_BEST,
    Estimate,
    column_of,
    number,
    score_names,
    summarize,
    summarize_largest,
    with_numbers,
)
from lissajous_env.episodes.guarantee import IdealFormation
from lissajous_env.episodes.lower_bounds import mean_time_lower_bound, worst_case_lower_bound
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import AT_END, DETECTION_TIME, LARGEST, OPEN, WORST_CASE, Column, task_score

_REFERENCES = ("kuramoto-mpcc", "kuramoto", "lanes")
"""Policies with which the others are compared where they are played: the paper's method, and the patrol of robots whose
actions are velocities."""

Row = Mapping[str, Any]
Rows = list[dict[str, Any]]
"""Score rows of episodes, by column."""
Estimates = dict[str, dict[str, Estimate]]
"""Estimates by policy and column."""


@dataclass(frozen=True)
class Overall:
    """Estimates over the scenarios of a kind of robots, of the policies that played all of them."""

    kind: str
    scenarios: tuple[str, ...]
    policies: Estimates


class Bounds(NamedTuple):
    """Bounds on the scores of one scenario [s]; NaN for those that do not exist, or are below a control step."""

    mean_time: float
    """Lower bound of the mean detection time of every policy without long-range sensing; NaN where the task has another
    score."""
    worst_case: float
    """Lower bound of the worst-case undetected time; the length of an episode where no policy guarantees anything."""
    in_formation: float
    """Worst-case undetected time of the formation in its equilibrium; inf if a target can stay undetected for ever."""
    best_known: float = math.nan
    """Shortest worst-case undetected time of a stored plan (`known_plans`) without collisions."""
    best_known_settled: float = math.nan
    """The same of the second halves of the episodes."""

    def in_words(self) -> str:
        """Return the bounds in words, each after a comma."""
        words = f", lower bound {number(self.mean_time)} s" if math.isfinite(self.mean_time) else ""
        words += f", guaranteed at least {number(self.worst_case)} s" if math.isfinite(self.worst_case) else ""
        if math.isfinite(self.best_known):
            words += f", best known {number(self.best_known)} s (second halves {number(self.best_known_settled)} s)"
        if self.in_formation == math.inf:
            words += ", in formation never"
        return words + (f", in formation {number(self.in_formation)} s" if math.isfinite(self.in_formation) else "")


@dataclass(frozen=True)
class Table:
    """The results of policies on scenarios."""

    rows: Rows
    """Score rows with their derived columns."""
    scenarios: dict[str, Scenario]
    references: dict[str, str]
    """Policy of each scenario with which the others are compared; no entry where there are no others."""
    estimates: dict[str, Estimates]
    """Estimates by scenario, the policy with the best score of the task first."""
    overall: list[Overall]
    """Estimates over several scenarios, by kind of robots, the best policy first."""

    @classmethod
    def of(
        cls, rows: Iterable[dict[str, Any]], scenarios: Mapping[str, Scenario], against: str | None = None
    ) -> "Table":
        """Make the table of some score rows.

        Args:
            rows: Score rows.
            scenarios: Their scenarios by name.
            against: Reference policy, where it was played; otherwise the first of `_REFERENCES` or of the policies.
        """
        references: dict[str, str] = {}
        derived: dict[str, dict[str, Rows]] = {}
        estimates: dict[str, Estimates] = {}
        for name, policies in grouped(rows).items():
            if len(policies) > 1:
                references[name] = next(policy for policy in (against, *_REFERENCES, *policies) if policy in policies)
            score, bound = task_score(scenarios[name]), least_mean_time(scenarios[name])
            derived[name] = with_derived(policies, bound, score, references.get(name))
            estimates[name] = ranked({policy: estimates_of(own) for policy, own in derived[name].items()}, score)
        every = [row for policies in derived.values() for own in policies.values() for row in own]
        return cls(every, dict(scenarios), references, estimates, over_scenarios(derived, scenarios))

    @cached_property
    def bounds(self) -> dict[str, Bounds]:
        """Return the bounds of each scenario, for which its formation is simulated."""
        return {name: bounds_of(scenario) for name, scenario in self.scenarios.items()}


def least_mean_time(scenario: Scenario) -> float:
    """Return `Bounds.mean_time` of a scenario."""
    bound = mean_time_lower_bound(scenario) if task_score(scenario) is DETECTION_TIME else math.nan
    return _beyond_a_step(bound, scenario)


@cache
def bounds_of(scenario: Scenario) -> Bounds:
    """Return the bounds of a scenario; if it computes contamination, the formation is simulated once for them."""
    worst_case = in_formation = math.nan
    if scenario.task.contamination is not None:
        worst_case = _beyond_a_step(worst_case_lower_bound(scenario), scenario)
        with suppress(ValueError):  # targets that are too fast for its grid
            in_formation = IdealFormation(scenario).guaranteed_time(scenario.rogue_speed)
    known = known_plans(scenario)
    best = min((plan.worst_case for plan in known), default=math.nan)
    settled = min((plan.settled for plan in known), default=math.nan)
    return Bounds(least_mean_time(scenario), worst_case, in_formation, best, settled)


def _beyond_a_step(bound: float, scenario: Scenario) -> float:
    return bound if bound >= scenario.task.step else math.nan


def numbers(rows: Iterable[Row], column: Column) -> np.ndarray:
    """Return a column of some rows; NaN where there is no number."""
    return np.array([row.get(column.name, math.nan) for row in rows], dtype=float)


def grouped(rows: Iterable[dict[str, Any]]) -> dict[str, dict[str, Rows]]:
    """Return rows by scenario and policy."""
    by_scenario: dict[str, dict[str, Rows]] = {}
    for row in rows:
        by_scenario.setdefault(row["scenario"], {}).setdefault(row["policy"], []).append(row)
    return by_scenario


def ranked(policies: Estimates, column: Column) -> Estimates:
    """Return estimates with the best policy by a column first; those without a number come last."""

    def place(policy: str) -> float:
        estimate = policies[policy].get(column.name)
        return -column.better * estimate.value if estimate is not None and estimate.known else math.inf

    return {policy: policies[policy] for policy in sorted(policies, key=place)}


def with_derived(
    policies: Mapping[str, Rows], least_time: float, score: Column, reference: str | None = None
) -> dict[str, Rows]:
    """Return the rows of a scenario, by policy, with the derived columns.

    The worst-case undetected time of an open episode is infinite. The best policy is the best on the same seed; where
    its number is 0 or not finite, no policy has a ratio. A policy is compared with the reference on the seeds of both.

    Args:
        policies: Rows of the scenario by policy.
        least_time: Lower bound of the mean detection time [s].
        score: Score of its task.
        reference: Policy with which the others are compared.
    """
    best: dict[int, tuple[float, float]] = {}
    better = np.fmin if score.better < 0 else np.fmax
    for row in (row for rows in policies.values() for row in rows):
        value, worst_case = best.get(row["seed"], (math.nan, math.inf))
        best[row["seed"]] = better(value, row[score.name]), np.fmin(worst_case, _worst_case(row))
    others = {row["seed"]: row for row in policies[reference]} if reference is not None else {}
    derived: dict[str, Rows] = {}
    for policy, rows in policies.items():
        derived[policy] = []
        for row in rows:
            other = others.get(row["seed"], {}) if policy != reference else {}
            ahead = score.better * (row[score.name] - other.get(score.name, math.nan))
            best_value, best_worst_case = best[row["seed"]]
            over_best = _ratio(row[score.name], best_value)
            derived[policy].append(row | {
                OVER_LOWER_BOUND.name: row[DETECTION_TIME.name] / least_time,
                SCORE_OVER_BEST.name: over_best if score.better < 0 else 1 / over_best if over_best else math.inf,
                WORST_CASE_OVER_BEST.name: _ratio(_worst_case(row), best_worst_case),
                IMPROVEMENT.name: float(np.heaviside(ahead, 0.5)),
            })  # fmt: skip
    return derived


def _worst_case(row: Row) -> float:
    """Return the worst-case undetected time of an episode [s], infinite if it is open."""
    return math.inf if row.get(OPEN.name) == 1 else row.get(WORST_CASE.name, math.nan)


def _ratio(value: float, best: float) -> float:
    return float(value / best) if 0 < best < math.inf else math.nan


def estimates_of(rows: Rows) -> dict[str, Estimate]:
    """Return the estimate of each column from the episodes of a policy on a scenario."""
    return {name: _estimate(column_of(name), rows) for name in score_names(rows[0])}


def _estimate(column: Column, rows: Rows) -> Estimate:
    values = numbers(rows, column)
    if column.summary == LARGEST:
        worst, is_open = numbers(rows, WORST_CASE), numbers(rows, OPEN) == 1
        growing = (worst > 0) & (worst == numbers(rows, AT_END))
        estimate, values = summarize_largest(values, is_open, growing), np.where(is_open, np.inf, values)
    else:
        estimate = summarize(values, column.summary)
    if not column.better or np.isnan(values).all():
        return estimate
    return replace(estimate, worst=rows[int(np.nanargmin(column.better * values))]["seed"])


def over_scenarios(played: Mapping[str, Mapping[str, Rows]], scenarios: Mapping[str, Scenario]) -> list[Overall]:
    """Return estimates over the scenarios of each kind of robots, where there are several.

    The scenarios are the sample: a scenario has the mean of its episodes or, of worst cases, the largest. More
    scenarios narrow the intervals; more episodes of the same scenarios do not.

    Args:
        played: Rows with derived columns, by scenario and policy.
        scenarios: Scenarios by name.
    """
    by_kind = []
    for kind in dict.fromkeys(scenario.actuation for scenario in scenarios.values()):
        names = tuple(name for name, scenario in scenarios.items() if name in played and scenario.actuation == kind)
        policies = [p for p in played[names[0]] if all(p in played[name] for name in names)] if len(names) > 1 else []
        if policies:
            by = {p: {c.name: _estimate_over(c, [played[n][p] for n in names]) for c in OVERALL} for p in policies}
            columns = with_numbers(by, OVERALL)
            by_kind.append(Overall(kind, names, ranked(by, columns[0]) if columns else by))
    return by_kind


def _estimate_over(column: Column, by_scenario: Sequence[Rows]) -> Estimate:
    if column.summary == LARGEST:
        of_scenarios = [_estimate(column, rows) for rows in by_scenario]
        largest = [math.inf if one.open else one.value for one in of_scenarios]
        estimate = summarize_largest(largest, growing=[one.at_least for one in of_scenarios])
    else:
        known = [values[~np.isnan(values)] for values in (numbers(rows, column) for rows in by_scenario)]
        estimate = summarize([values.mean() if len(values) else np.nan for values in known], column.summary)
    return replace(estimate, sample="scenarios")
