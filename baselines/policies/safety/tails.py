"""Tails: the paths of cars that coast to rest with the motor off and constant steering, with bounds on their errors.

A car whose motor is off slows down by v' = -c v, equation (12), whatever its motor and its wheelbase. With constant
steering it follows an arc of curvature kappa, and with q = 1 - exp(-c t) it has gone q L of the length L = v / c that
is left to it. All cars have the same c, so for q from 0 to 1 every car moves along its arc at a constant rate. A tail
is

    tail = (x, y, heading, L)        beginning [m], [rad], and length [m]
    tube = (kappa, w0, w1, w2)       curvature [1/m], and the bound w(q) = w0 + w1 q + w2 q^2 [m]

and the car is within w(q) of the arc's point at q, for every position, heading, speed and curvature that the bounds of
noise and model allow (`error_tube`).
"""

import warp as wp

from lissajous_env.device.approach import closest_approach
from lissajous_env.device.trig import cos_sin

PIECES = wp.constant(16)
"""Pieces of a tail between its sampled points, in equal steps of q."""
POINTS = wp.constant(int(PIECES) + 3)
"""Sampled points of a plan: the position of the car, and the beginning, inner points and end of its tail."""


@wp.func
def arc_end(x: float, y: float, heading: float, length: float, curvature: float) -> wp.vec3:
    """Return position and heading (x, y [m], heading [rad]) after a path along an arc."""
    half = 0.5 * length * curvature
    turn = cos_sin(half)
    chord = length * wp.where(wp.abs(half) < 1.0e-3, 1.0 - half * half / 6.0, turn[1] / half)
    ahead = cos_sin(heading + half)
    return wp.vec3(x + chord * ahead[0], y + chord * ahead[1], heading + 2.0 * half)


@wp.func
def roll_on(tail: wp.vec4, tube: wp.vec4, left: float) -> tuple[wp.vec4, wp.vec4]:
    """Return the rest of a tail when the share `left` = exp(-c t) of its length is left."""
    gone = 1.0 - left
    end = arc_end(tail[0], tail[1], tail[2], gone * tail[3], tube[0])
    w0 = tube[1] + gone * (tube[2] + gone * tube[3])
    w1 = (tube[2] + 2.0 * gone * tube[3]) * left
    return wp.vec4(end[0], end[1], end[2], tail[3] * left), wp.vec4(tube[0], w0, w1, tube[3] * left * left)


@wp.func
def error_tube(curvature: float, length: float, place: float, heading: float, along: float, bend: float) -> wp.vec4:
    """Return the tube of a tail for bounds on its errors: position [m], heading [rad], length [m], curvature [1/m].

    The distance of two cars that begin with these differences is at most

        |p_1 - p_2|(q) <= place + integral of (along + L |heading_1 - heading_2|) dq,
        |heading_1 - heading_2|(q) <= heading + bend L q + (|kappa| + bend) along q.
    """
    w2 = 0.5 * length * (bend * length + (wp.abs(curvature) + bend) * along)
    return wp.vec4(curvature, place, along + heading * length, w2)


@wp.func
def lay_out(
    plan_out: wp.array(dtype=wp.vec3), now: wp.vec2, middle: wp.vec3, tail: wp.vec4, tube: wp.vec4, slack: float
):
    """Sample a plan: points x, y, each with a bound on the deviation from the straight line before it [m].

    `middle` is that of the step before the tail, x, y and the bound for either half of it. Along a piece of the tail an
    arc leaves its chord by at most kappa (L / pieces)^2 / 8; `slack` is added to this. The third coordinate of the
    first point is the reach, a bound on the distance of the whole plan from where the car is now.
    """
    part = 1.0 / float(PIECES)
    length = tail[3] * part
    plan_out[1] = wp.vec3(middle[0], middle[1], middle[2] + tube[1])
    plan_out[2] = wp.vec3(tail[0], tail[1], middle[2] + tube[1])
    sagitta = wp.abs(tube[0]) * length * length / 8.0 + slack
    half = 0.5 * length * tube[0]
    end = arc_end(0.0, 0.0, tail[2], length, tube[0])
    turn = cos_sin(2.0 * half)
    way = wp.vec2(end[0], end[1])
    place = wp.vec2(tail[0], tail[1])
    for k in range(PIECES):
        place += way
        way = wp.vec2(turn[0] * way[0] - turn[1] * way[1], turn[1] * way[0] + turn[0] * way[1])
        q = float(k + 1) * part
        plan_out[k + 3] = wp.vec3(place[0], place[1], sagitta + tube[1] + q * (tube[2] + q * tube[3]))
    widest = wp.max(middle[2], sagitta) + tube[1] + tube[2] + tube[3]
    reach = wp.length(wp.vec2(tail[0], tail[1]) - now) + tail[3] + widest
    plan_out[0] = wp.vec3(now[0], now[1], reach)


@wp.func
def room_of_reaches(one: wp.array(dtype=wp.vec3), other: wp.array(dtype=wp.vec3), touch: float) -> float:
    """Return a lower bound of the distance of two plans from their reaches, less `touch` [m]."""
    apart = wp.length(wp.vec2(one[0][0] - other[0][0], one[0][1] - other[0][1]))
    return apart - one[0][2] - other[0][2] - touch


@wp.func
def room_between(one: wp.array(dtype=wp.vec3), other: wp.array(dtype=wp.vec3), touch: float, enough: float) -> float:
    """Return a lower bound of the distance of two cars at equal times on two plans, less `touch` [m].

    If the bound is below `enough`, any value below `enough` is returned. Along each piece it is the closest approach of
    the chords at equal times, less the bounds on both deviations. For two plans that are too far apart to meet, their
    reaches suffice.
    """
    least = room_of_reaches(one, other, touch)
    if least >= 0.0:
        return least
    least = float(1.0e30)
    before = wp.vec2(one[0][0] - other[0][0], one[0][1] - other[0][1])
    for k in range(1, POINTS):
        a = one[k]
        b = other[k]
        after = wp.vec2(a[0] - b[0], a[1] - b[1])
        least = wp.min(least, wp.sqrt(closest_approach(before, after)) - a[2] - b[2] - touch)
        if least < enough:
            break
        before = after
    return least
