"""Cosine and sine together, and the angle that has them, in float32, the same on every machine.

A kernel on the CPU would call the C library for each, at five times the cost of this, and the last bit would depend on
the library's version.
"""

import warp as wp

PI = wp.constant(3.141592653589793)
TWO_PI = wp.constant(6.283185307179586)
_TWO_OVER_PI = wp.constant(0.636619772367581)
_HALF_PI = wp.constant(wp.float64(1.5707963267948966))


@wp.func
def cos_sin(angle: float) -> wp.vec2:
    """Return (cos, sin) of an angle [rad], within 2e-7 for absolute angles up to 10^4 rad."""
    quadrants = wp.rint(angle * _TWO_OVER_PI)
    rest = float(wp.float64(angle) - wp.float64(quadrants) * _HALF_PI)
    square = rest * rest
    fourth = square * square
    # Minimax polynomials on [-pi / 4, pi / 4], in an order in which few operations wait for each other.
    sine = rest + (rest * square) * ((-0.16666655 + square * 0.0083321609) - fourth * 0.00019515296)
    cosine = (1.0 - 0.5 * square) + fourth * ((0.041666646 - square * 0.0013887316) + fourth * 0.000024433157)
    quadrant = int(quadrants) & 3
    odd = (quadrant & 1) == 1
    x = wp.where(odd, sine, cosine)
    y = wp.where(odd, cosine, sine)
    return wp.vec2(wp.where(quadrant == 1 or quadrant == 2, -x, x), wp.where(quadrant >= 2, -y, y))


@wp.func
def atan2(y: float, x: float) -> float:
    """Return the angle in [-pi, pi] of a place (x, y) [rad], within 4e-7; 0 if both are 0."""
    across = wp.abs(x)
    up = wp.abs(y)
    ratio = wp.min(across, up) / wp.max(wp.max(across, up), 1.0e-30)
    square = ratio * ratio
    fourth = square * square
    # Minimax polynomial on [0, 1], in an order in which few operations wait for each other.
    low = (0.99999922 - square * 0.33329538) + fourth * (0.19943081 - square * 0.13892041)
    high = (0.096016563 - square * 0.055381697) + fourth * (0.021509254 - square * 0.0039602574)
    angle = ratio * (low + (fourth * fourth) * high)
    angle = wp.where(up > across, 0.5 * PI - angle, angle)
    angle = wp.where(x < 0.0, PI - angle, angle)
    return wp.where(y < 0.0, -angle, angle)
