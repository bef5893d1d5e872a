"""Robots that move: points on the curve, and cars by the kinematic bicycle (12) with a motor."""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import MOTION
from lissajous_env.device.curve import CurveStruct, curve_parameter, point, point2, project, tangent2, wrap, wrap_phase
from lissajous_env.device.structs import struct_of
from lissajous_env.device.trig import cos_sin
from lissajous_env.parameters.scenario import Formation, Noise, Robot
from lissajous_env.world.faults import FaultsStruct, update_status
from lissajous_env.world.state import NOWHERE, REMOVED, RUNNING, WORKING, Clock, Links, Robots, Step

wp.set_module_options(MOTION)

RobotStruct = struct_of(Robot)
FormationStruct = struct_of(Formation)
NoiseStruct = struct_of(Noise)

LARGEST_CORRECTION = wp.constant(0.1)
"""Limit of a correction of a car's parameter on the curve [rad]: it may slide along its branch, not jump."""


@wp.func
def motor_push(robot: RobotStruct, drive: float, throttle: float) -> float:
    """Acceleration by the motor, alpha tau - beta above the dead zone [m/s^2], equation (12).

    Differs from the paper: it knows no dead zone; the authors' plant has one, in which the car coasts.
    """
    return wp.where(throttle > robot.dead_zone, drive * throttle - robot.offset, 0.0)


@wp.func
def car_rate(robot: RobotStruct, state: wp.vec4, curvature: float, push: float) -> wp.vec4:
    """(x, y, heading, v)' = (v cos heading, v sin heading, v tan(delta) / l, -c v + push), equation (12).

    `curvature` is tan(delta) / l [1/m]. The yaw rate is limited by grip to a_lat / v; a car does not reverse.
    """
    speed = wp.max(state[3], 0.0)
    yaw_rate = speed * curvature
    if speed * wp.abs(yaw_rate) > robot.lateral_acceleration_max:
        yaw_rate = wp.sign(yaw_rate) * robot.lateral_acceleration_max / speed
    ahead = cos_sin(state[2])
    return wp.vec4(speed * ahead[0], speed * ahead[1], yaw_rate, push - robot.drag * speed)


@wp.func
def car_step(robot: RobotStruct, state: wp.vec4, curvature: float, push: float, h: float) -> wp.vec4:
    """One step of the classical fourth-order Runge-Kutta method over h [s]."""
    k1 = car_rate(robot, state, curvature, push)
    k2 = car_rate(robot, state + 0.5 * h * k1, curvature, push)
    k3 = car_rate(robot, state + 0.5 * h * k2, curvature, push)
    k4 = car_rate(robot, state + h * k3, curvature, push)
    moved = state + (h / 6.0) * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return wp.vec4(moved[0], moved[1], moved[2], wp.max(moved[3], 0.0))


@wp.func
def stop_at_wall(curve: CurveStruct, car: wp.vec4) -> wp.vec4:
    """Keep a car's centre in the rectangle: what of its velocity goes into a wall is lost, its heading stays."""
    along = cos_sin(car[2])
    x = wp.clamp(car[0], -curve.half_width, curve.half_width)
    y = wp.clamp(car[1], -curve.half_height, curve.half_height)
    along_x = wp.where((car[0] - x) * along[0] > 0.0, 0.0, along[0])
    along_y = wp.where((car[1] - y) * along[1] > 0.0, 0.0, along[1])
    kept = wp.where(along_x == along[0] and along_y == along[1], 1.0, wp.length(wp.vec2(along_x, along_y)))
    return wp.vec4(x, y, car[2], car[3] * kept)


@wp.func
def measure(
    w: int,
    i: int,
    now: int,
    key: int,
    curve: CurveStruct,
    alpha: float,
    noise: NoiseStruct,
    robots: Robots,
    links: Links,
):
    """Take robot i's measurement of itself, send it on the ring, and point its sensor."""
    position = robots.position[w, i]
    senses = robots.status[w, i] == WORKING
    robots.sensor[w, i] = wp.vec2(wp.where(senses, position[0], NOWHERE), wp.where(senses, position[1], NOWHERE))
    slot = now % links.sent.shape[2]
    links.sending[w, i, slot] = wp.where(robots.status[w, i] == REMOVED, 0, 1)
    if now > 0 and robots.status[w, i] == REMOVED:
        return  # What it last knew of itself stays.
    pose = wp.vec4(position[0], position[1], robots.heading[w, i], robots.speed[w, i])
    phase = robots.phase[w, i]
    if noise.position > 0.0 or noise.heading > 0.0 or noise.speed > 0.0:
        draw = randomness.stream(key, i, randomness.MEASURE)
        pose[0] += noise.position * wp.randn(draw)
        pose[1] += noise.position * wp.randn(draw)
        pose[2] += noise.heading * wp.randn(draw)
        pose[3] += noise.speed * wp.randn(draw)
        gamma = curve_parameter(alpha, phase)
        seen = project(curve, wp.vec2(pose[0], pose[1]), gamma, LARGEST_CORRECTION)
        phase = wrap_phase(phase + wp.float64((seen - gamma) / alpha))
    robots.measured[w, i] = pose
    robots.measured_phase[w, i] = float(phase)
    links.sent[w, i, slot] = wp.vec3(float(phase), pose[0], pose[1])


