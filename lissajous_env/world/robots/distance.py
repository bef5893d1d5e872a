"""Distance of a place from the whole plane curve on the device, by the table of `distance_table.py`.

A robot's own parameter only ever moves along its branch; the nearest point of the curve may lie on any other. Here a
cell holds the few circles that the curve is around the points nearest to it, and the smallest distance from these is
the distance from the curve: a root and a division each, where a search would cost a hundred times as much.

On random places the error is at most 2e-4 m on the experiment, 5e-4 m on `intruders` and 1e-3 m with a, b = 7, 8 in
10 m x 10 m; around the rectangle twice as much, far from it 1e-3 of the distance. On curves so dense or rectangles so
narrow that the table would grow beyond its limit, it is below the size of a cell.

A curve of harmonics has another table, of grids around the curve itself, wherever it lies in its rectangle: each cell
holds the parameters of the few points of the curve that are nearest to places in it, and from each of these Newton's
steps lead to the nearest point. On rough random curves the error is at most a hundredth of the curve's extent.
"""

from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.abreast import ABREAST, Floats, Ints, width
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct, newton, series_around
from lissajous_env.settings.parts import Curve
from lissajous_env.theory.closed_forms import curve_point
from lissajous_env.world.robots.distance_table import AROUND, EXTENT, GRIDS, SPLIT, distance_table

wp.set_module_options(OPTIONS)

Arc = wp.types.vector(length=5, dtype=wp.float32)

_CELLS, _LEVELS = 128, 5
"""Columns and rows of each grid around a curve of harmonics; how many grids, each twice as large as the one before."""
_SEEDS = wp.constant(6)
"""Points of the curve that a cell has at most."""
_APART = 0.3
"""Their smallest distance along the curve, in diagonals of a cell."""
_STEPS = wp.constant(6)
"""Most steps of Newton's from each."""
_CLOSE = wp.constant(1e-3)
"""Step after which there is no further one, as a share of the largest."""
_FLATTEST = 0.1
"""Extent of the first grid across a flat curve, in that along it."""
_LARGEST_STEP = 0.5
"""Largest of Newton's steps, in radians of the highest harmonic."""

_SPLIT = wp.constant(SPLIT)
_AROUND = wp.constant(AROUND)
_GRIDS = wp.constant(GRIDS)


@wp.struct
class DistanceTable:
    """`lissajous_env.world.robots.distance_table.Table` on a device; without nodes, every distance is 0."""

    nodes: wp.array(dtype=wp.int32)
    arcs: wp.array(dtype=Arc)
    columns: wp.int32
    rows: wp.int32
    per_width: wp.float32
    """1 over the half width of the innermost grid [1/m]."""
    per_height: wp.float32
    """1 over the half height of the innermost grid [1/m]."""
    centre: wp.vec2
    """Centre of the grids around a curve of harmonics [m]."""
    seeds: wp.array4d(dtype=wp.float32)
    """(grids, rows, columns, points) for each cell of these, parameters of nearest points [rad], then -1."""
    largest_step: wp.float32
    """Largest of Newton's steps from these [rad]."""


@wp.func
def distance_from_seeds(table: DistanceTable, curve: CurveStruct, place: wp.vec2) -> float:
    """Distance of a place from a curve of harmonics [m]: that of the nearest point on the way of Newton's steps."""
    cells = table.seeds.shape[1]
    x = (place[0] - table.centre[0]) * table.per_width
    y = (place[1] - table.centre[1]) * table.per_height
    level = int(0)
    while level < table.seeds.shape[0] - 1 and wp.max(wp.abs(x), wp.abs(y)) > 1.0:
        x *= 0.5
        y *= 0.5
        level += 1
    outside = wp.max(wp.max(wp.abs(x), wp.abs(y)), 1.0)  # beyond the last grid, the cell in the same direction
    column = wp.min(int(0.5 * (x / outside + 1.0) * float(cells)), cells - 1)
    row = wp.min(int(0.5 * (y / outside + 1.0) * float(cells)), cells - 1)
    least = float(1.0e30)
    for k in range(_SEEDS):
        gamma = table.seeds[level, row, column, k]
        left = wp.where(gamma < 0.0, 0, _STEPS + 1)
        while left > 0:
            nearest, tangent, bend = series_around(curve, gamma)
            away = place - nearest
            least = wp.min(least, wp.length(away))
            further = newton(away, tangent, bend, gamma, table.largest_step)
            left = wp.where(wp.abs(further - gamma) < _CLOSE * table.largest_step, wp.min(left - 1, 1), left - 1)
            gamma = further
    return least


