"""Ways of rogues that are undetected for about as long as the contamination stage reports."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from lissajous_env.episodes.witness.played import Played, Way, peaks, resolution
from lissajous_env.episodes.witness.tracing import Rogue, rough_ways
from lissajous_env.episodes.witness.tube import ways_near

_TRIED = ((0, 6), (0, 6), (0, 8), (0, 6), (0, 8), (0, 6), (1, 6), (1, 8), (2, 6), (2, 8))
"""Attempts: the index of the stage's rogue, the longest first, and the nodes in the distance of a move."""


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
            found |= zip(places, _longest_ways([episodes[k] for k in places]), strict=True)
    return [found[k] for k in range(len(episodes))]


def _longest_ways(episodes: Sequence[Played]) -> list[Way | None]:
    """Return the ways of episodes of the same length."""
    rogues: list[list[Rogue]] = [peaks(each) for each in episodes]
    longest: list[Way | None] = [None for _ in episodes]
    enough = resolution(episodes[0].scenario) - 1
    blocked: list[dict[Rogue, list[tuple[int, np.ndarray]]]] = [{} for _ in episodes]
    for rank, fineness in _TRIED:
        tried = [k for k, each in enumerate(rogues) if _is_left(each, rank, longest[k], enough)]
        if not tried:
            continue
        each = [rogues[k][rank] for k in tried]
        known = [blocked[k].setdefault(rogue, []) for k, rogue in zip(tried, each, strict=True)]
        rough = rough_ways([episodes[k] for k in tried], each, known)
        there = [(j, way) for j, way in enumerate(rough) if way is not None]
        if not there:
            continue
        chosen = [episodes[tried[j]] for j, _ in there], [each[j] for j, _ in there]
        found = ways_near(*chosen, np.array([way for _, way in there]), fineness)
        for (j, near), (way, lost) in zip(there, found, strict=True):
            known[j].append((lost, near[lost]))
            longest[tried[j]] = max(longest[tried[j]], way, key=_time)
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
