"""The decisions of the proved filter: each robot in its turn takes an action only if a tail remains after it.

`baselines.safety.proved` has the theorem; here its steps are marked with the numbers of its conditions.
"""

from typing import Any

import warp as wp

from baselines.policies.own_row import hears, own_heading, own_key, own_position, own_speed, own_works
from baselines.safety.tails import POINTS, arc_end, error_tube, lay_out, roll_on, room_between
from lissajous_env.device import randomness
from lissajous_env.device.car_input import steering_angle, throttle
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.part_structs import RobotStruct
from lissajous_env.device.trig import cos_sin

wp.set_module_options(OPTIONS)

OLD, NEW = wp.constant(0), wp.constant(1)
"""Plans of a robot in a step: its old tail goes on; it takes an action, and a new tail follows."""
STEERINGS = wp.constant(25)
THROTTLES = wp.constant(5)
TAILS = wp.constant(19)
UNKNOWN, THERE, GONE = wp.constant(0), wp.constant(1), wp.constant(2)
"""Presence of a robot: it has not heard a neighbour yet; it has; it is removed."""


@wp.struct
class Bounds:
    """Constants of the theorem, for one scenario."""

    step: float
    """Control step, h [s]."""
    left: float
    """exp(-c h), the share of the speed that a rolling car has left after a step."""
    touch: float
    """Distance that is kept, 2 r + margin [m]."""
    place: float
    """Bound of the error of a measured position [m]."""
    heading: float
    """Bound of the error of a measured heading [rad]."""
    speed: float
    """Bound of the error of a measured speed [m/s]."""
    speed_unit: float
    """Unit of observed speeds [m/s]."""
    half_width: float
    """Half of the width that tails stay in [m]."""
    half_height: float
    """Half of the height that tails stay in [m]."""
    throttle_weight: float
    """Weight of a change of the throttle against one of the steering."""
    loss: float
    """Probability that a message of the filter is lost."""
    learns: int
    """1 where a robot learns the wheelbase and the drive from its own motion."""


@wp.struct
class Memory:
    """Memory of the robots (W, N) and worlds (W,) from step to step, all zeros before the first."""

    tail: wp.array2d(dtype=wp.vec4)
    """Committed tail at the beginning of the step: `baselines.safety.tails`."""
    tube: wp.array2d(dtype=wp.vec4)
    """Its tube."""
    old_tail: wp.array2d(dtype=wp.vec4)
    """Tail of a robot that failed in the latest step, before its action took effect."""
    old_tube: wp.array2d(dtype=wp.vec4)
    """Its tube."""
    steering: wp.array2d(dtype=wp.vec2)
    """Action of the steering that belongs to the tail, and to the old tail."""
    known: wp.array2d(dtype=wp.vec4)
    """Bounds of the robot's own curvature and drive, as factors: lowest, highest; lowest, highest."""
    last: wp.array2d(dtype=wp.vec4)
    """Measured heading [rad] and speed [m/s] in the step before, and the action taken then."""
    presence: wp.array2d(dtype=wp.int32)
    """UNKNOWN, THERE or GONE."""
    steps: wp.array(dtype=wp.int32)
    """Steps decided in this episode."""
    holds: wp.array(dtype=wp.int32)
    """1 where all committed tails are compatible: from here on, by the theorem, no robot collides."""


