"""Motion of a robot's own car over a step, with bounds on where it can be after an action.

Every number is an interval: the errors of measured positions, headings and speeds are within those of `Terms`. A robot
stores bounds on the `factors` of its own curvature and drive over the nominal ones: least and most curvature, least and
most drive. They are as wide as the scenario allows at first and narrow with each step: to what the step allows
(`learn`) or, where commands are noisy, to the mean of the steps (`add_step`). A way is the distance that the car drives
in a step. The theorem and its conditions are those of `baselines.policies.safety.proved`.
"""

import warp as wp

from baselines.policies.safety.tails import Tail, arc_end
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import wrap
from lissajous_env.device.structs import NoiseStruct, RobotStruct
from lissajous_env.device.trig import cos_sin
from lissajous_env.world.robots.car import steering_angle, throttle
from lissajous_env.world.robots.inside import Walls

wp.set_module_options(OPTIONS)

_BIAS = wp.constant(0.003)
"""Bound of the bias of a mean of factors, from the curvature's dependence on the steering and from noisy ways."""
_EDGE = wp.constant(1.0e-6)
"""Distance of a throttle from the dead zone, in full throttles, within which rounding decides if the motor is on."""


@wp.struct
class Terms:
    """The terms of the theorem in one scenario: the cars, the bounds of errors, and the actions that are tried."""

    step: wp.float32
    """Control step, h [s]."""
    decay: wp.float32
    """exp(-c h), the share of the speed that a rolling car has left after a step."""
    required: wp.float32
    """Least distance of two cars, 2 r + margin [m]."""
    position_error: wp.float32
    """Bound of the error of a measured position [m]."""
    heading_error: wp.float32
    """Bound of the error of a measured heading [rad]."""
    speed_error: wp.float32
    """Bound of the error of a measured speed [m/s]."""
    half_width: wp.float32
    """Half of the width of the rectangle that tails stay in [m]."""
    half_height: wp.float32
    """Half of its height [m]."""
    message_loss: wp.float32
    """Probability that a robot misses the tail of another one in a step."""
    chord: wp.float32
    """Distance of the simulation's straight sub-steps from the path, divided by the acceleration [s^2]."""
    coarseness: wp.float32
    """Relative error of the path in the simulation's integration."""
    coasts: wp.int32
    """1 where a robot's motor may fail in any step, and the robot coasts."""
    num_tails: wp.int32
    """Number of tails that are tried after an action: with its steering, the most to either side, and none."""
    robot: RobotStruct
    """The cars."""
    noise: NoiseStruct
    """The noise, of which the error of a step includes one standard deviation of an action."""
    walls: Walls
    """The walls, zeros without any."""
    widest: wp.array(dtype=wp.vec4)
    """(N,) bounds of curvature and drive of a car before it has learned, which `proved.widest_of` returns."""
    changes: wp.array(dtype=wp.vec2)
    """(K,) changes of an action that are tried, in this order."""
    stops: wp.array(dtype=wp.int32)
    """(N,) 1 where a robot can stop dead."""


@wp.func
def curvature_of(robot: RobotStruct, steering: float) -> float:
    """Return the curvature of the path [1/m] at an action of the steering, for the nominal wheelbase."""
    turn = cos_sin(steering_angle(robot, steering))
    return turn[1] / (turn[0] * robot.wheelbase)


@wp.func
def arc_of(terms: Terms, factors: wp.vec4, steering: float) -> tuple[float, float]:
    """Return the curvature of the path at an action of the steering, and the bound of its error [1/m]."""
    nominal = curvature_of(terms.robot, steering)
    return 0.5 * (factors[0] + factors[1]) * nominal, 0.5 * (factors[1] - factors[0]) * wp.abs(nominal)