@wp.func
def commanded(
    w: int, i: int, key: int, noise: NoiseStruct, action: wp.array3d(dtype=float), clock: Clock, step_out: Step
) -> wp.vec2:
    """Action of robot i in [-1, 1], with actuator noise; zero, and the world flagged, where it is not finite.

    A single component stands twice. The effort is that of the action without the noise.
    """
    command = wp.vec2(action[w, i, 0], action[w, i, action.shape[2] - 1])
    if not (wp.isfinite(command[0]) and wp.isfinite(command[1])):
        clock.invalid[w] = 1
        if clock.invalid_at[w] == 0:
            clock.invalid_at[w] = clock.step[w] + 1
        command = wp.vec2(0.0, 0.0)
    command = wp.vec2(wp.clamp(command[0], -1.0, 1.0), wp.clamp(command[1], -1.0, 1.0))
    step_out.effort[w, i] = 0.5 * wp.dot(command, command)
    if noise.actuator > 0.0:
        draw = randomness.stream(key, i, randomness.ACTUATOR)
        command += noise.actuator * wp.vec2(wp.randn(draw), wp.randn(draw))
        command = wp.vec2(wp.clamp(command[0], -1.0, 1.0), wp.clamp(command[1], -1.0, 1.0))
    return command


@wp.func
def clear_step(w: int, i: int, step_out: Step):
    """Zero the step's counters before the other stages add to them."""
    step_out.detections[w, i] = 0
    step_out.collisions[w, i] = 0
    if i == 0:
        step_out.in_sight[w] = 0
        step_out.waiting[w] = 0
        step_out.idle_ended[w] = wp.int64(0)


@wp.func
def place_on_curve(w: int, i: int, rate: float, curve: CurveStruct, alpha: float, robots: Robots):
    """Put a robot where its phase says, heading along the curve at phase rate `rate` [rad/s]."""
    gamma = curve_parameter(alpha, robots.phase[w, i])
    tangent = tangent2(curve, gamma) * (alpha * rate)
    robots.position[w, i] = point(curve, gamma)
    robots.speed[w, i] = wp.length(tangent)
    if rate != 0.0:
        robots.heading[w, i] = wp.atan2(tangent[1], tangent[0])


@wp.kernel
def reset_robots(
    first: int,
    curve: CurveStruct,
    formation: FormationStruct,
    robot: RobotStruct,
    noise: NoiseStruct,
    start_kind: int,
    equilibrium: wp.array(dtype=wp.float64),
    displaced: wp.array(dtype=float),
    clock: Clock,
    robots: Robots,
    links: Links,
    step_out: Step,
):
    """Place the robots on the curve at its speed, and draw each car's own constants."""
    tid, i = wp.tid()
    w = first + tid
    if clock.fresh[w] == 0:
        return
    key = randomness.step_key(clock.seed[w], 0)
    alpha = float(formation.alpha)
    phase = equilibrium[i] + wp.float64(displaced[i])
    if start_kind == 1:  # the same turn for every robot
        turn = randomness.stream(key, -1, randomness.START)
        phase += wp.float64(6.2831853 * wp.randf(turn))
    draw = randomness.stream(key, i, randomness.START)
    if start_kind == 2:
        phase = wp.float64(6.2831853 * wp.randf(draw))
    phase += wp.float64(formation.start_noise * wp.randn(draw))
    robots.phase[w, i] = wrap_phase(phase)
    robots.status[w, i] = wp.where(robots.removed_at[w, i] < 1, REMOVED, WORKING)
    robots.resumed_at[w, i] = -1
    place_on_curve(w, i, formation.phase_rate / alpha, curve, alpha, robots)
    body = randomness.stream(key, i, randomness.BODY)
    # A spread is clipped at three deviations, so that no car has a wheelbase of zero.
    robots.wheelbase[w, i] = robot.wheelbase * (1.0 + noise.wheelbase_spread * wp.clamp(wp.randn(body), -3.0, 3.0))
    robots.drive[w, i] = robot.drive * (1.0 + noise.drive_spread * wp.clamp(wp.randn(body), -3.0, 3.0))
    for s in range(robots.track.shape[2]):
        robots.track[w, i, s] = robots.position[w, i]
    for slot in range(links.sending.shape[2]):
        links.sending[w, i, slot] = 0
    for side in range(2):
        links.heard_at[w, i, side] = -1
    clear_step(w, i, step_out)
    measure(w, i, 0, key, curve, alpha, noise, robots, links)


