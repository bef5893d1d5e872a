"""When each target was detected, kept beside the score rows, and from that the share detected over time.

A target that was not detected when its episode ended is censored: its time is only known to be longer than it was
there. E. L. Kaplan, P. Meier, "Nonparametric Estimation from Incomplete Observations" (1958), says what share is
detected within each time all the same.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lissajous_env.storage.folder import Folder
from lissajous_env.world.simulation import Simulation

NAME = "detections.jsonl"
"""File that they are kept in: an object for each episode."""

KEPT = 64
"""First episodes of a cell whose targets are kept: enough for a smooth curve, however many are played."""

_DIGITS = 6
_ENTRIES = ("scenario", "policy", "episode", "found", "unfound")


def detections_of(simulation: Simulation, rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Times of the targets of episodes that have ended, world by world, for the rows of those that are kept.

    Each tells `scenario`, `policy` and `episode`, and of its targets the time from the appearance until the detection,
    `found` [s], or for which one was there undetected, `unfound` [s].
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
    """Times [s] in rising order, and the share of the targets that is detected within each, by Kaplan and Meier.

    Args:
        found: Times until the detection [s].
        unfound: Times for which the others were there [s].
    """
    from scipy import stats  # which takes longer to import than all of ours

    times = np.concatenate([found, unfound]).astype(float)
    if not times.size:
        return times, times
    censored = np.arange(len(times)) >= len(found)
    curve = stats.ecdf(stats.CensoredData.right_censored(times, censored)).cdf
    return curve.quantiles, curve.probabilities


class Detections:
    """The times of the targets of the episodes that have ended; of one that was played again, the last.

    Raises:
        ValueError: the file holds what is none; file and line are named.
    """

    def __init__(self, folder: Folder):
        self._of: dict[tuple[str, str, int], dict[str, Any]] = {}
        self._journal = folder.journal(NAME)
        for line, entry in enumerate(self._journal.entries, start=1):
            if wrong := what_is_wrong(entry):
                self._journal.close()
                raise ValueError(f"{self._journal.path}, line {line} {wrong}; delete that line to leave it out")
            self._of[_key(entry)] = entry

    def add(self, entries: Sequence[dict[str, Any]]) -> None:
        """Add those of episodes that have ended; they are on the disk when this returns."""
        self._journal.append(entries)
        self._of |= {_key(entry): entry for entry in entries}

    def curves(self, rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, tuple[Any, Any]]]:
        """Share detected over time, by scenario and policy, of the episodes of some rows."""
        pooled: dict[tuple[str, str], tuple[list[float], list[float]]] = {}
        for row in rows:
            found, unfound = pooled.setdefault((row["scenario"], row["policy"]), ([], []))
            entry = self._of.get(_key(row), {"found": [], "unfound": []})
            found += entry["found"]
            unfound += entry["unfound"]
        curves: dict[str, dict[str, tuple[Any, Any]]] = {}
        for (scenario, policy), times in pooled.items():
            curves.setdefault(scenario, {})[policy] = share_detected(*times)
        return curves

    def close(self) -> None:
        """Close the file."""
        self._journal.close()


def what_is_wrong(entry: Any) -> str | None:
    """Say by which rule something is none of `detections_of`; None where it is."""
    if not isinstance(entry, dict) or tuple(entry) != _ENTRIES:
        return f"must hold {', '.join(_ENTRIES)}"
    scenario, policy, episode, *times = entry.values()
    if not (isinstance(scenario, str) and isinstance(policy, str) and type(episode) is int and 0 <= episode < KEPT):
        return f"must hold two names and an episode below {KEPT}"
    if not all(isinstance(each, list) and all(map(_is_time, each)) for each in times):
        return "must hold lists of times of at least 0 [s]"
    return None


def _is_time(value: Any) -> bool:
    return type(value) in (int, float) and 0 <= value <= 1e9


def _key(entry: Mapping[str, Any]) -> tuple[str, str, int]:
    return entry["scenario"], entry["policy"], entry["episode"]
