"""Rehearsals: candidates among which the best one is probably found are played in simulation; the best is chosen.

Each is played in a few episodes, and the best ones of these in more, because the best of many results in few episodes
is often a lucky one.
"""

import dataclasses
import math
import warnings
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from baselines.planning.playing import grid
from baselines.policies.settings import PolicySettings
from lissajous_env import Scenario
from lissajous_env import scenario as make_scenario
from lissajous_env.episodes.guarantee import CELLS
from lissajous_env.parameters.assumptions import AssumptionWarning
from lissajous_env.world.columns import COLLISIONS
from training.choosing.playing import GUARANTEE, SHORTEST, cost_of, play

EPISODES, FIRST_SEED = 4, 800_000
"""Episodes of a rehearsal, and the seed of the first; no results of a choice are from these seeds."""
FINALISTS, FINAL_EPISODES = 2, 16
"""Number of the best candidates that are played again, and in how many episodes."""
_CELLS_IN_A_SENSOR = 4.0


def complementary(predicted: np.ndarray, errors: np.ndarray) -> list[int]:
    """Return the order of candidates in which each next one lowers the expected smallest cost most.

    Similar candidates are often predicted to be good together and fail together, so only one of them comes early.

    Args:
        predicted: Predicted cost (K,) of each candidate.
        errors: Costs less predicted costs (E, K), which are taken as E possible errors of this prediction.
    """
    costs = predicted + errors
    best, order = np.full(len(costs), np.inf), []
    for _ in predicted:
        expected = np.minimum(best[:, None], costs).mean(axis=0)
        expected[order] = np.inf
        order.append(int(expected.argmin()))
        best = np.minimum(best, costs[:, order[-1]])
    return order


def best_rehearsed(ranked: Sequence[PolicySettings], scenario: Scenario, objective: str, count: int) -> int | None:
    """Return the index of the best of the first `count` settings that suit a scenario; None if none does.

    The `FINALISTS` best of `EPISODES` episodes are compared in `FINAL_EPISODES`, of which a worst-case undetected time
    is the largest; so each further one follows that was better in its few episodes than these are in all. The episodes
    do not depend on the machine's load or on what ran before, so that all robots on machines of one kind choose the
    same.
    """
    given = tuple((each.policy, tuple(each.parameters.items())) for each in ranked)
    return _best(given, _stage(scenario, objective), objective, count)


@lru_cache(maxsize=256)
def _best(
    ranked: tuple[tuple[str, tuple[tuple[str, Any], ...]], ...], stage: Scenario, objective: str, count: int
) -> int | None:
    given = [(k, PolicySettings(policy, dict(parameters))) for k, (policy, parameters) in enumerate(ranked)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AssumptionWarning)
        costs = _costs(given, stage, objective, EPISODES, count)
        if len(costs) < 2:
            return min(costs, default=None)
        finals: dict[int, float] = {}
        for k in sorted(costs, key=lambda k: costs[k]):
            # The worst case of more episodes is at least that of some of them, so `costs` bounds it from below.
            may_be_best = objective == GUARANTEE and costs[k] < min(finals.values(), default=math.inf)
            if len(finals) < FINALISTS or may_be_best:
                finals |= _costs([given[k]], stage, objective, FINAL_EPISODES, 1)
    return min(finals, key=lambda k: finals[k])


def _costs(
    given: Sequence[tuple[int, PolicySettings]], stage: Scenario, objective: str, episodes: int, count: int
) -> dict[int, float]:
    """Play the first `count` settings that suit a scenario, and return the cost of each by its number."""
    costs: dict[int, float] = {}
    for k, settings in given:
        found = play(settings, stage, episodes, objective, FIRST_SEED)
        if found[COLLISIONS.name] is not None:
            time = math.inf if found["time"] is None else max(found["time"], SHORTEST * stage.task.step)
            costs[k] = cost_of(time, found[COLLISIONS.name])
        if len(costs) == count:
            break
    return costs


def _stage(scenario: Scenario, objective: str) -> Scenario:
    """Return the scenario of rehearsals: without extensions, with the rogues or the grid that the objective needs."""
    made = make_scenario(dataclasses.replace(scenario, extensions=()))
    changes: dict[str, Any] = {"task.grid": None}
    if objective != GUARANTEE:
        changes["task.contamination"] = None
    else:
        changes["targets.rogues"] = None
        if made.task.contamination is None:
            changes["task.contamination"] = grid(made, CELLS, _CELLS_IN_A_SENSOR)
    return make_scenario(made, **changes)
