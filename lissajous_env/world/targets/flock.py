"""Targets where they are few: those of a world, side by side, ask every robot."""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.abreast import ABREAST, Floats, Ints, width
from lissajous_env.device.compilation import MOTION
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.part_structs import SensingStruct, TargetStruct, TaskStruct
from lissajous_env.world.robots.sight import first_sight, longest_way, nearest_sensors
from lissajous_env.world.state import FOUND, GONE, HIDDEN, PRESENT, Clock, Counted, Robots, Targets
from lissajous_env.world.targets.motion import CUSTOM, FLEEING, STILL, add_counts, detect, flee, is_moved, wander

wp.set_module_options(MOTION)


@wp.struct
class Flock:
    """Some targets of a world, side by side."""

    count: wp.int32
    number: Ints
    stage: Ints
    motion: Ints
    """STILL for one that is hidden."""
    before_x: Floats
    before_y: Floats
    """Where it was at the beginning of the step [m]."""
    x: Floats
    y: Floats
    heading: Floats
    reach: Floats
    """How far from it a robot may be that can have met it within the step [m]."""


@wp.func
def gather(w: int, count: int, number: Ints, near: float, way: float, radius: float, targets: Targets) -> Flock:
    """Take up the targets of these numbers; one that an extension moves has already moved."""
    flock = Flock()
    flock.count = count
    flock.number = number
    flock.reach = Floats(near + way)
    for k in range(count):
        t = number[k]
        place = targets.position[w, t]
        flock.stage[k] = targets.stage[w, t]
        flock.motion[k] = targets.motion[w, t]
        flock.x[k] = place[0]
        flock.y[k] = place[1]
        flock.heading[k] = targets.heading[w, t]
        before = place
        if targets.motion[w, t] == CUSTOM:
            before = targets.before[w, t]
            targets.before[w, t] = place
            flock.reach[k] = radius + wp.length(place - before) + way
        flock.before_x[k] = before[0]
        flock.before_y[k] = before[1]
        if targets.stage[w, t] == HIDDEN:
            flock.motion[k] = STILL
    return flock


@wp.func
def move_together(
    w: int,
    key: int,
    flock: Flock,
    nearest: Ints,
    square: Floats,
    step: float,
    curve: CurveStruct,
    target: TargetStruct,
    robots: Robots,
    targets: Targets,
) -> tuple[Floats, Floats]:
    """Move targets over a step [s]; returns their new places [m]. `nearest` and `square` are of `nearest_sensors`."""
    # Copies: a loop over the fields of a struct does not become SIMD.
    number = flock.number
    motion = flock.motion
    x = flock.x
    y = flock.y
    heading = flock.heading
    for k in range(ABREAST):
        if k < width():
            moved = wander(number[k], key, motion[k], x[k], y[k], heading[k], step, curve, target)
            x[k] = wp.where(is_moved(motion[k]), moved[0], x[k])
            y[k] = wp.where(is_moved(motion[k]), moved[1], y[k])
            heading[k] = moved[2]
    for k in range(flock.count):
        if square[k] < target.flee_radius * target.flee_radius and flock.motion[k] == FLEEING:
            fled = flee(wp.vec2(flock.x[k], flock.y[k]), robots.sensor[w, nearest[k]], step, curve, target)
            x[k] = fled[0]
            y[k] = fled[1]
            heading[k] = fled[2]
        if is_moved(flock.motion[k]):
            targets.position[w, flock.number[k]] = wp.vec2(x[k], y[k])
            targets.heading[w, flock.number[k]] = heading[k]
    return x, y


@wp.func
def detect_together(
    w: int,
    part: int,
    flock: Flock,
    square: Floats,
    x: Floats,
    y: Floats,
    near: float,
    radius: float,
    clock: Clock,
    robots: Robots,
    targets: Targets,
    counted: Counted,
) -> wp.vec2i:
    """Let robots detect targets that are at x, y now [m]; returns how many wait on, and are in sight.

    `square` is of `nearest_sensors`, at the places before.
    """
    comes_near = bool(False)
    for k in range(flock.count):
        comes_near = comes_near or square[k] < near * near
    # A target that was far from every sensor cannot have come into one's reach in this step.
    nearest = Ints()
    least = square
    if comes_near:
        nearest, least = nearest_sensors(w, x, y, robots)
    waiting = int(0)
    sighted = int(0)
    stage = flock.stage
    reach = flock.reach
    seen = Ints()
    asks = Ints()
    for k in range(ABREAST):
        if k < width():
            seen[k] = wp.where(least[k] < radius * radius, 1, 0)
            met = wp.where(square[k] < reach[k] * reach[k], 1, 0)
            appears = wp.where(stage[k] == HIDDEN, 1, 0)
            asks[k] = wp.where(stage[k] == FOUND, 0, seen[k] | met | appears)
    for k in range(flock.count):
        t = flock.number[k]
        targets.in_sight[w, t] = seen[k]
        sighted += seen[k]
        waiting += wp.where(flock.stage[k] == FOUND, 0, 1)
        if asks[k] == 1:  # which is rare
            sight = wp.vec2(-1.0, 2.0)
            if flock.stage[k] == PRESENT:
                before = wp.vec2(flock.before_x[k], flock.before_y[k])
                sight = first_sight(w, before, wp.vec2(x[k], y[k]), radius, flock.reach[k], robots)
            at_end = wp.vec2(float(nearest[k]), least[k])
            waiting -= detect(w, t, clock.step[w], part, at_end, sight, radius, targets, counted)
    return wp.vec2i(waiting, sighted)


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
    total = wp.vec2i(0, 0)
    t = int(begin + lane)
    while t < end:
        number = Ints()
        count = int(0)
        while t < end and count < width():
            if targets.appears_at[w, t] > now:
                t = end  # the slots are in the order of their times
            else:
                stage = targets.stage[w, t]
                if target.leave == 1 and stage == FOUND:
                    targets.stage[w, t] = GONE
                    targets.in_sight[w, t] = 0
                elif stage != GONE:
                    number[count] = t
                    count += 1
                t += lanes
        if count > 0:
            flock = gather(w, count, number, near, way, radius, targets)
            nearest, square = nearest_sensors(w, flock.x, flock.y, robots)
            x, y = move_together(w, key, flock, nearest, square, task.step, curve, target, robots, targets)
            total += detect_together(w, part, flock, square, x, y, near, radius, clock, robots, targets, counted)
    add_counts(w, part, total[0], total[1], counted)
