"""Rogue targets: they appear, move, and are detected by the first working robot that has them in its disc."""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import MOTION
from lissajous_env.device.curve import CurveStruct, wrap
from lissajous_env.device.part_structs import SensingStruct, TargetStruct, TaskStruct
from lissajous_env.device.structs import place_of
from lissajous_env.device.trig import cos_sin
from lissajous_env.parameters import parts
from lissajous_env.world.sight import first_sight, longest_way, nearest_sensor
from lissajous_env.world.state import FOUND, GONE, HIDDEN, NEVER, PRESENT, Clock, Counted, Robots, Targets

wp.set_module_options(MOTION)

STILL = wp.constant(0)
DRIFTING = wp.constant(1)
WANDERING = wp.constant(2)
FLEEING = wp.constant(3)
CUSTOM = wp.constant(4)
"""Moved by a stage of the scenario's own."""

_BOUNDARY = wp.constant(place_of(parts.Targets, "entry", "boundary"))
PLACES = wp.constant(64)
"""Places that are tried for a target that appears unseen."""


@wp.func
def boundary_point(curve: CurveStruct, share: float) -> wp.vec2:
    """The point at a share in [0, 1) of the way around the rectangle, counter-clockwise from the right bottom [m]."""
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


@wp.kernel
def reset_targets(
    first: int,
    lanes: int,
    begin: int,
    end: int,
    curve: CurveStruct,
    target: TargetStruct,
    clock: Clock,
    targets: Targets,
):
    """Draw place, heading and motion of every slot; those of the start appear at step 0.

    The place of a target that appears unseen is drawn anew at that moment.
    """
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    key = randomness.step_key(clock.seed[w], 0)
    for t in range(begin + lane, end, lanes):
        draw = randomness.stream(key, t, randomness.ENTRY)
        x = (2.0 * wp.randf(draw) - 1.0) * curve.half_width
        y = (2.0 * wp.randf(draw) - 1.0) * curve.half_height
        place = wp.vec2(x, y)
        if target.entry == _BOUNDARY:
            place = boundary_point(curve, wp.randf(draw))
        targets.position[w, t] = place
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


@wp.kernel
def reset_arrivals(first: int, target: TargetStruct, task: TaskStruct, clock: Clock, targets: Targets):
    """Lay the arrivals of a Poisson process on the slots after those of the start, in order of time."""
    w = first + wp.tid()
    if clock.active[w] == 0:
        return
    draw = randomness.stream(randomness.step_key(clock.seed[w], 0), 0, randomness.ARRIVAL)
    time = float(0.0)
    for t in range(target.count, targets.stage.shape[1]):
        time -= wp.log(1.0 - wp.randf(draw)) / target.arrival_rate
        targets.appears_at[w, t] = 1 + int(wp.min(time / task.step, 1.0e9))


