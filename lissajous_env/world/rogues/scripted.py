"""Scripted rogues that decide by their row alone: wander, flee, shadow, follow-gap."""

from typing import Any

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.part_structs import SensingStruct, TargetStruct, TaskStruct
from lissajous_env.device.stage import TARGET, stage
from lissajous_env.device.trig import atan2, cos_sin
from lissajous_env.parameters.rogues import Rogue, register_rogue
from lissajous_env.world.rogues.rows import ROBOT, ROBOTS
from lissajous_env.world.state import Clock, Rogues

wp.set_module_options(OPTIONS)

TURN = wp.constant(6.2831853)
_MARGIN = wp.constant(0.05)
"""Distance that `shadow` preserves from a disc [sensing radius]."""
DIRECTIONS = wp.constant(16)
_MOMENTS = wp.constant(4)
"""Directions among which `follow-gap` selects, and moments at which it looks ahead."""


@wp.struct
class Rules:
    """Constants of the rules."""

    half: wp.vec2
    """half_width, half_height [m]."""
    radius: float
    """Sensing radius [m]."""
    speed: float
    """Speed limit of rogues [m/s]."""
    speed_unit: float
    """Unit of the robots' speeds [m/s]."""
    turn_rate: float
    """`targets.turn_rate` [rad/sqrt(s)]."""
    step: float
    """Control step [s]."""


@wp.func
def rules_of(
    curve: CurveStruct, sensing: SensingStruct, target: TargetStruct, task: TaskStruct, speed_unit: float
) -> Rules:
    """Collect the constants of the rules."""
    rules = Rules()
    rules.half = wp.vec2(curve.half_width, curve.half_height)
    rules.radius = sensing.radius
    rules.speed = target.speed_limit
    rules.speed_unit = speed_unit
    rules.turn_rate = target.turn_rate
    rules.step = task.step
    return rules


@wp.func
def own_place(w: int, t: int, rules: Rules, rogues: Rogues) -> wp.vec2:
    """Return where a rogue is, by its row [m]."""
    return wp.vec2(rogues.observation[w, t, 1] * rules.half[0], rogues.observation[w, t, 2] * rules.half[1])


@wp.func
def is_sensing(w: int, t: int, entry: int, rogues: Rogues) -> bool:
    """Return whether the robot at an entry of the row works."""
    return rogues.observation[w, t, entry + 1] > 0.0


@wp.func
def robot_away(w: int, t: int, entry: int, rules: Rules, rogues: Rogues) -> wp.vec2:
    """Return where the robot at an entry of the row is, relative to the rogue [m]."""
    x = 2.0 * rogues.observation[w, t, entry + 2] * rules.half[0]
    return wp.vec2(x, 2.0 * rogues.observation[w, t, entry + 3] * rules.half[1])


@wp.func
def robot_velocity(w: int, t: int, entry: int, rules: Rules, rogues: Rogues) -> wp.vec2:
    """Return the velocity of the robot at an entry of the row [m/s]."""
    return rules.speed_unit * wp.vec2(rogues.observation[w, t, entry + 4], rogues.observation[w, t, entry + 5])


@wp.func
def nearest_sensing(w: int, t: int, rogues: Rogues) -> int:
    """Return the entry of the nearest working robot in sight; -1 for none."""
    entry = int(ROBOTS)
    while entry < rogues.observation.shape[2]:
        if is_sensing(w, t, entry, rogues):
            return entry
        entry += ROBOT
    return -1


@wp.func
def wander(w: int, t: int, key: int, rules: Rules, rogues: Rogues) -> wp.vec2:
    """Return a direction that follows a random walk and bounces off the walls."""
    draw = randomness.uniform(key, t, randomness.ROGUE)
    before = wp.vec2(rogues.observation[w, t, 3], rogues.observation[w, t, 4])
    heading = TURN * draw
    if wp.length_sq(before) > 0.0:
        heading = atan2(before[1], before[0]) + rules.turn_rate * wp.sqrt(3.0 * rules.step) * (2.0 * draw - 1.0)
    ahead = cos_sin(heading)
    after = own_place(w, t, rules, rogues) + rules.speed * rules.step * ahead
    x = wp.where(wp.abs(after[0]) > rules.half[0], -ahead[0], ahead[0])
    return wp.vec2(x, wp.where(wp.abs(after[1]) > rules.half[1], -ahead[1], ahead[1]))


