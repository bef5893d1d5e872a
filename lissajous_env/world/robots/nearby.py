"""Bins: squares of the rectangle, each with a list of the robots that come near it in a step.

With many robots, kernels read the robots near a place from the list of its bin instead of testing all robots. A robot
is in the list of each bin that its path in the step, widened by `reach` to both sides, crosses. So the list of a
place's bin contains every robot that came within `reach` of the place at any time of the step. It may contain others,
and its order is not defined: kernels measure the distance, and of two robots at the same distance they use the one with
the lower index.

A list is read from the first entry of its bin to an entry without a robot:

    entry = bins.entry[w, bins.first[w, k]]
    while entry[0] >= 0:
        ...  # robot entry[0]
        entry = bins.entry[w, entry[1]]
"""

import math
from typing import Any

import warp as wp

from lissajous_env.device.abreast import ABREAST, Floats, Ints, width
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.stage import BIN, ROBOT, named_struct, part, stage
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.state import REMOVED, planar

wp.set_module_options(OPTIONS)

PARTED = wp.constant(1.05)
"""A collision is over when the distance is above this many times the sum of the radii; lists reach as far."""


@named_struct("bins")
class Bins:
    """The K bins of each world; worlds with few robots have none: K and `columns` are 0."""

    half_width: wp.float32
    half_height: wp.float32
    """Half extents of the rectangle [m]."""
    size: wp.float32
    """Side of a bin [m]."""
    columns: wp.int32
    rows: wp.int32
    """A bin is row * columns + column; the outermost ones are unbounded."""
    reach: wp.float32
    """Distance up to which lists are complete [m]."""
    widened: wp.float32
    """The same, and a margin for rounding [m]."""
    room: wp.int32
    """Number of entries for lists of single bins. Those after them form one more list, with which every list ends."""
    first: wp.array2d(dtype=wp.int32)
    """(W, K) first entry of each bin."""
    entry: wp.array2d(dtype=wp.vec2i)
    """(W, room + N + 1) robot, or -1 at the end, and the next entry."""
    used: wp.array(dtype=wp.int32)
    """(W,) number of entries that the lists require; those above `room` do not exist."""
    everywhere: wp.array(dtype=wp.int32)
    """(W,) number of robots that are in every list."""
    is_everywhere: wp.array2d(dtype=wp.int32)
    """(W, N) 1 for these."""
    first_target: wp.array2d(dtype=wp.int32)
    """(W, K) first of the entries of the targets in sight of each bin, or -1."""
    target_entry: wp.array2d(dtype=wp.vec4)
    """(W, T) x, y [m] of a target in sight, its index, and the entry of the next one in the same bin, or -1. They are
    stored together because they are read many times."""
    targets_used: wp.array(dtype=wp.int32)
    """(W,) number of these entries in use."""


@wp.func
def row_of(y: float, bins: Bins) -> int:
    """Return the row of the bins at y [m]."""
    return int(wp.clamp((y + bins.half_height) / bins.size, 0.0, float(bins.rows - 1)))


@wp.func
def column_of(x: float, bins: Bins) -> int:
    """Return the column of the bins at x [m]."""
    return int(wp.clamp((x + bins.half_width) / bins.size, 0.0, float(bins.columns - 1)))


@wp.func
def bin_of(place: wp.vec2, bins: Bins) -> int:
    """Return the bin of a place."""
    return row_of(place[1], bins) * bins.columns + column_of(place[0], bins)


@part
def rows_crossed(w, i, widened: float, robots, bins) -> wp.vec2i:
    """Return the first and last row that the robot's path in this step crosses, `widened` [m] to both sides."""
    low = robots.path[w, i, 0][1]
    high = low
    for s in range(1, robots.path.shape[2]):
        low = wp.min(low, robots.path[w, i, s][1])
        high = wp.max(high, robots.path[w, i, s][1])
    return wp.vec2i(row_of(low - widened, bins), row_of(high + widened, bins))


@part
def columns_crossed(w, i, row, widened: float, robots, bins) -> wp.vec2i:
    """Return the first and last column of this path in one of these rows."""
    bottom = float(row) * bins.size - bins.half_height
    low = wp.where(row == 0, -1.0e30, bottom - widened)
    high = wp.where(row == bins.rows - 1, 1.0e30, bottom + bins.size + widened)
    left = float(1.0e30)
    right = float(-1.0e30)
    start = planar(robots.path[w, i, 0])
    for s in range(1, robots.path.shape[2]):
        end = planar(robots.path[w, i, s])
        moved = end - start
        enter = float(0.0)
        leave = float(1.0)
        if moved[1] != 0.0:
            one = (low - start[1]) / moved[1]
            other = (high - start[1]) / moved[1]
            enter = wp.max(wp.min(one, other), 0.0)
            leave = wp.min(wp.max(one, other), 1.0)
        elif start[1] < low or start[1] > high:
            leave = -1.0
        if enter <= leave:
            one = start[0] + enter * moved[0]
            other = start[0] + leave * moved[0]
            left = wp.min(left, wp.min(one, other))
            right = wp.max(right, wp.max(one, other))
        start = end
    if left > right:
        return wp.vec2i(0, -1)
    return wp.vec2i(column_of(left - widened, bins), column_of(right + widened, bins))


