"""The points of the plane curve nearest to many places, in float32.

Their error is at most a millionth of the longer side of the rectangle. `distance_table.py` uses them to select the
places that require higher precision, and as the first guess of its search in float64.
"""

import numpy as np
import warp as wp

from lissajous_env.device.abreast import ABREAST, Floats, width
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import compile_quietly
from lissajous_env.device.trig import atan2, cos_sin
from lissajous_env.settings.parts import Curve

wp.set_module_options(OPTIONS)

SAMPLES = 9
"""Points at equal distances of an edge of the curve, from the nearest of which Newton's steps begin."""
_INTERVALS = wp.constant(float(SAMPLES - 1))
_SAMPLES = wp.constant(SAMPLES)
_STEPS = wp.constant(4)
_PI = wp.constant(float(np.pi))
_EDGES = wp.constant(4)


@wp.kernel
def find_rough_distances(
    half_width: float,
    half_height: float,
    a: float,
    b: float,
    inverse: int,
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
    each. `inverse` is that of b modulo a. The number of places is a multiple of `width()`.
    """
    start = wp.tid() * width()
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
                laps[k] = -line * float(inverse) - a * wp.floor(-line * float(inverse) / a)
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


def rough_distances(curve: Curve, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of the curve nearest to places (M, 2) [m] on each of the four edges around them.

    Returns:
        distances: (M, 4), from each edge [m].
        phases: (M, 4), gamma of the nearest point of each edge [rad].
    """
    count = len(places)
    padded = np.zeros((2, -(-count // int(ABREAST)) * int(ABREAST)), dtype=np.float32)
    padded[:, :count] = places.T
    with compile_quietly():
        outputs = [wp.empty((4, padded.shape[1]), dtype=wp.float32, device="cpu") for _ in range(2)]
        x, y = (wp.array(each, dtype=wp.float32, device="cpu", copy=False) for each in padded)
        shape = curve.half_width, curve.half_height, float(curve.a), float(curve.b), pow(curve.b, -1, curve.a)
        wp.launch(find_rough_distances, padded.shape[1] // int(ABREAST), [*shape, x, y], outputs, device="cpu")
    distances, phases = (each.numpy()[:, :count].T for each in outputs)
    return distances, phases
