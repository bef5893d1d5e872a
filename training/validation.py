"""Validation of a policy in a training: its score, its collisions, and its worth, the score relative to a rival's."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lissajous_env import Scenario, evaluate
from lissajous_env.world.columns import task_score
from training.settings import TrainingSettings

VALIDATION_SEED = 20_000
"""Seed of the first episode of a validation."""
_CAREFUL = 0.8
"""Limit of the collisions relative to those of the rival, below 1 because other worlds may have more collisions."""


def validate(
    settings: TrainingSettings, make: Callable[[Scenario, int], Any], reference: Sequence[dict[str, float]] | None
) -> list[dict[str, float]]:
    """Return the score, the collisions and the worth of a policy in each scenario of a validation.

    Args:
        settings: Settings of the training.
        make: Function that makes the policy for a scenario and a number of worlds.
        reference: Results, in the same scenarios, of a rival or of the network before the training; the worth is the
            ratio of the scores, above 1 if the policy is better. Without them, it is 1.
    """
    scenarios, results = settings.make_validation_scenarios(), []
    count = max(settings.episodes // len(scenarios), 1)
    for k, scenario in enumerate(scenarios):
        seeds = range(VALIDATION_SEED, VALIDATION_SEED + count)
        rows = evaluate(make(scenario, count), scenario, seeds=seeds, device=settings.device)
        column = task_score(scenario)
        # Without any target there is no score.
        known = [row[column.name] for row in rows if np.isfinite(row[column.name])]
        score = float(np.mean(known)) if known else 0.0
        compared = score if reference is None else reference[k]["score"]
        worth = (max(score, 1e-9) / max(compared, 1e-9)) ** column.better
        collisions = float(np.mean([row["collisions"] for row in rows]))
        results.append({"score": score, "collisions": collisions, "worth": worth})
    return results


def mean_of(results: Sequence[dict[str, float]]) -> dict[str, float]:
    """Return the means over scenarios of scores and collisions, and the geometric mean of the worths."""
    means = {name: float(np.mean([result[name] for result in results])) for name in ("score", "collisions")}
    return means | {"worth": float(np.exp(np.mean(np.log([result["worth"] for result in results]))))}


def rating_of(point: dict[str, float], limit: float) -> float:
    """Return the worth of a policy; if it has more collisions than the limit + 0.05, divided by the ratio of both."""
    return point["worth"] * min(1.0, (limit + 0.05) / max(point["collisions"], 1e-9))


def limit_of(collisions: float | None, results: Sequence[dict[str, float]]) -> float:
    """Return the collisions per episode above which their cost rises: the setting, or a share of those of a rival."""
    if collisions is None and results:
        return _CAREFUL * mean_of(results)["collisions"]
    return collisions or 0.0


def described(means: dict[str, float], reference: str | None = None) -> str:
    """Return the means of a validation in words, compared with the reference if it is named."""
    compared = "" if reference is None else f"{means['worth']:.3f} times as good as {reference}, "
    return f"score {means['score']:.4g}, {compared}{means['collisions']:.2f} collisions"