@wp.kernel
def place_unseen(
    first: int,
    lanes: int,
    begin: int,
    end: int,
    curve: CurveStruct,
    sensing: SensingStruct,
    clock: Clock,
    robots: Robots,
    targets: Targets,
):
    """Put each target that appears now at the first of `PLACES` uniform random places that is unseen, or the last."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    now = clock.step[w]
    key = randomness.step_key(clock.seed[w], now)
    for t in range(begin + lane, end, lanes):
        if targets.appears_at[w, t] > now:
            break  # the slots are in the order of their times
        if targets.stage[w, t] == HIDDEN:
            draw = randomness.stream(key, t, randomness.UNSEEN)
            for _ in range(PLACES):
                x = (2.0 * wp.randf(draw) - 1.0) * curve.half_width
                y = (2.0 * wp.randf(draw) - 1.0) * curve.half_height
                targets.position[w, t] = wp.vec2(x, y)
                nearest = nearest_sensor(w, wp.vec2(x, y), robots)
                if nearest[1] >= sensing.radius * sensing.radius:
                    break


@wp.func
def bounce(place: wp.vec2, heading: float, curve: CurveStruct) -> wp.vec3:
    """Reflect a target at the boundary of the rectangle: returns x, y [m], heading [rad]."""
    x = place[0]
    y = place[1]
    turned = heading
    if wp.abs(x) > curve.half_width:
        x = wp.clamp(wp.sign(x) * 2.0 * curve.half_width - x, -curve.half_width, curve.half_width)
        turned = 3.14159265 - turned
    if wp.abs(y) > curve.half_height:
        y = wp.clamp(wp.sign(y) * 2.0 * curve.half_height - y, -curve.half_height, curve.half_height)
        turned = -turned
    return wp.vec3(x, y, wrap(turned))


@wp.func
def move_target(
    w: int,
    t: int,
    key: int,
    motion: int,
    place: wp.vec2,
    nearest: wp.vec2,
    step: float,
    curve: CurveStruct,
    target: TargetStruct,
    robots: Robots,
    targets: Targets,
) -> wp.vec2:
    """Move one target over a step [s] and return its new place [m]; `nearest` is of `nearest_sensor`."""
    heading = targets.heading[w, t]
    if motion == FLEEING and nearest[1] < target.flee_radius * target.flee_radius:
        away = place - robots.sensor[w, int(nearest[0])]
        # A wall turns the flight along itself; it does not send the target back to the robot.
        fled = place + target.flee_speed * step * wp.normalize(away)
        fled = wp.vec2(
            wp.clamp(fled[0], -curve.half_width, curve.half_width),
            wp.clamp(fled[1], -curve.half_height, curve.half_height),
        )
        targets.position[w, t] = fled
        targets.heading[w, t] = wp.atan2(away[1], away[0])
        return fled
    if motion != DRIFTING:
        # A uniform draw of this deviation: its sum over a second is normal, at a third of the cost.
        heading += target.turn_rate * wp.sqrt(3.0 * step) * (2.0 * randomness.uniform(key, t, randomness.WANDER) - 1.0)
    moved = bounce(place + target.speed * step * cos_sin(heading), heading, curve)
    targets.heading[w, t] = moved[2]
    targets.position[w, t] = wp.vec2(moved[0], moved[1])
    return wp.vec2(moved[0], moved[1])


@wp.func
def detect(
    w: int,
    t: int,
    now: int,
    part: int,
    nearest: wp.vec2,
    sight: wp.vec2,
    radius: float,
    targets: Targets,
    counted: Counted,
) -> int:
    """Let a robot detect a target: the first on its way or else, if it is seen there, the nearest at its end.

    `nearest` is of `nearest_sensor`, `sight` of `first_sight`. Returns 1 where the target waits on, undetected.
    """
    found = wp.where(nearest[1] < radius * radius, int(nearest[0]), -1)
    if sight[1] <= 1.0:
        found = int(sight[0])
        targets.found_early[w, t] = 1.0 - sight[1]
    targets.stage[w, t] = wp.where(found >= 0, FOUND, PRESENT)
    if found < 0:
        return 1
    targets.found_at[w, t] = now
    wp.atomic_add(counted.detections, w, part, found, 1)
    return 0


@wp.func
def count(w: int, part: int, waiting: int, sighted: int, counted: Counted):
    """Add what one thread counted."""
    if waiting > 0:
        wp.atomic_add(counted.waiting, w, part, waiting)
    if sighted > 0:
        wp.atomic_add(counted.in_sight, w, part, sighted)


@wp.kernel
def move_and_detect(
    first: int,
    lanes: int,
    part: int,
    begin: int,
    end: int,
    curve: CurveStruct,
    target: TargetStruct,
    sensing: SensingStruct,
    task: TaskStruct,
    clock: Clock,
    robots: Robots,
    targets: Targets,
    counted: Counted,
):
    """Let detected targets leave, others appear or move, and the first robot that meets one detect it.

    A target appears at the end of its step: it is detected then or, on its way, from the next step on.
    """
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    now = clock.step[w]
    key = randomness.step_key(clock.seed[w], now)
    way, radius = longest_way(w, robots), sensing.radius
    near = radius + task.step * wp.max(target.speed, target.flee_speed)
    waiting = int(0)
    sighted = int(0)
    for t in range(begin + lane, end, lanes):
        if targets.appears_at[w, t] > now:
            break  # the slots are in the order of their times
        stage = targets.stage[w, t]
        if stage == FOUND and target.leave == 1:
            targets.stage[w, t] = GONE
            targets.in_sight[w, t] = 0
        elif stage != GONE:
            place = targets.position[w, t]
            motion = targets.motion[w, t]
            nearest = nearest_sensor(w, place, robots)
            before = place
            reach = near + way
            if motion == CUSTOM:
                before = targets.before[w, t]
                targets.before[w, t] = place
                reach = radius + wp.length(place - before) + way
            reach = wp.where(stage == PRESENT and nearest[1] < reach * reach, reach, 0.0)
            if stage != HIDDEN and motion != STILL and motion != CUSTOM:
                place = move_target(w, t, key, motion, place, nearest, task.step, curve, target, robots, targets)
                # A target that was far from every sensor cannot have come into one's reach in this step.
                if nearest[1] < near * near:
                    nearest = nearest_sensor(w, place, robots)
            seen = wp.where(nearest[1] < radius * radius, 1, 0)
            sighted += seen
            targets.in_sight[w, t] = seen
            if stage != FOUND:
                sight = first_sight(w, before, place, radius, reach, robots)
                waiting += detect(w, t, now, part, nearest, sight, radius, targets, counted)
    count(w, part, waiting, sighted, counted)
