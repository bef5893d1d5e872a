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
"""

import math
from dataclasses import dataclass

from lissajous_env.parameters.reaches import Reaches, reaches_of
from lissajous_env.settings.parts import Curve
from lissajous_env.settings.task import Task

TICK_FRACTIONS = 255
"""Number of fractions of a tick."""
HOPS = ((1, 0), (0, 1), (1, 1), (2, 1), (1, 2))
"""Columns and rows of the hops in the first quadrant, one for each length."""
_SHORTEST, _TICKS_MAX = 0.99, 32
"""Least duration of the shortest hop where a tick lasts several steps [tick]; limit on the ticks per step."""
_STRETCH_MAX = 1.5
_COARSE = 2.0
"""Sensing radius up to which it remains as it is, in spacings of the nodes."""
_STILL = Reaches(1, 0.0, (), ())


@dataclass(frozen=True)
class Spreading:
    """Constants of the hops of evading targets on the grid of a scenario."""

    columns: int
    rows: int
    radius: float
    """Radius within which nodes are sensed [m]."""
    ticks: int
    """Ticks per control step."""
    period: int
    """Control steps per tick; `ticks` or this is 1."""
    delays: tuple[int, ...]
    """Duration of each of `HOPS` in whole ticks; empty for targets at rest."""
    shares: tuple[int, ...]
    """Remaining duration of each hop, in `TICK_FRACTIONS` of a tick."""
    reaches: Reaches = _STILL
    """Replacement of hops for `task.conservative`."""

    @property
    def inset(self) -> float:
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

    Raises:
        ValueError: the cells are not square, or are far smaller than the distance that a target moves in a step.
    """
    if task.contamination is None:
        return Spreading(1, 1, 0.0, 1, 1, (), ())
    columns, rows = task.contamination
    sides = 2 * curve.half_width / columns, 2 * curve.half_height / rows
    if max(sides) > _STRETCH_MAX * min(sides):
        rule = f"must make cells whose sides differ by {_STRETCH_MAX} times at most"
        raise ValueError(f"task.contamination {rule}, got {columns} x {rows} of {sides[0]:.3g} m x {sides[1]:.3g} m")
    moved = speed * task.step
    if math.ceil(moved / min(sides)) > _TICKS_MAX:
        rule = f"must make cells of at least 1/{_TICKS_MAX} of an evading target's motion in a step, {moved:.3g} m"
        raise ValueError(f"task.contamination {rule}, got {columns} x {rows} of {min(sides):.3g} m")
    if task.conservative:
        reaches = reaches_of(sides, moved, task.steps)
        return Spreading(columns, rows, radius, 1, reaches.period, (), (), reaches)
    if min(columns, rows) > 1:
        sides = 2 * curve.half_width / (columns - 1), 2 * curve.half_height / (rows - 1)
    shortest = min(sides)
    ticks = math.ceil(moved / shortest)
    if moved * task.steps < shortest:  # no target leaves its cell
        return Spreading(columns, rows, radius, 1, 1, (), ())
    period = max(int(shortest / moved / _SHORTEST), 1)
    takes = [max(math.hypot(i * sides[0], j * sides[1]) / moved * ticks / period, 1.0) for i, j in HOPS]
    delays = tuple(int(time) for time in takes)
    shares = tuple(int((time - whole) * TICK_FRACTIONS) for time, whole in zip(takes, delays, strict=True))
    if radius > _COARSE * max(sides):
        radius = math.hypot(radius, max(sides))
    return Spreading(columns, rows, radius, ticks, period, delays, shares)
