"""The stage that fills the observation: `lissajous_env.world.observation` documents its entries.

With many robots, a robot searches the bins near it for robots and targets, with the same result to the last bit.
"""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.stage import ROBOT, part, stage
from lissajous_env.device.trig import cos_sin
from lissajous_env.world.observation import LINK_SIZE, OWN_SIZE, ROBOT_SIZE, TARGET_SIZE
from lissajous_env.world.robots.nearby import bin_of, column_of, has_lists, row_of
from lissajous_env.world.state import NOWHERE, REMOVED, WORKING, planar

wp.set_module_options(OPTIONS)

FARTHEST = wp.constant(4.0)
"""Largest scaled coordinate of an observation."""


@part
def clear_entries(w, i, start: int, stop: int, observation):
    """Zero the entries from `start` to before `stop` of a row."""
    for k in range(start, stop):
        observation[w, i, k] = 0.0


@part
def clear_slots(w, i, start: int, width: int, count: int, observation):
    """Zero `count` slots of `width` entries from `start` on, up to the first empty one; those after it are empty."""
    for entry in range(start, start + count * width, width):
        if observation[w, i, entry] == 0.0:
            break
        clear_entries(w, i, entry, entry + width, observation)


@part
def velocity_of(w, i, robots) -> wp.vec2:
    """Return the velocity of a robot along its heading [m/s]."""
    return robots.speed[w, i] * cos_sin(robots.heading[w, i])


@wp.func
def clip_coordinate(value: float) -> float:
    """Clip a scaled coordinate to the range of the observation."""
    return wp.clamp(value, -FARTHEST, FARTHEST)


@part
def observe_self(w, i, curve, speed_unit, robots, observation):
    """Fill `OWN_ENTRIES`."""
    own = robots.measured[w, i]
    turn = robots.measured_turn[w, i]
    observation[w, i, 0] = clip_coordinate(own[0] / curve.half_width)
    observation[w, i, 1] = clip_coordinate(own[1] / curve.half_height)
    observation[w, i, 2] = turn[2]
    observation[w, i, 3] = turn[3]
    observation[w, i, 4] = clip_coordinate(own[3] / speed_unit)
    observation[w, i, 5] = turn[0]
    observation[w, i, 6] = turn[1]
    observation[w, i, 7] = wp.where(robots.status[w, i] == WORKING, 1.0, 0.0)


@part
def observe_ring(w, i, now, curve, age_per_step, message_start, robots, links, messages, observation):
    """Fill `NEIGHBOUR_ENTRIES` of both ring neighbours, and the entries of their policies' messages."""
    own = robots.measured[w, i]
    turn = robots.measured_turn[w, i]
    removed = robots.status[w, i] == REMOVED
    size = messages.heard.shape[3]
    for side in range(2):
        start = OWN_SIZE + LINK_SIZE * side
        heard_at = links.heard_at[w, i, side]
        if heard_at < 0 or removed:
            clear_entries(w, i, start, start + LINK_SIZE, observation)
        else:
            message = links.heard[w, i, side]
            observation[w, i, start] = 1.0
            observation[w, i, start + 1] = wp.min(float(now - heard_at) * age_per_step, 1.0)
            observation[w, i, start + 2] = wp.clamp(message[0] * turn[0] + message[1] * turn[1], -1.0, 1.0)
            observation[w, i, start + 3] = wp.clamp(message[1] * turn[0] - message[0] * turn[1], -1.0, 1.0)
            observation[w, i, start + 4] = clip_coordinate(0.5 * (message[2] - own[0]) / curve.half_width)
            observation[w, i, start + 5] = clip_coordinate(0.5 * (message[3] - own[1]) / curve.half_height)
    if size > 0:  # a loop within the other would take time also without messages
        for side in range(2):
            for m in range(size):
                heard = wp.where(removed, 0.0, messages.heard[w, i, side, m])
                observation[w, i, message_start + side * size + m] = heard