@wp.func
def drive(
    bounds: Bounds,
    robot: RobotStruct,
    known: wp.vec4,
    here: wp.vec2,
    heading: float,
    speed: float,
    action: wp.vec2,
    after_steering: float,
) -> tuple[wp.vec4, wp.vec4, wp.vec3]:
    """Tail and tube after an action is held for a step, and the bound by which the step leaves its straight line [m].

    v(t) = v e^(-ct) + (push / c) (1 - e^(-ct)); push and curvature are known up to `known` (conditions 1 and 2).
    """
    turn = cos_sin(steering_angle(robot, action[0]))
    nominal = turn[1] / (turn[0] * robot.wheelbase)
    curvature = 0.5 * (known[0] + known[1]) * nominal
    bend = 0.5 * (known[1] - known[0]) * wp.abs(nominal)
    tau = throttle(robot, action[1])
    push = float(0.0)
    slack = float(0.0)
    if tau > robot.dead_zone:
        push = 0.5 * (known[2] + known[3]) * robot.drive * tau - robot.offset
        slack = 0.5 * (known[3] - known[2]) * robot.drive * tau
    gone = 1.0 - bounds.left
    late = (bounds.step - gone / robot.drag) / robot.drag
    after = wp.max(speed * bounds.left + push * gone / robot.drag, 0.0)
    after_slack = bounds.speed * bounds.left + slack * gone / robot.drag
    way = wp.max(speed * gone / robot.drag + push * late, 0.0)
    way_slack = bounds.speed * gone / robot.drag + slack * late
    way_slack += 0.5 * bounds.step * bounds.step * wp.max(slack - push, 0.0)  # where the car stops within the step
    swing = bounds.heading + wp.abs(curvature) * way_slack
    place = bounds.place + way_slack + swing * way + 0.5 * bend * way * way
    end = arc_end(here[0], here[1], heading, way, curvature)
    length = after / robot.drag
    swing += bend * way
    half_left = wp.sqrt(bounds.left)
    half_way = wp.max(speed * (1.0 - half_left) / robot.drag + push * (0.5 * bounds.step - (1.0 - half_left) / robot.drag) / robot.drag, 0.0)
    mid = arc_end(here[0], here[1], heading, half_way, curvature)
    turn = cos_sin(steering_angle(robot, after_steering))
    nominal = turn[1] / (turn[0] * robot.wheelbase)
    fastest = wp.max(speed, after)
    rate = wp.abs(push - robot.drag * speed) + fastest * fastest * wp.abs(curvature)
    curvature = 0.5 * (known[0] + known[1]) * nominal
    bend = 0.5 * (known[1] - known[0]) * wp.abs(nominal)
    tube = error_tube(curvature, length, place, swing, after_slack / robot.drag, bend)
    return wp.vec4(end[0], end[1], end[2], length), tube, wp.vec3(mid[0], mid[1], rate * bounds.step * bounds.step / 32.0)


@wp.func
def lay_out_old(
    w: int,
    i: int,
    bounds: Bounds,
    robot: RobotStruct,
    memory: Memory,
    points: wp.array4d(dtype=wp.vec3),
    reach: wp.array3d(dtype=float),
):
    """Let a robot's tail roll on for a step, as its old plan."""
    before = memory.tail[w, i]
    tail, tube = roll_on(before, memory.tube[w, i], bounds.left)
    speed = before[3] * robot.drag
    rate = speed * robot.drag + speed * speed * wp.abs(tube[0])
    memory.old_tail[w, i] = tail
    memory.old_tube[w, i] = tube
    bulge = rate * bounds.step * bounds.step / 32.0
    mid = arc_end(before[0], before[1], before[2], (1.0 - wp.sqrt(bounds.left)) * before[3], tube[0])
    lay_out(w, i, OLD, wp.vec2(before[0], before[1]), wp.vec2(mid[0], mid[1]), bulge, tail, tube, points, reach)


@wp.func
def narrowed(low: float, high: float, value: float, error: float, widest: wp.vec2) -> wp.vec2:
    """Intersect [low, high] with value -+ error; where they do not meet, the model is not that of the theorem."""
    lower = wp.max(low, value - error)
    upper = wp.min(high, value + error)
    if lower > upper:
        return widest
    return wp.vec2(lower, upper)


