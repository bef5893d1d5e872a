"""Cosine and sine together, in float32, the same on every machine.

A kernel on the CPU would call the C library once for each, at five times the cost of this, and the last bit would
depend on the library's version.
"""

import warp as wp

from lissajous_env.compilation import OPTIONS

wp.set_module_options(OPTIONS)

_TWO_OVER_PI = wp.constant(0.636619772367581)
# pi / 2 in three parts of few bits, so that q times each part is exact and angles up to 10^4 rad keep full accuracy.
_HALF_PI_HIGH = wp.constant(1.5703125)
_HALF_PI_MIDDLE = wp.constant(0.00048351287841796875)
_HALF_PI_LOW = wp.constant(3.1391647326017846e-07)


@wp.func
def cos_sin(angle: float) -> wp.vec2:
    """(cos, sin) of an angle [rad], within 2e-7 for angles up to 10^4 rad in size."""
    quadrants = wp.rint(angle * _TWO_OVER_PI)
    rest = ((angle - quadrants * _HALF_PI_HIGH) - quadrants * _HALF_PI_MIDDLE) - quadrants * _HALF_PI_LOW
    square = rest * rest
    # Minimax polynomials on [-pi / 4, pi / 4].
    sine = rest + rest * square * (-0.16666655 + square * (0.0083321609 - square * 0.00019515296))
    cosine = 1.0 - 0.5 * square + square * square * (0.041666646 + square * (-0.0013887316 + square * 0.000024433157))
    quadrant = int(quadrants) & 3
    odd = (quadrant & 1) == 1
    x = wp.where(odd, sine, cosine)
    y = wp.where(odd, cosine, sine)
    return wp.vec2(wp.where(quadrant == 1 or quadrant == 2, -x, x), wp.where(quadrant >= 2, -y, y))
