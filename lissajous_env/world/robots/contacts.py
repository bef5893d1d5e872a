"""Contacts of robots with each other and with walls, bodies outside the rectangle, and robots that are blocked.

A pair collides where it is closer than the sum of its radii, by the closest approach between sub-steps.
"""

from typing import Any

import warp as wp

from lissajous_env.device import abreast
from lissajous_env.device.abreast import Floats
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.stage import ROBOT, part, stage
from lissajous_env.device.structs import code_of
from lissajous_env.settings.task import Task
from lissajous_env.world.robots.nearby import PARTED, bins_crossed, has_lists, max_displacement
from lissajous_env.world.state import FAILED, LONGER, NEVER, NOWHERE, REMOVED, WORKING, planar

wp.set_module_options(OPTIONS)

_STOP = wp.constant(code_of(Task, "on_collision", "stop"))
_REMOVE = wp.constant(code_of(Task, "on_collision", "remove"))
_REMOVE_OUTSIDE = wp.constant(code_of(Task, "boundary", "remove"))


@wp.func
def closest_approach(before: Any, after: Any) -> float:
    """Return the smallest squared length of before + t (after - before), t in [0, 1] [m^2], in the plane or in space.

    `before` and `after` are the offset of two robots at the two ends of a stretch of time, at equal speeds within it.
    """
    moved = after - before
    t = wp.clamp(-wp.dot(before, moved) / wp.max(wp.dot(moved, moved), 1.0e-30), 0.0, 1.0)
    nearest = before + t * moved
    return wp.dot(nearest, nearest)


@part
def compare_pair(w, i, j, now, contact: float, places, robots, latest, tally) -> float:
    """Count or end a collision of two robots; return their least squared distance in the step [m^2].

    They collide below the distance `contact` [m]. Robots of the same `places` overlap by design and are not compared,
    see `Scenario.places`. A pair that is compared more than once in a step is counted once.
    """
    least = float(1.0e30)
    if places[i] == places[j]:
        return least
    before = robots.path[w, i, 0] - robots.path[w, j, 0]
    for s in range(1, robots.path.shape[2]):
        after = robots.path[w, i, s] - robots.path[w, j, s]
        least = wp.min(least, closest_approach(before, after))
        before = after
    if least < contact * contact:
        contact_at = tally.contact[w, i, j]
        tally.contact[w, i, j] = now
        if wp.abs(contact_at) != now:
            wp.atomic_add(tally.contact_steps, w, wp.int64(1))
            if contact_at <= 0:
                wp.atomic_add(tally.collisions, w, wp.int64(1))
                wp.atomic_add(latest.collisions, w, i, 1)
                wp.atomic_add(latest.collisions, w, j, 1)
    if wp.dot(before, before) > PARTED * PARTED * contact * contact:
        part_pair(w, i, j, tally)
    return least


@part
def part_pair(w, i, j, tally):
    """End the contact of two robots; its last step remains stored."""
    if tally.contact[w, i, j] > 0:
        tally.contact[w, i, j] = -tally.contact[w, i, j]


@part
def compare_with_others(
    w, i, now, contact: float, relevant: float, displacement: float, places, robots, bins, latest, tally
) -> float:
    """Run `compare_pair` for a robot and those of larger index; return the least squared distance of all [m^2].

    No robot moves farther than `displacement` [m] in the step. With bins, robots in the lists of the bins around the
    path are compared, some more than once. All robots are compared if lists do not reach as far as `relevant`, as in
    the first step of an episode.
    """
    nearest = float(1.0e30)
    if relevant <= bins.reach and has_lists(w, bins):
        crossed = bins_crossed(w, i, 0.0, robots, bins)
        for row in range(crossed[0], crossed[1] + 1):
            for column in range(crossed[2], crossed[3] + 1):
                entry = bins.first[w, row * bins.columns + column]
                while entry >= 0:
                    j = bins.entry[w, entry][0]
                    if j > i:
                        least = compare_pair(w, i, j, now, contact, places, robots, latest, tally)
                        nearest = wp.min(nearest, least)
                    entry = bins.entry[w, entry][1]
    else:
        last = robots.path.shape[2] - 1
        apart = relevant + 2.0 * displacement
        for j in range(i + 1, robots.status.shape[1]):
            if robots.status[w, j] != REMOVED:
                away = robots.path[w, i, last] - robots.path[w, j, last]
                if wp.length_sq(away) > apart * apart:
                    part_pair(w, i, j, tally)
                else:
                    least = compare_pair(w, i, j, now, contact, places, robots, latest, tally)
                    nearest = wp.min(nearest, least)
    return nearest


@stage(ROBOT, writes="latest: collisions; tally: collisions, contact, contact_steps, min_separation")
def count_collisions(w, lane, lanes, robot, places, clock, robots, latest, tally, bins):
    """Compare each robot with those of larger index, over the sub-steps of the latest step."""
    contact = 2.0 * robot.radius
    # A pair that is farther apart neither collides nor is the nearest of the episode.
    relevant = wp.max(tally.min_separation[w], PARTED * contact)
    nearest = float(1.0e30)
    displacement = float(1.0e30)
    if relevant < 1.0e30:
        displacement = max_displacement(w, robots)
    for i in range(lane, robots.status.shape[1], lanes):
        if robots.status[w, i] != REMOVED:
            least = compare_with_others(
                w, i, clock.step[w], contact, relevant, displacement, places, robots, bins, latest, tally
            )
            nearest = wp.min(nearest, least)
    if nearest < 1.0e30:
        wp.atomic_min(tally.min_separation, w, wp.sqrt(nearest))


