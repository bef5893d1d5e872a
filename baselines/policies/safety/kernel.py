"""The collision filter's arithmetic for one robot: manoeuvres, margins, and the agreed way out."""

import warp as wp

from baselines.policies.own_row import (
    hears,
    message_age,
    offset_heard,
    offset_seen,
    own_heading,
    own_position,
    own_speed,
    own_works,
    sees,
    velocity_seen,
)
from baselines.policies.safety.parameters import SafetyStruct
from baselines.policies.safety.quadratic_program import TOLERANCE, into_box, solve_quadratic_program
from lissajous_env.device.approach import closest_approach
from lissajous_env.device.car_input import car_action, steering_and_throttle
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.part_structs import RobotStruct
from lissajous_env.device.trig import cos_sin
from lissajous_env.world.robots.car import motor_push, speed_limit_below

wp.set_module_options(OPTIONS)

MANOEUVRES = wp.constant(9)
"""Ways out: full right, straight on, full left; each while coasting, at this speed, and driving on."""
NEAREST = wp.constant(8)
"""Largest number of robots that are avoided, the nearest first."""
_DIFFERENCE = wp.constant(0.05)
_NONE = wp.constant(1.0e30)

scores = wp.types.vector(length=9, dtype=wp.float32)


@wp.struct
class Scales:
    """Scales of the entries of an observation, and the number of robots that it lists.

    `speed` is the top speed of a car [m/s], `radius` that of the disc [m], `step` the control step [s], `age_unit`
    that of a message's age [s]. Robots within the sensing radius that drive at `fastest` [m/s] or faster are not
    avoided.
    """

    speed: wp.float32
    radius: wp.float32
    step: wp.float32
    age_unit: wp.float32
    robots_seen: wp.int32
    fastest: wp.float32


@wp.func
def drive_on(robot: RobotStruct, speed_max: float, car: wp.vec4, action: wp.vec2, h: float) -> wp.vec4:
    """Return x, y, heading, v after h [s] at a constant action: (12) by the midpoint rule, with v up to speed_max."""
    given = steering_and_throttle(robot, action)
    steering = cos_sin(given[0])
    curvature = steering[1] / (steering[0] * robot.wheelbase)
    push = wp.max(robot.drive * given[1] - robot.offset, 0.0)
    if robot.speed_min < 0.0:
        push = motor_push(robot, robot.drive, given[1])
    before = car[3]
    after = before + h * (push - robot.drag * (before + 0.5 * h * (push - robot.drag * before)))
    after = wp.clamp(after, speed_limit_below(robot), wp.max(before, speed_max))
    way = 0.5 * h * (before + after)
    grip = robot.lateral_acceleration_max / wp.max(before * before, 1.0e-20)
    turn = way * wp.clamp(curvature, -grip, grip)
    ahead = cos_sin(car[2] + 0.5 * turn)
    return wp.vec4(car[0] + way * ahead[0], car[1] + way * ahead[1], car[2] + turn, after)


@wp.func
def throttle_action(robot: RobotStruct, push: float) -> float:
    """Return the action of the throttle, in [-1, 1], that accelerates the car by `push` [m/s^2]."""
    return car_action(robot, 0.0, (push + robot.offset) / robot.drive)[1]


@wp.func
def manoeuvre(robot: RobotStruct, k: int, speed: float) -> wp.vec2:
    """Return the action of manoeuvre k of a car with some speed [m/s] at its beginning."""
    throttle = float(1.0)
    if k // 3 == 0:
        throttle = car_action(robot, 0.0, robot.throttle_min)[1]
    elif k // 3 == 1:
        throttle = throttle_action(robot, robot.drag * speed)
    return wp.vec2(float(k % 3) - 1.0, throttle)


