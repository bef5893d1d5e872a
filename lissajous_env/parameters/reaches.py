"""Cells that an evading target can reach, for `task.conservative`.

Labels L[n, c] are conservative if every target that is undetected until step n and then in cell c was introduced at
L[n, c] or later. They remain so if L[n, c'] does not exceed the least L[n - k, c] of all cells c from which a target
reaches c' within k steps: those whose least distance from c' is at most k v dt, v being the speed limit. This is true
for every lag k, hence also for the largest of the bounds. `lissajous_env.world.contamination.conservative` uses it and
proves it.

Short lags account for recent positions of sensors, long lags for the speed limit: rounding to cells enlarges the
reachable set by less than a cell and its diagonal. With k v dt just below a whole number of cells, as chosen here, it
is not enlarged along the axes.
"""

import math
from dataclasses import dataclass

_CELLS = (1, 2, 4, 8, 16, 24)
"""Limits on the distance of each lag but the first [cell]."""
_SHARE = 0.5
"""Largest distance of a target in a tick of several control steps [cell]."""
_ROUNDING = 1e-6
"""Relative increase of the speed limit that covers rounding to 32 bits."""


@dataclass(frozen=True)
class Reaches:
    """Cells from which an evading target can have come, for several lags.

    Labels are stored for each tick of one or several control steps and do not change within it.
    """

    period: int
    """Control steps per tick."""
    moved: float
    """Largest distance of a target in a control step [m]."""
    lags: tuple[int, ...]
    """Lags, from 1 on [tick]."""
    widths: tuple[tuple[int, ...], ...]
    """Reachable columns to either side, for each lag and each number of rows up or down."""


def reaches_of(sides: tuple[float, float], moved: float, steps: int) -> Reaches:
    """Return the reaches for cells with these sides [m] and targets that move at most `moved` [m] per control step."""
    moved *= 1 + _ROUNDING
    share = moved / min(sides)
    period = min(max(int(_SHARE / share), 1), steps + 1) if share > 0 else steps + 1
    share *= period
    lags = sorted({1} | {math.ceil(cells / share) - 1 for cells in _CELLS if cells > share > 0})
    lags = [lag for lag in lags if (lag - 1) * period <= steps]
    return Reaches(period, moved, tuple(lags), tuple(_widths(sides, lag * period * moved) for lag in lags))


def _widths(sides: tuple[float, float], distance: float) -> tuple[int, ...]:
    """Return, for 0, 1, 2 ... rows up or down, the columns to either side of cells within a least distance [m]."""
    up = [max(row - 1, 0) * sides[1] for row in range(int(distance / sides[1]) + 2)]
    return tuple(int(math.sqrt(max(distance**2 - height**2, 0.0)) / sides[0]) + 1 for height in up)
