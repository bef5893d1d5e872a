"""The point of the plane curve that is nearest to a place, and a table from which kernels compute its distance.

All in float64 NumPy. The table is a tree of cells. Each cell contains a few arcs of circles that approximate the curve
near the cell; the smallest distance from these circles is the distance from the curve. The curve is symmetric, so the
cells cover only the quarter in which x and y are at least 0.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from lissajous_env.parameters.scenario import Curve
from lissajous_env.world.robots.nearest_point import nearest_arcs
from lissajous_env.world.robots.rough_distance import rough_distances

TOLERANCE = 1e-4
"""Largest error of the table where it is checked, as a share of the smaller half extent of the rectangle."""
EXTENT = 1.25
"""Extent of the innermost grid of cells, in half extents of the rectangle; each grid around it is twice as large."""
GRIDS = 12
"""Grids around the innermost one; a place beyond the last is looked up at its edge."""
SPLIT = 4
"""Parts of a cell in each direction, where it has to be divided."""
AROUND = 8
"""Columns and rows of the grids around the innermost one."""
_MOST_ARCS = 7
_COLUMNS, _MOST_COLUMNS = 40, 64
_MOST_CELLS = 30_000
_DEPTH = 5
_ROUGHNESS = 2e-6
"""Assumed error of rough distances, in lengths of the rectangle; four times the largest one that was measured."""


def rough_search(curve: Curve, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the first guesses of `nearest_arcs` for places (M, 2) [m].

    Returns:
        phases: (4, M), gamma of the points that may be nearest [rad].
        plausible: (4, M), True where they may be.
        distances: (M,), the smallest distance [m].
        errors: (M,), the largest error of the distance [m].
    """
    distances, phases = rough_distances(curve, places)
    least = distances.min(axis=0)
    errors = _ROUGHNESS * np.maximum(least, max(curve.half_width, curve.half_height))
    return phases, distances <= least + 2 * errors, least, errors


# The table.


@dataclass(frozen=True)
class Table:
    """A tree of cells, each with a few arcs of circles that approximate the curve near the cell.

    `nodes[i]` is 16 times the index of a cell's first arc, plus the number of its arcs. If the cell is divided, it is
    negative, and `nodes[-nodes[i]:]` are the parts, row by row.
    """

    nodes: np.ndarray
    """(cells,) int32."""
    arcs: np.ndarray
    """(arcs, 5) a point of the curve [m], the unit normal there, and the curvature against it [1/m]."""
    columns: int
    """Columns of the innermost grid."""
    rows: int
    """Rows of the innermost grid."""