@wp.func
def price(safety: SafetyStruct, k: int) -> float:
    """Return the margin that manoeuvre k must add to be chosen [m]."""
    cost = 0.5 * safety.effort * wp.abs(float(k // 3) - 1.0)
    if k % 3 != 1:
        cost += safety.effort
    if k % 3 == 0:
        cost -= safety.right
    return cost


@wp.func
def margin(
    safety: SafetyStruct,
    robot: RobotStruct,
    car: wp.vec4,
    other: wp.vec4,
    action: wp.vec2,
    way_out: wp.vec2,
    step: float,
) -> float:
    """m(action; way_out) = min over the horizon of distance - (2 r + clearance + growth t) [m].

    The car applies the action for one step and then follows the way out; the other (x, y, x', y') goes straight on.
    """
    least = float(_NONE)
    now = car
    keep = 2.0 * robot.radius + safety.clearance
    for t in range(safety.horizon):
        then = drive_on(robot, safety.speed_max, now, wp.where(t == 0, action, way_out), step)
        early = float(t) * step
        late = early + step
        square = closest_approach(
            wp.vec2(now[0] - other[0] - early * other[2], now[1] - other[1] - early * other[3]),
            wp.vec2(then[0] - other[0] - late * other[2], then[1] - other[1] - late * other[3]),
        )
        least = wp.min(least, wp.sqrt(square) - keep - safety.growth * early)
        now = then
    return least


@wp.func
def barrier(
    safety: SafetyStruct,
    robot: RobotStruct,
    car: wp.vec4,
    w: int,
    i: int,
    n: int,
    others: wp.array3d(dtype=wp.vec4),
    action: wp.vec2,
    way_out: wp.vec2,
    step: float,
) -> float:
    """Return the least margin to the n others."""
    least = float(_NONE)
    for k in range(n):
        least = wp.min(least, margin(safety, robot, car, others[w, i, k], action, way_out, step))
    return least


@wp.func
def agreed_way_out(
    safety: SafetyStruct,
    robot: RobotStruct,
    car: wp.vec4,
    w: int,
    i: int,
    n: int,
    others: wp.array3d(dtype=wp.vec4),
    step: float,
    path: wp.array4d(dtype=wp.vec2),
) -> int:
    """Return the manoeuvre b that two cars agree on if both compute the best pair of manoeuvres.

    b = argmax min_k max_{b'} min(m_k(b, b'), ample) - price(b) - price(b'), where m_k(b, b') is the margin if this car
    follows b and the other b' from now on. Both cars of a pair observe the same two states, so they compute the same
    pair.
    """
    keep = 2.0 * robot.radius + safety.clearance
    score = scores()
    for b in range(MANOEUVRES):
        score[b] = _NONE
        now = car
        action = manoeuvre(robot, b, car[3])
        for t in range(safety.horizon + 1):
            path[w, i, b, t] = wp.vec2(now[0], now[1])
            now = drive_on(robot, safety.speed_max, now, action, step)
    for k in range(n):
        other = others[w, i, k]
        speed = wp.sqrt(other[2] * other[2] + other[3] * other[3])
        answers = wp.where(speed < safety.resting, 1, MANOEUVRES)
        for b in range(answers):
            now = wp.vec4(other[0], other[1], wp.atan2(other[3], other[2]), speed)
            action = manoeuvre(robot, b, speed)
            for t in range(safety.horizon + 1):
                path[w, i, MANOEUVRES + b, t] = wp.vec2(now[0], now[1])
                if speed >= safety.resting:
                    now = drive_on(robot, safety.speed_max, now, action, step)
        for b in range(MANOEUVRES):
            best = float(-_NONE)
            for answer in range(answers):
                least = float(_NONE)
                before = path[w, i, b, 0] - path[w, i, MANOEUVRES + answer, 0]
                for t in range(safety.horizon):
                    after = path[w, i, b, t + 1] - path[w, i, MANOEUVRES + answer, t + 1]
                    apart = wp.sqrt(closest_approach(before, after)) - keep - safety.growth * float(t) * step
                    least = wp.min(least, apart)
                    before = after
                worth = wp.min(least, safety.ample)
                if answers > 1:
                    worth -= price(safety, answer)
                best = wp.max(best, worth)
            score[b] = wp.min(score[b], best)
    chosen = int(0)
    best = float(-_NONE)
    for b in range(MANOEUVRES):
        worth = score[b] - price(safety, b)
        if worth > best:
            best = worth
            chosen = b
    return chosen


@wp.func
def linearise(
    safety: SafetyStruct,
    robot: RobotStruct,
    car: wp.vec4,
    w: int,
    i: int,
    n: int,
    others: wp.array3d(dtype=wp.vec4),
    at: wp.vec2,
    way_out: wp.vec2,
    step: float,
    rows_out: wp.array3d(dtype=wp.vec3),
):
    """Write row k, g.u >= c: m_k(at) + g.(u - at) >= 0, with g by differences towards the middle of the box.

    The margins are divided by `safety.unit`.
    """
    towards = wp.vec2(
        wp.where(at[0] > 0.0, -_DIFFERENCE, _DIFFERENCE), wp.where(at[1] > 0.0, -_DIFFERENCE, _DIFFERENCE)
    )
    for k in range(n):
        other = others[w, i, k]
        here = margin(safety, robot, car, other, at, way_out, step) / safety.unit
        steered = margin(safety, robot, car, other, at + wp.vec2(towards[0], 0.0), way_out, step) / safety.unit
        driven = margin(safety, robot, car, other, at + wp.vec2(0.0, towards[1]), way_out, step) / safety.unit
        g = wp.vec2((steered - here) / towards[0], (driven - here) / towards[1])
        rows_out[w, i, k] = wp.vec3(g[0], g[1], wp.dot(g, at) - here)


@wp.func
def see(
    w: int,
    i: int,
    scales: Scales,
    heading: float,
    speed: float,
    observation: wp.array3d(dtype=float),
    others_out: wp.array3d(dtype=wp.vec4),
) -> int:
    """Write relative x, y [m] and velocity [m/s] of the robots within the sensing radius, and return their number."""
    own = speed * cos_sin(heading)
    n = int(0)
    for k in range(wp.min(scales.robots_seen, NEAREST)):
        if sees(w, i, k, observation):
            away = offset_seen(w, i, k, scales.radius, observation)
            velocity = velocity_seen(w, i, k, scales.speed, observation) + own
            if wp.length(velocity) < scales.fastest:
                others_out[w, i, n] = wp.vec4(away[0], away[1], velocity[0], velocity[1])
                n += 1
    return n


@wp.func
def hear(
    w: int,
    i: int,
    n: int,
    curve: CurveStruct,
    scales: Scales,
    memory: wp.array3d(dtype=wp.vec3),
    observation: wp.array3d(dtype=float),
    others_out: wp.array3d(dtype=wp.vec4),
) -> int:
    """Add the ring neighbours beyond the sensing radius that sent in this step and the one before; return the number.

    Their velocity is the difference of the two positions that they sent. The memory is the latest position, and 1 if
    there is one.
    """
    own = own_position(w, i, curve, observation)
    found = int(n)
    for side in range(2):
        before = memory[w, i, side]
        memory[w, i, side] = wp.vec3(0.0, 0.0, 0.0)
        if hears(w, i, side, observation) and message_age(w, i, side, scales.age_unit, observation) < 0.5 * scales.step:
            away = offset_heard(w, i, side, curve, observation)
            place = own + away
            memory[w, i, side] = wp.vec3(place[0], place[1], 1.0)
            if before[2] > 0.0 and wp.length(away) >= scales.radius and found < NEAREST:
                velocity = (place - wp.vec2(before[0], before[1])) / scales.step
                others_out[w, i, found] = wp.vec4(away[0], away[1], velocity[0], velocity[1])
                found += 1
    return found


@wp.kernel
def keep_clear(
    safety: SafetyStruct,
    robot: RobotStruct,
    curve: CurveStruct,
    scales: Scales,
    listens: int,
    memory: wp.array3d(dtype=wp.vec3),
    observation: wp.array3d(dtype=float),
    wanted: wp.array3d(dtype=float),
    others: wp.array3d(dtype=wp.vec4),
    path: wp.array4d(dtype=wp.vec2),
    rows_out: wp.array3d(dtype=wp.vec3),
    count_out: wp.array2d(dtype=int),
    top_out: wp.array2d(dtype=float),
    action_out: wp.array3d(dtype=float),
):
    """Write the wanted action, or the nearest one that avoids the other robots."""
    w, i = wp.tid()
    u = wp.vec2(wanted[w, i, 0], wanted[w, i, 1])
    count_out[w, i] = 0
    top_out[w, i] = 1.0
    for k in range(action_out.shape[2]):
        action_out[w, i, k] = wanted[w, i, k]  # beyond the first two, a message
    step = scales.step
    speed = wp.max(own_speed(w, i, scales.speed, observation), speed_limit_below(robot))
    heading = own_heading(w, i, observation)
    n = see(w, i, scales, heading, speed, observation, others)
    if listens == 1:
        n = hear(w, i, n, curve, scales, memory, observation, others)
    if not own_works(w, i, observation) or not wp.isfinite(u[0]) or not wp.isfinite(u[1]):
        return
    car = wp.vec4(0.0, 0.0, heading, speed)
    top = throttle_action(robot, (safety.speed_max - speed) / step + robot.drag * speed)
    top_out[w, i] = top
    u = into_box(u, top)
    action_out[w, i, 0] = u[0]
    action_out[w, i, 1] = u[1]
    if n == 0:
        return
    for b in range(MANOEUVRES):
        if barrier(safety, robot, car, w, i, n, others, u, manoeuvre(robot, b, speed), step) >= 0.0:
            return
    chosen = agreed_way_out(safety, robot, car, w, i, n, others, step, path)
    way_out = manoeuvre(robot, chosen, speed)
    way_out[1] = wp.min(way_out[1], top)
    at = u
    count_out[w, i] = n
    nominal = wp.vec2(wanted[w, i, 0], wanted[w, i, 1])
    for turn in range(safety.passes):
        linearise(safety, robot, car, w, i, n, others, at, way_out, step, rows_out)
        found = solve_quadratic_program(w, i, n, rows_out, safety.throttle_weight, top, nominal)
        u = wp.vec2(found[0], found[1])
        at = u
        if turn == 0 and found[2] > 0.0:
            # The linearised rows contradict one another there: begin again at the way out itself.
            at = way_out
        elif barrier(safety, robot, car, w, i, n, others, u, way_out, step) >= -TOLERANCE * safety.unit:
            break
    action_out[w, i, 0] = u[0]
    action_out[w, i, 1] = u[1]
