"""Tails: the paths of cars that coast to rest with the motor off and constant steering, with bounds on their errors.

A car whose motor is off slows down by v' = -c v, equation (12), whatever its motor and its wheelbase. With constant
steering it follows an arc of curvature kappa, and with q = 1 - exp(-c t) it has gone q L of the length L = v / c that
is left to it. All cars have the same c, so for q from 0 to 1 every car moves along its arc at a constant rate. It is
within w(q) = w_0 + w_1 q + w_2 q^2 of the arc's point at q, for every position, heading, speed and curvature that the
bounds of noise and model allow (`own_motion.tail_from`).

A course is a step and the tail after it, as sampled points (`lay_out`). Two courses are compared at equal times
(`gap_at_equal_times`) or, where a robot may stop dead, at any two times that matter (`swept_gap`): a car that stops
dead at a time stands at its course's place of that time while the other one drives on.
"""

import warp as wp

from lissajous_env.device.trig import cos_sin
from lissajous_env.world.robots.contacts import closest_approach

PIECES = wp.constant(16)
"""Pieces of a tail between its sampled points, in equal steps of q."""
POINTS = wp.constant(int(PIECES) + 3)
"""Sampled points of a course: the position of the car, the middle of the step, and PIECES + 1 points of its tail."""
Course = wp.array(dtype=wp.vec3)
"""Sampled points of a course (POINTS,), as `lay_out` writes them."""


@wp.struct
class Tail:
    """A tail, with the bound w(q) on the distance of the car from it."""

    begin: wp.vec3
    """x, y [m] and heading [rad] where it begins."""
    length: float
    """L [m]."""
    curvature: float
    """kappa [1/m]."""
    steering: float
    """Action of the steering, in [-1, 1]."""
    w: wp.vec3
    """Coefficients of w(q) [m]: w(0), w'(0) and w''(0) / 2."""


@wp.func
def arc_end(begin: wp.vec3, length: float, curvature: float) -> wp.vec3:
    """Return position and heading (x, y [m], heading [rad]) after a path along an arc, from those at its beginning."""
    half = 0.5 * length * curvature
    turn = cos_sin(half)
    chord = length * wp.where(wp.abs(half) < 1.0e-3, 1.0 - half * half / 6.0, turn[1] / half)
    ahead = cos_sin(begin[2] + half)
    return wp.vec3(begin[0] + chord * ahead[0], begin[1] + chord * ahead[1], begin[2] + 2.0 * half)


@wp.func
def place_on(tail: Tail, q: float) -> wp.vec3:
    """Return position and heading (x, y [m], heading [rad]) on a tail, after the share q of its length."""
    return arc_end(tail.begin, q * tail.length, tail.curvature)


@wp.func
def error_on(tail: Tail, q: float) -> float:
    """Return w(q), the bound on the distance of the car from its place on a tail [m]."""
    return tail.w[0] + q * (tail.w[1] + q * tail.w[2])


@wp.func
def roll_on(tail: Tail, decay: float) -> Tail:
    """Return the rest of a tail when the share `decay` = exp(-c t) of its length is left."""
    gone = 1.0 - decay
    slope = (tail.w[1] + 2.0 * gone * tail.w[2]) * decay
    w = wp.vec3(error_on(tail, gone), slope, tail.w[2] * decay * decay)
    return Tail(place_on(tail, gone), tail.length * decay, tail.curvature, tail.steering, w)


