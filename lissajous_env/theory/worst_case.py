"""Lower bounds of the worst-case undetected time: of every motion of a team, against rogues that know it in advance.

N discs of radius r, whose centres move at most at a speed v, sense in a rectangle of area F. Rogues of a speed u can
appear anywhere. T is the longest time for which one can stay undetected. Robots that fail, turn slowly or communicate
only sometimes can only do worse, so the bounds apply to every policy.

**Clearing**, `clearing_time`. Let S, of area s, be where a rogue can be that was present at some moment and has been
undetected since. At that moment it is everything outside of the discs, s >= F - N pi r^2, and after T it is empty.

* The discs clear at most 2 r v N of its area per second.
* A line parallel to a side, but outside of all discs, that S fills in part: rogues that move along it fill u more of it
  per second. The discs meet lines of one direction over a width of at most 2 r N. Hence, if m is the width of the lines
  of one direction that S fills in part, s grows by at least u (m - 2 r N).
* In one of the two directions, m >= min(shorter side, sqrt(s), sqrt(F - s)). Proof: a line that S fills crosses every
  line of the other direction, so the latter are not empty. If there are a full and an empty line of one direction, all
  lines of the other are filled in part: m is at least the shorter side. If not, there is either no full line in both
  directions or no empty one in both; then S, or the remainder, lies where lines filled in part cross, and the product
  of the two widths is at least s, or F - s.

Hence ds/dt >= u max(m - 2 r N, 0) - 2 r v N, which bounds T by an integral over s. Where it is 0 or above for some s,
that area is never cleared: T is infinite. Then N 2 r (u + v) <= u m: the discs, side by side, advance less than what
rogues gain beside them. At u = 0 it is the time of a sweep, (F - N pi r^2) / (2 r v N).

**Revisiting**, `revisiting_time`. Let M > N points have distances of at least d > 2 r. A disc senses one of them at
once, and it takes at least h = (d - 2 r) / v from one to another. A rogue at rest may appear at any point at any
moment, so each must be sensed in every period of length T.

* In each of these periods, some robot senses M / N points, rounded up: T >= (ceil(M / N) - 1) h.
* A robot *attends* a point from when it first senses it to when it last does, before it senses another. In an episode
  of D seconds with n changes from a point to another, robots attend for at most N D - n h, so the points are unattended
  for at least M D - N D + n h. This consists of periods of at most T each. Each begins with such a change, with one of
  the N last departures, or, for each of the M points, at the start: T >= ((M - N) D + n h) / (n + N + M), where n is at
  most N D / h. If this exceeds h, the least T of the first item, it is least for the largest n. In a long episode, it
  is then M h / N.
"""

import math
from collections.abc import Iterator

import numpy as np

_AREAS = 4_001
"""Number of areas between which the integral of `clearing_time` is bounded from below."""
_SHIFTS = np.linspace(0.0, 0.5, 129)
"""Shifts between rows of points, as shares of the distance between points of a row."""
_MOST_POINTS = 4
"""Limit on the points of `revisiting_time` per robot; with more, discs overlap or a sweep is the better bound."""


def clearing_time(
    width: float, height: float, num_robots: int, radius: float, speed: float, rogue_speed: float = 0.0
) -> float:
    """Return the least time in which discs can clear a rectangle of rogues [s]; inf if they never can.

    Args:
        width: Side of the rectangle [m].
        height: Its other side [m].
        num_robots: Number of discs N.
        radius: Their radius r [m].
        speed: Top speed of a disc, v [m/s].
        rogue_speed: Speed of the rogues, u [m/s].
    """
    whole, blocked = width * height, 2 * num_robots * radius
    at_first = max(whole - num_robots * math.pi * radius**2, 0.0)
    left = np.linspace(0.0, at_first, _AREAS)
    crossed = np.minimum(np.minimum(np.sqrt(left), np.sqrt(whole - left)), min(width, height))
    rate = blocked * speed - rogue_speed * np.maximum(crossed - blocked, 0.0)
    if at_first > 0 and (rate <= 0).any():
        return math.inf
    # The width that is crossed rises, then falls: between two areas, it is at least the lesser one.
    return float((left[1] - left[0]) * np.sum(1 / np.maximum(rate[1:], rate[:-1])))


def revisiting_time(
    width: float,
    height: float,
    num_robots: int,
    radius: float,
    speed: float,
    duration: float = math.inf,
    on_boundary: bool = False,
) -> float:
    """Return the least time in which discs can revisit each of the far points of a rectangle [s]; 0 if none are far.

    Args:
        width: Side of the rectangle [m].
        height: Its other side [m].
        num_robots: Number of discs N.
        radius: Their radius r [m].
        speed: Top speed of a disc, v [m/s].
        duration: Length of the episode D [s].
        on_boundary: True for points on the boundary only.
    """
    longest = 0.0
    for sides in ((width, height), (height, width)):
        for points, apart in far_points(*sides, num_robots, rows_max=2 if on_boundary else None):
            takes = np.maximum(apart - 2 * radius, 0.0) / speed
            in_a_period = (np.ceil(points / num_robots) - 1) * takes
            in_all = points * takes / (num_robots + (num_robots + points) * takes / duration)
            longest = max(longest, float(np.maximum(in_a_period, in_all).max()))
    return min(longest, duration)


def far_points(
    width: float, height: float, num_robots: int, rows_max: int | None = None
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield arrays of M > N and of a distance d [m], for which M points of the rectangle are pairwise at least d apart.

    The points lie in rows from side to side, n in each, where every second row is shifted by a share of the distance
    between points; or where every second row has n - 1 points, opposite the middles between those of the others.

    Args:
        width: Side of the rectangle along the rows [m].
        height: Its other side [m].
        num_robots: N.
        rows_max: Limit on the rows; 2 makes all points lie on the boundary.
    """
    most = _MOST_POINTS * num_robots
    for rows in range(1, min(rows_max or most, most) + 1):
        in_row = np.arange(2, max(most // rows, 2) + 2)[:, None]
        gap = height / (rows - 1) if rows > 1 else math.inf
        next_but_one = 2 * gap if rows > 2 else math.inf
        apart = width / (in_row - 1 + _SHIFTS)
        shifted = np.minimum(np.minimum(apart, np.hypot(gap, _SHIFTS * apart)), next_but_one).max(axis=1)
        apart = width / (in_row[:, 0] - 1)
        alternating = np.minimum(np.minimum(apart, np.hypot(gap, apart / 2)), next_but_one)
        points = np.concatenate([rows * in_row[:, 0], rows * in_row[:, 0] - rows // 2])
        enough = points > num_robots
        if enough.any():
            yield points[enough], np.concatenate([shifted, alternating])[enough]
