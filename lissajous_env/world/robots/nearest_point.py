"""The points of the plane curve nearest to many places, and the curve around them, in float64, by all CPU threads."""

from functools import cache

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.device.work import interleaved
from lissajous_env.settings.parts import Curve

wp.set_module_options(OPTIONS)

_STEPS = wp.constant(2)
_MOST_CHANGE = wp.constant(wp.float64(0.01))
"""Longest step from a rough phase [rad]."""
_EDGES = wp.constant(4)
_HALF = wp.constant(wp.float64(0.5))
_FAR = wp.constant(wp.float64(1.0e300))
_MOST = 2**14
"""Places that are searched for together."""


@wp.struct
class Search:
    """A curve, and the number of places for which the nearest points of it are searched."""

    half_width: wp.float64
    half_height: wp.float64
    a: wp.float64
    b: wp.float64
    count: wp.int32


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return sqrt(x * x + y * y);
#else
    return __builtin_hypot(x, y);
#endif
""")
def hypot(x: wp.float64, y: wp.float64) -> wp.float64:
    """Return sqrt(x^2 + y^2)."""
    ...


@wp.kernel
def find_nearest(
    first: int,
    apart: int,
    searches: wp.array(dtype=Search),
    places_x: wp.array(dtype=wp.float64),
    places_y: wp.array(dtype=wp.float64),
    rough: wp.array2d(dtype=wp.float32),
    plausible: wp.array2d(dtype=wp.uint8),
    arcs_out: wp.array2d(dtype=wp.float64),
    distances_out: wp.array(dtype=wp.float64),
):
    """Find the nearest point, its distance [m], the unit normal there and the curvature against it [1/m].

    The search begins at the plausible ones of the rough phases.
    """
    place = first + apart * wp.tid()
    search = searches[0]
    if place >= search.count:
        return
    x = places_x[place]
    y = places_y[place]
    a = search.a
    b = search.b
    nearest = wp.float64(rough[0, place])
    smallest = _FAR
    for edge in range(_EDGES):
        if plausible[edge, place] != wp.uint8(0):
            gamma = wp.float64(rough[edge, place])
            for _ in range(_STEPS):
                point_x = search.half_width * wp.cos(a * gamma)
                point_y = search.half_height * wp.sin(b * gamma)
                tangent_x = -a * search.half_width * wp.sin(a * gamma)
                tangent_y = b * search.half_height * wp.cos(b * gamma)
                away_x = x - point_x
                away_y = y - point_y
                square = tangent_x * tangent_x + tangent_y * tangent_y
                slope = wp.max(square + a * a * point_x * away_x + b * b * point_y * away_y, square * _HALF)
                change = (tangent_x * away_x + tangent_y * away_y) / slope
                gamma = gamma + wp.clamp(change, -_MOST_CHANGE, _MOST_CHANGE)
            distance = hypot(x - search.half_width * wp.cos(a * gamma), y - search.half_height * wp.sin(b * gamma))
            if distance < smallest:
                smallest = distance
                nearest = gamma
    tangent_x = -a * search.half_width * wp.sin(a * nearest)
    tangent_y = b * search.half_height * wp.cos(b * nearest)
    point_x = search.half_width * wp.cos(a * nearest)
    point_y = search.half_height * wp.sin(b * nearest)
    speed = wp.sqrt(tangent_x * tangent_x + tangent_y * tangent_y)
    normal_x = tangent_y / speed
    normal_y = -tangent_x / speed
    bend_x = -search.half_width * (a * a) * wp.cos(a * nearest)
    bend_y = -search.half_height * (b * b) * wp.sin(b * nearest)
    arcs_out[place, 0] = point_x
    arcs_out[place, 1] = point_y
    arcs_out[place, 2] = normal_x
    arcs_out[place, 3] = normal_y
    arcs_out[place, 4] = -(normal_x * bend_x + normal_y * bend_y) / (speed * speed)
    distances_out[place] = smallest


class _Search:
    """Arrays for the search and the launches of all CPU threads, which are recorded once."""

    def __init__(self):
        device = as_device("cpu")
        self.search = wp.zeros(1, dtype=Search, device=device)
        self.places = [wp.zeros(_MOST, dtype=wp.float64, device=device) for _ in range(2)]
        self.rough = wp.zeros((4, _MOST), dtype=wp.float32, device=device)
        self.plausible = wp.zeros((4, _MOST), dtype=wp.uint8, device=device)
        self.outputs = [wp.zeros(shape, dtype=wp.float64, device=device) for shape in ((_MOST, 5), _MOST)]
        arguments = [self.search, *self.places, self.rough, self.plausible, *self.outputs]
        self.run = interleaved(find_nearest, _MOST, arguments, device)


@cache
def _prepared() -> _Search:
    return _Search()


def nearest_arcs(
    curve: Curve, places: np.ndarray, phases: np.ndarray, plausible: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the arcs (M, 5) of the curve nearest to places (M, 2) [m], and the distances (M,) of their points [m].

    An arc has a point [m], the unit normal there and the curvature against it [1/m]. Newton's steps towards
    r'.(q - r) = 0 begin at those of the rough phases (4, M) [rad] that are plausible. Where the second derivative
    vanishes, a step is twice that of Gauss and Newton.
    """
    arcs, distances = np.empty((len(places), 5)), np.empty(len(places))
    with compile_quietly():
        prepared = _prepared()
        for begin in range(0, len(places), _MOST):
            chosen = slice(begin, begin + _MOST)
            count = len(places[chosen])
            prepared.search.numpy()[0] = curve.half_width, curve.half_height, curve.a, curve.b, count
            given = *places[chosen].T, phases[:, chosen], plausible[:, chosen]
            for array, part in zip((*prepared.places, prepared.rough, prepared.plausible), given, strict=True):
                array.numpy()[..., :count] = part
            prepared.run()
            arcs[chosen], distances[chosen] = (each.numpy()[:count] for each in prepared.outputs)
    return arcs, distances