@wp.func
def lay_out(course_out: Course, now: wp.vec2, middle: wp.vec3, tail: Tail, slack: float):
    """Sample a course: points x, y, each with a bound on the deviation from the straight line before it [m].

    `middle` is the middle of the step before the tail: x, y and the bound for either half of the step. Along a piece of
    the tail, an arc leaves its chord by at most kappa (L / pieces)^2 / 8, to which `slack` is added. The third
    coordinate of the first point is the reach, a bound on the distance of the whole course from the car's position.
    """
    part = 1.0 / float(PIECES)
    length = tail.length * part
    course_out[1] = wp.vec3(middle[0], middle[1], middle[2] + tail.w[0])
    course_out[2] = wp.vec3(tail.begin[0], tail.begin[1], middle[2] + tail.w[0])
    sagitta = wp.abs(tail.curvature) * length * length / 8.0 + slack
    end = arc_end(wp.vec3(0.0, 0.0, tail.begin[2]), length, tail.curvature)
    turn = cos_sin(length * tail.curvature)
    onward = wp.vec2(end[0], end[1])
    place = wp.vec2(tail.begin[0], tail.begin[1])
    for k in range(PIECES):
        place += onward
        onward = wp.vec2(turn[0] * onward[0] - turn[1] * onward[1], turn[1] * onward[0] + turn[0] * onward[1])
        course_out[k + 3] = wp.vec3(place[0], place[1], sagitta + error_on(tail, float(k + 1) * part))
    widest = wp.max(middle[2], sagitta) + tail.w[0] + tail.w[1] + tail.w[2]
    reach = wp.length(wp.vec2(tail.begin[0], tail.begin[1]) - now) + tail.length + widest
    course_out[0] = wp.vec3(now[0], now[1], reach)


@wp.func
def gap_at_equal_times(one: Course, other: Course, required: float, enough: float) -> float:
    """Return `gap_between` the courses of two cars that cannot stop dead.

    Along each piece it is the closest approach of the chords at equal times, less the bounds on both deviations.
    """
    least = float(wp.inf)
    before = wp.vec2(one[0][0] - other[0][0], one[0][1] - other[0][1])
    for k in range(1, POINTS):
        a = one[k]
        b = other[k]
        after = wp.vec2(a[0] - b[0], a[1] - b[1])
        least = wp.min(least, wp.sqrt(closest_approach(before, after)) - a[2] - b[2] - required)
        if least < enough:
            break
        before = after
    return least


@wp.func
def segment_distance(a: wp.vec3, a_end: wp.vec3, b: wp.vec3, b_end: wp.vec3) -> float:
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
def swept_gap(one: Course, other: Course, stops: bool, other_stops: bool, required: float, enough: float) -> float:
    """Return `gap_between` the courses of two cars of which either may stop dead, at most 0.

    A car that `stops` can be at any earlier place of its course than at equal times: the places of piece k are compared
    with those of all pieces m >= k of the other course, with those of k >= m if the other one stops, and with all if
    both do. The distance of piece k from the next piece is at most shorter by the length of that one, so `clear` is a
    lower bound of it, and no distance is computed while this bound is large enough.
    """
    least = float(0.0)
    for k in range(POINTS - 1):
        a_end = one[k + 1]
        length = wp.length(wp.vec2(a_end[0] - one[k][0], a_end[1] - one[k][1]))
        to_end = wp.length(wp.vec2(a_end[0] - other[0][0], a_end[1] - other[0][1]))
        clear = to_end - length - a_end[2]
        if clear >= other[0][2] + required:
            continue  # it is farther away than the reach of the other course
        m = int(0)  # a loop over a range is a third slower
        while m < POINTS - 1:
            b_end = other[m + 1]
            clear -= wp.length(wp.vec2(b_end[0] - other[m][0], b_end[1] - other[m][1]))
            if clear < b_end[2] + required and (stops or k >= m) and (other_stops or m >= k):
                clear = segment_distance(one[k], a_end, other[m], b_end) - a_end[2]
                least = wp.min(least, clear - b_end[2] - required)
                if least < enough:
                    return least
            m += 1
    return least


@wp.func
def gap_between(one: Course, other: Course, stops: bool, other_stops: bool, required: float, enough: float) -> float:
    """Return a lower bound of the distance of two cars on two courses, less `required` [m].

    A car that `stops` may stop dead. If the bound is below `enough`, which is at most 0, any value below `enough` is
    returned. For two courses that are too far apart to meet, their reaches suffice.
    """
    apart = wp.length(wp.vec2(one[0][0] - other[0][0], one[0][1] - other[0][1])) - one[0][2] - other[0][2] - required
    if apart >= 0.0:
        return apart
    if stops or other_stops:
        return swept_gap(one, other, stops, other_stops, required, enough)
    return gap_at_equal_times(one, other, required, enough)
