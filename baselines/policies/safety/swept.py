"""The distance of the paths of two cars at any two times, for robots that may stop dead.

A car that stops dead at a time a stands at its plan's place of that time while the other one drives on, so a place of
its plan is compared with the places of the other one's plan at the same time and later (`swept_room`).
"""

import warp as wp

from baselines.policies.safety.tails import PIECES, room_of_reaches
from lissajous_env.device.approach import closest_approach

BLOCK = wp.constant(4)
"""Pieces of a tail that are compared together first."""
BLOCKS = wp.constant(int(PIECES) // int(BLOCK) + 1)
"""Blocks of a plan: the step, and those of the tail."""


@wp.func
def gap(a: wp.vec3, a_end: wp.vec3, b: wp.vec3, b_end: wp.vec3) -> float:
    """Return the distance of two line segments in the plane [m]; a third coordinate is ignored.

    The differences of their points are a parallelogram, and its distance from the origin is that of the segments.
    """
    p = wp.vec2(a[0] - b[0], a[1] - b[1])
    q = wp.vec2(a_end[0] - b[0], a_end[1] - b[1])
    r = wp.vec2(a_end[0] - b_end[0], a_end[1] - b_end[1])
    s = wp.vec2(a[0] - b_end[0], a[1] - b_end[1])
    turns = wp.vec4(
        q[1] * p[0] - q[0] * p[1], r[1] * q[0] - r[0] * q[1], s[1] * r[0] - s[0] * r[1], p[1] * s[0] - p[0] * s[1]
    )
    if wp.min(turns) > 0.0 or wp.max(turns) < 0.0:
        return 0.0
    least = wp.min(closest_approach(p, q), closest_approach(q, r))
    return wp.sqrt(wp.min(least, wp.min(closest_approach(r, s), closest_approach(s, p))))


@wp.func
def block_start(block: int) -> int:
    """Return the point of a plan at which a block begins; it ends where the next one begins."""
    return wp.where(block == 0, 0, 2 + (block - 1) * BLOCK)


@wp.func
def chord_bound(plan: wp.array(dtype=wp.vec3), block: int) -> float:
    """Return a bound on the distance of the car from a block's chord [m]: that of the points, and their own bound."""
    begin = block_start(block)
    end = block_start(block + 1)
    along = plan[end] - plan[begin]
    away = float(0.0)
    for k in range(begin + 1, end):
        offset = plan[k] - plan[begin]
        share = (offset[0] * along[0] + offset[1] * along[1]) / wp.max(
            along[0] * along[0] + along[1] * along[1], 1.0e-30
        )
        share = wp.clamp(share, 0.0, 1.0)
        away = wp.max(away, wp.length(wp.vec2(offset[0] - share * along[0], offset[1] - share * along[1])))
    return away + wp.max(plan[begin + 1][2], plan[end][2])


@wp.func
def room_of_blocks(
    one: wp.array(dtype=wp.vec3),
    other: wp.array(dtype=wp.vec3),
    block: int,
    other_block: int,
    stops: bool,
    other_stops: bool,
    touch: float,
    enough: float,
) -> float:
    """Return `swept_room` of two blocks."""
    least = float(1.0e30)
    for k in range(block_start(block), block_start(block + 1)):
        a_end = one[k + 1]
        for m in range(block_start(other_block), block_start(other_block + 1)):
            if (stops or k >= m) and (other_stops or m >= k):
                b_end = other[m + 1]
                least = wp.min(least, gap(one[k], a_end, other[m], b_end) - a_end[2] - b_end[2] - touch)
                if least < enough:
                    return least
    return least


@wp.func
def swept_room(
    one: wp.array(dtype=wp.vec3),
    other: wp.array(dtype=wp.vec3),
    stops: bool,
    other_stops: bool,
    touch: float,
    enough: float,
) -> float:
    """Return a lower bound of the distance of two cars, of which either may stop dead, less `touch` [m].

    If the bound is below `enough`, any value below `enough` is returned. A car that `stops` can be at any earlier place
    of its plan than at equal times: the places of piece k are compared with those of all pieces m >= k of the other
    plan, with those of k >= m if the other one stops, and with all if both do.
    """
    least = room_of_reaches(one, other, touch)
    if least >= 0.0:
        return least
    least = float(1.0e30)
    for block in range(BLOCKS):
        begin = one[block_start(block)]
        end = one[block_start(block + 1)]
        to_end = wp.length(wp.vec2(end[0] - other[0][0], end[1] - other[0][1]))
        wide = chord_bound(one, block)
        length = wp.length(wp.vec2(end[0] - begin[0], end[1] - begin[1]))
        away = to_end - length - wide - other[0][2] - touch
        if away >= wp.max(enough, 0.0):
            least = wp.min(least, away)
            continue
        for other_block in range(BLOCKS):
            if (stops or block >= other_block) and (other_stops or other_block >= block):
                start = other[block_start(other_block)]
                finish = other[block_start(other_block + 1)]
                room = gap(begin, end, start, finish) - wide - chord_bound(other, other_block) - touch
                if room < 0.0:
                    room = room_of_blocks(one, other, block, other_block, stops, other_stops, touch, enough)
                least = wp.min(least, room)
                if least < enough:
                    return least
    return least