@wp.func
def flee(w: int, t: int, key: int, rules: Rules, rogues: Rogues) -> wp.vec2:
    """Return the direction away from the nearest working robot."""
    entry = nearest_sensing(w, t, rogues)
    if entry < 0:
        return wp.vec2(0.0, 0.0)
    return -wp.normalize(robot_away(w, t, entry, rules, rogues))


@wp.func
def shadow(w: int, t: int, key: int, rules: Rules, rogues: Rogues) -> wp.vec2:
    """Return the velocity to just outside the disc in which the nearest working robot will sense after this step."""
    entry = nearest_sensing(w, t, rogues)
    if entry < 0:
        return wp.vec2(0.0, 0.0)
    robot = robot_away(w, t, entry, rules, rogues) + rules.step * robot_velocity(w, t, entry, rules, rogues)
    beside = robot - (1.0 + _MARGIN) * rules.radius * wp.normalize(robot)
    return beside / (rules.speed * rules.step)


@wp.func
def gap_at(w: int, t: int, offset: wp.vec2, after: float, rules: Rules, rogues: Rogues) -> float:
    """Return the distance from all discs that a place will have after a time [s], if the robots go straight on [m]."""
    gap = float(1.0e30)
    entry = int(ROBOTS)
    while entry < rogues.observation.shape[2]:
        if is_sensing(w, t, entry, rogues):
            robot = robot_away(w, t, entry, rules, rogues) + after * robot_velocity(w, t, entry, rules, rogues)
            gap = wp.min(gap, wp.length(robot - offset) - rules.radius)
        entry += ROBOT
    return gap


@wp.func
def least_gap(w: int, t: int, ahead: wp.vec2, rules: Rules, rogues: Rogues) -> float:
    """Return the smallest distance from all discs on a straight way over half a sensing radius, or in that time [m]."""
    here = own_place(w, t, rules, rogues)
    gap = float(1.0e30)
    for k in range(1, _MOMENTS + 1):
        way = 0.5 * rules.radius * float(k) / float(_MOMENTS)
        x = wp.clamp(here[0] + way * ahead[0], -rules.half[0], rules.half[0])
        y = wp.clamp(here[1] + way * ahead[1], -rules.half[1], rules.half[1])
        gap = wp.min(gap, gap_at(w, t, wp.vec2(x, y) - here, way / rules.speed, rules, rogues))
    return gap


@wp.func
def follow_gap(w: int, t: int, key: int, rules: Rules, rogues: Rogues) -> wp.vec2:
    """Return the direction in which the smallest gap to all discs stays largest; none if that is where it is."""
    best = wp.vec2(0.0, 0.0)
    widest = least_gap(w, t, best, rules, rogues)
    for k in range(DIRECTIONS):
        ahead = cos_sin(TURN * float(k) / float(DIRECTIONS))
        gap = least_gap(w, t, ahead, rules, rogues)
        if gap > widest:
            widest = gap
            best = ahead
    return best


def _deciding(rule: Any) -> Any:
    """Make the kernel of a rule."""

    @stage(TARGET, writes="rogues: action", split=True)
    def decide(
        w: int,
        t: int,
        curve: CurveStruct,
        sensing: SensingStruct,
        target: TargetStruct,
        task: TaskStruct,
        speed_unit: float,
        clock: Clock,
        rogues: Rogues,
    ):
        """Decide for each rogue by its row."""
        if rogues.observation[w, t, 0] > 0.0:
            key = randomness.step_key(clock.seed[w], clock.step[w])
            velocity = rule(w, t, key, rules_of(curve, sensing, target, task, speed_unit), rogues)
            rogues.action[w, t, 0] = velocity[0]
            rogues.action[w, t, 1] = velocity[1]

    return decide


WANDER, FLEE, SHADOW, FOLLOW_GAP = map(_deciding, (wander, flee, shadow, follow_gap))

register_rogue(Rogue("wander", WANDER, "goes straight, turning at random"))
register_rogue(Rogue("flee", FLEE, "goes away from the nearest working robot"))
register_rogue(Rogue("shadow", SHADOW, "stays just outside the nearest disc"))
register_rogue(Rogue("follow-gap", FOLLOW_GAP, "stays in the largest gap between discs"))
