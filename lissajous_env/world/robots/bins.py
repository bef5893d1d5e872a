"""Bins: squares of the rectangle, each with a list of the robots that come near it in a step.

Where robots are many, whoever asks who is near a place asks the list of its bin and not every robot. A robot stands in
the list of each bin that its way through the step, widened by `reach` to both sides, touches. So the list of a place's
bin has every robot that came within `reach` of the place at any time of the step; it may have others, and the order is
not defined: who asks measures the distance, and takes the lower index of two robots that are equally near.

A list is walked along, from the first entry of its bin to one without a robot:

    entry = bins.entry[w, bins.first[w, k]]
    while entry[0] >= 0:
        ...  # robot entry[0]
        entry = bins.entry[w, entry[1]]
"""

import math
from typing import Any

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.robots.collisions import PARTED
from lissajous_env.world.robots.sight import planar
from lissajous_env.world.state import REMOVED, Clock, Robots

wp.set_module_options(OPTIONS)

MANY = 100
"""Robots from which on bins are faster than to ask every robot, whatever the number of targets."""
_SOME = 64
_PAIRS = 10_000
"""Pairs of a robot and a target from which on they are where robots are not many, but some."""

_FEWEST = 12
"""Bins below which they do not pay: every list is of nearly every robot."""

_BINS_PER_ROBOT = 16
_AT_LEAST = 1024
_MOST_ENTRIES = 256
"""Entries for each robot that there is room for at most; those for which there is none stand in every list."""


@wp.struct
class Bins:
    """The bins of each world, K of them, P parts into which robots and targets of a world are split among threads."""

    half_width: wp.float32
    half_height: wp.float32
    """Of the rectangle [m]."""
    size: wp.float32
    """Side of a bin [m]."""
    columns: wp.int32
    rows: wp.int32
    """The bins in row k begin with bin k columns; the outermost go on for ever."""
    reach: wp.float32
    """Up to where lists are complete [m]."""
    widened: wp.float32
    """The same, and a margin for rounding [m]."""
    room: wp.int32
    """Entries for lists of one bin; those after them are of the list with which every other ends."""
    first: wp.array2d(dtype=wp.int32)
    """(W, K) first entry of each bin."""
    begun: wp.array3d(dtype=wp.int32)
    """(W, P, K) the same of the robots of a part, before the lists of the parts are joined."""
    entry: wp.array2d(dtype=wp.vec2i)
    """(W, room + N + 1) robot, or -1 at the end, and the next entry; each part has as many of the room."""
    used: wp.array2d(dtype=wp.int32)
    """(W, P) entries that were asked for."""
    everywhere: wp.array(dtype=wp.int32)
    """(W,) robots that stand in every list."""
    is_everywhere: wp.array2d(dtype=wp.int32)
    """(W, N) 1 for these."""
    first_seen: wp.array3d(dtype=wp.int32)
    """(W, P, K) place in `seen` of the first target in sight of each bin, or -1."""
    seen: wp.array2d(dtype=wp.vec4)
    """(W, T) x, y [m], target, and the place of the next one of the same bin and part, or -1; side by side, as they
    are read many times. The places of a part begin where its targets do."""
    seen_used: wp.array2d(dtype=wp.int32)
    """(W, P) how many places are taken."""
    nearest: wp.array3d(dtype=wp.vec2)
    """(W, N, entries) squared distance [radius^2] and index of what a robot sees, while it is being listed."""


@wp.func
def row_of(y: float, bins: Bins) -> int:
    """Row of the bins at y [m]."""
    return int(wp.clamp((y + bins.half_height) / bins.size, 0.0, float(bins.rows - 1)))


@wp.func
def column_of(x: float, bins: Bins) -> int:
    """Column of the bins at x [m]."""
    return int(wp.clamp((x + bins.half_width) / bins.size, 0.0, float(bins.columns - 1)))


@wp.func
def bin_of(place: wp.vec2, bins: Bins) -> int:
    """Bin of a place."""
    return row_of(place[1], bins) * bins.columns + column_of(place[0], bins)


@wp.func
def rows_of(w: int, i: int, widened: float, robots: Robots, bins: Bins) -> wp.vec2i:
    """First and last row that a robot's way through the step, `widened` [m] to both sides, touches."""
    low = robots.track[w, i, 0][1]
    high = low
    for s in range(1, robots.track.shape[2]):
        low = wp.min(low, robots.track[w, i, s][1])
        high = wp.max(high, robots.track[w, i, s][1])
    return wp.vec2i(row_of(low - widened, bins), row_of(high + widened, bins))


@wp.func
def columns_of(w: int, i: int, row: int, widened: float, robots: Robots, bins: Bins) -> wp.vec2i:
    """First and last column in one of these rows."""
    bottom = float(row) * bins.size - bins.half_height
    low = wp.where(row == 0, -1.0e30, bottom - widened)
    high = wp.where(row == bins.rows - 1, 1.0e30, bottom + bins.size + widened)
    left = float(1.0e30)
    right = float(-1.0e30)
    start = planar(robots.track[w, i, 0])
    for s in range(1, robots.track.shape[2]):
        end = planar(robots.track[w, i, s])
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