@wp.func
def comes_before(one: wp.vec2, other: wp.vec2) -> bool:
    """Return whether one (squared distance, index) is nearer than the other or, if equally near, of lower index."""
    return one[0] < other[0] or (one[0] == other[0] and one[1] < other[1])


@part
def insert_nearest(w, i, filled: int, room: int, offset: wp.vec2, index: int, nearest) -> int:
    """Insert an object into the sorted list `nearest` of a robot; return the length of the list, at most `room`.

    `filled` is its length before, and `offset` the object's position relative to the robot, in the unit of the list.
    """
    new = wp.vec2(wp.dot(offset, offset), float(index))
    rank = int(filled)
    while rank > 0:
        if not comes_before(new, nearest[w, i, rank - 1]):
            break
        rank -= 1
    is_listed = bool(False)  # a list of bins may contain a robot twice
    if rank > 0:
        is_listed = nearest[w, i, rank - 1] == new
    if rank == room or is_listed:
        return filled
    for k in range(wp.min(filled, room - 1), rank, -1):
        nearest[w, i, k] = nearest[w, i, k - 1]
    nearest[w, i, rank] = new
    return wp.min(filled + 1, room)


@part
def insert_if_in_sight(w, i, j, filled: int, room: int, radius: float, robots, nearest) -> int:
    """Insert robot j as `insert_nearest` does, if it is within `radius` [m]."""
    away = planar(robots.position[w, j]) - planar(robots.position[w, i])
    if wp.dot(away, away) < radius * radius and j != i and robots.status[w, j] != REMOVED:
        return insert_nearest(w, i, filled, room, away / radius, j, nearest)
    return filled


@part
def nearest_robots(w, i, room: int, radius: float, robots, bins, nearest) -> int:
    """List the nearest robots within `radius` [m] in `nearest`; return their number, at most `room`."""
    filled = int(0)
    if has_lists(w, bins):
        entry = bins.first[w, bin_of(planar(robots.position[w, i]), bins)]
        while entry >= 0:
            filled = insert_if_in_sight(w, i, bins.entry[w, entry][0], filled, room, radius, robots, nearest)
            entry = bins.entry[w, entry][1]
    else:
        for j in range(robots.status.shape[1]):
            filled = insert_if_in_sight(w, i, j, filled, room, radius, robots, nearest)
    return filled


_IN_DISC = """
    const int together = 32, left = in_sight.shape[1] - first;
    const wp::vec2* positions = &wp::index(position, w, first);
    const int* seen = &wp::index(in_sight, w, first);
    const float square = radius * radius;
    unsigned int near = 0;
    for (int k = 0; k < (left < together ? left : together); ++k) {
        const float x = positions[k][0] - place[0], y = positions[k][1] - place[1];
        near |= (unsigned int)(seen[k] == 1 & x * x + y * y < square) << k;
    }
    return near;
"""


@wp.func_native(_IN_DISC)
def in_disc(
    w: int,
    first: int,
    place: wp.vec2,
    radius: float,
    position: wp.array2d(dtype=wp.vec2),
    in_sight: wp.array2d(dtype=int),
) -> wp.uint32:
    """Return a bit for each of 32 targets, from `first` on, that is in sight and within `radius` of `place` [m].

    It is in C++ because SIMD halves the time of the observation.
    """
    ...


