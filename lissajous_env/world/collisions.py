"""Collisions: a pair closer than the sum of its radii, by the closest approach between sub-steps."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.world.robots import RobotStruct
from lissajous_env.world.state import NEVER, NOWHERE, REMOVED, RUNNING, STUCK, Clock, Robots, Step, Tally

wp.set_module_options(OPTIONS)

PARTED = wp.constant(1.05)
"""A collision is over when the distance is above this many times the sum of the radii."""

COUNT = wp.constant(0)
STOP = wp.constant(1)
REMOVE = wp.constant(2)
ON_COLLISION = {"count": 0, "stop": 1, "remove": 2}


@wp.func
def closest_approach(before: wp.vec3, after: wp.vec3) -> float:
    """Smallest squared length of before + t (after - before), t in [0, 1] [m^2]: two robots on straight ways."""
    moved = after - before
    t = wp.clamp(-wp.dot(before, moved) / wp.max(wp.dot(moved, moved), 1.0e-12), 0.0, 1.0)
    nearest = before + t * moved
    return wp.dot(nearest, nearest)


@wp.kernel
def find_collisions(
    first: int, lanes: int, robot: RobotStruct, clock: Clock, robots: Robots, step_out: Step, tally: Tally
):
    """Compare robot i with the robots after it, over the sub-steps of the latest step."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.stage[w] != RUNNING:
        return
    touch = 2.0 * robot.radius
    nearest = float(1.0e30)
    for i in range(lane, robots.status.shape[1], lanes):
        if robots.status[w, i] != REMOVED:
            for j in range(i + 1, robots.status.shape[1]):
                if robots.status[w, j] != REMOVED:
                    least = float(1.0e30)
                    before = robots.track[w, i, 0] - robots.track[w, j, 0]
                    for s in range(1, robots.track.shape[2]):
                        after = robots.track[w, i, s] - robots.track[w, j, s]
                        least = wp.min(least, closest_approach(before, after))
                        before = after
                    nearest = wp.min(nearest, least)
                    if least < touch * touch:
                        wp.atomic_add(tally.contact_steps, w, wp.int64(1))
                        if tally.contact[w, i, j] == 0:
                            tally.contact[w, i, j] = 1
                            wp.atomic_add(tally.collisions, w, wp.int64(1))
                            wp.atomic_add(step_out.collisions, w, i, 1)
                            wp.atomic_add(step_out.collisions, w, j, 1)
                    if wp.dot(before, before) > PARTED * PARTED * touch * touch:
                        tally.contact[w, i, j] = 0
    if nearest < 1.0e30:
        wp.atomic_min(tally.min_separation, w, wp.sqrt(nearest))


@wp.func
def take_consequence(w: int, i: int, on_collision: int, robots: Robots, step_out: Step):
    """Stop or remove a robot that collided in the latest step, as `on_collision`, STOP or REMOVE, says."""
    if step_out.collisions[w, i] > 0:
        robots.sensor[w, i] = wp.vec2(NOWHERE, NOWHERE)
        if on_collision == STOP:
            robots.status[w, i] = STUCK
            robots.stuck_until[w, i] = NEVER
        if on_collision == REMOVE:
            robots.status[w, i] = REMOVED
            step_out.terminated[w, i] = True
