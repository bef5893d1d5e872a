"""Closest approach of two points that move on straight lines."""

from typing import Any

import warp as wp


@wp.func
def closest_approach(before: Any, after: Any) -> float:
    """Return the smallest squared length of before + t (after - before), t in [0, 1] [m^2], in the plane or in space.

    `before` and `after` are the offset of two robots at the two ends of a stretch of time, at equal speeds within it.
    """
    moved = after - before
    t = wp.clamp(-wp.dot(before, moved) / wp.max(wp.dot(moved, moved), 1.0e-30), 0.0, 1.0)
    nearest = before + t * moved
    return wp.dot(nearest, nearest)


@wp.func
def first_within(before: wp.vec2, after: wp.vec2, radius: float) -> float:
    """Return the smallest t in [0, 1] with |before + t (after - before)| <= radius [m], as above; 2 for none."""
    outside = wp.dot(before, before) - radius * radius
    if outside <= 0.0:
        return 0.0
    moved = after - before
    nearing = -wp.dot(before, moved)
    root = nearing * nearing - wp.dot(moved, moved) * outside
    if nearing <= 0.0 or root < 0.0:
        return 2.0
    # The smaller root of a quadratic equation, written without a difference of numbers that are nearly equal.
    t = outside / (nearing + wp.sqrt(root))
    return wp.where(t <= 1.0, t, 2.0)
