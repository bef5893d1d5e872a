"""Portfolios: policies that rehearse some classical patrols for their scenario, and drive the best one of them.

A prior determines which patrols are rehearsed. All robots read the same numbers and play the same episodes, so they
choose the same patrol without messages, on processors of one kind.
"""

import math
from collections.abc import Iterable, Sequence
from functools import lru_cache, partial
from typing import Any

import numpy as np

from baselines.planning.plans import absolute
from baselines.planning.prior import Prior, complementary
from baselines.planning.rehearse import DETECTION, GUARANTEE, cells, quietly, result_of
from baselines.policies import registry
from baselines.policies.base import Policy, UnsuitableScenarioError
from baselines.policies.settings import PolicySettings
from lissajous_env.episodes.guarantee import CELLS
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import few_of, shown

NAMES = {
    "portfolio": "Rehearses patrols with the proved filter for a short detection time, and drives the best one.",
    "portfolio-guarantee": "Rehearses patrols for a short worst case, and drives the best one.",
}
"""Descriptions of the portfolios, by name."""
REHEARSED = 5
"""Number of patrols that are rehearsed, twice as many for a scenario with a number that the prior has not seen."""

FEW, FIRST_SEED = 4, 800_000
"""Episodes of a rehearsal, and the seed of the first; no published results are from these seeds."""
FINALISTS, MANY = 2, 16
"""Number of the best policies that are played again, and in how many episodes."""
_CELLS_IN_A_SENSOR = 4.0


def chosen(name: str, scenario: str | Scenario) -> PolicySettings:
    """Return the policy and the parameters that a portfolio plays on a scenario.

    Raises:
        ValueError: there is no such portfolio, the prior does not include the scenario, or no patrol suits it.
    """
    if name not in NAMES:
        raise ValueError(f"portfolio must be one of {few_of(NAMES, name)}, got {shown(name)}")
    return _first_suitable(name, scenario, 1, "cpu")[0]


def _make(name: str, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu") -> Policy:
    return _first_suitable(name, scenario, num_worlds, device)[1]


def _first_suitable(name: str, scenario: str | Scenario, num_worlds: int, device: Any) -> tuple[PolicySettings, Policy]:
    """Return the best patrol that suits a scenario, and the policy that it makes."""
    reason: ValueError | None = None
    for settings in ordered(Prior.read(name), scenario):
        try:
            return settings, settings.make(named.build(scenario), num_worlds, device)
        except UnsuitableScenarioError as error:
            reason = reason or error
    assert reason is not None
    raise reason


def ordered(prior: Prior, scenario: str | Scenario, count: int | None = None) -> list[PolicySettings]:
    """Return the patrols of a portfolio in the order in which they are tried, the best rehearsed one first.

    Args:
        prior: The prior of the portfolio.
        scenario: The scenario.
        count: Number of patrols to rehearse, by default `REHEARSED` or twice as many; with 0 the prior decides alone.

    Raises:
        UnsuitableScenarioError: the prior does not include the scenario.
    """
    task = named.build(scenario).resolve()
    predicted = prior.predicted(task)
    patrols = [absolute(patrol, task) for patrol in prior.patrols]
    order = np.argsort(predicted, kind="stable").tolist()
    count = (REHEARSED if prior.has_seen(task) else 2 * REHEARSED) if count is None else count
    if count > 0:
        rehearsed = complementary(predicted, prior.errors)
        given = tuple((patrols[k].policy, tuple(patrols[k].parameters.items())) for k in rehearsed)
        best = _best(given, stage(task, prior.objective), prior.objective, count)
        order = order if best is None else [rehearsed[best], *(k for k in order if k != rehearsed[best])]
    return [patrols[k] for k in order]


@lru_cache(maxsize=256)
def _best(given: tuple[tuple[str, tuple], ...], task: Scenario, objective: str, count: int) -> int | None:
    return best_of([PolicySettings(policy, dict(parameters)) for policy, parameters in given], task, objective, count)


def stage(scenario: Scenario, objective: str) -> Scenario:
    """Return the scenario of rehearsals: without extensions, with the rogues or the grid that the objective needs."""
    task = scenario.without_extensions()
    changes: dict[str, Any] = {"task.grid": None}
    if objective == DETECTION:
        changes["task.contamination"] = None
    else:
        changes["targets.rogues"] = None
        if task.task.contamination is None:
            changes["task.contamination"] = cells(task, CELLS, _CELLS_IN_A_SENSOR)
    return named.build(task, **changes)


def best_of(candidates: Sequence[PolicySettings], task: Scenario, objective: str, count: int) -> int | None:
    """Return the index of the best of the first `count` candidates that suit a scenario; None if none does.

    The `FINALISTS` best of `FEW` episodes are compared in `MANY`, of which a worst-case undetected time
    is the largest; so each further one follows that was better in its few episodes than these are in all. The episodes
    do not depend on the machine's load or on what ran before, so that all robots on machines of one kind choose the
    same.
    """
    with quietly():
        costs = _costs(candidates, range(len(candidates)), task, objective, FEW, count)
        if len(costs) < 2:
            return min(costs, default=None)
        finals: dict[int, float] = {}
        for k in sorted(costs, key=costs.__getitem__):
            # The worst case of more episodes is at least that of some of them, so `costs` bounds it from below.
            may_be_best = objective == GUARANTEE and costs[k] < min(finals.values(), default=math.inf)
            if len(finals) < FINALISTS or may_be_best:
                finals |= _costs(candidates, [k], task, objective, MANY, 1)
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
        result = result_of(candidates[k], task, episodes, objective, FIRST_SEED)
        if result is not None:
            costs[k] = result.cost(task.task.step)
        if len(costs) == count:
            break
    return costs


for _name, _about in NAMES.items():
    registry.register(_name, "car", partial(_make, _name), about=_about, learned=True, on_request=True)