@wp.func
def cell_at(table: DistanceTable, x: float, y: float) -> tuple[int, float, float]:
    """Cell in which a place lies, x, y >= 0 [m], and where in it, from 0 to 1 along its width and its height."""
    across = x * table.per_width
    up = y * table.per_height
    # How often the place is halved until it is within the innermost grid; the grid around that is the first, and so on.
    exponent = (wp.cast(wp.max(across, up), wp.int32) - 1) >> 23
    level = wp.clamp(exponent - 126, 0, _GRIDS)
    power = wp.cast((127 - level) << 23, wp.float32)
    columns = wp.where(level > 0, _AROUND, table.columns)
    rows = wp.where(level > 0, _AROUND, table.rows)
    before = wp.where(level > 0, table.columns * table.rows + (level - 1) * _AROUND * _AROUND, 0)
    across = wp.min(across * power, 1.0) * float(columns)
    up = wp.min(up * power, 1.0) * float(rows)
    column = wp.min(int(across), columns - 1)
    row = wp.min(int(up), rows - 1)
    return before + row * columns + column, across - float(column), up - float(row)


@wp.func
def leaf(table: DistanceTable, start: int, across: float, up: float) -> int:
    """Node of a place in a node: 16 times the first arc of the part in which it lies, and how many that has."""
    node = int(start)
    while node < 0:
        across *= float(_SPLIT)
        up *= float(_SPLIT)
        column = wp.min(int(across), _SPLIT - 1)
        row = wp.min(int(up), _SPLIT - 1)
        node = table.nodes[row * _SPLIT + column - node]
        across -= float(column)
        up -= float(row)
    return node


@wp.func
def arc_distance(across: float, up: float, normal_x: float, normal_y: float, bend: float) -> float:
    """Distance from a circle [m] that passes a point with a unit normal and a bend [1/m], of a place so far from it."""
    g = 2.0 * (normal_x * across + normal_y * up) + bend * (across * across + up * up)
    return wp.abs(g) / (1.0 + wp.sqrt(wp.max(1.0 + bend * g, 0.0)))


@wp.func
def curve_distances(table: DistanceTable, curve: CurveStruct, x: Floats, y: Floats, count: int) -> Floats:
    """Distance of the robots of a block from the curve [m]; 0 for robots that are always on it."""
    distance = Floats()
    if table.seeds.shape[0] > 0:
        for k in range(count):
            distance[k] = distance_from_seeds(table, curve, wp.vec2(x[k], y[k]))
    elif table.nodes.shape[0] > 0:
        node = Ints()
        across = Floats()
        up = Floats()
        normal_x = Floats()
        normal_y = Floats()
        bend = Floats()
        for k in range(ABREAST):
            if k < width():
                cell, along, above = cell_at(table, wp.abs(x[k]), wp.abs(y[k]))
                node[k] = cell
                across[k] = along
                up[k] = above
        most = int(1)
        for k in range(count):
            node[k] = table.nodes[node[k]]
        for k in range(count):
            node[k] = leaf(table, node[k], across[k], up[k])
            most = wp.max(most, node[k] & 15)
            arc = table.arcs[node[k] >> 4]
            across[k] = wp.abs(x[k]) - arc[0]
            up[k] = wp.abs(y[k]) - arc[1]
            normal_x[k] = arc[2]
            normal_y[k] = arc[3]
            bend[k] = arc[4]
        for k in range(ABREAST):
            if k < width():
                distance[k] = arc_distance(across[k], up[k], normal_x[k], normal_y[k], bend[k])
        if most > 1:  # few cells have more arcs than one
            for k in range(count):
                for other in range((node[k] >> 4) + 1, (node[k] >> 4) + (node[k] & 15)):
                    arc = table.arcs[other]
                    further = arc_distance(wp.abs(x[k]) - arc[0], wp.abs(y[k]) - arc[1], arc[2], arc[3], arc[4])
                    distance[k] = wp.min(distance[k], further)
    return distance


def table_of(curve: Curve, keeps_to_curve: bool, device: Any) -> DistanceTable:
    """The table of a curve; empty for robots that are always on it."""
    if keeps_to_curve:
        return _on_device(0.0, 0.0, 0, 0, str(device))
    if curve.harmonics:
        return _of_harmonics(curve, str(device))
    return _on_device(curve.half_width, curve.half_height, curve.a, curve.b, str(device))


