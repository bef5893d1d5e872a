"""Candidates that are played on scenarios of a space: the data of a choice."""

import itertools
import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.settings import PolicySettings
from lissajous_env import Scenario, ScenarioSpace, evaluate
from lissajous_env import scenario as make_scenario
from lissajous_env.storage.journal import Journal
from lissajous_env.world.columns import COLLISIONS, DETECTION_TIME, OPEN, WORST_CASE
from training.choosing.candidates import Candidate

Table = dict[tuple[str, str], Mapping[str, Any]]
"""Results by the digest of the scenario and the name of the candidate."""
DETECTION, GUARANTEE = "detection", "guarantee"
"""Objectives: the mean detection time, and the worst-case undetected time."""
FIRST_SEED = 900_000
_LONGEST = 20.0
"""Largest time of a candidate that counts, over the shortest of all candidates."""
SHORTEST = 1.0
"""Smallest time that counts [control steps]: below, collisions alone decide."""
_OPEN = 2.0
"""Worst case that counts where the episodes show no bound [episodes]."""
_COLLISION, _COLLISIONS = 0.1, 20
"""Cost of a collision in an episode, and the largest number of collisions that counts."""


def scenarios_of(space: ScenarioSpace, split: str, count: int, objective: str) -> list[Scenario]:
    """Return the first scenarios of a split or shift, with the fields that the objective does not need left out."""
    spare: dict[str, Any] = {"task.grid": None}
    if objective == DETECTION:
        spare["task.contamination"] = None
    return [make_scenario(drawn, **spare) for drawn in itertools.islice(space.scenarios(split), count)]


def play(
    settings: PolicySettings, scenario: Scenario, episodes: int, objective: str, first_seed: int = FIRST_SEED
) -> dict[str, float | None]:
    """Return the time of a policy by an objective [s], and its collisions per episode.

    The time is the mean of the episodes' detection times, or their longest worst case. Both are None for a scenario
    that does not suit the policy.
    """
    try:
        policy = settings.make(scenario, episodes)
    except UnsuitableScenarioError:
        return {"time": None, COLLISIONS.name: None}
    rows = evaluate(policy, scenario, range(first_seed, first_seed + episodes))
    collisions = sum(row[COLLISIONS.name] for row in rows) / episodes
    if objective == GUARANTEE:
        opened = any(row[OPEN.name] for row in rows)
        longest = _OPEN * scenario.task.duration if opened else max(row[WORST_CASE.name] for row in rows)
        return {"time": longest, COLLISIONS.name: collisions}
    times = [row[DETECTION_TIME.name] for row in rows if math.isfinite(row[DETECTION_TIME.name])]
    return {"time": sum(times) / len(times) if times else None, COLLISIONS.name: collisions}


def table(
    candidates: Sequence[Candidate],
    scenarios: Sequence[Scenario],
    episodes: int,
    objective: str,
    journal: Journal,
    progress: Callable[[], None] = lambda: None,
) -> Table:
    """Return the results of `play`; what the journal contains for as many episodes and the objective is not played."""
    given = {"objective": objective, "episodes": episodes}
    found: Table = {
        (entry["digest"], entry["candidate"]): entry for entry in journal.entries if given.items() <= entry.items()
    }

    def played(scenario: Scenario) -> list[dict[str, Any]]:
        of = {"scenario": scenario.name, "digest": scenario.digest()}
        return [
            {**of, "candidate": each.name, **given, **play(each.settings(scenario), scenario, episodes, objective)}
            for each in candidates
            if (of["digest"], each.name) not in found
        ]

    pool = ThreadPoolExecutor(os.cpu_count())
    try:
        for entries in pool.map(played, scenarios):
            journal.append(entries)
            found |= {(entry["digest"], entry["candidate"]): entry for entry in entries}
            progress()
    finally:
        pool.shutdown(cancel_futures=True)
    return found


def as_arrays(
    found: Table, candidates: Sequence[Candidate], scenarios: Sequence[Scenario]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the time (S, K) of each candidate in each scenario [s], and its collisions per episode.

    Times are limited to 20 times the shortest one in the scenario, which a candidate has that does not suit it.
    """
    times, collisions = np.empty((2, len(scenarios), len(candidates)))
    for s, scenario in enumerate(scenarios):
        digest = scenario.digest()
        entries = [found[digest, each.name] for each in candidates]
        given = np.array([math.inf if entry["time"] is None else entry["time"] for entry in entries])
        given = np.maximum(given, SHORTEST * scenario.task.step)
        times[s] = np.minimum(given, _LONGEST * given.min())
        collisions[s] = [_COLLISIONS if entry[COLLISIONS.name] is None else entry[COLLISIONS.name] for entry in entries]
    return times, collisions


def costs(found: Table, candidates: Sequence[Candidate], scenarios: Sequence[Scenario]) -> np.ndarray:
    """Return the cost (S, K) of each candidate in each scenario.

    It is the logarithm of its time over the shortest in the scenario, and a tenth for each collision in an episode.
    """
    times, collisions = as_arrays(found, candidates, scenarios)
    return cost_of(times / times.min(axis=1, keepdims=True), collisions)


def cost_of(time: Any, collisions: Any) -> Any:
    """Return the logarithm of a time, and a tenth for each collision in an episode."""
    return np.log(time) + _COLLISION * np.minimum(collisions, _COLLISIONS)
