"""A quadratic program of two variables: the nearest action in a box and some half-planes, by active sets."""

import warp as wp

TOLERANCE = wp.constant(1.0e-5)
"""Tolerance of the constraints in a solution of the program, in units of the margins."""
HalfPlanes = wp.array(dtype=wp.vec3)
"""Half-planes of actions u, (g0, g1, c) for g.u >= c."""


@wp.func
def half_plane(k: int, n: int, rows: HalfPlanes, top: float, relaxed: float) -> wp.vec3:
    """Return row k of n, relaxed, or for the next four k a side of the box [-1, 1] x [-1, top], as (g0, g1, c)."""
    if k < n:
        return wp.vec3(rows[k][0], rows[k][1], rows[k][2] - relaxed)
    if k == n:
        return wp.vec3(1.0, 0.0, -1.0)
    if k == n + 1:
        return wp.vec3(-1.0, 0.0, -1.0)
    if k == n + 2:
        return wp.vec3(0.0, 1.0, -1.0)
    return wp.vec3(0.0, -1.0, -top)


@wp.func
def violation(n: int, rows: HalfPlanes, u: wp.vec2) -> float:
    """Return max_k c - g.u, and at least 0."""
    most = float(0.0)
    for k in range(n):
        most = wp.max(most, rows[k][2] - rows[k][0] * u[0] - rows[k][1] * u[1])
    return most


@wp.func
def in_box(u: wp.vec2, top: float) -> bool:
    """Return whether an action is in the box, up to rounding."""
    return wp.abs(u[0]) <= 1.00001 and u[1] >= -1.00001 and u[1] <= top + 0.00001


@wp.func
def into_box(u: wp.vec2, top: float) -> wp.vec2:
    """Return the nearest action of the box."""
    return wp.vec2(wp.clamp(u[0], -1.0, 1.0), wp.clamp(u[1], -1.0, top))


@wp.func
def least_violation(n: int, rows: HalfPlanes, top: float) -> float:
    """Return the smallest s >= 0 for which g.u >= c - s has a solution u in the box: a vertex in (u, s)."""
    least = violation(n, rows, wp.vec2(-1.0, -1.0))
    for a in range(n):
        first = half_plane(a, n, rows, top, 0.0)
        for b in range(a + 1, n + 4):
            second = half_plane(b, n, rows, top, 0.0)
            slack = wp.where(b < n, 1.0, 0.0)
            for c in range(b + 1, n + 4):
                third = half_plane(c, n, rows, top, 0.0)
                m = wp.mat33(
                    first[0], first[1], 1.0,
                    second[0], second[1], slack,
                    third[0], third[1], wp.where(c < n, 1.0, 0.0),
                )  # fmt: skip
                if wp.abs(wp.determinant(m)) > 1.0e-9:
                    x = wp.inverse(m) * wp.vec3(first[2], second[2], third[2])
                    u = wp.vec2(x[0], x[1])
                    if in_box(u, top):
                        least = wp.min(least, violation(n, rows, into_box(u, top)))
    return least


@wp.func
def nearest_action(n: int, rows: HalfPlanes, allowed: float, weight: float, top: float, wanted: wp.vec2) -> wp.vec3:
    """Return the best (steering, throttle, cost) over active sets of up to two half-planes; cost inf for none."""
    best = wp.vec3(0.0, 0.0, wp.inf)
    relaxed = allowed - TOLERANCE
    for a in range(-1, n + 4):
        first = half_plane(wp.max(a, 0), n, rows, top, relaxed)
        square = first[0] * first[0] + first[1] * first[1] / weight
        for b in range(a, wp.where(a < 0, 0, n + 4)):  # none is active if a < 0, one if b == a, otherwise two
            u = wanted
            if a >= 0 and b == a and square > 1.0e-10:
                along = (first[2] - first[0] * wanted[0] - first[1] * wanted[1]) / square
                u = wanted + along * wp.vec2(first[0], first[1] / weight)
            elif b > a:
                second = half_plane(b, n, rows, top, relaxed)
                determinant = first[0] * second[1] - first[1] * second[0]
                if wp.abs(determinant) > 1.0e-8:
                    x = first[2] * second[1] - first[1] * second[2]
                    y = first[0] * second[2] - first[2] * second[0]
                    u = wp.vec2(x, y) / determinant
            inside = into_box(u, top)
            away = inside - wanted
            cost = away[0] * away[0] + weight * away[1] * away[1]
            if in_box(u, top) and cost < best[2] and violation(n, rows, inside) <= allowed:
                best = wp.vec3(inside[0], inside[1], cost)
    return best


@wp.func
def solve_quadratic_program(n: int, rows: HalfPlanes, weight: float, top: float, wanted: wp.vec2) -> wp.vec3:
    """Minimise (u0 - w0)^2 + weight (u1 - w1)^2 over the box with g.u >= c for n rows; return (steering, throttle, s).

    If the rows contradict one another or the box, all are relaxed by the same least s > 0.
    """
    best = nearest_action(n, rows, TOLERANCE, weight, top, wanted)
    slack = float(0.0)
    if best[2] == wp.inf:
        slack = least_violation(n, rows, top)
        best = nearest_action(n, rows, slack + TOLERANCE, weight, top, wanted)
    return wp.vec3(best[0], best[1], slack)