def arc_distance(arcs: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return |g| / (1 + sqrt(1 + k g)) with g = 2 n.e + k e^2: distances of places (..., 2) from arcs (..., 5) [m].

    e is the place less the arc's point; exact for a circle, and for the straight line k = 0.
    """
    across, up, bend = places[..., 0] - arcs[..., 0], places[..., 1] - arcs[..., 1], arcs[..., 4]
    g = 2 * (arcs[..., 2] * across + arcs[..., 3] * up) + bend * (across**2 + up**2)
    return np.abs(g) / (1 + np.sqrt(np.maximum(1 + bend * g, 0)))


@lru_cache(maxsize=32)
def distance_table(half_width: float, half_height: float, a: int, b: int) -> Table:
    """Return the table of a curve (3), refined until it is right to `TOLERANCE` at nine points of every cell."""
    curve = Curve(half_width, half_height, a, b)
    columns, rows = (min(max(4 * n, _COLUMNS), _MOST_COLUMNS) for n in (b, a))
    centres, halves, used = _grids(curve, columns, rows)
    nodes, arcs = np.zeros(len(centres), dtype=np.int64), []
    total = 0
    open_nodes, centres, halves = np.flatnonzero(used), centres[used], halves[used]
    for depth in range(_DEPTH + 1):
        found, chosen, is_right = _arcs_of(curve, centres, halves)
        may_divide = depth < _DEPTH and len(nodes) + SPLIT**2 * np.sum(~is_right) < _MOST_CELLS
        done = is_right if may_divide else np.ones_like(is_right)
        # If no more cells are left, the points represent the curve: circles of no size are never too near.
        found[done & ~is_right, :, 4], chosen[done & ~is_right] = 1e6, True
        counts = chosen[done].sum(axis=1)
        ends = total + np.cumsum(counts)
        nodes[open_nodes[done]] = (ends - counts) * 16 + counts
        arcs.append(found[chosen & done[:, None]])
        total = int(ends[-1]) if len(ends) else total
        if done.all():
            break
        first = len(nodes) + SPLIT**2 * np.arange(np.sum(~done))
        nodes[open_nodes[~done]] = -first
        open_nodes = len(nodes) + np.arange(SPLIT**2 * len(first))
        nodes = np.concatenate([nodes, np.zeros(len(open_nodes), dtype=np.int64)])
        centres, halves = _divided(centres[~done], halves[~done])
    return Table(nodes.astype(np.int32), np.concatenate(arcs).astype(np.float32), columns, rows)


def _grids(curve: Curve, columns: int, rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return centres and half extents (cells, 2) [m], from the innermost grid outwards, and a mask of those in use.

    Cells of a grid that an inner grid covers are not in use.
    """
    extent = EXTENT * np.array([curve.half_width, curve.half_height])
    centres, halves, used = [], [], []
    for grid in range(GRIDS + 1):
        shape = np.array([columns, rows] if grid == 0 else [AROUND, AROUND])
        half = 2.0**grid * extent / (2 * shape)
        centres.append(_odd(*shape.tolist()) * half)
        halves.append(np.broadcast_to(half, centres[-1].shape))
        used.append((centres[-1] > 2.0 ** (grid - 1) * extent).any(axis=1) | (grid == 0))
    return np.concatenate(centres), np.concatenate(halves), np.concatenate(used)


@lru_cache(maxsize=64)
def _odd(columns: int, rows: int) -> np.ndarray:
    """Return the centres (cells, 2) of a grid, from its corner, in half extents of a cell."""
    row, column = np.indices((rows, columns)).reshape(2, -1)
    return 2 * np.stack([column, row], axis=-1) + 1


def _divided(centres: np.ndarray, halves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    offsets = (_odd(SPLIT, SPLIT) - SPLIT) / SPLIT
    parts = centres[:, None] + offsets * halves[:, None]
    return parts.reshape(-1, 2), np.repeat(halves / SPLIT, SPLIT**2, axis=0)


_CHECKED = np.array(
    [(x, y) for x in (0, -1, 1) for y in (0, -1, 1)] + [(x, y) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]
)


def _arcs_of(curve: Curve, centres: np.ndarray, halves: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return arcs (cells, C, 5) near C points of each cell, which of them the cell uses, and where these suffice.

    A cell first uses the arc nearest to its centre, then repeatedly adds that of the point with the largest error. If
    the rough distances show that the first arc is right at every point, the others are not searched.
    """
    lanes = np.array([centres[:, k] + _CHECKED[:, k, None] * halves[:, k] for k in range(2)])
    places, cells = np.moveaxis(lanes, 0, -1), len(centres)
    arcs, chosen = np.zeros((cells, len(_CHECKED), 5)), np.zeros((cells, len(_CHECKED)), dtype=bool)
    chosen[:, 0] = True
    is_right = np.ones(cells, dtype=bool)
    phases, plausible, least, room = (
        each.reshape(*each.shape[:-1], *places.shape[:2]) for each in rough_search(curve, lanes.reshape(2, -1).T)
    )
    arcs[:, 0], _ = nearest_arcs(curve, places[0], phases[:, 0], plausible[:, 0])
    error = np.abs(arc_distance(arcs[:, 0], places) - least) + room
    open_cells = np.flatnonzero((error > _allowed(curve, least - room)).any(axis=0))
    if len(open_cells):
        begin = (each[..., open_cells].swapaxes(1, 2).reshape(4, -1) for each in (phases, plausible))
        there = places[:, open_cells].swapaxes(0, 1)
        found, exact = nearest_arcs(curve, there.reshape(-1, 2), *begin)
        found, exact = found.reshape(len(open_cells), -1, 5), exact.reshape(len(open_cells), -1)
        arcs[open_cells] = found
        chosen[open_cells], is_right[open_cells] = _chosen(curve, there, found, exact)
    return arcs, chosen, is_right


def _allowed(curve: Curve, distances: np.ndarray) -> np.ndarray:
    """Return the largest allowed error of the table at places of these distances from the curve [m]."""
    return TOLERANCE * np.maximum(distances, (curve.half_width * curve.half_height) ** 0.5)


def _chosen(curve: Curve, places: np.ndarray, arcs: np.ndarray, exact: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the arcs of each cell (cells, C), and True where they suffice (cells,), by exact distances [m]."""
    allowed = _allowed(curve, exact)
    chosen = np.zeros(exact.shape, dtype=bool)
    chosen[:, 0] = True
    best = arc_distance(arcs[:, :1], places)
    for _ in range(_MOST_ARCS - 1):
        error = (best - exact) / allowed
        worst = np.argmax(error, axis=1)
        more = np.flatnonzero(error[np.arange(len(error)), worst] > 1)
        if not len(more):
            break
        chosen[more, worst[more]] = True
        best[more] = np.minimum(best[more], arc_distance(arcs[more, worst[more]][:, None], places[more]))
    return chosen, np.all(np.abs(best - exact) <= allowed, axis=1)
