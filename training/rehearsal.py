"""Rehearsal before a training: classical policies play its scenarios, and the best ones become rivals.

Each policy is played in a few episodes, and the best ones of these, with their collision filters if they collide, in
more, because the best of many results in few episodes is often a lucky one.
"""

import hashlib
import json
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import baselines
from baselines.planning.rehearse import Result
from baselines.policies import registry
from baselines.policies.base import Policy
from lissajous_env import Scenario, evaluate
from lissajous_env.parameters.assumptions import AssumptionWarning
from lissajous_env.storage.journal import Journal
from lissajous_env.wording import where_raised
from lissajous_env.world.columns import COLLISIONS
from training import scenarios
from training.learned.history import summarize_scores

EPISODES, FIRST_SEED = 4, 700_000
"""Episodes of each policy, on at most as many scenarios, and the seed of the first; no evaluation has these seeds."""
FINALISTS, FINAL_EPISODES = 3, 16
"""Number of the best policies that are played again, and in how many episodes."""


class Rehearsal:
    """Classical policies on the scenarios of the evaluations of a training.

    Args:
        played_on: The scenarios.
        journal: Results so far, to which new ones are added; a policy is not played twice.
        device: Warp device.
        begin: Function that is called with the name of each policy before it is played.
        leave_out: Function that is called with a sentence about each policy that raises an error.
    """

    def __init__(
        self,
        played_on: Sequence[Scenario],
        journal: Journal,
        device: Any,
        begin: Callable[[str], None],
        leave_out: Callable[[str], None],
    ):
        self._played_on, self._journal, self._device = [scenarios.leaner(made) for made in played_on], journal, device
        self._begin, self._leave_out = begin, leave_out
        self._digests = [made.digest() for made in self._played_on]
        self._entries = {entry["key"]: entry for entry in journal.entries}

    def best(self) -> tuple[str, ...]:
        """Return the best policy by detection time and collisions and, if it differs, the one of the highest return.

        Returns of several scenarios are not comparable, so that these have only the first of the two.
        """
        names = [name for name in registry.names(self._played_on[0]) if registry.is_classical(name)]
        first = self._scores([name for name in names if not registry.unwrapped(name)[1]], EPISODES)
        finalists = _best(first, FINALISTS)
        colliding = [name for name in finalists if first[name][COLLISIONS.name] > 0]
        filtered = [name for name in names if registry.unwrapped(name)[0] in colliding and name not in finalists]
        return _best(self._scores([*finalists, *filtered], FINAL_EPISODES), 1)

    def _scores(self, names: Sequence[str], episodes: int) -> dict[str, dict[str, Any]]:
        """Return the scores of the policies that can be played on all scenarios."""
        found = {}
        for name in names:
            key = self._key(name, episodes)
            if key not in self._entries:
                self._begin(name)
                entry = {"key": key, "policy": name, "episodes": episodes, "scores": self._play(name, episodes)}
                self._journal.append([entry])
                self._entries[key] = entry
            if (scores := self._entries[key]["scores"]) is not None:
                found[name] = scores
        return found

    def _key(self, name: str, episodes: int) -> str:
        """Return a digest of what determines the scores of a policy."""
        text = json.dumps([name, episodes, self._digests, registry.parts(name)])
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def _play(self, name: str, episodes: int) -> dict[str, Any] | None:
        """Return the cost, collisions and return of a policy; None if it cannot be played on all scenarios."""
        stages = self._played_on[:episodes]
        count = max(episodes // len(stages), 1)
        seeds, played = range(FIRST_SEED, FIRST_SEED + count), []
        for made in stages:
            if (policy := self._suitable(name, made, count)) is None:
                return None
            try:
                played.append(summarize_scores(evaluate(policy, made, seeds, self._device)))
            except Exception as error:  # a policy of a user does not prevent a training
                self._leave_out(f"{name} is left out of the rehearsal: {where_raised(error)}")
                return None
        costs = [_cost(scores, made) for scores, made in zip(played, stages, strict=True)]
        collisions = [scores[COLLISIONS.name] or 0.0 for scores in played]
        return {
            "cost": sum(costs) / len(costs),
            COLLISIONS.name: sum(collisions) / len(collisions),
            "return": played[0]["return"] if len(played) == 1 else None,
        }

    def _suitable(self, name: str, made: Scenario, count: int) -> Policy | None:
        """Make a policy, or return None for a scenario that does not suit it."""
        try:
            with warnings.catch_warnings(action="ignore", category=AssumptionWarning):
                return baselines.make(name, made, count, self._device)
        except ValueError:
            return None


def _cost(scores: dict[str, float | None], made: Scenario) -> float:
    """Return the logarithm of the detection time, and a tenth for each collision; collisions alone without targets."""
    return Result(scores["detection_time"] or 0.0, scores[COLLISIONS.name] or 0.0).cost(made.task.step)


def _best(found: dict[str, dict[str, Any]], count: int) -> tuple[str, ...]:
    """Return the `count` policies of the lowest costs, then those of the highest returns that are not among them."""
    by_cost = sorted(found, key=lambda name: found[name]["cost"])[:count]
    rewarded = [name for name in found if found[name]["return"] is not None]
    by_return = sorted(rewarded, key=lambda name: -found[name]["return"])[:count]
    return tuple(dict.fromkeys([*by_cost, *by_return]))
