"""How far a rogue can have come, in cells: what `task.conservative` is made of.

Labels L[n, c] are on the safe side when every rogue that is unseen until step n and in cell c then was introduced at
L[n, c] or later. They stay so where L[n, c'] is not above the least L[n - k, c] of all cells c from which a rogue comes
to c' within k steps: those whose least distance from c' is at most k v dt, v the speed limit. That holds for every lag
k, so the largest of these bounds holds as well: `lissajous_env.world.contamination.conservative` takes it, and has the
proof.

Short lags see where sensors were a moment ago, long ones how slow a rogue is: what is reached in k v dt sticks out by
less than a cell and its diagonal. Lags are chosen so that k v dt is just below a whole number of cells, as it then
sticks out by nothing along the axes.
"""

import math
from dataclasses import dataclass

_CELLS = (1, 2, 4, 8, 16, 24)
"""Below how many cells the way of a rogue is kept, of each lag but the first."""
_SHARE = 0.5
"""Of a cell, what a rogue passes in a tick at most where that is several control steps."""
_ROUNDING = 1e-6
"""By what a rogue is made faster, for numbers of 32 bits."""


@dataclass(frozen=True)
class Reaches:
    """Cells that a rogue can have come from, for some times that have passed.

    Labels are kept of each tick, one or several control steps; within a tick they stay where they are, and what they
    stand for spreads around their cell.
    """

    period: int
    """Control steps in a tick."""
    moved: float
    """What a rogue passes in a control step [m]."""
    lags: tuple[int, ...]
    """Ticks that have passed, from 1 on."""
    widths: tuple[tuple[int, ...], ...]
    """For each of the lags, by rows up or down: how many columns to either side a rogue can have come from."""


def reaches_of(sides: tuple[float, float], moved: float, steps: int) -> Reaches:
    """Reaches on cells of these sides [m], of rogues that pass `moved` [m] in one of the `steps` of an episode."""
    moved *= 1 + _ROUNDING
    share = moved / min(sides)
    period = min(max(int(_SHARE / share), 1), steps + 1) if share > 0 else steps + 1
    share *= period
    lags = sorted({1} | {math.ceil(cells / share) - 1 for cells in _CELLS if cells > share > 0})
    lags = [lag for lag in lags if (lag - 1) * period <= steps]
    return Reaches(period, moved, tuple(lags), tuple(_widths(sides, lag * period * moved) for lag in lags))


def _widths(sides: tuple[float, float], way: float) -> tuple[int, ...]:
    """Columns to either side, for 0, 1, 2 ... rows up or down, of cells whose least distance is at most `way` [m]."""
    up = [max(row - 1, 0) * sides[1] for row in range(int(way / sides[1]) + 2)]
    return tuple(int(math.sqrt(max(way**2 - height**2, 0.0)) / sides[0]) + 1 for height in up)
