"""The points of the plane curve nearest to many places, in float32, found by all CPU threads.

Their error is at most a millionth of the longer side of the rectangle. `distance_table.py` uses them to select the
places that require higher precision, and as the first guess of its search in float64.
"""

from functools import cache

import numpy as np
import warp as wp

from lissajous_env.device.abreast import ABREAST, Floats, width
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.device.trig import atan2, cos_sin
from lissajous_env.device.work import interleaved
from lissajous_env.settings.parts import Curve

wp.set_module_options(OPTIONS)

SAMPLES = 9
"""Points at equal distances of an edge of the curve, from the nearest of which Newton's steps begin."""
_INTERVALS = wp.constant(float(SAMPLES - 1))
_SAMPLES = wp.constant(SAMPLES)
_STEPS = wp.constant(4)
_PI = wp.constant(float(np.pi))
_EDGES = wp.constant(4)
_MOST = 2**15
"""Places that are searched for together, a multiple of the width of a block."""


@wp.struct
class Search:
    """A curve, and the number of places for which the nearest points of it are searched."""

    half_width: wp.float32
    half_height: wp.float32
    a: wp.float32
    b: wp.float32
    inverse: wp.int32
    """Inverse of b modulo a."""
    count: wp.int32


@wp.kernel
def find_rough_distances(
    first: int,
    apart: int,
    searches: wp.array(dtype=Search),
    places_x: wp.array(dtype=wp.float32),
    places_y: wp.array(dtype=wp.float32),
    distances_out: wp.array2d(dtype=wp.float32),
    phases_out: wp.array2d(dtype=wp.float32),
):
    """Find the distance [m] of places from the four edges around them, and the phase gamma [rad] of the nearest points.

    The curve is a mesh, and the nearest point lies on one of the four edges around the place: between the point of the
    edge that is straight above or below the place and the one that is straight beside it. With alpha = arccos(x / A)
    and beta = arcsin(y / B) the place is at (+-alpha, beta) and (+-alpha, pi - beta) on the torus of the angles u = a
    gamma and v = b gamma, where the curve is a bundle of straight lines, equally far apart: one of them is next to
    each. A thread searches for one block of places in `apart`, beginning with `first`.
    """
    start = (first + apart * wp.tid()) * width()
    search = searches[0]
    if start >= search.count:
        return
    half_width = search.half_width
    half_height = search.half_height
    a = search.a
    b = search.b
    x = Floats()
    y = Floats()
    alpha = Floats()
    beta = Floats()
    u = Floats()
    v = Floats()
    spacing = Floats()
    distance = Floats()
    laps = Floats()
    cos_u = Floats()
    sin_u = Floats()
    cos_v = Floats()
    sin_v = Floats()
    turn_cos_u = Floats()
    turn_sin_u = Floats()
    turn_cos_v = Floats()
    turn_sin_v = Floats()
    for k in range(width()):
        x[k] = places_x[start + k]
        y[k] = places_y[start + k]
    for k in range(ABREAST):
        if k < width():
            across = wp.clamp(x[k] / half_width, -1.0, 1.0)
            up = wp.clamp(y[k] / half_height, -1.0, 1.0)
            alpha[k] = atan2(wp.sqrt(1.0 - across * across), across)
            beta[k] = atan2(up, wp.sqrt(1.0 - up * up))
    for edge in range(_EDGES):
        for k in range(ABREAST):
            if k < width():
                u0 = wp.where(edge < 2, alpha[k], -alpha[k])
                v1 = wp.where((edge & 1) == 0, beta[k], _PI - beta[k])
                line = wp.rint((b * u0 - a * v1) / (2.0 * _PI))
                laps[k] = -line * float(search.inverse) - a * wp.floor(-line * float(search.inverse) / a)
                turns = 2.0 * _PI * line
                length = ((a * v1 + turns) / b - u0) / a
                room = 0.1 * length + wp.where(length < 0.0, -1.0e-3, 1.0e-3) / wp.max(a, b)
                spacing[k] = (length + 2.0 * room) / _INTERVALS
                u[k] = u0 - a * room
                v[k] = (b * u0 - turns) / a - b * room
                first_u = cos_sin(u[k])
                first_v = cos_sin(v[k])
                turn_u = cos_sin(a * spacing[k])
                turn_v = cos_sin(b * spacing[k])
                cos_u[k] = first_u[0]
                sin_u[k] = first_u[1]
                cos_v[k] = first_v[0]
                sin_v[k] = first_v[1]
                turn_cos_u[k] = turn_u[0]
                turn_sin_u[k] = turn_u[1]
                turn_cos_v[k] = turn_v[0]
                turn_sin_v[k] = turn_v[1]
        nearest = Floats()
        smallest = Floats(1.0e38)
        for sample in range(_SAMPLES):
            for k in range(ABREAST):
                if k < width():
                    to_x = x[k] - half_width * cos_u[k]
                    to_y = y[k] - half_height * sin_v[k]
                    square = to_x * to_x + to_y * to_y
                    nearest[k] = wp.where(square < smallest[k], float(sample), nearest[k])
                    smallest[k] = wp.min(square, smallest[k])
                    cosine = cos_u[k] * turn_cos_u[k] - sin_u[k] * turn_sin_u[k]
                    sin_u[k] = sin_u[k] * turn_cos_u[k] + cos_u[k] * turn_sin_u[k]
                    cos_u[k] = cosine
                    cosine = cos_v[k] * turn_cos_v[k] - sin_v[k] * turn_sin_v[k]
                    sin_v[k] = sin_v[k] * turn_cos_v[k] + cos_v[k] * turn_sin_v[k]
                    cos_v[k] = cosine
        for k in range(ABREAST):
            if k < width():
                u[k] += a * nearest[k] * spacing[k]
                v[k] += b * nearest[k] * spacing[k]
        for _ in range(_STEPS):
            for k in range(ABREAST):
                if k < width():
                    turn_u = cos_sin(u[k])
                    turn_v = cos_sin(v[k])
                    point_x = half_width * turn_u[0]
                    point_y = half_height * turn_v[1]
                    tangent_x = -a * half_width * turn_u[1]
                    tangent_y = b * half_height * turn_v[0]
                    to_x = x[k] - point_x
                    to_y = y[k] - point_y
                    speed = tangent_x * tangent_x + tangent_y * tangent_y
                    slope = wp.max(speed + a * a * point_x * to_x + b * b * point_y * to_y, 0.5 * speed)
                    most = wp.abs(spacing[k])
                    change = wp.clamp((tangent_x * to_x + tangent_y * to_y) / wp.max(slope, 1.0e-30), -most, most)
                    u[k] += a * change
                    v[k] += b * change
        for k in range(ABREAST):
            if k < width():
                to_x = x[k] - half_width * cos_sin(u[k])[0]
                to_y = y[k] - half_height * cos_sin(v[k])[1]
                distance[k] = wp.sqrt(to_x * to_x + to_y * to_y)
        for k in range(width()):
            distances_out[edge, start + k] = distance[k]
            phases_out[edge, start + k] = (u[k] + 2.0 * _PI * laps[k]) / a