@wp.func
def tail_from(terms: Terms, factors: wp.vec4, car: wp.vec4, errors: wp.vec3, steering: float) -> Tail:
    """Return the tail from x, y, heading, speed, with bounds on their errors: place [m], heading [rad], speed [m/s].

    The distance of two cars that begin with these differences, and whose L and kappa differ by `along` and `bend`, is
    at most

        |p_1 - p_2|(q) <= place + integral of (along + L |heading_1 - heading_2|) dq,
        |heading_1 - heading_2|(q) <= heading + bend L q + (|kappa| + bend) along q.
    """
    curvature, bend = arc_of(terms, factors, steering)
    length = car[3] / terms.robot.drag
    along = errors[2] / terms.robot.drag + terms.coarseness * length
    w2 = 0.5 * length * (bend * length + (wp.abs(curvature) + bend) * along)
    w = wp.vec3(errors[0], along + errors[1] * length, w2)
    return Tail(wp.vec3(car[0], car[1], car[2]), length, curvature, steering, w)


@wp.func
def acceleration_on(terms: Terms, tail: Tail) -> float:
    """Return the bound of the acceleration on a tail, that at its beginning [m/s^2]."""
    drag = terms.robot.drag
    speed = tail.length * drag
    return speed * (drag + speed * wp.abs(tail.curvature))


@wp.func
def bulge_of(terms: Terms, acceleration: float) -> float:
    """Return the bound by which a car with a bounded acceleration leaves the chord of half a step [m]."""
    return acceleration * (terms.step * terms.step / 32.0 + terms.chord)


@wp.func
def step_from(terms: Terms, factors: wp.vec4, car: wp.vec4, action: wp.vec2) -> tuple[wp.vec4, wp.vec3, wp.vec3]:
    """Return the car after an action of one step, the bounds of its errors, and the middle of the step.

    `car` is the measured x, y, heading, speed. The middle is x, y and the bound by which either half of the step leaves
    the straight line [m]. v(t) = v e^(-ct) + (push / c) (1 - e^(-ct)), with the motor's acceleration, push [m/s^2].
    """
    robot = terms.robot
    curvature, bend = arc_of(terms, factors, action[0])
    if terms.noise.actuator > 0.0:
        slope = wp.tan(steering_angle(robot, action[0]))
        bend += factors[1] * terms.noise.actuator * robot.steering_max * (1.0 + slope * slope) / robot.wheelbase
    tau = throttle(robot, action[1])
    push = float(0.0)
    push_error = float(0.0)
    if tau > robot.dead_zone:
        push = 0.5 * (factors[2] + factors[3]) * robot.drive * tau - robot.offset
        push_error = 0.5 * (factors[3] - factors[2]) * robot.drive * tau
        push_error += factors[3] * robot.drive * 0.5 * (robot.throttle_max - robot.throttle_min) * terms.noise.actuator
    speed = car[3]
    lost = 1.0 - terms.decay
    way_per_push = (terms.step - lost / robot.drag) / robot.drag
    after = wp.max(speed * terms.decay + push * lost / robot.drag, 0.0)
    way = wp.max(speed * lost / robot.drag + push * way_per_push, 0.0)
    way_error = terms.speed_error * lost / robot.drag + push_error * way_per_push
    way_error += 0.5 * terms.step * terms.step * wp.max(push_error - push, 0.0)  # a car that stops within the step
    turn_error = terms.heading_error + (wp.abs(curvature) + bend) * way_error
    errors = wp.vec3(
        terms.position_error + terms.coarseness * way + way_error + turn_error * way + 0.5 * bend * way * way,
        turn_error + bend * way,
        terms.speed_error * terms.decay + push_error * lost / robot.drag,
    )
    begin = wp.vec3(car[0], car[1], car[2])
    end = arc_end(begin, way, curvature)
    half_lost = 1.0 - wp.sqrt(terms.decay)
    half_way_per_push = (0.5 * terms.step - half_lost / robot.drag) / robot.drag
    half_way = wp.clamp(speed * half_lost / robot.drag + push * half_way_per_push, 0.0, way)
    middle = arc_end(begin, half_way, curvature)
    fastest = wp.max(speed, after)
    middle[2] = bulge_of(terms, wp.abs(push - robot.drag * speed) + fastest * fastest * wp.abs(curvature))
    return wp.vec4(end[0], end[1], end[2], after), errors, middle