@wp.func
def learn(
    bounds: Bounds, robot: RobotStruct, known: wp.vec4, widest: wp.vec4, last: wp.vec4, heading: float, speed: float
) -> wp.vec4:
    """Narrow the bounds of curvature and drive by the motion of the latest step (condition 2).

    push = c (v_1 - v_0 e^(-ch)) / (1 - e^(-ch)), way = (v_0 - v_1 + push h) / c, kappa = turn / way.
    """
    gone = 1.0 - bounds.left
    push = robot.drag * (speed - last[1] * bounds.left) / gone
    push_error = robot.drag * bounds.speed * (1.0 + bounds.left) / gone
    tau = throttle(robot, last[3])
    found = known
    if tau > robot.dead_zone and speed > 0.0:
        unit = robot.drive * tau
        span = narrowed(known[2], known[3], (push + robot.offset) / unit, push_error / unit, wp.vec2(widest[2], widest[3]))
        found[2] = span[0]
        found[3] = span[1]
    way = (last[1] - speed + push * bounds.step) / robot.drag
    way_error = (2.0 * bounds.speed + push_error * bounds.step) / robot.drag
    turn = cos_sin(steering_angle(robot, last[2]))
    nominal = turn[1] / (turn[0] * robot.wheelbase)
    unit = way * nominal
    if way > 2.0 * way_error and wp.abs(unit) > 10.0 * bounds.heading:
        turned = heading - last[0]
        turned -= 6.2831853 * wp.rint(turned / 6.2831853)
        value = turned / unit
        error = (2.0 * bounds.heading / wp.abs(unit) + wp.abs(value) * way_error / way) * way / (way - way_error)
        span = narrowed(known[0], known[1], value, error, wp.vec2(widest[0], widest[1]))
        found[0] = span[0]
        found[1] = span[1]
    return found


@wp.func
def room_inside(
    w: int, i: int, slot: int, bounds: Bounds, points: wp.array4d(dtype=wp.vec3)
) -> float:
    """Least distance of a plan from the edge of the rectangle that it has to stay in [m] (condition 1)."""
    least = float(1.0e30)
    for k in range(1, POINTS):
        place = points[w, i, slot, k]
        inside = wp.min(bounds.half_width - wp.abs(place[0]), bounds.half_height - wp.abs(place[1]))
        least = wp.min(least, inside - place[2])
    return least


@wp.func
def room_of(
    w: int,
    i: int,
    slot: int,
    enough: float,
    bounds: Bounds,
    presence: wp.array2d(dtype=int),
    decided: wp.array2d(dtype=int),
    points: wp.array4d(dtype=wp.vec3),
    reach: wp.array3d(dtype=float),
) -> float:
    """Least room of a plan to the tails of all others, old and new, until it is below `enough` [m] (condition 4)."""
    least = room_inside(w, i, slot, bounds, points)
    for j in range(presence.shape[1]):
        if least < enough:
            return least
        if j != i and presence[w, j] != GONE:
            least = wp.min(least, room_between(w, i, slot, j, OLD, bounds.touch, points, reach))
            if decided[w, j] == 1:
                least = wp.min(least, room_between(w, i, slot, j, NEW, bounds.touch, points, reach))
    return least


@wp.func
def hears_all(w: int, i: int, step: int, bounds: Bounds, observation: wp.array3d(dtype=float)) -> bool:
    """Return whether a robot heard, in this step, the tails of all others (condition 3)."""
    if bounds.loss == 0.0:
        return True
    key = randomness.step_key(own_key(w, i, observation), step)
    for j in range(observation.shape[1]):
        if j != i and randomness.uniform(key, j, randomness.MESSAGE) < bounds.loss:
            return False
    return True


