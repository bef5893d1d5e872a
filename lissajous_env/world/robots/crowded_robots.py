"""Collisions, and the robots and targets that a robot sees, where robots or targets are many: through bins.

The same numbers as those of `lissajous_env.world.robots.collisions` and `observation`, to the last bit.
"""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.part_structs import RobotStruct, SensingStruct
from lissajous_env.world.observation import (
    LINK,
    OWN,
    ROBOT,
    TARGET,
    clear,
    observe_ring,
    observe_self,
    velocity,
)
from lissajous_env.world.robots.bins import Bins, bin_of, column_of, columns_of, row_of, rows_of
from lissajous_env.world.robots.collisions import PARTED, compare_pair, compare_with_all
from lissajous_env.world.robots.sight import longest_way, planar
from lissajous_env.world.state import NOWHERE, REMOVED, WORKING, Clock, Counted, Links, Robots, Tally, Targets

wp.set_module_options(OPTIONS)


@wp.func
def compare_with_listed(
    w: int,
    i: int,
    k: int,
    now: int,
    part: int,
    touch: float,
    beyond: float,
    places: wp.array(dtype=int),
    robots: Robots,
    bins: Bins,
    tally: Tally,
    counted: Counted,
) -> float:
    """`compare_pair` with the robots after this one that are in the list of bin k; some are in several lists."""
    nearest = float(1.0e30)
    entry = bins.entry[w, bins.first[w, k]]
    while entry[0] >= 0:
        j = entry[0]
        if j > i:
            nearest = wp.min(nearest, compare_pair(w, i, j, now, part, touch, beyond, places, robots, tally, counted))
        entry = bins.entry[w, entry[1]]
    return nearest


