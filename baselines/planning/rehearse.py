"""Rehearsals: policies are played in a few episodes each, and the best ones of these in more.

The best of many results in few episodes is often a lucky one.
"""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from baselines.planning.playing import grid, quietly
from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.settings import PolicySettings
from lissajous_env.episodes.evaluation import evaluate
from lissajous_env.episodes.guarantee import CELLS
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import COLLISIONS, DETECTION_TIME, OPEN, WORST_CASE

DETECTION, GUARANTEE = "detection", "guarantee"
"""Objectives: the mean detection time, and the worst-case undetected time."""
EPISODES, FIRST_SEED = 4, 800_000
"""Episodes of a rehearsal, and the seed of the first; no results of a portfolio are from these seeds."""
FINALISTS, FINAL_EPISODES = 2, 16
"""Number of the best policies that are played again, and in how many episodes."""
_CELLS_IN_A_SENSOR = 4.0
_OPEN = 2.0
"""Worst case that counts where the episodes show no bound [episodes]."""
_COLLISION, MOST_COLLISIONS = 0.1, 20
"""Cost of a collision in an episode, and the largest number of collisions that counts."""


class Result(NamedTuple):
    """The result of a policy in some episodes."""

    time: float
    """Mean detection time, or largest worst-case undetected time [s]; infinite if nothing was detected."""
    collisions: float
    """Collisions in an episode."""

    def cost(self, step: float) -> float:
        """Return the cost, with a time of at least a control step [s]: below, collisions alone decide."""
        return float(cost_of(max(self.time, step), self.collisions))


def cost_of(time: Any, collisions: Any) -> Any:
    """Return the logarithm of a time, and a tenth for each collision in an episode."""
    return np.log(time) + _COLLISION * np.minimum(collisions, MOST_COLLISIONS)


def stage(scenario: Scenario, objective: str) -> Scenario:
    """Return the scenario of rehearsals: without extensions, with the rogues or the grid that the objective needs."""
    task = dataclasses.replace(scenario, extensions=())
    changes: dict[str, Any] = {"task.grid": None}
    if objective == DETECTION:
        changes["task.contamination"] = None
    else:
        changes["targets.rogues"] = None
        if task.task.contamination is None:
            changes["task.contamination"] = grid(task, CELLS, _CELLS_IN_A_SENSOR)
    return named.build(task, **changes)


def result_of(
    settings: PolicySettings, task: Scenario, episodes: int, objective: str, first_seed: int = FIRST_SEED
) -> Result | None:
    """Play a policy and return its result; None for a scenario that does not suit the policy."""
    try:
        policy = settings.make(task, episodes)
    except UnsuitableScenarioError:
        return None
    rows = evaluate(policy, task, range(first_seed, first_seed + episodes))
    collisions = sum(row[COLLISIONS.name] for row in rows) / episodes
    if objective == GUARANTEE:
        is_open = any(row[OPEN.name] for row in rows)
        return Result(_OPEN * task.task.duration if is_open else max(row[WORST_CASE.name] for row in rows), collisions)
    times = [row[DETECTION_TIME.name] for row in rows if math.isfinite(row[DETECTION_TIME.name])]
    return Result(sum(times) / len(times) if times else math.inf, collisions)


def best_of(candidates: Sequence[PolicySettings], task: Scenario, objective: str, count: int) -> int | None:
    """Return the index of the best of the first `count` candidates that suit a scenario; None if none does.

    The `FINALISTS` best of `EPISODES` episodes are compared in `FINAL_EPISODES`, of which a worst-case undetected time
    is the largest; so each further one follows that was better in its few episodes than these are in all. The episodes
    do not depend on the machine's load or on what ran before, so that all robots on machines of one kind choose the
    same.
    """
    with quietly():
        costs = _costs(candidates, range(len(candidates)), task, objective, EPISODES, count)
        if len(costs) < 2:
            return min(costs, default=None)
        finals: dict[int, float] = {}
        for k in sorted(costs, key=costs.__getitem__):
            # The worst case of more episodes is at least that of some of them, so `costs` bounds it from below.
            may_be_best = objective == GUARANTEE and costs[k] < min(finals.values(), default=math.inf)
            if len(finals) < FINALISTS or may_be_best:
                finals |= _costs(candidates, [k], task, objective, FINAL_EPISODES, 1)
    return min(finals, key=finals.__getitem__)


def _costs(
    candidates: Sequence[PolicySettings],
    indices: Iterable[int],
    task: Scenario,
    objective: str,
    episodes: int,
    count: int,
) -> dict[int, float]:
    """Return the costs of the first `count` candidates that suit a scenario, by index."""
    costs: dict[int, float] = {}
    for k in indices:
        result = result_of(candidates[k], task, episodes, objective)
        if result is not None:
            costs[k] = result.cost(task.task.step)
        if len(costs) == count:
            break
    return costs
