"""Ways of rogues that are undetected for about as long as the contamination stage reports."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import warp as wp

from lissajous_env.episodes.witness.larger import certain_increase, spacing_of, with_larger_discs
from lissajous_env.episodes.witness.played import Played, Way, peaks, resolution
from lissajous_env.episodes.witness.tracing import Rogue, rough_way
from lissajous_env.episodes.witness.tube import ways_near

_RANKS = (0, 0, 0, 1, 1, 2)
"""Rogue of the stage whose way is traced in each attempt, the longest first."""
_LARGER, _RANKS_LARGER = (0.3, 1.0), (0, 0, 1)
"""Increases of the discs [spacing of nodes], and the rogues whose ways are traced with each."""
_FINENESS = (6, 10, 16)
"""Nodes in the distance of a move: near a way, gaps are searched with more of them where fewer find no passage."""
_LABELS = 60_000_000
"""Limit on the labels of the episodes that are searched together, each of which takes 9 bytes more while it is."""


class Longest(NamedTuple):
    """The longest way found in an episode."""

    way: Way | None
    """The way, None if no target can be undetected at the end of any step."""
    resolution: int
    """Time by which the contamination stage may differ from the worst case [step]."""


def longest_ways(episodes: Sequence[Played]) -> list[Longest]:
    """Return the longest way found in each episode.

    The way of the stage's rogue is traced through its labels, and a way near it is searched that no disc detects. Where
    there is none, the place at which the rogue is lost is blocked, and the next way is traced. Where none of these
    lasts as long as the stage reports, the ways of the stage with larger discs are traced, which avoid narrow gaps.

    Args:
        episodes: The episodes, of one scenario.
    """
    found: dict[int, Longest] = {}
    with wp.ScopedDevice("cpu"):
        for steps in {each.steps for each in episodes}:
            places = [k for k, each in enumerate(episodes) if each.steps == steps]
            together = max(_LABELS // episodes[places[0]].labels.size, 1)
            for first in range(0, len(places), together):
                some = places[first : first + together]
                found |= zip(some, _longest_ways([episodes[k] for k in some]), strict=True)
    return [found[k] for k in range(len(episodes))]


def _longest_ways(episodes: Sequence[Played]) -> list[Longest]:
    """Return the ways of episodes of the same length."""
    enough = resolution(episodes[0].scenario)
    longest = _ways_along(episodes, episodes, [None] * len(episodes), _RANKS)
    found = [Longest(way, enough) for way in longest]
    stated = [_stated(each) for each in episodes]

    def is_short(k: int) -> bool:
        """Return whether the way is shorter than the stage reports by more than the time of a cell and a step."""
        return longest[k] is not None and _time(longest[k]) < stated[k] - enough - 1

    short = [k for k in range(len(episodes)) if is_short(k)]
    if not short:
        return found
    spacing, certain = spacing_of(episodes[0]), certain_increase([episodes[k] for k in short])
    for more in (*(share * spacing for share in _LARGER), certain):
        some = [episodes[k] for k in short]
        traced = with_larger_discs(some, more)
        ways = _ways_along(some, traced, [longest[k] for k in short], _RANKS_LARGER)
        for k, way, larger in zip(short, ways, traced, strict=True):
            longest[k] = way
            found[k] = Longest(way, max(stated[k] - _stated(larger), enough) if is_short(k) else enough)
        short = [k for k in short if is_short(k)]
        if not short:
            break
    return found


def _ways_along(
    episodes: Sequence[Played], traced: Sequence[Played], known: Sequence[Way | None], ranks: Sequence[int]
) -> list[Way | None]:
    """Return the longest ways near those of the stage in `traced` that no disc of `episodes` detects.

    Args:
        episodes: The episodes, of the same length.
        traced: The same episodes, with labels of the same discs or of larger ones.
        known: Ways that are known.
        ranks: Rogue of the stage whose way is traced in each attempt, the longest first.
    """
    rogues: list[list[Rogue]] = [peaks(each) for each in traced]
    longest = list(known)
    enough = resolution(episodes[0].scenario) - 1
    blocked: list[dict[Rogue, list[tuple[int, np.ndarray]]]] = [{} for _ in episodes]
    for rank in ranks:
        tried = [k for k, each in enumerate(rogues) if _is_left(each, rank, longest[k], enough)]
        if not tried:
            continue
        each = [rogues[k][rank] for k in tried]
        places = [blocked[k].setdefault(rogue, []) for k, rogue in zip(tried, each, strict=True)]
        rough = [rough_way(traced[k], *some) for k, some in zip(tried, zip(each, places, strict=True), strict=True)]
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
        for block, way, last in zip(places, rough, lost, strict=True):
            if way is not None:
                block.append((last, way[last]))
    return longest


def _stated(played: Played) -> int:
    """Return the worst-case undetected time of the contamination stage [step]."""
    return max((until - since for since, until in peaks(played)), default=0)


def _time(way: Way | None) -> int:
    """Return the time for which a rogue is undetected, -1 for none [step]."""
    return -1 if way is None else way.unseen_until - way.appears_at


def _is_left(rogues: Sequence[Rogue], rank: int, longest: Way | None, enough: int) -> bool:
    """Return whether a rogue of the contamination stage stays undetected for clearly longer than on the known path."""
    if rank >= len(rogues):
        return False
    since, until = rogues[rank]
    return until - since > _time(longest) + (enough if longest is not None else 0)
