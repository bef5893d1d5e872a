"""The place on the curve at which a robot begins, by its pose."""

import numpy as np

from lissajous_env.settings.parts import Curve
from lissajous_env.theory.closed_forms import curve_derivatives, curve_point

_PLACES = 8192
"""Places of the curve that are compared."""
_REACH = 0.25
"""Distance that weighs as much as a heading that is off by a right angle, in the shorter half of the rectangle."""


def locate(curve: Curve, alpha: int, x: float, y: float, heading: float, near: float) -> float:
    """Return the phase theta in [0, 2 pi) [rad] at which the curve passes a pose in its direction.

    The curve crosses itself, so the heading decides between branches. Where several phases belong to one place of the
    curve (`alpha` of Lemma 2 above 1), it is the one nearest to `near` [rad].
    """
    gamma = np.arange(_PLACES) * (2 * np.pi / _PLACES)
    place, along = curve_point(curve, gamma), curve_derivatives(curve, gamma)[0]
    off = np.arctan2(along[..., 1], along[..., 0]) - heading
    reach = _REACH * min(curve.half_width, curve.half_height)
    square = np.sum((place - (x, y)) ** 2, axis=-1)
    best = gamma[np.argmin(square / reach**2 + 1 - np.cos(off))]
    phases = (best + 2 * np.pi * np.arange(alpha)) / alpha
    return float(phases[np.argmax(np.cos(phases - near))] % (2 * np.pi))
