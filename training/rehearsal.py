"""Rehearsal before a training: classical policies play its scenarios, and the best ones become rivals.

Each policy is played in a few episodes, and the best ones of these, with their collision filters if they collide, in
more, because the best of many results in few episodes is often a lucky one.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import baselines
from baselines.planning.rehearse import Result, quietly
from baselines.policies import registry
from lissajous_env import Scenario, evaluate
from lissajous_env.wording import where_raised
from lissajous_env.world.columns import COLLISIONS
from training import scenarios
from training.learned.history import summarize_scores

EPISODES, FIRST_SEED = 4, 700_000
"""Episodes of each policy, on at most as many scenarios, and the seed of the first; no evaluation has these seeds."""
FINALISTS, FINAL_EPISODES = 3, 16
"""Number of the best policies that are played again, and in how many episodes."""


def best_policies(
    played_on: Sequence[Scenario],
    device: Any = "cpu",
    show: Callable[[str], None] = lambda words: None,
    say: Callable[[str], None] = lambda words: None,
) -> tuple[str, ...]:
    """Return the best policy by detection time and collisions and, if it differs, the one of the highest return.

    Returns of several scenarios are not comparable, so that these have only the first of the two.

    Args:
        played_on: The scenarios of the evaluations of a training.
        device: Warp device.
        show: Called with words about each policy before it is played.
        say: Called with a sentence about each policy that is left out because it raises an error.
    """
    stages = [scenarios.leaner(made) for made in played_on]

    def scores_of(names: Sequence[str], episodes: int) -> dict[str, dict[str, Any]]:
        """Return the scores of the policies that can be played on all scenarios."""
        scores = {}
        for name in names:
            show(f"rehearsal of {name}")
            try:
                scores[name] = _play(name, stages[:episodes], max(episodes // len(stages), 1), device)
            except Exception as error:  # a policy of a user does not prevent a training
                say(f"{name} is left out of the rehearsal: {where_raised(error)}")
        return {name: of for name, of in scores.items() if of is not None}

    names = [name for name in registry.names(stages[0]) if registry.is_classical(name)]
    first = scores_of([name for name in names if not registry.unwrapped(name)[1]], EPISODES)
    finalists = _best(first, FINALISTS)
    colliding = [name for name in finalists if first[name][COLLISIONS.name] > 0]
    filtered = [name for name in names if registry.unwrapped(name)[0] in colliding and name not in finalists]
    return _best(scores_of([*finalists, *filtered], FINAL_EPISODES), 1)


def _play(name: str, stages: Sequence[Scenario], episodes: int, device: Any) -> dict[str, Any] | None:
    """Return the cost, collisions and return of a policy; None if a scenario does not suit it."""
    cost, collisions, played = 0.0, 0.0, []
    for made in stages:
        try:
            with quietly():
                policy = baselines.make(name, made, episodes, device)
        except ValueError:
            return None
        scores = summarize_scores(evaluate(policy, made, range(FIRST_SEED, FIRST_SEED + episodes), device))
        result = Result(scores["detection_time"] or 0.0, scores[COLLISIONS.name] or 0.0)
        cost, collisions = cost + result.cost(made.task.step), collisions + result.collisions
        played.append(scores["return"])
    own_return = played[0] if len(played) == 1 else None
    return {"cost": cost / len(stages), COLLISIONS.name: collisions / len(stages), "return": own_return}


def _best(scores: Mapping[str, Mapping[str, Any]], count: int) -> tuple[str, ...]:
    """Return the `count` policies of the lowest costs, then those of the highest returns that are not among them."""
    by_cost = sorted(scores, key=lambda name: scores[name]["cost"])[:count]
    rewarded = [name for name in scores if scores[name]["return"] is not None]
    by_return = sorted(rewarded, key=lambda name: -scores[name]["return"])[:count]
    return tuple(dict.fromkeys([*by_cost, *by_return]))
