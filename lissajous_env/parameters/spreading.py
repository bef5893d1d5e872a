"""The spreading of contamination over a grid: the hops of an evading target between cells, and their durations.

Each cell has a node, and the target hops between nodes that are a move of a chess king or knight apart, at its speed
limit. On a square grid such a path is at most 2.7 % longer than the straight line, so the target is too slow by at most
that much. The outermost nodes lie on the edges of the rectangle, because targets can: a corner that discs leave free
may be smaller than half a cell. Nodes are therefore a little farther apart than centres of cells.

A hop to the next node must not pass over a place that a disc covers thinly, as where it only just reaches a wall. The
nodes are therefore sensed within a radius of sqrt(r^2 + s^2) instead of r, where s is their spacing: the two nodes on
both sides of a place that a disc touches are then within it. This is larger by s^2 / 2 r at most, 1 mm on `evaders`.
Where r is not even 2 s, no disc is so wide that it could clear an area, and r remains.

The duration of a hop is not a whole number of control steps. It is counted in ticks (several per step for a target
that passes more than a cell in one step, one per several steps for a slow target), and the remainder is carried along
as a fraction of a tick, so that rounding does not accumulate. A target introduced between two ticks counts from the
earlier one, which is early by less than the time for one cell.

For `task.conservative`, cells from which an evading target can have come replace the hops. Labels L[n, c] are
conservative if every target that is undetected until step n and then in cell c was introduced at L[n, c] or later. They
remain so if L[n, c'] does not exceed the least L[n - k, c] of all cells c from which a target reaches c' within k
steps: those whose least distance from c' is at most k v dt, v being the speed limit. This is true for every lag k,
hence also for the largest of the bounds. `lissajous_env.world.contamination.conservative` uses it and proves it.

Short lags account for recent positions of sensors, long lags for the speed limit: rounding to cells enlarges the
reachable set by less than a cell and its diagonal. With k v dt just below a whole number of cells, as chosen here, it
is not enlarged along the axes.
"""

import math
from dataclasses import dataclass

from lissajous_env.settings.parts import Curve
from lissajous_env.settings.task import Task

TICK_FRACTIONS = 255
"""Number of fractions of a tick."""
HOPS = ((1, 0), (0, 1), (1, 1), (2, 1), (1, 2))
"""Columns and rows of the hops in the first quadrant, one for each length."""
TICKS_MAX = 32
"""Limit on the ticks per step."""
_SHORTEST = 0.99
"""Least duration of the shortest hop where a tick lasts several steps [tick]."""
_COARSE = 2.0
"""Sensing radius up to which it remains as it is, in spacings of the nodes."""
_CELLS = (1, 2, 4, 8, 16, 24)
"""Limits on the distance of each lag but the first [cell]."""
_CELLS_PER_TICK = 0.5
"""Largest distance of a target in a tick of several control steps [cell]."""
_ROUNDING = 1e-6, 2.0**-23
"""Shares of its displacement and coordinates by which rounding to 32 bits may move a target farther in each step."""


@dataclass(frozen=True)
class Reaches:
    """Cells from which an evading target can have come, for several lags.

    Labels are stored for each tick of one or several control steps and do not change within it.
    """

    period: int = 1
    """Control steps per tick."""
    moved: float = 0.0
    """Largest distance of a target in a control step [m]."""
    lags: tuple[int, ...] = ()
    """Lags, from 1 on [tick]."""
    widths: tuple[tuple[int, ...], ...] = ()
    """Reachable columns to either side, for each lag and each number of rows up or down."""


@dataclass(frozen=True)
class Spreading:
    """Constants of the hops of evading targets on the grid of a scenario, by default of one cell and none."""

    columns: int = 1
    rows: int = 1
    radius: float = 0.0
    """Radius within which nodes are sensed [m]."""
    ticks: int = 1
    """Ticks per control step."""
    period: int = 1
    """Control steps per tick; `ticks` or this is 1."""
    delays: tuple[int, ...] = ()
    """Duration of each of `HOPS` in whole ticks; empty for targets at rest."""
    shares: tuple[int, ...] = ()
    """Remaining duration of each hop, in `TICK_FRACTIONS` of a tick."""
    reaches: Reaches = Reaches()
    """Replacement of hops for `task.conservative`."""

    @property
    def edge_gap(self) -> float:
        """Distance of the outermost nodes from the edges [cell]; one row or column of nodes is in the middle."""
        return 0.0 if min(self.columns, self.rows) > 1 else 0.5

    @property
    def history_length(self) -> int:
        """Number of past ticks whose labels are stored."""
        return max(self.reaches.lags, default=max(self.delays, default=0) + 1) + 1


def spreading_of(curve: Curve, task: Task, radius: float, speed: float) -> Spreading:
    """Return the hops for `task.contamination`.

    Args:
        curve: Curve, which defines the rectangle.
        task: Grid and control step.
        radius: Sensing radius of the robots [m].
        speed: Speed limit of evading targets [m/s].
    """
    if task.contamination is None:
        return Spreading()
    columns, rows = task.contamination
    gaps = 1 if min(columns, rows) > 1 and not task.conservative else 0  # between nodes: one less than nodes
    sides = 2 * curve.half_width / (columns - gaps), 2 * curve.half_height / (rows - gaps)
    moved, shortest = speed * task.step, min(sides)
    if task.conservative:
        rounding = _ROUNDING[0] * moved + _ROUNDING[1] * (curve.half_width + curve.half_height)
        reaches = reaches_of(sides, moved + min(rounding, moved), task.steps)
        return Spreading(columns, rows, radius, period=reaches.period, reaches=reaches)
    if moved * task.steps < shortest:  # no target leaves its cell
        return Spreading(columns, rows, radius)
    ticks = math.ceil(moved / shortest)
    period = max(int(shortest / moved / _SHORTEST), 1)
    takes = [max(math.hypot(i * sides[0], j * sides[1]) / moved * ticks / period, 1.0) for i, j in HOPS]
    delays = tuple(int(time) for time in takes)
    shares = tuple(int((time - whole) * TICK_FRACTIONS) for time, whole in zip(takes, delays, strict=True))
    if radius > _COARSE * max(sides):
        radius = math.hypot(radius, max(sides))
    return Spreading(columns, rows, radius, ticks, period, delays, shares)


def reaches_of(sides: tuple[float, float], moved: float, steps: int) -> Reaches:
    """Return the reaches for cells with these sides [m] and targets that move at most `moved` [m] per control step."""
    per_step = moved / min(sides)  # [cell]
    period = min(max(int(_CELLS_PER_TICK / per_step), 1), steps + 1) if per_step > 0 else steps + 1
    per_tick = period * per_step
    lags = sorted({1} | {math.ceil(cells / per_tick) - 1 for cells in _CELLS if cells > per_tick > 0})
    lags = [lag for lag in lags if (lag - 1) * period <= steps]
    return Reaches(period, moved, tuple(lags), tuple(_widths(sides, lag * period * moved) for lag in lags))


def _widths(sides: tuple[float, float], distance: float) -> tuple[int, ...]:
    """Return, for 0, 1, 2 ... rows up or down, the columns to either side of the cells nearer than a distance [m]."""
    up = [max(row - 1, 0) * sides[1] for row in range(int(distance / sides[1]) + 2)]
    return tuple(int(math.sqrt(max(distance**2 - height**2, 0.0)) / sides[0]) + 1 for height in up)
