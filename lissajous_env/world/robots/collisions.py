"""Collisions: a pair closer than the sum of its radii, by the closest approach between sub-steps."""

import warp as wp

from lissajous_env.device.approach import closest_approach
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.stage import ROBOT, part, stage
from lissajous_env.device.structs import place_of
from lissajous_env.settings.task import Task
from lissajous_env.world.robots.bins import PARTED, columns_of, rows_of
from lissajous_env.world.robots.sight import max_displacement
from lissajous_env.world.state import NEVER, NOWHERE, REMOVED, STUCK

wp.set_module_options(OPTIONS)

_STOP = wp.constant(place_of(Task, "on_collision", "stop"))
_REMOVE = wp.constant(place_of(Task, "on_collision", "remove"))


@part
def compare_pair(w, i, j, now, touch: float, beyond: float, places, robots, latest, tally) -> float:
    """Count a collision of two robots that come within `touch`, or end it; return their least squared distance [m^2].

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
            wp.atomic_add(tally.contact_steps, w, wp.int64(1))
            if met_at <= 0:
                wp.atomic_add(tally.collisions, w, wp.int64(1))
                wp.atomic_add(latest.collisions, w, i, 1)
                wp.atomic_add(latest.collisions, w, j, 1)
    if wp.dot(before, before) > PARTED * PARTED * touch * touch:
        part_pair(w, i, j, tally)
    return least


@part
def part_pair(w, i, j, tally):
    """End the contact of two robots; its last step remains stored."""
    if tally.contact[w, i, j] > 0:
        tally.contact[w, i, j] = -tally.contact[w, i, j]


@part
def compare_with_others(
    w, i, now, touch: float, beyond: float, way: float, places, robots, bins, latest, tally
) -> float:
    """Run `compare_pair` for the robots after this one; none moves farther than `way` [m] in the step.

    With bins, robots are those in the lists on the robot's path, in several of which a robot may be. In the first step
    of an episode, and as long as no two robots were within reach, the nearest is in no list.
    """
    nearest = float(1.0e30)
    if bins.columns > 0 and beyond <= bins.reach and bins.is_everywhere[w, i] == 0:
        rows = rows_of(w, i, 0.0, robots, bins)
        for row in range(rows[0], rows[1] + 1):
            columns = columns_of(w, i, row, 0.0, robots, bins)
            for column in range(columns[0], columns[1] + 1):
                entry = bins.entry[w, bins.first[w, row * bins.columns + column]]
                while entry[0] >= 0:
                    j = entry[0]
                    if j > i:
                        least = compare_pair(w, i, j, now, touch, beyond, places, robots, latest, tally)
                        nearest = wp.min(nearest, least)
                    entry = bins.entry[w, entry[1]]
    else:
        last = robots.track.shape[2] - 1
        apart = beyond + 2.0 * way
        for j in range(i + 1, robots.status.shape[1]):
            if robots.status[w, j] != REMOVED:
                away = robots.track[w, i, last] - robots.track[w, j, last]
                if wp.length_sq(away) > apart * apart:
                    part_pair(w, i, j, tally)
                else:
                    nearest = wp.min(nearest, compare_pair(w, i, j, now, touch, beyond, places, robots, latest, tally))
    return nearest


@stage(ROBOT, writes="latest: collisions; tally: collisions, contact, contact_steps, min_separation")
def find_collisions(w, lane, lanes, robot, places, clock, robots, bins, latest, tally):
    """Compare each robot with those after it, over the sub-steps of the latest step."""
    touch = 2.0 * robot.radius
    # A pair this far apart cannot collide, nor be the nearest of the episode.
    beyond = wp.max(tally.min_separation[w], PARTED * touch)
    nearest = float(1.0e30)
    way = float(1.0e30)
    if beyond < 1.0e30:
        way = max_displacement(w, robots)
    for i in range(lane, robots.status.shape[1], lanes):
        if robots.status[w, i] != REMOVED:
            least = compare_with_others(w, i, clock.step[w], touch, beyond, way, places, robots, bins, latest, tally)
            nearest = wp.min(nearest, least)
    if nearest < 1.0e30:
        wp.atomic_min(tally.min_separation, w, wp.sqrt(nearest))


@stage(ROBOT, writes="latest: terminated; robots: sensor, status, stuck_until")
def take_consequences(w, i, task, clock, robots, latest):
    """Stop or remove the robots that collided in this step, by `task.on_collision`."""
    if latest.collisions[w, i] > 0:
        robots.sensor[w, i] = wp.vec2(NOWHERE, NOWHERE)
        if task.on_collision == _STOP:
            robots.status[w, i] = STUCK
            robots.stuck_until[w, i] = NEVER
        if task.on_collision == _REMOVE:
            robots.status[w, i] = REMOVED
            latest.terminated[w, i] = True
