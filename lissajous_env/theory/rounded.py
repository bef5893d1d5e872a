"""The rounded form of the curve 3:2, for cars that cannot follow its bends within walls.

In the open, a car that turns more widely than the curve bends leaves the rectangle there, which walls prevent. The
rounded curve has the extents and the symmetries of (3):

    x(gamma) = A sum of c_k cos(k gamma), k odd        y(gamma) = B sum of s_k sin(k gamma), k even
"""

import dataclasses

import numpy as np

from lissajous_env.settings.parts import Curve

ROUNDED = {(3, 2): ((-0.25, 0.825, -0.037, -0.002, 0.03), (0.623, 0.707, -0.289, 0.202, 0.038))}
"""By a and b: c_k for k = 1, 3 and so on, and s_k for k = 2, 4 and so on.

`python benchmarks/rounding.py` computes them for the cars of `evaders-walls`: of the curves that bend at 1.1 of their
turning radius at least, and on which they are 0.39 m apart in formation, this one is nearest to (3) at equal gamma.
"""


def rounded(curve: Curve) -> Curve:
    """Return the rounded form of a Lissajous curve, as a series in the same rectangle; the curve itself without one."""
    if (curve.a, curve.b) not in ROUNDED:
        return curve
    x, y = ROUNDED[curve.a, curve.b]
    rows = np.zeros((2 * len(y), 4))
    rows[::2, 0], rows[1::2, 3] = curve.half_width * np.array(x), curve.half_height * np.array(y)
    return dataclasses.replace(curve, harmonics=tuple(map(tuple, rows.tolist())))
