"""Robots that have a place in their sensing discs, at the end of a step and first within it.

Within a step a target goes straight from its old place to its new one at one speed, past the robots, each of which goes
along its track of sub-steps.
"""

import warp as wp

from lissajous_env.device.abreast import ABREAST, Floats, Ints, width
from lissajous_env.device.approach import first_within
from lissajous_env.device.stage import part
from lissajous_env.world.robots.bins import Bins, bin_of
from lissajous_env.world.state import NOWHERE, planar


@part
def nearest_listed(w, place: wp.vec2, robots, bins) -> wp.vec2:
    """Return (index, squared distance [m^2]) of the working robot nearest to a place in the list of its bin."""
    nearest = int(0)
    least = float(1.0e30)
    entry = bins.entry[w, bins.first[w, bin_of(place, bins)]]
    while entry[0] >= 0:
        i = entry[0]
        away = robots.sensor[w, i] - place
        square = wp.dot(away, away)
        if square < least or (square == least and i < nearest):
            least = square
            nearest = i
        entry = bins.entry[w, entry[1]]
    return wp.vec2(float(nearest), least)


@part
def nearest_sensors(w, count: int, x: Floats, y: Floats, robots, bins) -> tuple[Ints, Floats]:
    """Return index and squared distance [m^2] of the working robots nearest to `count` places side by side.

    With bins, robots are only those in the lists of the places.
    """
    nearest = Ints()
    least = Floats(1.0e30)
    if bins.columns > 0:
        for k in range(count):
            listed = nearest_listed(w, wp.vec2(x[k], y[k]), robots, bins)
            nearest[k] = int(listed[0])
            least[k] = listed[1]
    else:
        for i in range(robots.sensor.shape[1]):
            sensor = robots.sensor[w, i]
            for k in range(ABREAST):
                if k < width():
                    across = sensor[0] - x[k]
                    up = sensor[1] - y[k]
                    square = across * across + up * up
                    nearest[k] = wp.where(square < least[k], i, nearest[k])
                    least[k] = wp.min(square, least[k])
    return nearest, least


@part
def max_displacement(w, robots) -> float:
    """Return the largest distance, over robots and the step, from the position at its end [m]."""
    last = robots.track.shape[2] - 1
    square = float(0.0)
    for i in range(robots.track.shape[1]):
        for s in range(last):
            square = wp.max(square, wp.length_sq(robots.track[w, i, last] - robots.track[w, i, s]))
    return wp.sqrt(square)


@part
def share_until_sight(w, i, before: wp.vec2, after: wp.vec2, radius: float, robots) -> float:
    """Return the share of the step until a robot detects a target that moves as in `first_sight`; 2 for never."""
    pieces = robots.track.shape[2] - 1
    moved = (after - before) / float(pieces)
    start = before - planar(robots.track[w, i, 0])
    for s in range(pieces):
        end = before + float(s + 1) * moved - planar(robots.track[w, i, s + 1])
        share = first_within(start, end, radius)
        if share <= 1.0:
            return (float(s) + share) / float(pieces)
        start = end
    return 2.0


@wp.func
def leaves_lists(before: wp.vec2, after: wp.vec2, radius: float, bins: Bins) -> bool:
    """Return whether a target moved too far for the list of the bin in which it was to contain all that detect it.

    Half of the margin of the lists is for the rounding of a target that moves exactly as far as they reach.
    """
    return wp.length(after - before) > 0.5 * (bins.reach + bins.widened) - radius


@part
def first_sight(w, before: wp.vec2, after: wp.vec2, radius: float, reach: float, robots, bins) -> wp.vec2:
    """Return (index of the robot that first has a target in its disc, share of the step until then; 2 for none).

    The target goes from `before` to `after` [m] at one speed; where a wall reflects it, that cuts the corner. Robots
    that end the step beyond `reach` [m] of `after`, as those that do not work, are passed over. A robot that resumes
    works from the beginning of its first step on. With bins, robots are those in the list of the bin in which the
    target was, unless it moved far.
    """
    finder = int(-1)
    least = float(2.0)
    if bins.columns > 0 and not leaves_lists(before, after, radius, bins):
        entry = bins.entry[w, bins.first[w, bin_of(before, bins)]]
        while entry[0] >= 0:
            i = entry[0]
            if robots.sensor[w, i][0] < NOWHERE:
                share = share_until_sight(w, i, before, after, radius, robots)
                if share < least or (share == least and i < finder):
                    least = share
                    finder = i
            entry = bins.entry[w, entry[1]]
    elif reach > 0.0:
        for i in range(robots.sensor.shape[1]):
            if wp.length_sq(robots.sensor[w, i] - after) < reach * reach:
                share = share_until_sight(w, i, before, after, radius, robots)
                if share < least:
                    least = share
                    finder = i
    return wp.vec2(float(finder), least)
