"""Rogue targets: they appear, move, and are detected by the first working robot that has them in its disc."""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import MOTION
from lissajous_env.device.curve import CurveStruct, wrap
from lissajous_env.device.part_structs import SensingStruct, TargetStruct, TaskStruct
from lissajous_env.device.structs import place_of
from lissajous_env.device.trig import cos_sin
from lissajous_env.parameters import parts
from lissajous_env.world.state import FOUND, GONE, HIDDEN, NEVER, PRESENT, Clock, Latest, Robots, Targets

wp.set_module_options(MOTION)

STILL = wp.constant(0)
DRIFTING = wp.constant(1)
WANDERING = wp.constant(2)
FLEEING = wp.constant(3)
CUSTOM = wp.constant(4)
"""Moved by a stage of the scenario's own."""

_BOUNDARY = wp.constant(place_of(parts.Targets, "entry", "boundary"))


@wp.func
def planar(position: wp.vec3) -> wp.vec2:
    """Position on the ground [m]."""
    return wp.vec2(position[0], position[1])


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
def reset_targets(first: int, lanes: int, curve: CurveStruct, target: TargetStruct, clock: Clock, targets: Targets):
    """Draw place, heading and motion of every slot; those of the start appear at step 0."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    key = randomness.step_key(clock.seed[w], 0)
    for t in range(lane, targets.stage.shape[1], lanes):
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


@wp.func
def square_to_sensor(w: int, place: wp.vec2, robots: Robots) -> float:
    """Squared distance of a place from the nearest working robot [m^2]."""
    least = float(1.0e30)
    for i in range(robots.sensor.shape[1]):
        away = robots.sensor[w, i] - place
        least = wp.min(least, wp.dot(away, away))
    return least


@wp.func
def nearest_sensor(w: int, place: wp.vec2, robots: Robots) -> int:
    """Index of the working robot nearest to a place; the first of those that are equally near."""
    nearest = int(0)
    least = float(1.0e30)
    for i in range(robots.sensor.shape[1]):
        away = robots.sensor[w, i] - place
        square = wp.dot(away, away)
        if square < least:
            least = square
            nearest = i
    return nearest


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
def flee(w: int, t: int, away: wp.vec2, step: float, curve: CurveStruct, target: TargetStruct, targets: Targets):
    """Run along `away`; a wall turns the flight along itself, it does not send the target back to the robot."""
    fled = targets.position[w, t] + target.flee_speed * step * wp.normalize(away)
    targets.position[w, t] = wp.vec2(
        wp.clamp(fled[0], -curve.half_width, curve.half_width),
        wp.clamp(fled[1], -curve.half_height, curve.half_height),
    )
    targets.heading[w, t] = wp.atan2(away[1], away[0])


@wp.func
def wander(w: int, t: int, turn: float, step: float, curve: CurveStruct, target: TargetStruct, targets: Targets):
    """Turn by an angle [rad] and go straight on, off the boundary."""
    heading = targets.heading[w, t] + turn
    moved = bounce(targets.position[w, t] + target.speed * step * cos_sin(heading), heading, curve)
    targets.position[w, t] = wp.vec2(moved[0], moved[1])
    targets.heading[w, t] = moved[2]


@wp.kernel
def move_targets(
    first: int,
    lanes: int,
    curve: CurveStruct,
    target: TargetStruct,
    task: TaskStruct,
    clock: Clock,
    robots: Robots,
    targets: Targets,
):
    """Let targets that were detected leave, and the others move; one that appears in this step does not move yet."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    now = clock.step[w]
    key = randomness.step_key(clock.seed[w], now)
    # A uniform draw of the wanted deviation: its sum over a second is normal, at a third of the cost.
    widest = target.turn_rate * wp.sqrt(3.0 * task.step)
    for t in range(lane, targets.stage.shape[1], lanes):
        if targets.appears_at[w, t] > now:
            break  # the slots are in the order of their times
        stage = targets.stage[w, t]
        motion = targets.motion[w, t]
        if stage == FOUND and target.leave == 1:
            targets.stage[w, t] = GONE
            targets.in_sight[w, t] = 0
        elif stage != GONE and stage != HIDDEN and motion != STILL and motion != CUSTOM:
            place = targets.position[w, t]
            runs = bool(False)
            if motion == FLEEING:
                runs = square_to_sensor(w, place, robots) < target.flee_radius * target.flee_radius
            if runs:
                from_robot = place - robots.sensor[w, nearest_sensor(w, place, robots)]
                flee(w, t, from_robot, task.step, curve, target, targets)
            else:
                turn = float(0.0)
                if motion != DRIFTING:
                    turn = widest * (2.0 * randomness.uniform(key, t, randomness.WANDER) - 1.0)
                wander(w, t, turn, task.step, curve, target, targets)


@wp.kernel
def detect_targets(
    first: int, lanes: int, sensing: SensingStruct, clock: Clock, robots: Robots, targets: Targets, latest: Latest
):
    """Let the nearest working robot detect a target that is in its disc; what is in none waits."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    now = clock.step[w]
    waiting = int(0)
    sighted = int(0)
    for t in range(lane, targets.stage.shape[1], lanes):
        if targets.appears_at[w, t] > now:
            break
        stage = targets.stage[w, t]
        if stage != GONE:
            place = targets.position[w, t]
            seen = wp.where(square_to_sensor(w, place, robots) < sensing.radius * sensing.radius, 1, 0)
            sighted += seen
            targets.in_sight[w, t] = seen
            if stage != FOUND:
                if seen == 1:
                    targets.stage[w, t] = FOUND
                    targets.found_at[w, t] = now
                    wp.atomic_add(latest.detections, w, nearest_sensor(w, place, robots), 1)
                else:
                    targets.stage[w, t] = PRESENT
                    waiting += 1
    if waiting > 0:
        wp.atomic_add(latest.waiting, w, waiting)
    if sighted > 0:
        wp.atomic_add(latest.in_sight, w, sighted)