@stage(ROBOT, writes="latest: terminated; robots: sensor, status, failed_until")
def stop_or_remove(w, i, task, clock, robots, latest):
    """Stop or remove the robots that collided in this step, by `task.on_collision`."""
    if latest.collisions[w, i] > 0:
        robots.sensor[w, i] = wp.vec2(NOWHERE, NOWHERE)
        if task.on_collision == _STOP:
            robots.status[w, i] = FAILED
            robots.failed_until[w, i] = NEVER
        if task.on_collision == _REMOVE:
            robots.status[w, i] = REMOVED
            latest.terminated[w, i] = True


_TOLERANCE = wp.constant(1e-3)
"""Share of the radius within which a body is in contact with a wall, and by which a body must extend beyond the edge to
be partly outside; the rounding of coordinates is less."""
_APART = wp.constant(0.05)
"""Share of the radius beyond which a contact with a wall is over."""


@wp.func
def distance_inside(half_width: float, half_height: float, x: float, y: float) -> float:
    """Return the distance of a place from the edge of a rectangle around the origin, below 0 outside of it [m]."""
    return wp.min(half_width - wp.abs(x), half_height - wp.abs(y))


@stage(ROBOT, writes="latest: outside, partly_outside, terminated; robots: sensor, status")
def mark_outside(block, curve, robot, task, clock, robots, latest):
    """Mark the robots that are partly or wholly outside the rectangle; `task.boundary=remove` removes the latter."""
    n = robots.status.shape[1]
    x = abreast.coordinates(block, robots.position, 0)
    y = abreast.coordinates(block, robots.position, 1)
    excess = Floats()  # of a centre beyond the nearest edge, negative inside
    square = Floats()  # of the distance of a centre from the rectangle
    for k in range(abreast.ABREAST):
        if k < abreast.width():
            beyond_x = wp.abs(x[k]) - curve.half_width
            beyond_y = wp.abs(y[k]) - curve.half_height
            excess[k] = wp.max(beyond_x, beyond_y)
            beyond_x = wp.max(beyond_x, 0.0)
            beyond_y = wp.max(beyond_y, 0.0)
            square[k] = beyond_x * beyond_x + beyond_y * beyond_y
    there = ~abreast.where_equal(block, robots.status, REMOVED)
    outside = abreast.where_above(block, square, robot.radius * robot.radius) & there
    partly = abreast.where_above(block, excess, -(1.0 - _TOLERANCE) * robot.radius) & there
    abreast.put_bits(block, block.active_mask, partly, latest.partly_outside)
    abreast.put_bits(block, block.active_mask, outside, latest.outside)
    if task.boundary == _REMOVE_OUTSIDE:
        for k in range(block.count):
            if abreast.is_in(k, outside & block.active_mask):
                w = (block.start + k) / n
                i = (block.start + k) % n
                robots.status[w, i] = REMOVED
                robots.sensor[w, i] = wp.vec2(NOWHERE, NOWHERE)
                latest.terminated[w, i] = True


@part
def driven_speed(w, i, action_speeds, limited_action) -> float:
    """Return the speed that a robot's action requests [m/s]; its components add up like those of a vector."""
    square = float(0.0)
    for k in range(action_speeds.shape[0]):
        away = limited_action[w, i, k] - action_speeds[k, 0]
        speed = away * wp.where(away < 0.0, action_speeds[k, 2], action_speeds[k, 1])
        square += speed * speed
    return wp.sqrt(square)


@stage(ROBOT, writes="tally: at_wall, blocked_steps, driven_from, driven_steps, wall_contacts")
def count_wall_contacts(w, i, curve, robot, task, action_speeds, clock, robots, limited_action, tally):
    """Count contacts with a wall, and the steps in which robots are blocked.

    A contact begins when a body reaches a wall and lasts until it is farther than `_APART` from it. A working robot is
    blocked if its policy has driven it for `task.blocked_after` since it last moved by its radius. A policy drives it
    in a step if the speed that its action requests would move it by two radii in that time.
    """
    if robots.status[w, i] != REMOVED:
        for s in range(1, robots.path.shape[2]):
            at = robots.path[w, i, s]
            distance = distance_inside(curve.half_width, curve.half_height, at[0], at[1]) - robot.radius
            if distance > _APART * robot.radius:
                tally.at_wall[w, i] = 0
            if distance < _TOLERANCE * robot.radius and tally.at_wall[w, i] == 0:
                tally.at_wall[w, i] = 1
                tally.wall_contacts[w, i] += 1
        place = planar(robots.position[w, i])
        moved = wp.length(place - tally.driven_from[w, i]) >= robot.radius
        if moved or robots.status[w, i] != WORKING:
            tally.driven_from[w, i] = place
            tally.driven_steps[w, i] = 0
        elif driven_speed(w, i, action_speeds, limited_action) * task.blocked_after >= 2.0 * robot.radius:
            tally.driven_steps[w, i] += 1
            if float(tally.driven_steps[w, i]) * task.step > LONGER * task.blocked_after:
                tally.blocked_steps[w, i] += 1
