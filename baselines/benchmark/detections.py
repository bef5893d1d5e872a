"""Detection times of the targets, stored beside the score rows, and the share detected over time.

The time of a target that was not detected is censored: it is at least as long as the target was present. The share that
is detected within each time is the estimate of E. L. Kaplan, P. Meier, "Nonparametric Estimation from Incomplete
Observations" (1958).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lissajous_env.world.simulation import Simulation

NAME = "detections.jsonl"
"""File of the detection times: an object for each episode."""

KEPT = 64
"""Number of episodes of a cell whose detection times are stored: enough for a smooth curve."""

_DIGITS = 6
_ENTRIES = ("scenario", "policy", "episode", "found", "unfound")


def detections_of(simulation: Simulation, rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the detection times of the targets of episodes that have ended, for the rows with `episode` below `KEPT`.

    Each entry has `scenario`, `policy` and `episode`; `found` [s], the times from a target's appearance until it was
    detected; and `unfound` [s], the times for which the other targets were present.
    """
    kept = []
    for world, row in enumerate(rows):
        if row["episode"] < KEPT:
            times, found = simulation.detection_times(world)
            times = np.round(times, _DIGITS)
            identity = {name: row[name] for name in _ENTRIES[:3]}
            kept.append(identity | {"found": times[found].tolist(), "unfound": times[~found].tolist()})
    return kept


def share_detected(found: Sequence[float] | np.ndarray, unfound: Sequence[float] | np.ndarray) -> tuple[Any, Any]:
    """Return times [s] in rising order, and the Kaplan-Meier estimate of the share detected within each.

    Args:
        found: times until the detection [s].
        unfound: times for which the other targets were present [s].
    """
    from scipy import stats  # its import takes longer than that of this project

    times = np.concatenate([found, unfound]).astype(float)
    if not times.size:
        return times, times
    censored = np.arange(len(times)) >= len(found)
    curve = stats.ecdf(stats.CensoredData.right_censored(times, censored)).cdf
    return curve.quantiles, curve.probabilities


def refusal_of(entry: Any) -> str | None:
    """Return the rule that an entry violates; None for a valid one."""
    if not isinstance(entry, dict) or tuple(entry) != _ENTRIES:
        return f"must have {', '.join(_ENTRIES)}"
    scenario, policy, episode, *times = entry.values()
    if not (isinstance(scenario, str) and isinstance(policy, str) and type(episode) is int and 0 <= episode < KEPT):
        return f"must have two names and an episode below {KEPT}"
    if not all(isinstance(each, list) and all(map(_is_time, each)) for each in times):
        return "must have lists of times of at least 0 [s]"
    return None


def _is_time(value: Any) -> bool:
    return type(value) in (int, float) and 0 <= value <= 1e9