@part
def list_robot(w, i, robots, bins) -> bool:
    """Put a robot into the lists of the bins that it comes near; return whether there was room for it."""
    rows = rows_crossed(w, i, bins.widened, robots, bins)
    for row in range(rows[0], rows[1] + 1):
        columns = columns_crossed(w, i, row, bins.widened, robots, bins)
        for column in range(columns[0], columns[1] + 1):
            entry = wp.atomic_add(bins.used, w, 1)
            if entry >= bins.room:
                return False
            after = wp.atomic_exch(bins.first, w, row * bins.columns + column, entry)
            bins.entry[w, entry] = wp.vec2i(i, after)
    return True


@stage(BIN, writes="bins: entry, everywhere, first, first_target, targets_used, used")
def clear_bins(w, lane, lanes, clock, bins):
    """Empty the lists."""
    for k in range(lane, bins.first.shape[1], lanes):
        bins.first[w, k] = bins.room
        bins.first_target[w, k] = -1
    for k in range(bins.room + lane, bins.entry.shape[1], lanes):
        bins.entry[w, k] = wp.vec2i(-1, k + 1)
    if lane == 0:
        bins.used[w] = 0
        bins.targets_used[w] = 0
        bins.everywhere[w] = 0


@stage(ROBOT, writes="bins: entry, everywhere, first, is_everywhere, used")
def list_robots(w, i, clock, robots, bins):
    """List the robots that are not removed; one for which there is no room is added to the end of all lists."""
    bins.is_everywhere[w, i] = 0
    if robots.status[w, i] != REMOVED and not list_robot(w, i, robots, bins):
        bins.is_everywhere[w, i] = 1
        last = bins.room + wp.atomic_add(bins.everywhere, w, 1)
        bins.entry[w, last] = wp.vec2i(i, last + 1)


MANY = 64
"""Number of robots from which on bins are faster than a test of every robot."""

_FEWEST = 12
"""Number of bins below which each list has nearly every robot, so that bins do not pay."""

_BINS_PER_ROBOT = 16
_AT_LEAST = 1024
_MOST_ENTRIES = 256
"""Most entries for a robot; a robot that needs more is in every list."""


def has_bins(scenario: Scenario) -> bool:
    """Return whether bins are faster for a resolved scenario."""
    *_, columns, rows = _squares(scenario)
    return scenario.num_robots >= MANY and columns * rows >= _FEWEST


def _squares(scenario: Scenario) -> tuple[float, float, float, int, int]:
    """Return reach, widened reach and size of the bins [m], and the numbers of columns and rows."""
    targets, curve, radius = scenario.targets, scenario.curve, scenario.sight
    reach = max(radius + scenario.task.step * targets.speed_max, 2 * float(PARTED) * (scenario.robot.radius or 0.0))
    if targets.fleeing > 0:
        reach = max(reach, targets.flee_radius)
    widened = 1.01 * reach + 1e-6 * max(curve.half_width, curve.half_height)
    most_bins = max(_BINS_PER_ROBOT * scenario.num_robots, _AT_LEAST)
    size = max(widened, math.sqrt(4 * curve.half_width * curve.half_height / most_bins))
    return reach, widened, size, math.ceil(2 * curve.half_width / size), math.ceil(2 * curve.half_height / size)


def bins_of(scenario: Scenario, speed: float, num_worlds: int, device: Any) -> Any:
    """Make the `Bins` of a resolved scenario whose robots rarely exceed `speed` [m/s]; none if it needs none."""
    filled, (n, curve) = Bins(), (scenario.num_robots, scenario.curve)
    if not has_bins(scenario):
        return filled
    filled.reach, filled.widened, filled.size, filled.columns, filled.rows = _squares(scenario)
    filled.half_width, filled.half_height = curve.half_width, curve.half_height
    bins_across = 2 * filled.widened / filled.size + 2
    entries_each = min(math.ceil(bins_across * (bins_across + speed * scenario.task.step / filled.size)), _MOST_ENTRIES)
    filled.room, bins = n * entries_each, filled.columns * filled.rows

    def array(*shape: int, dtype: Any = wp.int32) -> Any:
        return wp.zeros((num_worlds, *shape), dtype=dtype, device=device)

    filled.first, filled.entry = array(bins), array(filled.room + n + 1, dtype=wp.vec2i)
    filled.used, filled.everywhere, filled.is_everywhere = array(), array(), array(n)
    filled.first_target, filled.targets_used = array(bins), array()
    filled.target_entry = array(scenario.target_capacity, dtype=wp.vec4)
    return filled


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
    """Return index and squared distance [m^2] of the working robot nearest to each of `count` places at x, y [m].

    With bins, only the robots in the list of a place's bin count.
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
                    dx = sensor[0] - x[k]
                    dy = sensor[1] - y[k]
                    square = dx * dx + dy * dy
                    nearest[k] = wp.where(square < least[k], i, nearest[k])
                    least[k] = wp.min(square, least[k])
    return nearest, least


@part
def max_displacement(w, robots) -> float:
    """Return the largest distance of any robot, at any sub-step, from its position at the end of the step [m]."""
    last = robots.path.shape[2] - 1
    square = float(0.0)
    for i in range(robots.path.shape[1]):
        for s in range(last):
            square = wp.max(square, wp.length_sq(robots.path[w, i, last] - robots.path[w, i, s]))
    return wp.sqrt(square)
