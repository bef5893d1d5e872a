"""How contamination spreads over a grid: the hops of a rogue between cells, and the time that each takes.

A rogue hops from the centre of a cell to that of one of the sixteen around it that are a move of a chess king or knight
away, when it has been there for as long as its speed asks for. Straight ways between centres are at most 2.7 % longer
by such hops than they are (cells that are square), so a rogue of the grid is slower by that at worst.

What a hop takes is no whole number of control steps. It is counted in ticks: several in a step where a rogue passes
more than a cell in one, one in several steps where it needs many for a cell; and what is left over is carried along as
a share of a tick, so that no hop is late because the one before it ended between two ticks. A rogue that is introduced
between two ticks counts from the one before: it is early, by less than it needs for a cell.
"""

import math
from dataclasses import dataclass

from lissajous_env.parameters.parts import Curve, Task
from lissajous_env.parameters.reaches import Reaches, reaches_of

TICK_FRACTIONS = 255
"""Into how many a tick is divided."""
HOPS = ((1, 0), (0, 1), (1, 1), (2, 1), (1, 2))
"""Columns and rows of the hops in the first quadrant, one for each length that there is."""
_SHORTEST, _TICKS_MAX = 0.99, 32
"""Ticks that the shortest hop takes at least where a tick is several steps, or close to it; most ticks of a step."""
_STRETCH_MAX = 1.5
_STILL = Reaches(1, 0.0, (), ())


@dataclass(frozen=True)
class Spreading:
    """Hops of the rogues of a scenario on its grid."""

    columns: int
    rows: int
    radius: float
    """Radius of the robots' sensors [m]."""
    ticks: int
    """Ticks in a control step."""
    period: int
    """Control steps in a tick; one of the two is 1."""
    delays: tuple[int, ...]
    """Whole ticks that each of `HOPS` takes; empty where rogues stand still."""
    shares: tuple[int, ...]
    """What it takes beyond them, in `TICK_FRACTIONS` of a tick."""
    reaches: Reaches = _STILL
    """What takes the place of hops for `task.conservative`."""

    @property
    def history_length(self) -> int:
        """Ticks for which labels are kept."""
        return max(self.reaches.lags, default=max(self.delays, default=0) + 1) + 1


def spreading_of(curve: Curve, task: Task, radius: float, speed: float) -> Spreading:
    """Hops for `task.contamination`.

    Args:
        curve: With it the rectangle.
        task: Grid and control step.
        radius: Of the robots' sensors [m].
        speed: That no rogue is above [m/s].

    Raises:
        ValueError: cells that are no squares, or far smaller than what a rogue moves in a step.
    """
    if task.contamination is None:
        return Spreading(1, 1, 0.0, 1, 1, (), ())
    columns, rows = task.contamination
    sides = 2 * curve.half_width / columns, 2 * curve.half_height / rows
    shortest = min(sides)
    if max(sides) > _STRETCH_MAX * shortest:
        rule = f"must make cells whose sides differ by {_STRETCH_MAX} times at most"
        raise ValueError(f"task.contamination {rule}, got {columns} x {rows} of {sides[0]:.3g} m x {sides[1]:.3g} m")
    moved = speed * task.step
    ticks = math.ceil(moved / shortest)
    if ticks > _TICKS_MAX:
        rule = f"must make cells of at least 1/{_TICKS_MAX} of what a rogue moves in a step, {moved:.3g} m"
        raise ValueError(f"task.contamination {rule}, got {columns} x {rows} of {shortest:.3g} m")
    if task.conservative:
        reaches = reaches_of(sides, moved, task.steps)
        return Spreading(columns, rows, radius, 1, reaches.period, (), (), reaches)
    if moved * task.steps < shortest:  # no rogue leaves its cell
        return Spreading(columns, rows, radius, 1, 1, (), ())
    period = max(int(shortest / moved / _SHORTEST), 1)
    takes = [max(math.hypot(i * sides[0], j * sides[1]) / moved * ticks / period, 1.0) for i, j in HOPS]
    delays = tuple(int(time) for time in takes)
    shares = tuple(int((time - whole) * TICK_FRACTIONS) for time, whole in zip(takes, delays, strict=True))
    return Spreading(columns, rows, radius, ticks, period, delays, shares)