@wp.func
def list_robot(w: int, i: int, part: int, robots: Robots, bins: Bins) -> int:
    """Put a robot of a part into the lists of the bins that it comes near; returns 1 where there is no room for it."""
    each = bins.room / bins.begun.shape[1]
    rows = rows_of(w, i, bins.widened, robots, bins)
    for row in range(rows[0], rows[1] + 1):
        columns = columns_of(w, i, row, bins.widened, robots, bins)
        for column in range(columns[0], columns[1] + 1):
            used = wp.atomic_add(bins.used, w, part, 1)
            if used >= each:
                return 1
            entry = part * each + used
            after = wp.atomic_exch(bins.begun, w, part, row * bins.columns + column, entry)
            bins.entry[w, entry] = wp.vec2i(i, after)
    return 0


@wp.kernel
def clear_bins(first: int, lanes: int, begin: int, end: int, clock: Clock, bins: Bins):
    """Empty the lists."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    parts = bins.begun.shape[1]
    for part in range(parts):
        for k in range(begin + lane, end, lanes):
            bins.begun[w, part, k] = bins.room
            bins.first_seen[w, part, k] = -1
    if begin == 0:
        for k in range(bins.room + lane, bins.entry.shape[1], lanes):
            bins.entry[w, k] = wp.vec2i(-1, k + 1)
        for part in range(lane, parts, lanes):
            bins.used[w, part] = 0
            bins.seen_used[w, part] = 0
        if lane == 0:
            bins.everywhere[w] = 0


@wp.kernel
def list_robots(first: int, lanes: int, part: int, begin: int, end: int, clock: Clock, robots: Robots, bins: Bins):
    """List the robots that are there, working or not."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    for i in range(begin + lane, end, lanes):
        bins.is_everywhere[w, i] = 0
        if robots.status[w, i] != REMOVED:
            bins.is_everywhere[w, i] = list_robot(w, i, part, robots, bins)


@wp.kernel
def list_everywhere(first: int, lanes: int, clock: Clock, bins: Bins):
    """List the robots for whom there was no room where all lists end."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    for i in range(lane, bins.is_everywhere.shape[1], lanes):
        if bins.is_everywhere[w, i] == 1:
            last = bins.room + wp.atomic_add(bins.everywhere, w, 1)
            bins.entry[w, last] = wp.vec2i(i, last + 1)


@wp.kernel
def join_lists(first: int, lanes: int, begin: int, end: int, clock: Clock, bins: Bins):
    """Make one list of those that the parts of the robots have begun for a bin."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    for k in range(begin + lane, end, lanes):
        start = int(bins.room)
        for part in range(bins.begun.shape[1]):
            begun = bins.begun[w, part, k]
            if begun != bins.room:
                if start != bins.room:
                    place = int(begun)
                    last = bins.entry[w, place]
                    while last[1] != bins.room:
                        place = last[1]
                        last = bins.entry[w, place]
                    bins.entry[w, place] = wp.vec2i(last[0], start)
                start = begun
        bins.first[w, k] = start


def has_bins(scenario: Scenario) -> bool:
    """Whether a resolved scenario is large enough for bins to pay."""
    n = scenario.num_robots
    if n < MANY and (n < _SOME or n * scenario.target_capacity < _PAIRS):
        return False
    *_, columns, rows = _squares(scenario)
    return columns * rows >= _FEWEST


def _squares(scenario: Scenario) -> tuple[float, float, float, int, int]:
    """Reach, the same widened, and side of the bins [m]; their columns and rows."""
    targets, curve = scenario.targets, scenario.curve
    flight = targets.flee_radius if targets.fleeing > 0 else 0.0
    sight = (scenario.sensing.radius or 0.0) + scenario.task.step * targets.speed_max
    reach = max(sight, flight, 2 * float(PARTED) * (scenario.robot.radius or 0.0))
    widened = 1.01 * reach + 1e-6 * max(curve.half_width, curve.half_height)
    most = max(_BINS_PER_ROBOT * scenario.num_robots, _AT_LEAST)
    size = max(widened, math.sqrt(4 * curve.half_width * curve.half_height / most))
    return reach, widened, size, math.ceil(2 * curve.half_width / size), math.ceil(2 * curve.half_height / size)


def bins_of(scenario: Scenario, speed: float, num_worlds: int, parts: int, device: Any) -> Bins:
    """Make the bins of a resolved scenario, of robots that are mostly not faster than `speed` [m/s]."""
    filled, (n, curve) = Bins(), (scenario.num_robots, scenario.curve)
    filled.reach, filled.widened, filled.size, filled.columns, filled.rows = _squares(scenario)
    filled.half_width, filled.half_height = curve.half_width, curve.half_height
    across = 2 * filled.widened / filled.size + 2
    each = min(math.ceil(across * (across + speed * scenario.task.step / filled.size)), _MOST_ENTRIES)
    filled.room, bins = -(-n // parts) * parts * each, filled.columns * filled.rows

    def array(*shape: int, dtype: Any = wp.int32) -> Any:
        return wp.zeros((num_worlds, *shape), dtype=dtype, device=device)

    filled.first, filled.entry = array(bins), array(filled.room + n + 1, dtype=wp.vec2i)
    filled.begun = array(parts, bins) if parts > 1 else filled.first.reshape((num_worlds, 1, bins))
    filled.used, filled.everywhere, filled.is_everywhere = array(parts), array(), array(n)
    filled.first_seen, filled.seen_used = array(parts, bins), array(parts)
    filled.seen = array(scenario.target_capacity, dtype=wp.vec4)
    entries = max(scenario.sensing.robots_seen, scenario.sensing.targets_seen)
    filled.nearest = array(n, entries, dtype=wp.vec2)
    return filled