@wp.func
def narrowed(low: float, high: float, value: float, error: float, widest: wp.vec2) -> wp.vec2:
    """Return [low, high] within value -+ error; `widest` if that is empty, because the conditions are violated."""
    lower = wp.max(low, value - error)
    upper = wp.min(high, value + error)
    if lower > upper:
        return widest
    return wp.vec2(lower, upper)


@wp.func
def push_of(terms: Terms, before: float, after: float, error: float) -> tuple[float, float]:
    """Return the acceleration by the motor in a step, c (v_1 - v_0 e^(-ch)) / (1 - e^(-ch)), and its error [m/s^2].

    `before` and `after` are the measured speeds v_0 and v_1, each with an error [m/s].
    """
    drag = terms.robot.drag
    lost = 1.0 - terms.decay
    return drag * (after - before * terms.decay) / lost, drag * error * (1.0 + terms.decay) / lost


@wp.func
def learn(terms: Terms, factors: wp.vec4, widest: wp.vec4, last: wp.vec4, heading: float, speed: float) -> wp.vec4:
    """Return the bounds of curvature and drive, narrowed by the motion of the latest step (condition 2 of the theorem).

    `last` is the measured heading [rad] and speed [m/s] before it, and its action.
    way = (v_0 - v_1 + push h) / c, kappa = turn / way.
    """
    robot = terms.robot
    push, push_error = push_of(terms, last[1], speed, terms.speed_error)
    tau = throttle(robot, last[3])
    narrow = factors
    if tau > robot.dead_zone and speed > 0.0:
        nominal = robot.drive * tau
        value = (push + robot.offset) / nominal
        span = narrowed(factors[2], factors[3], value, push_error / nominal, wp.vec2(widest[2], widest[3]))
        narrow[2] = span[0]
        narrow[3] = span[1]
    way = (last[1] - speed + push * terms.step) / robot.drag
    way_error = (2.0 * terms.speed_error + push_error * terms.step) / robot.drag
    nominal = way * curvature_of(robot, last[2])
    # A car that has stopped within the step has driven less than this; one that turns by more than pi hides a turn.
    shows = speed > 0.0 and way > 2.0 * way_error and wp.abs(nominal) > 10.0 * terms.heading_error
    if shows and wp.abs(nominal) * factors[1] < 3.0:
        value = wrap(heading - last[0]) / nominal
        error = 2.0 * terms.heading_error / wp.abs(nominal) + wp.abs(value) * way_error / way
        error = error * way / (way - way_error)
        span = narrowed(factors[0], factors[1], value, error, wp.vec2(widest[0], widest[1]))
        narrow[0] = span[0]
        narrow[1] = span[1]
    return narrow


@wp.func
def mean_and_deviation(action: float, noise: float) -> wp.vec2:
    """Return mean and standard deviation of an action with noise of deviation `noise`, clipped to [-1, 1].

    A deviation of 0 means that they are not known: the noise may be clipped, or not.
    At an end of the range, half of the noise is clipped: of min(n, 0), the mean is -1 / sqrt(2 pi) and the variance
    1 / 2 - 1 / (2 pi).
    """
    if wp.abs(action) >= 1.0:
        return wp.vec2(wp.sign(action) * (1.0 - 0.39894 * noise), 0.58381 * noise)
    if wp.abs(action) > 1.0 - 3.0 * noise:
        return wp.vec2(action, 0.0)
    return wp.vec2(action, noise)


