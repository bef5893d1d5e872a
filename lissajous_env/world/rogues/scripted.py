"""Scripted rogues, whose actions depend on their rows alone: wander, flee, shadow and follow-gap."""

from typing import Any

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import into_rectangle
from lissajous_env.device.stage import TARGET, part, stage
from lissajous_env.device.trig import TWO_PI, atan2, cos_sin
from lissajous_env.parameters.rogues import rogue
from lissajous_env.world.rogues.acting import FIRST_ROBOT, ROBOT_SIZE

wp.set_module_options(OPTIONS)

_MARGIN = wp.constant(0.05)
"""Distance that `shadow` preserves from a disc [sensing radius]."""
DIRECTIONS = wp.constant(16)
"""Number of directions among which `follow-gap` selects."""
_MOMENTS = wp.constant(4)
"""Number of later moments for which it compares them."""


@part
def own_place(w, t, curve, rogues) -> wp.vec2:
    """Return the position of a rogue, from its row [m]."""
    return wp.vec2(rogues.observation[w, t, 1] * curve.half_width, rogues.observation[w, t, 2] * curve.half_height)


@part
def robot_away(w, t, entry: int, curve, rogues) -> wp.vec2:
    """Return the position, relative to the rogue, of the robot at an entry of the row [m]."""
    x = 2.0 * rogues.observation[w, t, entry + 2] * curve.half_width
    return wp.vec2(x, 2.0 * rogues.observation[w, t, entry + 3] * curve.half_height)


@part
def robot_velocity(w, t, entry: int, speed_unit, rogues) -> wp.vec2:
    """Return the velocity of the robot at an entry of the row [m/s]."""
    return speed_unit * wp.vec2(rogues.observation[w, t, entry + 4], rogues.observation[w, t, entry + 5])


@part
def nearest_working(w, t, rogues) -> int:
    """Return the entry of the nearest working robot in sight; -1 for none."""
    entry = int(FIRST_ROBOT)
    while entry < rogues.observation.shape[2]:
        if rogues.observation[w, t, entry + 1] > 0.0:  # it works
            return entry
        entry += ROBOT_SIZE
    return -1


@part
def wander(w, t, key, curve, sensing, target, task, speed_unit, rogues) -> wp.vec2:
    """Return the direction of a random walk that bounces off the walls."""
    draw = randomness.uniform(key, t, randomness.ROGUE)
    before = wp.vec2(rogues.observation[w, t, 3], rogues.observation[w, t, 4])
    heading = TWO_PI * draw
    if wp.length_sq(before) > 0.0:
        heading = atan2(before[1], before[0]) + target.turn_rate * wp.sqrt(3.0 * task.step) * (2.0 * draw - 1.0)
    ahead = cos_sin(heading)
    after = own_place(w, t, curve, rogues) + target.speed_limit * task.step * ahead
    x = wp.where(wp.abs(after[0]) > curve.half_width, -ahead[0], ahead[0])
    return wp.vec2(x, wp.where(wp.abs(after[1]) > curve.half_height, -ahead[1], ahead[1]))


@part
def flee(w, t, key, curve, sensing, target, task, speed_unit, rogues) -> wp.vec2:
    """Return the direction away from the nearest working robot."""
    entry = nearest_working(w, t, rogues)
    if entry < 0:
        return wp.vec2(0.0, 0.0)
    return -wp.normalize(robot_away(w, t, entry, curve, rogues))


@part
def shadow(w, t, key, curve, sensing, target, task, speed_unit, rogues) -> wp.vec2:
    """Return the velocity to just outside the disc in which the nearest working robot will sense after this step."""
    entry = nearest_working(w, t, rogues)
    if entry < 0:
        return wp.vec2(0.0, 0.0)
    robot = robot_away(w, t, entry, curve, rogues) + task.step * robot_velocity(w, t, entry, speed_unit, rogues)
    wanted = robot - (1.0 + _MARGIN) * sensing.radius * wp.normalize(robot)
    return wanted / wp.max(wp.length(wanted), target.speed_limit * task.step)


@part
def gap_at(w, t, offset: wp.vec2, after: float, curve, sensing, speed_unit, rogues) -> float:
    """Return the distance to the nearest disc [m] of a point at an offset from the rogue [m] after a time [s].

    The velocities of the robots are assumed to be constant.
    """
    gap = float(wp.inf)
    entry = int(FIRST_ROBOT)
    while entry < rogues.observation.shape[2]:
        if rogues.observation[w, t, entry + 1] > 0.0:  # it works
            robot = robot_away(w, t, entry, curve, rogues) + after * robot_velocity(w, t, entry, speed_unit, rogues)
            gap = wp.min(gap, wp.length(robot - offset) - sensing.radius)
        entry += ROBOT_SIZE
    return gap


@part
def least_gap(w, t, ahead: wp.vec2, curve, sensing, target, speed_unit, rogues) -> float:
    """Return the smallest distance to a disc [m] on a straight path of half a sensing radius; `ahead` = 0 is a wait."""
    here = own_place(w, t, curve, rogues)
    gap = float(wp.inf)
    for k in range(1, _MOMENTS + 1):
        distance = 0.5 * sensing.radius * float(k) / float(_MOMENTS)
        offset = into_rectangle(here + distance * ahead, curve) - here
        gap = wp.min(gap, gap_at(w, t, offset, distance / target.speed_limit, curve, sensing, speed_unit, rogues))
    return gap


@part
def follow_gap(w, t, key, curve, sensing, target, task, speed_unit, rogues) -> wp.vec2:
    """Return the direction with the largest `least_gap`, or 0 if waiting has a larger one."""
    best = wp.vec2(0.0, 0.0)
    widest = least_gap(w, t, best, curve, sensing, target, speed_unit, rogues)
    for k in range(DIRECTIONS):
        ahead = cos_sin(TWO_PI * float(k) / float(DIRECTIONS))
        gap = least_gap(w, t, ahead, curve, sensing, target, speed_unit, rogues)
        if gap > widest:
            widest = gap
            best = ahead
    return best


def _stage_of(rule: Any) -> Any:
    """Make the stage in which a rule decides; rules have the same parameters and return a velocity [speed_limit]."""

    @stage(TARGET, writes="rogues: action")
    def decide(w, t, curve, sensing, target, task, speed_unit, clock, rogues):
        """Write the action of each present rogue."""
        if rogues.observation[w, t, 0] > 0.0:
            key = randomness.step_key(clock.seed[w], clock.step[w])
            velocity = rule(w, t, key, curve, sensing, target, task, speed_unit, rogues)
            rogues.action[w, t, 0] = velocity[0]
            rogues.action[w, t, 1] = velocity[1]

    return decide


WANDER, FLEE, SHADOW, FOLLOW_GAP = map(_stage_of, (wander, flee, shadow, follow_gap))

rogue("wander", "goes straight, turning at random")(WANDER)
rogue("flee", "goes away from the nearest working robot")(FLEE)
rogue("shadow", "stays just outside the nearest disc")(SHADOW)
rogue("follow-gap", "stays in the largest gap between discs")(FOLLOW_GAP)
