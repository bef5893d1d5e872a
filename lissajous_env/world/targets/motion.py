"""Targets: their places, motions and times at the start of an episode, and how they move."""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import MOTION
from lissajous_env.device.curve import CurveStruct, wrap
from lissajous_env.device.part_structs import TargetStruct, TaskStruct
from lissajous_env.device.stage import TARGET, WORLD, stage
from lissajous_env.device.structs import place_of
from lissajous_env.device.trig import atan2, cos_sin
from lissajous_env.settings import parts
from lissajous_env.world.state import HIDDEN, NEVER, Clock, Targets

wp.set_module_options(MOTION)

STILL = wp.constant(0)
DRIFTING = wp.constant(1)
WANDERING = wp.constant(2)
FLEEING = wp.constant(3)
CUSTOM = wp.constant(4)
"""Moved by an extension of the scenario, or by an adversary: `lissajous_env.world.rogues`."""

_BOUNDARY = wp.constant(place_of(parts.Targets, "entry", "boundary"))


@wp.func
def boundary_point(curve: CurveStruct, share: float) -> wp.vec2:
    """Return the point at a share in [0, 1) of the boundary, counter-clockwise from the right bottom [m]."""
    width = curve.half_width
    height = curve.half_height
    along = share * 4.0 * (width + height)
    if along < 2.0 * height:
        return wp.vec2(width, along - height)
    along -= 2.0 * height
    if along < 2.0 * width:
        return wp.vec2(width - along, height)
    along -= 2.0 * width
    if along < 2.0 * height:
        return wp.vec2(-width, height - along)
    return wp.vec2(along - 2.0 * height - width, -height)


@stage(TARGET, writes="targets: appears_at, before, found_at, found_early, heading, in_sight, motion, position, stage")
def reset_targets(
    w: int,
    lane: int,
    lanes: int,
    begin: int,
    end: int,
    curve: CurveStruct,
    target: TargetStruct,
    clock: Clock,
    targets: Targets,
):
    """Draw position, heading and motion of every target; those of the start appear at step 0.

    The place of a target that appears outside all discs is drawn anew at that moment.
    """
    key = randomness.step_key(clock.seed[w], 0)
    for t in range(begin + lane, end, lanes):
        draw = randomness.stream(key, t, randomness.ENTRY)
        x = (2.0 * wp.randf(draw) - 1.0) * curve.half_width
        y = (2.0 * wp.randf(draw) - 1.0) * curve.half_height
        place = wp.vec2(x, y)
        if target.entry == _BOUNDARY:
            place = boundary_point(curve, wp.randf(draw))
        targets.position[w, t] = place
        targets.before[w, t] = place
        targets.heading[w, t] = 6.2831853 * wp.randf(draw)
        share = wp.randf(draw)
        motion = int(STILL)
        if share < target.drifting:
            motion = DRIFTING
        elif share < target.drifting + target.wandering:
            motion = WANDERING
        elif share < target.drifting + target.wandering + target.fleeing:
            motion = FLEEING
        elif share < target.drifting + target.wandering + target.fleeing + target.custom:
            motion = CUSTOM
        targets.motion[w, t] = motion
        targets.stage[w, t] = HIDDEN
        targets.appears_at[w, t] = 0
        targets.found_at[w, t] = NEVER
        targets.found_early[w, t] = 0.0
        targets.in_sight[w, t] = 0


@stage(WORLD, writes="targets: appears_at")
def reset_arrivals(w: int, target: TargetStruct, task: TaskStruct, clock: Clock, targets: Targets):
    """Draw the arrival times of the targets after those of the start, by a Poisson process."""
    draw = randomness.stream(randomness.step_key(clock.seed[w], 0), 0, randomness.ARRIVAL)
    time = float(0.0)
    for t in range(target.count, targets.stage.shape[1]):
        time -= wp.log(1.0 - wp.randf(draw)) / target.arrival_rate
        targets.appears_at[w, t] = 1 + int(wp.min(time / task.step, 1.0e9))


@wp.func
def bounce(x: float, y: float, heading: float, curve: CurveStruct) -> wp.vec3:
    """Reflect a target at the boundary of the rectangle: returns x, y [m], heading [rad]."""
    beside = wp.abs(x) > curve.half_width
    above = wp.abs(y) > curve.half_height
    inside_x = wp.clamp(wp.sign(x) * 2.0 * curve.half_width - x, -curve.half_width, curve.half_width)
    inside_y = wp.clamp(wp.sign(y) * 2.0 * curve.half_height - y, -curve.half_height, curve.half_height)
    turned = wp.where(beside, 3.14159265 - heading, heading)
    turned = wp.where(above, -turned, turned)
    return wp.vec3(wp.where(beside, inside_x, x), wp.where(above, inside_y, y), wrap(turned))


@wp.func
def wander(
    t: int,
    key: int,
    motion: int,
    x: float,
    y: float,
    heading: float,
    step: float,
    curve: CurveStruct,
    target: TargetStruct,
) -> wp.vec3:
    """Move one target over a step [s], straight on if it drifts: returns x, y [m], heading [rad]."""
    # A uniform draw of this deviation: its sum over a second is normal, at a third of the cost.
    turn = target.turn_rate * wp.sqrt(3.0 * step) * (2.0 * randomness.uniform(key, t, randomness.WANDER) - 1.0)
    turned = wp.where(motion == DRIFTING, heading, heading + turn)
    way = target.speed * step
    ahead = cos_sin(turned)
    return bounce(x + way * ahead[0], y + way * ahead[1], turned, curve)


@wp.func
def is_moved(motion: int) -> bool:
    """Return whether targets of this motion are moved by the simulation."""
    return motion != STILL and motion != CUSTOM


@wp.func
def flee(place: wp.vec2, sensor: wp.vec2, step: float, curve: CurveStruct, target: TargetStruct) -> wp.vec3:
    """Move one target over a step [s] away from a sensor: returns x, y [m], heading [rad]."""
    away = place - sensor
    # A wall turns the flight along itself; it does not send the target back to the robot.
    fled = place + target.flee_speed * step * wp.normalize(away)
    x = wp.clamp(fled[0], -curve.half_width, curve.half_width)
    y = wp.clamp(fled[1], -curve.half_height, curve.half_height)
    return wp.vec3(x, y, atan2(away[1], away[0]))
