"""Bins: squares of the rectangle, each with a list of the robots that come near it in a step.

With many robots, kernels read the robots near a place from the list of its bin instead of testing all robots. A robot
is in the list of each bin of the rectangle around its path in the step, widened by `reach` to all sides. So the list of
a place's bin contains every robot that came within `reach` of the place at any time of the step. It may contain others,
and its order is not defined: kernels measure the distance, and of two robots at the same distance they use the one with
the lower index. If robots go so far in a step that there is no room for the lists, all robots are tested in it.

    entry = bins.first[w, k]
    while entry >= 0:
        ...  # robot bins.entry[w, entry][0]
        entry = bins.entry[w, entry][1]
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
    """Number of entries of all lists."""
    first: wp.array2d(dtype=wp.int32)
    """(W, K) first entry of each bin, or -1."""
    entry: wp.array2d(dtype=wp.vec2i)
    """(W, room) robot, and the next entry in the same bin, or -1."""
    used: wp.array(dtype=wp.int32)
    """(W,) number of entries that the lists require; above `room`, there are no lists."""
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
def bins_crossed(w, i, widened: float, robots, bins) -> wp.vec4i:
    """Return first and last row and first and last column of the bins around a path, `widened` [m] to all sides."""
    low = planar(robots.path[w, i, 0])
    high = low
    for s in range(1, robots.path.shape[2]):
        low = wp.min(low, planar(robots.path[w, i, s]))
        high = wp.max(high, planar(robots.path[w, i, s]))
    return wp.vec4i(
        row_of(low[1] - widened, bins),
        row_of(high[1] + widened, bins),
        column_of(low[0] - widened, bins),
        column_of(high[0] + widened, bins),
    )


@wp.func
def has_lists(w: int, bins: Bins) -> bool:
    """Return whether a world has lists in this step."""
    if bins.columns == 0:
        return False
    return bins.used[w] <= bins.room


@stage(BIN, writes="bins: first, first_target, targets_used, used")
def clear_bins(w, lane, lanes, clock, bins):
    """Empty the lists."""
    for k in range(lane, bins.first.shape[1], lanes):
        bins.first[w, k] = -1
        bins.first_target[w, k] = -1
    if lane == 0:
        bins.used[w] = 0
        bins.targets_used[w] = 0


@stage(ROBOT, writes="bins: entry, first, used")
def list_robots(w, i, clock, robots, bins):
    """Put each robot that is not removed into the lists of the bins that it comes near, as far as there is room."""
    if robots.status[w, i] != REMOVED:
        crossed = bins_crossed(w, i, bins.widened, robots, bins)
        for row in range(crossed[0], crossed[1] + 1):
            for column in range(crossed[2], crossed[3] + 1):
                entry = wp.atomic_add(bins.used, w, 1)
                if entry < bins.room:
                    after = wp.atomic_exch(bins.first, w, row * bins.columns + column, entry)
                    bins.entry[w, entry] = wp.vec2i(i, after)


MANY = 64
"""Number of robots from which on bins are faster than a test of every robot."""

_FEWEST = 12
"""Number of bins below which each list has nearly every robot, so that bins do not pay."""

_BINS_PER_ROBOT = 16
_AT_LEAST = 1024
_MOST_ENTRIES = 256
"""Most entries for a robot."""


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
    across = (2 * filled.widened + speed * scenario.task.step) / filled.size + 2
    filled.room, bins = n * min(math.ceil(across**2), _MOST_ENTRIES), filled.columns * filled.rows

    def array(*shape: int, dtype: Any = wp.int32) -> Any:
        return wp.zeros((num_worlds, *shape), dtype=dtype, device=device)

    filled.first, filled.entry = array(bins), array(filled.room, dtype=wp.vec2i)
    filled.used, filled.first_target, filled.targets_used = array(), array(bins), array()
    filled.target_entry = array(scenario.target_capacity, dtype=wp.vec4)
    return filled


@part
def nearest_listed(w, place: wp.vec2, robots, bins) -> wp.vec2:
    """Return (index, squared distance [m^2]) of the working robot nearest to a place in the list of its bin."""
    nearest = int(0)
    least = float(1.0e30)
    entry = bins.first[w, bin_of(place, bins)]
    while entry >= 0:
        i = bins.entry[w, entry][0]
        away = robots.sensor[w, i] - place
        square = wp.dot(away, away)
        if square < least or (square == least and i < nearest):
            least = square
            nearest = i
        entry = bins.entry[w, entry][1]
    return wp.vec2(float(nearest), least)


@part
def nearest_sensors(w, count: int, x: Floats, y: Floats, robots, bins) -> tuple[Ints, Floats]:
    """Return index and squared distance [m^2] of the working robot nearest to each of `count` places at x, y [m].

    With bins, only the robots in the list of a place's bin count.
    """
    nearest = Ints()
    least = Floats(1.0e30)
    if has_lists(w, bins):
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