class _Search:
    """Arrays for the search and the launches of all CPU threads, which are recorded once."""

    def __init__(self):
        device = as_device("cpu")
        self.search = wp.zeros(1, dtype=Search, device=device)
        self.places = [wp.zeros(_MOST, dtype=wp.float32, device=device) for _ in range(2)]
        self.outputs = [wp.zeros((4, _MOST), dtype=wp.float32, device=device) for _ in range(2)]
        blocks, arguments = _MOST // int(ABREAST), [self.search, *self.places, *self.outputs]
        self.run = interleaved(find_rough_distances, blocks, arguments, device)


@cache
def _prepared() -> _Search:
    return _Search()


def rough_distances(curve: Curve, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of the curve nearest to places (M, 2) [m] on each of the four edges around them.

    Returns:
        distances: (4, M), from each edge [m].
        phases: (4, M), gamma of the nearest point of each edge [rad].
    """
    found = np.empty((2, 4, len(places)), dtype=np.float32)
    with compile_quietly():
        prepared = _prepared()
        inputs = [each.numpy() for each in prepared.places]
        outputs = [each.numpy() for each in prepared.outputs]
        for begin in range(0, len(places), _MOST):
            part = places[begin : begin + _MOST]
            for array, given in zip(inputs, part.T, strict=True):
                array[: len(part)] = given
            prepared.search.numpy()[0] = (
                curve.half_width, curve.half_height, curve.a, curve.b, pow(curve.b, -1, curve.a), len(part)
            )  # fmt: skip
            prepared.run()
            for array, kept in zip(outputs, found, strict=True):
                kept[:, begin : begin + len(part)] = array[:, : len(part)]
    return found[0], found[1]
