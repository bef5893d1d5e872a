"""Worst-case undetected time of evading targets while robots move ideally, on a coarse grid.

A short computation on the CPU, for policies that compare many motions before an episode: each cell has the earliest
time at which a target that may be there now, undetected, can have appeared. A cell within a sensing disc contains none,
and targets hop to neighbouring cells once they can have driven as far. The hops go to the four and to the eight nearest
cells in turn, so that the reached octagon differs from a disc by 6 % at most. Scores use the finer contamination field
of the simulation (`lissajous_env.world.contamination.field`).
"""

import math

import numpy as np

from lissajous_env.device.discs import in_discs

_MOST_CELLS = 3000
_CELLS_IN_RADIUS = 7
_ROUNDS = 4
"""Periods of the loops that are simulated."""
_NONE = np.uint32(2**32 - 1)
"""Introduction of a cell without undetected targets."""


def worst_undetected_time(
    loop: np.ndarray,
    half: tuple[float, float],
    radius: float,
    speed: float,
    step: float,
    limit: float = math.inf,
    lead_in: np.ndarray | None = None,
) -> float:
    """Return the longest time for which a target can stay undetected while robots go around their loops [s].

    Args:
        loop: (N, K, 2) places of the robots at each control step of a period [m].
        half: Half width and half height of the rectangle [m].
        radius: Sensing radius [m].
        speed: Largest speed of a target [m/s].
        step: Control step [s].
        limit: Time from which on the result does not matter [s].
        lead_in: (N, L, 2) places before the loops, during which targets are undetected too [m].

    Returns:
        Infinity above `limit`, or if a target of the start is still undetected after `_ROUNDS` - 2 periods.
    """
    field = _Field(half, radius, speed * step)
    sensed = field.sensed(loop)
    before = sensed[:0] if lead_in is None else field.sensed(lead_in)
    for now in before:
        field.advance(now)
    first = 1 if lead_in is None else 0  # the place at the start is not sensed
    for k in range(first, _ROUNDS * len(sensed) + 1):
        field.advance(sensed[k % len(sensed)])
        if field.longest * step > limit:
            return math.inf
        # Once all targets of the start are detected, two more periods show the longest time for which others can hide.
        if field.cleared_at > 0 and field.now >= max(field.cleared_at, len(before)) + 2 * len(sensed):
            return field.longest * step
    return math.inf


def unvisited_and_gap(
    loop: np.ndarray, half: tuple[float, float], radius: float, coarse: bool = False
) -> tuple[float, float]:
    """Return the share of places that are never visited, and the longest time between two visits [control steps].

    Args:
        loop: (N, K, 2) places of the robots at each control step of a period [m].
        half: Half width and half height of the rectangle [m].
        radius: Sensing radius [m].
        coarse: True to test only a quarter of the places, at every second control step.
    """
    every = 2 if coarse else 1
    field = _Field(half, radius, 0.0, every)
    sensed = field.sensed(loop[:, ::every])
    visited = sensed.any(axis=0)
    age = gap = np.zeros(visited.shape, dtype=np.int32)
    for unseen in [*~sensed, *~sensed]:
        age = (age + 1) * unseen
        gap = np.maximum(gap, age)
    return 1 - float(visited.mean()), float(gap[visited].max(initial=0) * every)


class _Field:
    """Earliest introduction of an undetected target in each cell (rows, columns) [control step]."""

    def __init__(self, half: tuple[float, float], radius: float, moved: float, coarseness: int = 1):
        side = coarseness * max(radius / _CELLS_IN_RADIUS, 2 * math.sqrt(half[0] * half[1] / _MOST_CELLS))
        columns, rows = (max(round(2 * length / side), 1) + 1 for length in half)
        # The outermost nodes lie on the edges, so that the corners count, which discs are the last to cover.
        self.x = np.linspace(-half[0], half[0], columns)
        self.y = np.linspace(-half[1], half[1], rows)
        self.radius, self.rate = radius, moved / (2 * half[0] / (columns - 1))  # [m], [cells per control step]
        self.introduced = np.zeros((rows, columns), dtype=np.uint32)
        self.now, self.hops, self.longest = 0, 0, 0
        self.cleared_at = 0  # step from which on no target of the start can be undetected

    def sensed(self, places: np.ndarray) -> np.ndarray:
        """Return True for the cells (K, rows, columns) whose centres are in a disc at K times, for places (N, K, 2)."""
        return in_discs(self.x, self.y, places, self.radius)

    def advance(self, sensed: np.ndarray) -> None:
        """Let targets hop and be introduced, and be detected in some cells, over a control step."""
        self.now += 1
        while self.hops < math.floor(self.rate * self.now):
            self.hops += 1
            self._hop(diagonally=self.hops % 2 == 0)
        np.minimum(self.introduced, np.uint32(self.now), out=self.introduced)
        np.putmask(self.introduced, sensed, _NONE)
        oldest = int(self.introduced.min())
        self.longest = max(self.longest, self.now - oldest if oldest < _NONE else 0)
        if self.cleared_at == 0 and oldest > 0:
            self.cleared_at = self.now

    def _hop(self, diagonally: bool) -> None:
        before, after = self.introduced, self.introduced.copy()
        np.minimum(after[:, 1:], before[:, :-1], out=after[:, 1:])
        np.minimum(after[:, :-1], before[:, 1:], out=after[:, :-1])
        before = after.copy() if diagonally else before
        np.minimum(after[1:], before[:-1], out=after[1:])
        np.minimum(after[:-1], before[1:], out=after[:-1])
        self.introduced = after
