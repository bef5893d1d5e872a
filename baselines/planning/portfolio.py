"""Portfolios: policies that rehearse some classical patrols for their scenario, and drive the best one of them.

All robots play the same episodes, so they choose the same patrol without messages, on processors of one kind.
"""

import math
from functools import lru_cache, partial
from typing import Any

from baselines.planning.plans import absolute
from baselines.policies import registry
from baselines.policies.base import Policy, UnsuitableScenarioError
from baselines.policies.settings import PolicySettings
from lissajous_env.episodes.evaluation import evaluate
from lissajous_env.episodes.guarantee import cells
from lissajous_env.parameters import named
from lissajous_env.parameters.assumptions import quietly
from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import require
from lissajous_env.world.columns import COLLISIONS, DETECTION_TIME, OPEN, WORST_CASE

DETECTION, GUARANTEE = "portfolio", "portfolio-guarantee"
NAMES = {
    DETECTION: "Rehearses patrols with the proved filter for a short detection time, and drives the best one.",
    GUARANTEE: "Rehearses patrols for a short worst case, and drives the best one.",
}
"""Descriptions of the portfolios, by name."""
PATROLS = {
    DETECTION: (
        PolicySettings("sweep-proved", {"cruise": 0.93, "inset": 0.37, "lookahead": 0.6}),
        PolicySettings("sweep-proved", {"cruise": 0.9, "inset": 0.52, "gather": 5.0, "bow": 0.09}),
        PolicySettings(
            "sweep-proved", {"cruise": 0.86, "inset": 0.48, "slowest": 0.2, "gather": 1.3, "bow": 0.3, "lookahead": 0.8}
        ),
        PolicySettings("sweep-proved", {"cruise": 0.86, "inset": 0.32, "slowest": 0.45, "gather": 1.3, "corner": 1.6}),
        PolicySettings(
            "sweep-proved", {"cruise": 0.86, "inset": 0.3, "slowest": 0.45, "gather": 2.6, "lookahead": 1.5}
        ),
        PolicySettings("sweep-proved", {"cruise": 0.8, "slowest": 0.15, "gather": 1.3}),
        PolicySettings("sweep-proved", {"cruise": 0.9, "slowest": 0.15, "gather": 1.3}),
        PolicySettings("laps-proved", {"cruise": 0.7}),
        PolicySettings("partition-proved", {"speed": 0.98, "in_phase": True}),
        PolicySettings("partition-proved", {"speed": 0.98, "extent_x": 0.3, "extent_y": 0.3}),
        PolicySettings("partition-repair-proved", {"speed": 0.98}),
    ),
    GUARANTEE: (
        PolicySettings("line-abreast"),
        PolicySettings("line-abreast", {"lines": 1, "speed": 0.7}),
        PolicySettings("line-abreast", {"lines": 1, "speed": 0.85}),
        PolicySettings("line-abreast", {"lines": 2, "speed": 0.97}),
        PolicySettings("line-abreast-safe"),
        PolicySettings("line-abreast-safe", {"lines": 1, "speed": 0.9}),
        PolicySettings("line-abreast-proved"),
        PolicySettings("line-abreast-proved", {"lines": 1, "speed": 0.85}),
        PolicySettings("sweep-safe", {"cruise": 0.89, "inset": 0.44, "slowest": 0.1, "gather": 2.6}),
        PolicySettings("sweep-safe", {"cruise": 0.91, "inset": 0.19, "slowest": 0.2, "gather": 2.6}),
        PolicySettings("sweep-proved", {"cruise": 0.86, "inset": 0.32, "gather": 1.3, "corner": 1.6, "by_phase": True}),
        PolicySettings(
            "sweep-proved", {"cruise": 0.86, "inset": 0.3, "slowest": 0.45, "gather": 2.6, "lookahead": 1.5}
        ),
        PolicySettings("partition", {"speed": 0.89, "extent_y": 0.6}),
        PolicySettings("partition-safe", {"speed": 0.7}),
        PolicySettings("partition-safe", {"speed": 0.98}),
        PolicySettings("partition-proved", {"speed": 0.7}),
        PolicySettings("partition-proved", {"speed": 0.98}),
        PolicySettings("partition-repair"),
    ),
}
"""The patrols that each portfolio rehearses, with parameters relative to the scenario (`plans.absolute`)."""

FEW, FIRST_SEED = 4, 800_000
"""Episodes of a rehearsal, and the seed of the first; no published results are from these seeds."""
FINALISTS, MANY = 2, 16
"""Number of the best policies that are played again, and in how many episodes."""
_OPEN = 2.0
"""Worst case that stands for one without a bound, in durations of an episode."""
_COLLISION, _MOST_COLLISIONS = 0.1, 20
"""Cost of a collision in an episode, and the largest number of collisions that counts."""


