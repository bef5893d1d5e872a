"""Worst-case undetected time of evading targets while robots move ideally, on a coarse grid.

A short computation on the CPU, for policies that compare many motions before an episode: each cell has the earliest
time at which a target that may be there now, undetected, can have appeared. A cell within a sensing disc contains none,
and targets hop to neighbouring cells once they can have driven as far. The hops go to the four and to the eight nearest
cells in turn, so that the reached octagon differs from a disc by 6 % at most. Scores use the finer contamination field
of the simulation (`lissajous_env.world.contamination.field`).
"""

import math

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import compile_quietly

wp.set_module_options(OPTIONS)

_MOST_CELLS = 3000
_CELLS_IN_RADIUS = 7
_ROUNDS = 4
_NONE = 2**32 - 1
"""Introduction of a cell without undetected targets; all bits are 1, also in the masks of detected cells."""


@wp.kernel
def cover(
    square: wp.float64,
    x_squares: wp.array3d(dtype=wp.float64),
    x_squares_max: wp.array3d(dtype=wp.float64),
    sensed_out: wp.array3d(dtype=int),
):
    """Write -1 for the cells within a disc at each time, and for the column beyond the last one.

    `square` is that of the radius, `x_squares` (N, K, columns) are those of distances along x, and `x_squares_max`
    (N, K, rows) the largest of them in a disc.
    """
    k = wp.tid()
    columns = x_squares.shape[2]
    for row in range(x_squares_max.shape[2]):
        sensed_out[k, row, columns] = -1
    for robot in range(x_squares.shape[0]):
        first = int(columns)
        end = int(0)
        for column in range(columns):
            if x_squares[robot, k, column] < square:
                first = wp.min(first, column)
                end = column + 1
        for row in range(x_squares_max.shape[2]):
            most = x_squares_max[robot, k, row]
            if most > wp.float64(0.0):
                for column in range(first, end):
                    if x_squares[robot, k, column] < most:
                        sensed_out[k, row, column] = -1


@wp.kernel
def longest_gaps(sensed: wp.array3d(dtype=int), visits: wp.array3d(dtype=int), gap_out: wp.array2d(dtype=int)):
    """Write the longest time between two visits of each cell of a row, in which the period repeats; -1 without a visit.

    `visits` (rows, 2, columns) is working memory: times of the first and of the latest visit.
    """
    row = wp.tid()
    period = sensed.shape[0]
    for column in range(gap_out.shape[1]):
        gap_out[row, column] = -1
    for k in range(period):
        for column in range(gap_out.shape[1]):
            if sensed[k, row, column] != 0:
                if gap_out[row, column] < 0:
                    visits[row, 0, column] = k
                    gap_out[row, column] = 0
                else:
                    gap_out[row, column] = wp.max(gap_out[row, column], k - visits[row, 1, column] - 1)
                visits[row, 1, column] = k
    for column in range(gap_out.shape[1]):
        if gap_out[row, column] >= 0:
            around = visits[row, 0, column] + period - visits[row, 1, column] - 1
            gap_out[row, column] = wp.max(gap_out[row, column], around)


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
        Infinity if the time exceeds `limit`, or if a target of the start is still undetected after four periods.
    """
    field = _Field(half, radius, speed * step)
    sensed = field.masks(loop)
    before = sensed[:0] if lead_in is None else field.masks(lead_in)
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
    field = _Field(half, radius, 0.0, field_cells=_MOST_CELLS // (4 if coarse else 1))
    every = 2 if coarse else 1
    rows, columns = len(field.y), len(field.x)
    gaps = wp.empty((rows, columns), dtype=int, device="cpu")
    visits = wp.empty((rows, 2, columns), dtype=int, device="cpu")
    wp.launch(longest_gaps, rows, [field.sensed(loop[:, ::every]), visits], [gaps], device="cpu")
    visited = gaps.numpy()[gaps.numpy() >= 0]
    return 1 - visited.size / gaps.size, float(visited.max(initial=0) * every)


class _Field:
    """Earliest introduction of an undetected target in each cell [control step].

    The cells are in one row, with a cell without targets between two rows of the grid.
    """

    def __init__(self, half: tuple[float, float], radius: float, moved: float, field_cells: int = _MOST_CELLS):
        finer = math.sqrt(field_cells / _MOST_CELLS)
        side = max(radius / _CELLS_IN_RADIUS / finer, 2 * math.sqrt(half[0] * half[1] / field_cells))
        columns, rows = (max(round(2 * length / side), 1) + 1 for length in half)
        # The outermost nodes lie on the edges, so that the corners count, which discs are the last to cover.
        self.x = np.linspace(-half[0], half[0], columns)
        self.y = np.linspace(-half[1], half[1], rows)
        self.radius, self.rate = radius, moved / (2 * half[0] / (columns - 1))
        self.between = np.zeros((rows, columns + 1), dtype=np.uint32)
        self.between[:, columns] = _NONE
        self.between = self.between.ravel()
        self.introduced = self.between.copy()
        self.now, self.hops, self.longest = 0, 0, 0
        self.cleared_at = 0  # step from which on no target of the start can be undetected

    def sensed(self, places: np.ndarray) -> wp.array:
        """Return the masks (K, rows, columns + 1) of the cells whose centres are in a disc.

        Args:
            places: (N, K, 2) places of the robots at K times [m].
        """
        x_squares = (self.x - places[..., :1]) ** 2
        x_squares_max = self.radius**2 - (self.y - places[..., 1:]) ** 2
        with compile_quietly():
            given = [wp.array(of, dtype=wp.float64, device="cpu", copy=False) for of in (x_squares, x_squares_max)]
            sensed = wp.zeros((places.shape[1], len(self.y), len(self.x) + 1), dtype=int, device="cpu")
            wp.launch(cover, sensed.shape[0], [self.radius**2, *given], [sensed], device="cpu")
        return sensed

    def masks(self, places: np.ndarray) -> np.ndarray:
        """Return the masks of `sensed`, those of a time in one row (K, rows (columns + 1))."""
        return self.sensed(places).numpy().view(np.uint32).reshape(places.shape[1], -1)

    def advance(self, sensed: np.ndarray) -> None:
        """Let targets hop and be introduced, and be detected in the cells of a mask, over a control step."""
        self.now += 1
        while self.hops < math.floor(self.rate * self.now):
            self.hops += 1
            self._hop(diagonally=self.hops % 2 == 0)
        np.minimum(self.introduced, np.uint32(self.now), out=self.introduced)
        np.bitwise_or(self.introduced, sensed, out=self.introduced)
        oldest = int(self.introduced.min())
        self.longest = max(self.longest, self.now - oldest if oldest < _NONE else 0)
        if self.cleared_at == 0 and oldest > 0:
            self.cleared_at = self.now

    def _hop(self, diagonally: bool) -> None:
        introduced, row = self.introduced, len(self.x) + 1
        sideways = introduced.copy()
        np.minimum(sideways[1:], introduced[:-1], out=sideways[1:])
        np.minimum(sideways[:-1], introduced[1:], out=sideways[:-1])
        spread = sideways if diagonally else introduced
        after = sideways.copy()
        np.minimum(after[row:], spread[:-row], out=after[row:])
        np.minimum(after[:-row], spread[row:], out=after[:-row])
        self.introduced = np.bitwise_or(after, self.between, out=after)