@wp.func
def begin(
    w: int,
    i: int,
    bounds: Bounds,
    robot: RobotStruct,
    curve: CurveStruct,
    widest: wp.vec4,
    memory: Memory,
    observation: wp.array3d(dtype=float),
) -> bool:
    """Bring a robot's memory to the step that begins; return whether it is where its tail says (condition 5).

    A robot that failed in the latest step did not take its action, but went on with its old tail. One that is not where
    its tail says, as at the beginning of an episode, begins a tail where it is.
    """
    here = own_position(w, i, curve, observation)
    heading = own_heading(w, i, observation)
    speed = wp.max(own_speed(w, i, bounds.speed_unit, observation), 0.0)
    works = own_works(w, i, observation)
    neighbours = hears(w, i, 0, observation) or hears(w, i, 1, observation)
    if neighbours:
        memory.presence[w, i] = THERE
    elif memory.presence[w, i] == THERE and not works:
        memory.presence[w, i] = GONE
    if memory.steps[w] == 0:
        memory.known[w, i] = widest
    elif not works:
        memory.tail[w, i] = memory.old_tail[w, i]
        memory.tube[w, i] = memory.old_tube[w, i]
        memory.steering[w, i] = wp.vec2(memory.steering[w, i][1], memory.steering[w, i][1])
    elif bounds.learns == 1:
        memory.known[w, i] = learn(bounds, robot, memory.known[w, i], widest, memory.last[w, i], heading, speed)
    memory.last[w, i] = wp.vec4(heading, speed, 0.0, 0.0)
    tail = memory.tail[w, i]
    away = wp.length(here - wp.vec2(tail[0], tail[1]))
    if memory.steps[w] > 0 and away <= memory.tube[w, i][1] + bounds.place:
        return True
    known = memory.known[w, i]
    turn = cos_sin(steering_angle(robot, memory.steering[w, i][0]))
    nominal = turn[1] / (turn[0] * robot.wheelbase)
    bend = 0.5 * (known[1] - known[0]) * wp.abs(nominal)
    curvature = 0.5 * (known[0] + known[1]) * nominal
    length = speed / robot.drag
    memory.tail[w, i] = wp.vec4(here[0], here[1], heading, length)
    memory.tube[w, i] = error_tube(
        curvature, length, bounds.place, bounds.heading, bounds.speed / robot.drag, bend
    )
    return memory.presence[w, i] == GONE


@wp.func
def is_compatible(
    w: int,
    bounds: Bounds,
    presence: wp.array2d(dtype=int),
    points: wp.array4d(dtype=wp.vec3),
    reach: wp.array3d(dtype=float),
) -> int:
    """Return 1 if the tails of all robots are compatible: the beginning of the induction (condition 6)."""
    for i in range(presence.shape[1]):
        if presence[w, i] != GONE:
            if room_inside(w, i, OLD, bounds, points) < 0.0:
                return 0
            for j in range(i):
                if presence[w, j] != GONE:
                    if room_between(w, i, OLD, j, OLD, bounds.touch, points, reach) < 0.0:
                        return 0
    return 1