@wp.kernel
def move_points(
    first: int,
    lanes: int,
    curve: CurveStruct,
    formation: FormationStruct,
    robot: RobotStruct,
    noise: NoiseStruct,
    faults: FaultsStruct,
    step: float,
    walled: int,
    schedule: wp.array2d(dtype=int),
    action: wp.array3d(dtype=float),
    clock: Clock,
    robots: Robots,
    links: Links,
    step_out: Step,
):
    """Move robots of kind `curve`: the phase goes on at the commanded rate, on the curve; no wall is in their way."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.stage[w] != RUNNING:
        return
    now = clock.step[w] + 1
    key = randomness.step_key(clock.seed[w], now)
    alpha = float(formation.alpha)
    substeps = robots.track.shape[2] - 1
    for i in range(lane, robots.status.shape[1], lanes):
        command = commanded(w, i, key, noise, action, clock, step_out)
        clear_step(w, i, step_out)
        status = update_status(w, i, now, key, step, faults, schedule, robots)
        rate = wp.where(status == WORKING, command[0] * robot.phase_rate_max, 0.0)
        start = robots.phase[w, i]
        robots.track[w, i, 0] = robots.position[w, i]
        for s in range(1, substeps):
            passed = start + wp.float64(rate * step * float(s) / float(substeps))
            robots.track[w, i, s] = point(curve, curve_parameter(alpha, passed))
        robots.phase[w, i] = wrap_phase(start + wp.float64(rate * step))
        place_on_curve(w, i, rate, curve, alpha, robots)
        robots.track[w, i, substeps] = robots.position[w, i]
        measure(w, i, now, key, curve, alpha, noise, robots, links)


@wp.kernel
def move_cars(
    first: int,
    lanes: int,
    curve: CurveStruct,
    formation: FormationStruct,
    robot: RobotStruct,
    noise: NoiseStruct,
    faults: FaultsStruct,
    step: float,
    walled: int,
    schedule: wp.array2d(dtype=int),
    action: wp.array3d(dtype=float),
    clock: Clock,
    robots: Robots,
    links: Links,
    step_out: Step,
):
    """Move cars: steering and throttle are held over the step; the phase follows the car along its branch."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.stage[w] != RUNNING:
        return
    now = clock.step[w] + 1
    key = randomness.step_key(clock.seed[w], now)
    alpha = float(formation.alpha)
    substeps = robots.track.shape[2] - 1
    for i in range(lane, robots.status.shape[1], lanes):
        command = commanded(w, i, key, noise, action, clock, step_out)
        clear_step(w, i, step_out)
        status = update_status(w, i, now, key, step, faults, schedule, robots)
        position = robots.position[w, i]
        robots.track[w, i, 0] = position
        if status != WORKING:
            robots.speed[w, i] = 0.0
            for s in range(substeps):
                robots.track[w, i, s + 1] = position
        else:
            throttle = robot.throttle_min + 0.5 * (command[1] + 1.0) * (robot.throttle_max - robot.throttle_min)
            steering = cos_sin(command[0] * robot.steering_max)
            curvature = steering[1] / (steering[0] * robots.wheelbase[w, i])
            push = motor_push(robot, robots.drive[w, i], throttle)
            car = wp.vec4(position[0], position[1], robots.heading[w, i], robots.speed[w, i])
            for s in range(substeps):
                car = car_step(robot, car, curvature, push, step / float(substeps))
                if walled == 1:
                    car = stop_at_wall(curve, car)
                robots.track[w, i, s + 1] = wp.vec3(car[0], car[1], 0.0)
            robots.position[w, i] = wp.vec3(car[0], car[1], 0.0)
            robots.heading[w, i] = wrap(car[2])
            robots.speed[w, i] = car[3]
            start = curve_parameter(alpha, robots.phase[w, i])
            gamma = project(curve, wp.vec2(car[0], car[1]), start, LARGEST_CORRECTION)
            robots.phase[w, i] = wrap_phase(robots.phase[w, i] + wp.float64((gamma - start) / alpha))
        measure(w, i, now, key, curve, alpha, noise, robots, links)


@wp.func
def tracking_error(curve: CurveStruct, gamma: float, position: wp.vec3) -> float:
    """Distance of a robot from the point of the curve at its own parameter [m]."""
    return wp.length(wp.vec2(position[0], position[1]) - point2(curve, gamma))
