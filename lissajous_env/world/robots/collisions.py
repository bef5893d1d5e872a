"""Collisions: a pair closer than the sum of its radii, by the closest approach between sub-steps."""

import warp as wp

from lissajous_env.device.approach import closest_approach
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.part_structs import RobotStruct, TaskStruct
from lissajous_env.device.structs import place_of
from lissajous_env.parameters.parts import Task
from lissajous_env.world.robots.sight import longest_way
from lissajous_env.world.state import NEVER, NOWHERE, REMOVED, STUCK, Clock, Counted, Latest, Robots, Tally

wp.set_module_options(OPTIONS)

PARTED = wp.constant(1.05)
"""A collision is over when the distance is above this many times the sum of the radii."""

_STOP = wp.constant(place_of(Task, "on_collision", "stop"))
_REMOVE = wp.constant(place_of(Task, "on_collision", "remove"))


@wp.func
def compare_pair(
    w: int,
    i: int,
    j: int,
    now: int,
    part: int,
    touch: float,
    beyond: float,
    places: wp.array(dtype=int),
    robots: Robots,
    tally: Tally,
    counted: Counted,
) -> float:
    """Let two robots collide that come within `touch`, or part; returns their least squared distance [m^2].

    Robots of one of `places` overlap by design and are not compared: `Scenario.places`.
    Stretches of the step in which they are farther apart than `beyond` [m] are passed over; 1e30 where all are. A pair
    that is compared more than once in the same step is counted once.
    """
    least = float(1.0e30)
    if places[i] == places[j]:
        return least
    before = robots.track[w, i, 0] - robots.track[w, j, 0]
    for s in range(1, robots.track.shape[2]):
        after = robots.track[w, i, s] - robots.track[w, j, s]
        moved = after - before
        ends = wp.min(wp.dot(before, before), wp.dot(after, after))
        if ends < 2.0 * (beyond * beyond + wp.dot(moved, moved)):
            least = wp.min(least, closest_approach(before, after))
        before = after
    if least < touch * touch:
        met_at = tally.contact[w, i, j]
        tally.contact[w, i, j] = now
        if wp.abs(met_at) != now:
            wp.atomic_add(counted.contact_steps, w, part, wp.int64(1))
            if met_at <= 0:
                wp.atomic_add(counted.collisions, w, part, wp.int64(1))
                wp.atomic_add(counted.met, w, part, i, 1)
                wp.atomic_add(counted.met, w, part, j, 1)
    if wp.dot(before, before) > PARTED * PARTED * touch * touch:
        part_pair(w, i, j, tally)
    return least


@wp.func
def part_pair(w: int, i: int, j: int, tally: Tally):
    """End the contact of two robots; when they last met stays known."""
    if tally.contact[w, i, j] > 0:
        tally.contact[w, i, j] = -tally.contact[w, i, j]


@wp.func
def compare_with_all(
    w: int,
    i: int,
    now: int,
    part: int,
    touch: float,
    beyond: float,
    way: float,
    places: wp.array(dtype=int),
    robots: Robots,
    tally: Tally,
    counted: Counted,
) -> float:
    """`compare_pair` with the robots after this one, of which none goes farther than `way` [m] in the step."""
    last = robots.track.shape[2] - 1
    nearest = float(1.0e30)
    apart = beyond + 2.0 * way
    for j in range(i + 1, robots.status.shape[1]):
        away = robots.track[w, i, last] - robots.track[w, j, last]
        if wp.length_sq(away) > apart * apart:
            part_pair(w, i, j, tally)
        elif robots.status[w, j] != REMOVED:
            nearest = wp.min(nearest, compare_pair(w, i, j, now, part, touch, beyond, places, robots, tally, counted))
    return nearest


@wp.kernel
def find_collisions(
    first: int,
    lanes: int,
    part: int,
    begin: int,
    end: int,
    robot: RobotStruct,
    places: wp.array(dtype=int),
    clock: Clock,
    robots: Robots,
    tally: Tally,
    counted: Counted,
):
    """Compare robot i with the robots after it, over the sub-steps of the latest step."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    now = clock.step[w]
    touch = 2.0 * robot.radius
    # A pair this far apart cannot touch, nor be the nearest of the episode.
    beyond = wp.max(tally.min_separation[w], PARTED * touch)
    nearest = float(1.0e30)
    way = longest_way(w, robots)
    for i in range(begin + lane, end, lanes):
        if robots.status[w, i] != REMOVED:
            nearest = wp.min(
                nearest, compare_with_all(w, i, now, part, touch, beyond, way, places, robots, tally, counted)
            )
    if nearest < 1.0e30:
        wp.atomic_min(counted.min_separation, w, part, wp.sqrt(nearest))


@wp.kernel
def take_consequences(first: int, lanes: int, task: TaskStruct, clock: Clock, robots: Robots, latest: Latest):
    """Stop or remove the robots that collided in this step, as `task.on_collision` says."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    for i in range(lane, robots.status.shape[1], lanes):
        if latest.collisions[w, i] > 0:
            robots.sensor[w, i] = wp.vec2(NOWHERE, NOWHERE)
            if task.on_collision == _STOP:
                robots.status[w, i] = STUCK
                robots.stuck_until[w, i] = NEVER
            if task.on_collision == _REMOVE:
                robots.status[w, i] = REMOVED
                latest.terminated[w, i] = True