@wp.func
def alternative(robot: RobotStruct, k: int, wanted: wp.vec2) -> wp.vec2:
    """Return an action that may be taken in place of the wanted one, which is the first of them."""
    s = k // int(THROTTLES)
    steering = wanted[0]
    if s >= 1:
        steering += 0.05 * float((s + 1) // 2) * float(2 * (s % 2) - 1) * (1.0 + 0.1 * float(s))
    m = k % int(THROTTLES)
    if m == 3:
        return wp.vec2(wp.clamp(steering, -1.0, 1.0), wp.min(1.0, wanted[1] + 0.4))
    if m == 4:
        return wp.vec2(wp.clamp(steering, -1.0, 1.0), 1.0)
    share = 0.5 * float(m)
    return wp.vec2(wp.clamp(steering, -1.0, 1.0), wanted[1] - share * (wanted[1] + 1.0))


@wp.func
def AFTER(m: int, steering: float, held: float) -> float:
    """x"""
    if m == 1:
        return held
    return float(m - 2) / 8.0 - 1.0


@wp.func
def within_grip(robot: RobotStruct, bounds: Bounds, known: wp.vec4, speed: float, action: wp.vec2) -> wp.vec2:
    """Limit the steering to what grip allows at the speed before and after the step (condition 1)."""
    push = wp.max(known[3] * robot.drive * throttle(robot, action[1]) - robot.offset, 0.0)
    fastest = wp.max(speed + bounds.speed, (speed + bounds.speed) * bounds.left + push * bounds.step)
    most = robot.lateral_acceleration_max / wp.max(fastest * fastest, 1.0e-20)
    angle = wp.atan(0.999 * most * robot.wheelbase / known[1]) / robot.steering_max
    return wp.vec2(wp.clamp(action[0], -angle, angle), action[1])


@wp.kernel
def commit(
    bounds: Bounds,
    robot: RobotStruct,
    curve: CurveStruct,
    widest: wp.array(dtype=wp.vec4),
    observation: wp.array3d(dtype=float),
    wanted: wp.array3d(dtype=float),
    memory: Memory,
    decided: wp.array2d(dtype=int),
    points: wp.array4d(dtype=wp.vec3),
    reach: wp.array3d(dtype=float),
    action_out: wp.array3d(dtype=float),
):
    """Decide on the actions of a world's robots, one after another, in an order that moves on by one in each step."""
    w = wp.tid()
    n = observation.shape[1]
    holds = memory.holds[w]
    for i in range(n):
        decided[w, i] = 0
        if not begin(w, i, bounds, robot, curve, widest[i], memory, observation):
            holds = 0
        lay_out_old(w, i, bounds, robot, memory, points, reach)
    if holds == 0:
        holds = is_compatible(w, bounds, memory.presence, points, reach)
    memory.holds[w] = holds
    step = memory.steps[w]
    for turn in range(n):
        i = (turn + step) % n
        for k in range(2, action_out.shape[2]):
            action_out[w, i, k] = wanted[w, i, k]  # a message
        tail = memory.old_tail[w, i]
        tube = memory.old_tube[w, i]
        held = memory.steering[w, i][0]
        chosen = wp.vec2(held, -1.0)
        want = wp.vec2(wanted[w, i, 0], wanted[w, i, 1])
        able = own_works(w, i, observation) and wp.isfinite(want[0]) and wp.isfinite(want[1])
        if able and hears_all(w, i, step, bounds, observation):
            want = wp.vec2(wp.clamp(want[0], -1.0, 1.0), wp.clamp(want[1], -1.0, 1.0))
            most = float(0.0)
            if holds == 0:
                most = wp.min(room_of(w, i, OLD, -1.0e30, bounds, memory.presence, decided, points, reach), 0.0)
            here = own_position(w, i, curve, observation)
            known = memory.known[w, i]
            speed = memory.last[w, i][1]
            least = float(1.0e30)
            chosen_after = float(held)
            for kk in range(STEERINGS * THROTTLES * TAILS):
                k = kk // TAILS
                m = kk % TAILS
                action = alternative(robot, k, want)
                after_steering = action[0]
                if m > 0:
                    after_steering = AFTER(m, action[0], held)

                if wp.isfinite(robot.lateral_acceleration_max):
                    action = within_grip(robot, bounds, known, speed, action)
                apart = action - want
                cost = apart[0] * apart[0] + bounds.throttle_weight * apart[1] * apart[1]
                if cost < least or most < 0.0:
                    new_tail, new_tube, bulge = drive(bounds, robot, known, here, memory.last[w, i][0], speed, action, after_steering)
                    lay_out(w, i, NEW, here, wp.vec2(bulge[0], bulge[1]), bulge[2], new_tail, new_tube, points, reach)
                    room = room_of(w, i, NEW, most, bounds, memory.presence, decided, points, reach)
                    better = room >= 0.0 and (most < 0.0 or cost < least)
                    if better or (most < 0.0 and room > most):
                        most = wp.min(room, 0.0)
                        least = cost
                        chosen = action
                        chosen_after = after_steering
                        tail = new_tail
                        tube = new_tube
                        decided[w, i] = 1
                    if least == 0.0 and room >= 0.0:
                        break
            if decided[w, i] == 1:
                again, again_tube, bulge = drive(bounds, robot, known, here, memory.last[w, i][0], speed, chosen, chosen_after)
                lay_out(w, i, NEW, here, wp.vec2(bulge[0], bulge[1]), bulge[2], again, again_tube, points, reach)
            held = chosen_after
        action_out[w, i, 0] = chosen[0]
        action_out[w, i, 1] = chosen[1]
        memory.tail[w, i] = tail
        memory.tube[w, i] = tube
        memory.steering[w, i] = wp.vec2(held, memory.steering[w, i][0])
        memory.last[w, i] = wp.vec4(memory.last[w, i][0], memory.last[w, i][1], chosen[0], chosen[1])
    memory.steps[w] = step + 1