@part
def nearest_targets(w, i, room: int, radius: float, robots, targets, bins, nearest) -> int:
    """List the nearest targets within `radius` [m] in `nearest`; return their number, at most `room`."""
    here = robots.sensor[w, i]
    filled = int(0)
    if bins.columns > 0:
        left = column_of(here[0] - bins.widened, bins)
        right = column_of(here[0] + bins.widened, bins)
        for row in range(row_of(here[1] - bins.widened, bins), row_of(here[1] + bins.widened, bins) + 1):
            for column in range(left, right + 1):
                entry = bins.first_target[w, row * bins.columns + column]
                while entry >= 0:
                    target = bins.target_entry[w, entry]
                    away = wp.vec2(target[0], target[1]) - here
                    if wp.dot(away, away) < radius * radius:
                        filled = insert_nearest(w, i, filled, room, away / radius, int(target[2]), nearest)
                    entry = int(target[3])
    else:
        for first in range(0, targets.in_sight.shape[1], 32):
            near = in_disc(w, first, here, radius, targets.position, targets.in_sight)
            while near != wp.uint32(0):
                t = first + int(wp.bit_count(~near & (near - wp.uint32(1))))
                near &= near - wp.uint32(1)
                filled = insert_nearest(w, i, filled, room, (targets.position[w, t] - here) / radius, t, nearest)
    return filled


@part
def observe_robots(w, i, filled: int, sensing, speed_unit, robots, nearest, observation):
    """Fill the entries of the robots in `nearest`, and clear those of the other slots."""
    entry = OWN_SIZE + 2 * LINK_SIZE
    for k in range(filled):
        j = int(nearest[w, i, k][1])
        offset = (planar(robots.position[w, j]) - planar(robots.position[w, i])) / sensing.sight
        relative = (velocity_of(w, j, robots) - velocity_of(w, i, robots)) / (2.0 * speed_unit)
        observation[w, i, entry] = 1.0
        observation[w, i, entry + 1] = offset[0]
        observation[w, i, entry + 2] = offset[1]
        observation[w, i, entry + 3] = wp.clamp(relative[0], -1.0, 1.0)
        observation[w, i, entry + 4] = wp.clamp(relative[1], -1.0, 1.0)
        entry += ROBOT_SIZE
    clear_slots(w, i, entry, ROBOT_SIZE, sensing.robots_seen - filled, observation)


@part
def observe_targets(w, i, filled: int, sensing, robots, targets, nearest, observation):
    """Fill the entries of the targets in `nearest`, and clear those of the other slots."""
    entry = OWN_SIZE + 2 * LINK_SIZE + ROBOT_SIZE * sensing.robots_seen
    for k in range(filled):
        offset = (targets.position[w, int(nearest[w, i, k][1])] - robots.sensor[w, i]) / sensing.sight
        observation[w, i, entry] = 1.0
        observation[w, i, entry + 1] = offset[0]
        observation[w, i, entry + 2] = offset[1]
        entry += TARGET_SIZE
    clear_slots(w, i, entry, TARGET_SIZE, sensing.targets_seen - filled, observation)


@stage(ROBOT, writes="nearest; observation")
def observe(
    w,
    i,
    curve,
    sensing,
    age_per_step,
    speed_unit,
    message_start,
    clock,
    robots,
    links,
    messages,
    targets,
    nearest,
    latest,
    observation,
    bins,
):
    """Fill the row of each robot."""
    observe_self(w, i, curve, speed_unit, robots, observation)
    observe_ring(w, i, clock.step[w], curve, age_per_step, message_start, robots, links, messages, observation)
    filled = int(0)
    if sensing.robots_seen > 0 and robots.status[w, i] == WORKING:
        filled = nearest_robots(w, i, sensing.robots_seen, sensing.sight, robots, bins, nearest)
    observe_robots(w, i, filled, sensing, speed_unit, robots, nearest, observation)
    filled = 0
    if sensing.targets_seen > 0 and latest.in_sight[w] > 0 and robots.sensor[w, i][0] < NOWHERE:
        filled = nearest_targets(w, i, sensing.targets_seen, sensing.sight, robots, targets, bins, nearest)
    observe_targets(w, i, filled, sensing, robots, targets, nearest, observation)


@stage(ROBOT, writes="final_observation")
def store_final_rows(w, i, clock, observation, final_observation):
    """Store the rows with which the previous episode ended."""
    for k in range(observation.shape[2]):
        final_observation[w, i, k] = observation[w, i, k]
