"""Mean ranks of the policies over the scenarios of a robot kind, with bootstrap intervals."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.benchmark import clairvoyant
from baselines.benchmark.shown_columns import COMPARED
from baselines.benchmark.statistics import bootstrap_interval
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import OPEN, WORST_CASE, Column

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


def rankings(rows: Sequence[Mapping[str, Any]], scenarios: Mapping[str, Scenario]) -> list[Ranking]:
    """Rank the policies on each seed of each scenario, and average; of equal ones each has the mean of their ranks.

    Args:
        rows: Score rows with their derived columns.
        scenarios: Their scenarios by name.
    """
    played: dict[str, dict[str, dict[int, Mapping[str, Any]]]] = {}
    for row in rows:
        if row["policy"] != clairvoyant.NAME:
            played.setdefault(row["scenario"], {}).setdefault(row["policy"], {})[row["seed"]] = row
    found = []
    for kind in dict.fromkeys(scenarios[name].robot.kind for name in played):
        group = {name: played[name] for name, of in scenarios.items() if name in played and of.robot.kind == kind}
        policies = [p for p in next(iter(group.values())) if all(p in of for of in group.values())]
        if len(policies) > 1:
            found.append(_ranking(kind, group, policies))
    return found


def _ranking(kind: str, group: Mapping[str, Mapping[str, Mapping[int, Any]]], policies: list[str]) -> Ranking:
    from scipy.stats import rankdata  # which takes longer to import than all of ours

    worths = [_worths(of, policies) for of in group.values()]
    known = [~np.isnan(table) for table in worths]
    places = [c for c in range(len(COMPARED)) if all(table[c].all(axis=0).any() for table in known)]
    columns = tuple(COMPARED[c] for c in places)
    # (C, P, n) of each scenario, on the seeds on which every policy has a number in each column.
    ranks = [rankdata(table[places][:, :, there[places].all(axis=(0, 1))], axis=1)
             for table, there in zip(worths, known, strict=True)]  # fmt: skip
    of = {
        policy: {of.name: _mean([table[c, k] for table in ranks]) for c, of in enumerate(columns)}
        for k, policy in enumerate(policies)
    }
    overall = {policy: _mean([table[:, k].mean(axis=0) for table in ranks]) for k, policy in enumerate(policies)}
    order = sorted(policies, key=lambda policy: overall[policy][0])
    return Ranking(
        kind,
        tuple(group),
        columns,
        {p: of[p] for p in order},
        {p: overall[p] for p in order},
    )


def _worths(of: Mapping[str, Mapping[int, Mapping[str, Any]]], policies: Sequence[str]) -> np.ndarray:
    """Return the numbers that policies are ranked by on the seeds that all played, smaller being better: (C, P, n)."""
    seeds = sorted(set.intersection(*(set(of[policy]) for policy in policies)))
    return np.array([[[_worth(of[p][seed], column) for seed in seeds] for p in policies] for column in COMPARED])


def _worth(row: Mapping[str, Any], column: Column) -> float:
    """Return the number of a row, smaller being better; the worst-case time of an open episode is infinite.

    One that was still growing when its episode ended counts as long as it was.
    """
    if column is WORST_CASE and row.get(OPEN.name) == 1:
        return math.inf
    return -column.better * row.get(column.name, math.nan)


def _mean(strata: Sequence[np.ndarray]) -> Rank:
    return float(np.concatenate(strata).mean()), *bootstrap_interval(*strata, cut=0.0)
