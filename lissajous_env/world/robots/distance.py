"""Distance of robots from the plane curve: Newton's steps from the nearest of many points of the curve.

A robot's own parameter moves only along its branch, but the nearest point may be on any other branch. So the points are
divided into branches, the steps begin at the nearest point of every branch, and the smallest distance counts. A branch
of a Lissajous curve goes from one axis or edge of the rectangle to the next. The curve is symmetric to both axes,
because its a is odd, so the points of a quarter suffice. A curve of harmonics is one branch with many points.
"""

from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.abreast import ABREAST, Floats, width
from lissajous_env.device.curve import CurveStruct, lissajous, project, project_lissajous, series
from lissajous_env.settings.parts import Curve
from lissajous_env.theory.closed_forms import curve_point

_STEPS = wp.constant(2)
"""Newton's steps from the nearest point of a branch."""
_LARGEST_STEP = wp.constant(0.1)
"""Largest of them, in radians of the highest harmonic of the curve."""
_PER_WINDING, _PER_HARMONIC, _FEWEST_OF_HARMONICS = 24, 128, 512
"""Points of a lap of a Lissajous curve, by a + b, and of a curve of harmonics, by their number and besides."""


@wp.struct
class CurvePoints:
    """Points of a curve on a device; none for robots that are always on it."""

    points: wp.array(dtype=wp.vec3)
    """(M,) x, y [m] and parameter [rad]."""
    ends: wp.array(dtype=wp.int32)
    """(branches,) number of points up to the end of each branch."""


@wp.func
def curve_distances(sampled: CurvePoints, curve: CurveStruct, x: Floats, y: Floats, count: int) -> Floats:
    """Return the distance of the robots of a block from the curve [m]; 0 for robots that are always on it."""
    smallest = Floats()
    if sampled.ends.shape[0] > 0:
        smallest = Floats(1.0e30)
        size = curve.harmonics.shape[0]
        across = Floats()
        up = Floats()
        gamma = Floats()
        for k in range(ABREAST):
            if k < width():
                across[k] = wp.where(size == 0, wp.abs(x[k]), x[k])
                up[k] = wp.where(size == 0, wp.abs(y[k]), y[k])
        n = int(0)
        for branch in range(sampled.ends.shape[0]):
            square = Floats(1.0e30)
            while n < sampled.ends[branch]:
                point = sampled.points[n]
                for k in range(ABREAST):
                    if k < width():
                        away_x = across[k] - point[0]
                        away_y = up[k] - point[1]
                        away = away_x * away_x + away_y * away_y
                        gamma[k] = wp.where(away < square[k], point[2], gamma[k])
                        square[k] = wp.min(square[k], away)
                n += 1
            if size == 0:
                largest = _LARGEST_STEP / float(wp.max(curve.a, curve.b))
                for _ in range(_STEPS):
                    for k in range(ABREAST):
                        if k < width():
                            gamma[k] = project_lissajous(curve, across[k], up[k], gamma[k], largest)
                for k in range(ABREAST):
                    if k < width():
                        nearest = lissajous(curve, gamma[k])
                        away_x = across[k] - nearest[0]
                        away_y = up[k] - nearest[1]
                        square[k] = wp.min(square[k], away_x * away_x + away_y * away_y)
            else:
                for k in range(count):
                    place = wp.vec2(x[k], y[k])
                    for _ in range(_STEPS):
                        gamma[k] = project(curve, place, gamma[k], _LARGEST_STEP / float(size))
                    square[k] = wp.min(square[k], wp.length_sq(place - series(curve, gamma[k], 0)))
            for k in range(ABREAST):
                if k < width():
                    smallest[k] = wp.min(smallest[k], square[k])
        for k in range(ABREAST):
            if k < width():
                smallest[k] = wp.sqrt(smallest[k])
    return smallest


@lru_cache(maxsize=32)
def points_of(curve: Curve | None, device: str) -> Any:
    """Return points of a curve on a device, at equal distances of its parameter; none without a curve."""
    points, ends = np.zeros((0, 3)), []
    if curve is not None:
        size = len(curve.harmonics)
        count = _PER_HARMONIC * size + _FEWEST_OF_HARMONICS if size else _PER_WINDING * (curve.a + curve.b)
        gamma = 2 * np.pi * (np.arange(count) + 0.5) / count
        points, ends = np.column_stack([curve_point(curve, gamma), gamma]), [count]
        if size == 0:
            points = points[(points[:, :2] > 0).all(axis=1)]
            quarters = np.floor(points[:, 2:] * [curve.a, curve.b] / (np.pi / 2))  # of the waves along x and y
            ends = [*1 + np.flatnonzero(np.diff(quarters, axis=0).any(axis=1)), len(points)]
    sampled: Any = CurvePoints()
    sampled.points = wp.array(points, dtype=wp.vec3, device=device)
    sampled.ends = wp.array(np.array(ends), dtype=wp.int32, device=device)
    return sampled
