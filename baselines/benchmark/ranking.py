"""The order of policies, by mean ranks, and of episodes: the ways in which one fails, and the worst first."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from baselines.benchmark.shown import COMPARED
from baselines.benchmark.statistics import bootstrap_interval
from baselines.benchmark.table import Group, Row, Rows, Table, numbers
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import (
    COLLISIONS,
    DETECTED,
    DETECTION_TIME,
    LARGEST,
    OPEN,
    SENSED,
    WORST_CASE,
    Column,
)

Rank = tuple[float, float, float]
"""Mean rank, 1 for the best, and the ends of its 95 % bootstrap interval over seeds, stratified by scenario."""
_HALF = 0.5


@dataclass(frozen=True)
class Ranking:
    """Ranks on the scenarios of a kind of robots, among the policies that played all of them."""

    group: Group
    columns: tuple[Column, ...]
    """Columns that the policies are ranked by: those of `COMPARED` with numbers on each of the scenarios."""
    ranks: dict[str, dict[str, Rank]]
    """Ranks by policy and name of the column, the best policy over all columns first."""
    overall: dict[str, Rank]
    """Mean over the columns, by policy."""


def rankings(table: Table) -> list[Ranking]:
    """Rank the policies on each seed of each scenario, and average; of equal ones each has the mean of their ranks.

    A guarantee is ranked by its largest value in a scenario, on every seed alike.
    """
    return [_ranking(group) for group in table.groups() if len(group.rows) > 1]


def _ranking(group: Group) -> Ranking:
    from scipy.stats import rankdata  # which takes longer to import than all of ours

    policies = list(group.rows)
    worths = [_worths([by[name] for by in group.rows.values()]) for name in group.scenarios]
    known = [~np.isnan(table) for table in worths]
    places = [c for c in range(len(COMPARED)) if all(table[c].all(axis=0).any() for table in known)]
    columns = tuple(COMPARED[c] for c in places)
    # (C, P, n) of each scenario, on the seeds on which every policy has a number in each column.
    common = [table[places][:, :, there[places].all(axis=(0, 1))] for table, there in zip(worths, known, strict=True)]
    for c, column in enumerate(columns):
        for table in common if column.summary == LARGEST else ():
            table[c] = table[c].max(axis=1, keepdims=True)
    ranks = [rankdata(table, axis=1) for table in common]
    overall = {policy: _mean([table[:, k].mean(axis=0) for table in ranks]) for k, policy in enumerate(policies)}
    order = sorted(policies, key=lambda policy: overall[policy][0])
    of = {
        policy: {column.name: _mean([table[c, policies.index(policy)] for table in ranks])
                 for c, column in enumerate(columns)}
        for policy in order
    }  # fmt: skip
    return Ranking(group, columns, of, {policy: overall[policy] for policy in order})


def _worths(played: Sequence[Rows]) -> np.ndarray:
    """Return the numbers that policies are ranked by on the seeds that all played, smaller being better: (C, P, n).

    The worst-case time of an open episode is infinite; one that was still growing when its episode ended counts as long
    as it was.

    Args:
        played: Rows of a scenario, of each policy.
    """
    by_seed = [{row["seed"]: row for row in rows} for rows in played]
    seeds = sorted(set.intersection(*map(set, by_seed)))
    common = [[rows[seed] for seed in seeds] for rows in by_seed]
    worths = np.array([[-column.better * numbers(rows, column) for rows in common] for column in COMPARED])
    is_open = np.array([numbers(rows, OPEN) == 1 for rows in common])
    worths[COMPARED.index(WORST_CASE)][is_open] = np.inf
    return worths


def _mean(strata: Sequence[np.ndarray]) -> Rank:
    return float(np.concatenate(strata).mean()), *bootstrap_interval(*strata, cut=0.0)


@dataclass(frozen=True)
class Kind:
    """A way to fail."""

    name: str
    words: str
    """Predicate of which the policy is the subject."""
    about: str
    """Rule in words."""
    applies: Callable[[Row], bool]
    """Function that tests a score row with its derived columns."""


KINDS = (
    Kind(
        "unseen",
        "missed more than half",
        "Less than half of the targets were detected, or less than half of the cells were covered.",
        lambda row: row[DETECTED.name] < _HALF or row[SENSED.name] < _HALF,
    ),
    Kind(
        "open",
        "lost the guarantee",
        "The worst-case undetected time was still growing when the episode ended and was at least half of the episode, "
        "or no robot was left.",
        lambda row: row[OPEN.name] == 1,
    ),
    Kind("collided", "collided", "Two robots collided.", lambda row: row[COLLISIONS.name] > 0),
)
"""The gravest first."""


def failed(row: Row) -> list[bool]:
    """Return for each of `KINDS` whether an episode failed in that way; NaN is no failure."""
    return [kind.applies(row) for kind in KINDS]


def headline(scenario: Scenario) -> Column:
    """Return the main column of a scenario: the worst-case undetected time if computed, else the detection time."""
    return DETECTION_TIME if scenario.task.contamination is None else WORST_CASE


def badness(row: Row, scenario: Scenario) -> tuple[float, ...]:
    """Return a key by which episodes are sorted, larger being worse.

    It is the number of ways in which the episode failed, then the headline of its scenario over T_max, the collisions,
    and the mean detection time over T_max. A missing number counts as 0.
    """
    bound = scenario.detection_time_bound
    times = (row[headline(scenario).name] / bound, row[COLLISIONS.name], row[DETECTION_TIME.name] / bound)
    return sum(failed(row)), *(0.0 if math.isnan(number) else number for number in times)


def worst_first(rows: Sequence[Row], scenarios: Mapping[str, Scenario]) -> list[int]:
    """Return the indices of some rows, the worst episode first; of equal ones the earlier first."""
    return sorted(range(len(rows)), key=lambda k: badness(rows[k], scenarios[rows[k]["scenario"]]), reverse=True)
