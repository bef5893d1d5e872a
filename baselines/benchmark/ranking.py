"""Mean ranks of the policies over the scenarios of a robot kind, with bootstrap intervals."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.benchmark import clairvoyant
from baselines.benchmark.rows import Rows, by_kind
from baselines.benchmark.shown_columns import COMPARED
from baselines.benchmark.statistics import bootstrap_interval
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import LARGEST, OPEN, WORST_CASE, Column

Rank = tuple[float, float, float]
"""Mean rank, 1 for the best, and the ends of its 95 % bootstrap interval over seeds, stratified by scenario."""


@dataclass(frozen=True)
class Ranking:
    """Ranks on the scenarios of a kind of robots, among the policies that played all of them."""

    kind: str
    scenarios: tuple[str, ...]
    columns: tuple[Column, ...]
    """Columns that the policies are ranked by: those of `COMPARED` with numbers on each of the scenarios."""
    ranks: dict[str, dict[str, Rank]]
    """Ranks by policy and name of the column, the best policy over all columns first."""
    overall: dict[str, Rank]
    """Mean over the columns, by policy."""


def rankings(rows: Rows, scenarios: Mapping[str, Scenario]) -> list[Ranking]:
    """Rank the policies on each seed of each scenario, and average; of equal ones each has the mean of their ranks.

    A guarantee is ranked by its largest value in a scenario, on every seed alike.

    Args:
        rows: Score rows with their derived columns.
        scenarios: Their scenarios by name.
    """
    rivals = [row for row in rows if row["policy"] != clairvoyant.NAME]
    return [_ranking(kind, of) for kind, of in by_kind(rivals, scenarios).items() if len(of) > 1]


def _ranking(kind: str, played: Mapping[str, Mapping[str, Rows]]) -> Ranking:
    from scipy.stats import rankdata  # which takes longer to import than all of ours

    policies = list(played)
    names = tuple(played[policies[0]])
    worths = [_worths([of[name] for of in played.values()]) for name in names]
    known = [~np.isnan(table) for table in worths]
    places = [c for c in range(len(COMPARED)) if all(table[c].all(axis=0).any() for table in known)]
    columns = tuple(COMPARED[c] for c in places)
    # (C, P, n) of each scenario, on the seeds on which every policy has a number in each column.
    common = [table[places][:, :, there[places].all(axis=(0, 1))] for table, there in zip(worths, known, strict=True)]
    for c, column in enumerate(columns):
        for table in common if column.summary == LARGEST else ():
            table[c] = table[c].max(axis=1, keepdims=True)
    ranks = [rankdata(table, axis=1) for table in common]
    of = {
        policy: {of.name: _mean([table[c, k] for table in ranks]) for c, of in enumerate(columns)}
        for k, policy in enumerate(policies)
    }
    overall = {policy: _mean([table[:, k].mean(axis=0) for table in ranks]) for k, policy in enumerate(policies)}
    order = sorted(policies, key=lambda policy: overall[policy][0])
    return Ranking(kind, names, columns, {p: of[p] for p in order}, {p: overall[p] for p in order})


def _worths(played: Sequence[Rows]) -> np.ndarray:
    """Return the numbers that policies are ranked by on the seeds that all played, smaller being better: (C, P, n).

    Args:
        played: Rows of a scenario, of each policy.
    """
    of = [{row["seed"]: row for row in rows} for rows in played]
    seeds = sorted(set.intersection(*map(set, of)))
    return np.array([[[_worth(rows[seed], column) for seed in seeds] for rows in of] for column in COMPARED])


def _worth(row: Mapping[str, Any], column: Column) -> float:
    """Return the number of a row, smaller being better; the worst-case time of an open episode is infinite.

    One that was still growing when its episode ended counts as long as it was.
    """
    if column is WORST_CASE and row.get(OPEN.name) == 1:
        return math.inf
    return -column.better * row.get(column.name, math.nan)


def _mean(strata: Sequence[np.ndarray]) -> Rank:
    return float(np.concatenate(strata).mean()), *bootstrap_interval(*strata, cut=0.0)