@lru_cache(maxsize=32)
def _on_device(half_width: float, half_height: float, a: int, b: int, device: str) -> DistanceTable:
    filled = DistanceTable()
    filled.seeds = wp.empty((0, 0, 0, 0), dtype=wp.float32, device=device)
    if a == 0:
        filled.nodes = wp.empty(0, dtype=wp.int32, device=device)
        filled.arcs = wp.empty(0, dtype=Arc, device=device)
        return filled
    table = distance_table(half_width, half_height, a, b)
    filled.nodes = wp.array(table.nodes, dtype=wp.int32, device=device)
    filled.arcs = wp.array(table.arcs, dtype=Arc, device=device)
    filled.columns, filled.rows = table.columns, table.rows
    filled.per_width, filled.per_height = 1 / (EXTENT * half_width), 1 / (EXTENT * half_height)
    return filled


@lru_cache(maxsize=32)
def _of_harmonics(curve: Curve, device: str) -> DistanceTable:
    from scipy.spatial import KDTree  # which takes longer to import than all of ours

    empty = _on_device(0.0, 0.0, 0, 0, device)
    seeded = DistanceTable()
    seeded.nodes, seeded.arcs = empty.nodes, empty.arcs
    gamma = np.linspace(0, 2 * np.pi, 256 * len(curve.harmonics) + 1024, endpoint=False)
    points = curve_point(curve, gamma)
    tree, arc = KDTree(points), np.concatenate([[0], np.cumsum(_lengths(points))])
    centre = (points.max(axis=0) + points.min(axis=0)) / 2
    half = np.ptp(points, axis=0) / 2
    half = EXTENT * np.maximum(half, _FLATTEST * half.max())
    seeds = np.full((_LEVELS, _CELLS, _CELLS, int(_SEEDS)), -1.0)
    for level in range(_LEVELS):
        corners = np.linspace(-1, 1, 2 * _CELLS + 1) * 2**level
        x, y = np.meshgrid(centre[0] + corners * half[0], centre[1] + corners * half[1])
        _, nearest = tree.query(np.stack([x, y], axis=-1))
        apart = _APART * np.hypot(*half) * 2 ** (level + 1) / _CELLS
        seeds[level] = _apart(np.asarray(nearest), gamma, arc, apart)
    seeded.seeds = wp.array(seeds, dtype=wp.float32, device=device)
    seeded.centre = wp.vec2(*centre)
    seeded.per_width, seeded.per_height = 1 / half[0], 1 / half[1]
    seeded.largest_step = _LARGEST_STEP / len(curve.harmonics)
    return seeded


def _lengths(points: np.ndarray) -> np.ndarray:
    """Distance of each point (K, 2) of a closed line to the next one."""
    return np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)


def _apart(nearest: np.ndarray, gamma: np.ndarray, arc: np.ndarray, apart: float) -> np.ndarray:
    """(cells, cells, points) parameters of points nearest to nine places of each cell, some way `apart` on the curve.

    Args:
        nearest: (2 cells + 1, 2 cells + 1) index of the point nearest to each corner and middle of the cells.
        gamma: (K,) parameters [rad].
        arc: (K + 1,) length of the curve up to each point, then of all of it [m].
        apart: [m].
    """
    nine = np.stack(
        [nearest[j : j - 2 or None : 2, i : i - 2 or None : 2] for j in range(3) for i in range(3)], axis=-1
    )
    nine = np.take_along_axis(nine, np.array([4, 0, 2, 6, 8, 1, 3, 5, 7])[None, None], axis=-1)  # the middle first
    found = np.full((*nine.shape[:2], int(_SEEDS)), -1.0)
    found[..., 0] = gamma[nine[..., 0]]
    way = np.full(nine.shape, np.inf)  # of each of the nine to the nearest that was taken
    last = nine[..., :1]
    for k in range(1, int(_SEEDS)):
        along = np.abs(arc[nine] - arc[last])
        way = np.minimum(way, np.minimum(along, arc[-1] - along))
        last = np.take_along_axis(nine, np.argmax(way, axis=-1)[..., None], axis=-1)
        found[..., k] = np.where(way.max(axis=-1) > apart, gamma[last[..., 0]], -1.0)
    return found
