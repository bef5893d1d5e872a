"""How near two things come to each other on straight ways."""

from typing import Any

import warp as wp

from lissajous_env.device.compilation import OPTIONS

wp.set_module_options(OPTIONS)


@wp.func
def closest_approach(before: Any, after: Any) -> float:
    """Smallest squared length of before + t (after - before), t in [0, 1] [m^2], in the plane or in space.

    `before` and `after` are the offset of two robots at the two ends of a stretch of time, at equal speeds within it.
    """
    moved = after - before
    t = wp.clamp(-wp.dot(before, moved) / wp.max(wp.dot(moved, moved), 1.0e-12), 0.0, 1.0)
    nearest = before + t * moved
    return wp.dot(nearest, nearest)
