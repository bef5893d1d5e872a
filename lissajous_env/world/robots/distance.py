"""Distance of a place from the whole plane curve on the device, by the table of `distance_table.py`.

A robot's own parameter moves only along its branch, but the nearest point of the curve may be on any other branch. Near
a cell, a few circles approximate the curve; the table contains these circles for each cell, and the smallest distance
from them is the distance from the curve. This costs a root and a division per circle, a hundredth of the cost of a
search.

On random places the error is at most 2e-4 m on the experiment, 5e-4 m on `intruders` and 1e-3 m with a, b = 7, 8 in 10
m x 10 m; around the rectangle twice as much, far from it 1e-3 of the distance. On curves so dense or rectangles so
narrow that the table would exceed its limit, the error is below the size of a cell.

For a curve of harmonics, the table contains points of the curve instead: Newton's method, from the nearest of them,
computes the nearest point. On rough random curves the error is at most a hundredth of the curve's extent.
"""

from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.abreast import ABREAST, Floats, Ints, width
from lissajous_env.device.curve import TWO_PI, CurveStruct, newton, series_around
from lissajous_env.settings.parts import Curve
from lissajous_env.theory.closed_forms import curve_point
from lissajous_env.world.robots.distance_table import AROUND, EXTENT, GRIDS, SPLIT, distance_table

Arc = wp.types.vector(length=5, dtype=wp.float32)

_STEPS = wp.constant(6)
"""Most of Newton's steps from the nearest point of a curve of harmonics."""
_CLOSE = wp.constant(1e-3)
"""Step after which there is no further one, as a share of the largest."""
_LARGEST_STEP = 0.5
"""Largest of Newton's steps, in radians of the highest harmonic."""

_SPLIT = wp.constant(SPLIT)
_AROUND = wp.constant(AROUND)
_GRIDS = wp.constant(GRIDS)


@wp.struct
class DistanceTable:
    """`lissajous_env.world.robots.distance_table.Table` on a device; without nodes or points, every distance is 0."""

    nodes: wp.array(dtype=wp.int32)
    arcs: wp.array(dtype=Arc)
    columns: wp.int32
    rows: wp.int32
    per_width: wp.float32
    """1 over the half width of the innermost grid [1/m]."""
    per_height: wp.float32
    """1 over the half height of the innermost grid [1/m]."""
    points: wp.array(dtype=wp.vec2)
    """Points of a curve of harmonics at equal distances of its parameter [m]."""
    largest_step: wp.float32
    """Largest of Newton's steps from these [rad]."""


@wp.func
def distances_from_points(table: DistanceTable, curve: CurveStruct, x: Floats, y: Floats, count: int) -> Floats:
    """Return the distance of a block's robots from a curve of harmonics [m], the smallest of all Newton steps."""
    nearest = Ints()
    distance = Floats(1.0e30)
    for n in range(table.points.shape[0]):
        place = table.points[n]
        for k in range(ABREAST):
            if k < width():
                across = x[k] - place[0]
                up = y[k] - place[1]
                square = across * across + up * up
                nearest[k] = wp.where(square < distance[k], n, nearest[k])
                distance[k] = wp.min(square, distance[k])
    for k in range(count):
        distance[k] = wp.sqrt(distance[k])
        gamma = TWO_PI * float(nearest[k]) / float(table.points.shape[0])
        left = int(_STEPS)
        while left > 0:
            point, tangent, bend = series_around(curve, gamma)
            away = wp.vec2(x[k], y[k]) - point
            distance[k] = wp.min(distance[k], wp.length(away))
            further = newton(away, tangent, bend, gamma, table.largest_step)
            left = wp.where(wp.abs(further - gamma) < _CLOSE * table.largest_step, wp.min(left - 1, 1), left - 1)
            gamma = further
    return distance


@wp.func
def cell_at(table: DistanceTable, x: float, y: float) -> tuple[int, float, float]:
    """Return the cell of a place x, y >= 0 [m], and the position in it from 0 to 1 along its width and height."""
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
    """Return 16 times the first arc of the part of a node that contains a place, plus the number of its arcs."""
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
    """Return the distance of a place from a circle [m] that passes a point with a unit normal and a bend [1/m]."""
    g = 2.0 * (normal_x * across + normal_y * up) + bend * (across * across + up * up)
    return wp.abs(g) / (1.0 + wp.sqrt(wp.max(1.0 + bend * g, 0.0)))


@wp.func
def curve_distances(table: DistanceTable, curve: CurveStruct, x: Floats, y: Floats, count: int) -> Floats:
    """Return the distance of the robots of a block from the curve [m]; 0 for robots that are always on it."""
    distance = Floats()
    if table.points.shape[0] > 0:
        distance = distances_from_points(table, curve, x, y, count)
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
    """Return the table of a curve; it is empty for robots that are always on it."""
    return _on_device(None if keeps_to_curve else curve, str(device))


@lru_cache(maxsize=32)
def _on_device(curve: Curve | None, device: str) -> DistanceTable:
    filled, table, points = DistanceTable(), None, np.zeros((0, 2))
    if curve is not None and curve.harmonics:
        gamma = np.linspace(0, 2 * np.pi, 128 * len(curve.harmonics) + 512, endpoint=False)
        points, filled.largest_step = curve_point(curve, gamma), _LARGEST_STEP / len(curve.harmonics)
    elif curve is not None:
        table = distance_table(curve.half_width, curve.half_height, curve.a, curve.b)
        filled.columns, filled.rows = table.columns, table.rows
        filled.per_width, filled.per_height = 1 / (EXTENT * curve.half_width), 1 / (EXTENT * curve.half_height)
    filled.points = wp.array(points, dtype=wp.vec2, device=device)
    filled.nodes = wp.array(table.nodes if table else [], dtype=wp.int32, device=device)
    filled.arcs = wp.array(table.arcs if table else np.zeros((0, 5)), dtype=Arc, device=device)
    return filled
