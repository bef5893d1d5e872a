"""Ways of rogues that are undetected for about as long as the contamination stage reports."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from lissajous_env.episodes.witness.played import Played, Way, peaks, resolution
from lissajous_env.episodes.witness.tracing import Rogue, rough_way
from lissajous_env.episodes.witness.tube import ways_near

_RANKS = (0, 0, 0, 0, 0, 1, 1, 2)
"""Rogue of the stage whose way is traced in each attempt, the longest first."""
_FINENESS = (6, 10, 16)
"""Nodes in the distance of a move: near a way, gaps are searched with more of them where fewer find no passage."""
_LABELS = 60_000_000
"""Limit on the labels of the episodes that are searched together, each of which takes 9 bytes more while it is."""


def longest_ways(episodes: Sequence[Played]) -> list[Way | None]:
    """Return the longest way found in each episode, None if no target can be undetected at the end of any step.

    The way of the stage's rogue is traced through its labels, and a way near it is searched that no disc detects. Where
    there is none, the place at which the rogue is lost is blocked, and the next way is traced.

    Args:
        episodes: The episodes, of one scenario.
    """
    found: dict[int, Way | None] = {}
    with wp.ScopedDevice("cpu"):
        for steps in {each.steps for each in episodes}:
            places = [k for k, each in enumerate(episodes) if each.steps == steps]
            together = max(_LABELS // episodes[places[0]].labels.size, 1)
            for first in range(0, len(places), together):
                some = places[first : first + together]
                found |= zip(some, _longest_ways([episodes[k] for k in some]), strict=True)
    return [found[k] for k in range(len(episodes))]


def _longest_ways(episodes: Sequence[Played]) -> list[Way | None]:
    """Return the ways of episodes of the same length."""
    rogues: list[list[Rogue]] = [peaks(each) for each in episodes]
    longest: list[Way | None] = [None for _ in episodes]
    enough = resolution(episodes[0].scenario) - 1
    blocked: list[dict[Rogue, list[tuple[int, np.ndarray]]]] = [{} for _ in episodes]
    for rank in _RANKS:
        tried = [k for k, each in enumerate(rogues) if _is_left(each, rank, longest[k], enough)]
        if not tried:
            continue
        each = [rogues[k][rank] for k in tried]
        known = [blocked[k].setdefault(rogue, []) for k, rogue in zip(tried, each, strict=True)]
        rough = [rough_way(episodes[k], *some) for k, *some in zip(tried, each, known, strict=True)]
        lost = [-1] * len(tried)
        for fineness in _FINENESS:
            left = [j for j, way in enumerate(rough) if way is not None and lost[j] < each[j][1] - enough]
            if not left:
                break
            chosen = [episodes[tried[j]] for j in left], [each[j] for j in left]
            found = ways_near(*chosen, np.array([rough[j] for j in left]), fineness)
            for j, (way, last) in zip(left, found, strict=True):
                lost[j] = max(lost[j], last)
                longest[tried[j]] = max(longest[tried[j]], way, key=_time)
        for places, way, last in zip(known, rough, lost, strict=True):
            if way is not None:
                places.append((last, way[last]))
    return longest


def _time(way: Way | None) -> int:
    """Return the time for which a rogue is undetected, -1 for none [step]."""
    return -1 if way is None else way.unseen_until - way.appears_at


def _is_left(rogues: Sequence[Rogue], rank: int, longest: Way | None, enough: int) -> bool:
    """Return whether a rogue of the stage is longer than the way that is known, by more than enough."""
    if rank >= len(rogues):
        return False
    since, until = rogues[rank]
    return until - since > _time(longest) + (enough if longest is not None else 0)