@wp.func
def add_step(terms: Terms, sums: wp.vec4, last: wp.vec4, heading: float, speed: float) -> wp.vec4:
    """Return the sums with the latest step: of weight and of weight times (factor - 1), for curvature, then for drive.

    The motion of a step with a noisy command shows a factor with a standard deviation; the weight is 1 over its square.
    Steps in which noise may turn off the motor, or grip may limit the turn, do not count.
    """
    robot = terms.robot
    push, push_deviation = push_of(terms, last[1], speed, terms.noise.speed)
    summed = sums
    throttling = mean_and_deviation(last[3], terms.noise.actuator)
    tau = throttle(robot, throttling[0])
    tau_deviation = 0.5 * (robot.throttle_max - robot.throttle_min) * throttling[1]
    if tau - 3.0 * tau_deviation > robot.dead_zone and throttling[1] > 0.0 and speed > 0.0:
        nominal = robot.drive * tau
        of_push = push_deviation * push_deviation / (nominal * nominal)
        weight = 1.0 / (tau_deviation * tau_deviation / (tau * tau) + of_push)
        summed[2] += weight
        summed[3] += weight * ((push + robot.offset) / nominal - 1.0)
    way = 0.5 * (last[1] + speed) * terms.step
    way_deviation = 0.7071 * terms.noise.speed * terms.step
    steering = mean_and_deviation(last[2], terms.noise.actuator)
    slope = wp.tan(steering_angle(robot, wp.abs(steering[0])))
    nominal = way * curvature_of(robot, steering[0])
    fastest = wp.max(speed, last[1])
    grips = fastest * fastest * curvature_of(robot, wp.abs(last[2]) + 3.0 * terms.noise.actuator)
    if (
        way > 10.0 * way_deviation
        and slope > 1.0e-3
        and wp.abs(nominal) < 2.0
        and steering[1] > 0.0
        and grips < 0.9 * robot.lateral_acceleration_max
    ):
        turn_deviation = terms.noise.heading / nominal
        steering_deviation = steering[1] * robot.steering_max * (1.0 + slope * slope) / slope
        variance = (
            2.0 * turn_deviation * turn_deviation
            + steering_deviation * steering_deviation
            + way_deviation * way_deviation / (way * way)
        )
        summed[0] += 1.0 / variance
        summed[1] += (wrap(heading - last[0]) / nominal - 1.0) / variance
    return summed


@wp.func
def bounds_from_sums(weight: float, weighted: float, widest: wp.vec2) -> wp.vec2:
    """Return the bounds of a factor from its two sums: the mean of the steps -+ four standard errors and a bias."""
    if weight <= 0.0:
        return widest
    return narrowed(widest[0], widest[1], 1.0 + weighted / weight, 4.0 / wp.sqrt(weight) + _BIAS, widest)


@wp.func
def within_limits(terms: Terms, factors: wp.vec4, speed: float, wanted: wp.vec2) -> wp.vec2:
    """Return an action clipped to the box, and so that grip never limits the yaw rate from then on (condition 1)."""
    robot = terms.robot
    throttling = wp.clamp(wanted[1], -1.0, 1.0)
    if wp.abs(throttle(robot, throttling) - robot.dead_zone) < _EDGE * robot.throttle_max:
        throttling = -1.0
    most = float(1.0)
    if wp.isfinite(robot.lateral_acceleration_max):
        push = wp.max(factors[3] * robot.drive * throttle(robot, throttling) - robot.offset, 0.0)
        fastest = speed + terms.speed_error
        fastest = wp.max(fastest, fastest * terms.decay + push * (1.0 - terms.decay) / robot.drag)
        curvature = 0.999 * robot.lateral_acceleration_max / wp.max(fastest * fastest, 1.0e-20)
        most = wp.min(wp.atan(curvature * robot.wheelbase / factors[1]) / robot.steering_max, 1.0)
    return wp.vec2(wp.clamp(wanted[0], -most, most), throttling)