def cost(time: float, collisions: float, step: float) -> float:
    """Return the logarithm of a time [s], and a tenth for each collision in an episode.

    A time below a control step [s] counts as one step.
    """
    return math.log(max(time, step)) + _COLLISION * min(collisions, _MOST_COLLISIONS)


def result_of(
    settings: PolicySettings, scenario: Scenario, episodes: int, portfolio: str, first_seed: int = FIRST_SEED
) -> tuple[float, float]:
    """Play a policy and return the time that a portfolio minimises [s], and the collisions in an episode.

    The time is the mean detection time, or the largest worst-case undetected time; infinite if nothing was detected.

    Raises:
        UnsuitableScenarioError: the scenario does not suit the policy.
    """
    rows = evaluate(settings.make(scenario, episodes), scenario, range(first_seed, first_seed + episodes))
    collisions = sum(row[COLLISIONS.name] for row in rows) / episodes
    if portfolio == GUARANTEE:
        without_bound = _OPEN * scenario.task.duration
        return max(without_bound if row[OPEN.name] else row[WORST_CASE.name] for row in rows), collisions
    times = [row[DETECTION_TIME.name] for row in rows if math.isfinite(row[DETECTION_TIME.name])]
    return sum(times) / len(times) if times else math.inf, collisions


def rehearsal_of(scenario: Scenario, portfolio: str) -> Scenario:
    """Return the scenario of rehearsals: without extensions, with the rogues or the grid that the objective needs.

    Targets stand still in place of rogues that are agents, whose actions no rehearsal has.
    """
    scenario = scenario.without_extensions()
    changes: dict[str, Any] = {"task.grid": None, "task.contamination": None}
    if portfolio == GUARANTEE:
        changes["task.contamination"] = scenario.task.contamination or cells(scenario)
    if portfolio == GUARANTEE or scenario.targets.rogues == AGENTS:
        changes |= {"targets.rogues": None, "targets.custom": 0.0}  # a resolved scenario has custom = 1 with rogues
    return named.build(scenario, **changes)


def chosen(name: str, scenario: str | Scenario) -> PolicySettings:
    """Return the policy and the parameters that a portfolio plays on a scenario.

    Raises:
        ValueError: there is no such portfolio, the robots are not cars, or no patrol suits the scenario.
    """
    require(name in NAMES, "portfolio", f"must be one of {', '.join(NAMES)}", name, NAMES)
    scenario = named.build(scenario).resolve()
    if scenario.robot.kind != "car":
        raise UnsuitableScenarioError(f"robot.kind must be car, got {scenario.robot.kind}")
    return _best_rehearsed(name, scenario)


@lru_cache(maxsize=256)
def _best_rehearsed(name: str, scenario: Scenario) -> PolicySettings:
    """Return the best patrol of a portfolio on a scenario of cars.

    The `FINALISTS` best patrols of `FEW` episodes are compared in `MANY`. The worst case of more episodes is never
    shorter. So with the objective `GUARANTEE`, every other patrol that was better in its few episodes than these are in
    all is played again, too. The episodes do not depend on the machine's load or on what ran before, so that all robots
    on machines of one kind choose the same.
    """
    patrols = [absolute(patrol, scenario) for patrol in PATROLS[name]]
    rehearsal, step = rehearsal_of(scenario, name), scenario.task.step
    costs: dict[int, float] = {}
    finals: dict[int, float] = {}
    reason: UnsuitableScenarioError | None = None
    with quietly():
        for k, patrol in enumerate(patrols):
            try:
                costs[k] = cost(*result_of(patrol, rehearsal, FEW, name), step)
            except UnsuitableScenarioError as error:
                reason = reason or error
        if reason is not None and not costs:
            raise reason
        for k in sorted(costs, key=costs.__getitem__):
            # Without collisions, `costs` bounds the cost from below: the worst case of more episodes is never shorter.
            may_be_best = name == GUARANTEE and costs[k] < min(finals.values(), default=math.inf)
            if len(finals) < FINALISTS or may_be_best:
                finals[k] = cost(*result_of(patrols[k], rehearsal, MANY, name), step)
    return patrols[min(finals, key=finals.__getitem__)]


def _make(name: str, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu") -> Policy:
    return chosen(name, scenario).make(named.build(scenario), num_worlds, device)


for _name, _about in NAMES.items():
    registry.register(_name, "car", partial(_make, _name), about=_about, steered_by="plan", on_request=True)