@wp.kernel
def find_listed_collisions(
    first: int,
    lanes: int,
    part: int,
    begin: int,
    end: int,
    robot: RobotStruct,
    places: wp.array(dtype=int),
    clock: Clock,
    robots: Robots,
    bins: Bins,
    tally: Tally,
    counted: Counted,
):
    """Compare robot i with the robots after it that came near it, over the sub-steps of the latest step."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    now = clock.step[w]
    touch = 2.0 * robot.radius
    beyond = wp.max(tally.min_separation[w], PARTED * touch)
    # In the first step of an episode, and as long as no two robots were within reach, the nearest is in no list.
    ask_all = beyond > bins.reach
    way = float(1.0e30)
    if beyond < 1.0e30:
        way = longest_way(w, robots)
    nearest = float(1.0e30)
    for i in range(begin + lane, end, lanes):
        if robots.status[w, i] != REMOVED:
            if ask_all or bins.is_everywhere[w, i] == 1:
                least = compare_with_all(w, i, now, part, touch, beyond, way, places, robots, tally, counted)
                nearest = wp.min(nearest, least)
            else:
                # Whoever comes within reach of a place on its way is in the list of that place's bin.
                rows = rows_of(w, i, 0.0, robots, bins)
                for row in range(rows[0], rows[1] + 1):
                    columns = columns_of(w, i, row, 0.0, robots, bins)
                    for column in range(columns[0], columns[1] + 1):
                        k = row * bins.columns + column
                        least = compare_with_listed(
                            w, i, k, now, part, touch, beyond, places, robots, bins, tally, counted
                        )
                        nearest = wp.min(nearest, least)
    if nearest < 1.0e30:
        wp.atomic_min(counted.min_separation, w, part, wp.sqrt(nearest))


@wp.func
def comes_before(one: wp.vec2, other: wp.vec2) -> bool:
    """Whether one (squared distance, index) is nearer than the other or, where both are as near, the first."""
    return one[0] < other[0] or (one[0] == other[0] and one[1] < other[1])


@wp.func
def keep_nearest(w: int, i: int, kept: int, room: int, offset: wp.vec2, index: int, bins: Bins) -> int:
    """Enter what a robot sees at `offset` among the nearest that it sees, in their order; returns how many are kept."""
    new = wp.vec2(wp.dot(offset, offset), float(index))
    place = int(kept)
    while place > 0:
        if not comes_before(new, bins.nearest[w, i, place - 1]):
            break
        place -= 1
    is_known = bool(False)  # a robot may be in a list twice
    if place > 0:
        is_known = bins.nearest[w, i, place - 1] == new
    if place == room or is_known:
        return kept
    for k in range(wp.min(kept, room - 1), place, -1):
        bins.nearest[w, i, k] = bins.nearest[w, i, k - 1]
    bins.nearest[w, i, place] = new
    return wp.min(kept + 1, room)


@wp.func
def nearest_robots(w: int, i: int, room: int, radius: float, robots: Robots, bins: Bins) -> int:
    """Find the nearest robots in the disc; returns how many, at most `room`."""
    here = planar(robots.position[w, i])
    kept = int(0)
    entry = bins.entry[w, bins.first[w, bin_of(here, bins)]]
    while entry[0] >= 0:
        j = entry[0]
        away = planar(robots.position[w, j]) - here
        if wp.dot(away, away) < radius * radius and j != i and robots.status[w, j] != REMOVED:
            kept = keep_nearest(w, i, kept, room, away / radius, j, bins)
        entry = bins.entry[w, entry[1]]
    return kept


@wp.func
def nearest_targets(w: int, i: int, room: int, radius: float, robots: Robots, bins: Bins) -> int:
    """Find the nearest targets in the disc; returns how many, at most `room`."""
    here = robots.sensor[w, i]
    kept = int(0)
    left = column_of(here[0] - bins.widened, bins)
    right = column_of(here[0] + bins.widened, bins)
    for row in range(row_of(here[1] - bins.widened, bins), row_of(here[1] + bins.widened, bins) + 1):
        for column in range(left, right + 1):
            for part in range(bins.first_seen.shape[1]):
                place = bins.first_seen[w, part, row * bins.columns + column]
                while place >= 0:
                    seen = bins.seen[w, place]
                    away = wp.vec2(seen[0], seen[1]) - here
                    if wp.dot(away, away) < radius * radius:
                        kept = keep_nearest(w, i, kept, room, away / radius, int(seen[2]), bins)
                    place = int(seen[3])
    return kept


@wp.func
def list_robots_seen(
    w: int,
    i: int,
    sensing: SensingStruct,
    speed_unit: float,
    robots: Robots,
    bins: Bins,
    observation_out: wp.array3d(dtype=float),
):
    """List the nearest robots in the disc."""
    kept = int(0)
    if sensing.robots_seen > 0 and robots.status[w, i] == WORKING:
        kept = nearest_robots(w, i, sensing.robots_seen, sensing.radius, robots, bins)
    entry = OWN + 2 * LINK
    clear(w, i, entry + ROBOT * kept, entry + ROBOT * sensing.robots_seen, observation_out)
    for k in range(kept):
        j = int(bins.nearest[w, i, k][1])
        offset = (planar(robots.position[w, j]) - planar(robots.position[w, i])) / sensing.radius
        relative = (velocity(w, j, robots) - velocity(w, i, robots)) / (2.0 * speed_unit)
        observation_out[w, i, entry] = 1.0
        observation_out[w, i, entry + 1] = offset[0]
        observation_out[w, i, entry + 2] = offset[1]
        observation_out[w, i, entry + 3] = wp.clamp(relative[0], -1.0, 1.0)
        observation_out[w, i, entry + 4] = wp.clamp(relative[1], -1.0, 1.0)
        entry += ROBOT


@wp.func
def list_targets_seen(
    w: int,
    i: int,
    sensing: SensingStruct,
    robots: Robots,
    targets: Targets,
    bins: Bins,
    observation_out: wp.array3d(dtype=float),
):
    """List the nearest targets in the disc."""
    kept = int(0)
    if sensing.targets_seen > 0 and robots.sensor[w, i][0] < NOWHERE:
        kept = nearest_targets(w, i, sensing.targets_seen, sensing.radius, robots, bins)
    entry = OWN + 2 * LINK + ROBOT * sensing.robots_seen
    clear(w, i, entry + TARGET * kept, entry + TARGET * sensing.targets_seen, observation_out)
    for k in range(kept):
        offset = (targets.position[w, int(bins.nearest[w, i, k][1])] - robots.sensor[w, i]) / sensing.radius
        observation_out[w, i, entry] = 1.0
        observation_out[w, i, entry + 1] = offset[0]
        observation_out[w, i, entry + 2] = offset[1]
        entry += TARGET


@wp.kernel
def observe_listed(
    first: int,
    lanes: int,
    begin: int,
    end: int,
    curve: CurveStruct,
    sensing: SensingStruct,
    age_per_step: float,
    speed_unit: float,
    clock: Clock,
    robots: Robots,
    links: Links,
    targets: Targets,
    bins: Bins,
    observation_out: wp.array3d(dtype=float),
):
    """Fill the row of each robot."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    for i in range(begin + lane, end, lanes):
        observe_self(w, i, curve, speed_unit, robots, observation_out)
        observe_ring(w, i, clock.step[w], curve, age_per_step, robots, links, observation_out)
        list_robots_seen(w, i, sensing, speed_unit, robots, bins, observation_out)
        list_targets_seen(w, i, sensing, robots, targets, bins, observation_out)
