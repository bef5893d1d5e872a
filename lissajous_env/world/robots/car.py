"""Cars by the kinematic bicycle (12) with a motor; action = steering, throttle, or a velocity for their driver."""

import itertools
import math

import numpy as np
import warp as wp

from lissajous_env.device import abreast
from lissajous_env.device.abreast import Floats
from lissajous_env.device.compilation import MOTION, OPTIONS, module_apart
from lissajous_env.device.curve import wrap
from lissajous_env.device.stage import ROBOT, part, stage
from lissajous_env.device.structs import RobotStruct
from lissajous_env.device.trig import atan2, cos_sin
from lissajous_env.parameters.robot_models import RobotModel, register_robot_model
from lissajous_env.settings.parts import Curve, Formation, Noise, Robot
from lissajous_env.settings.task import Task
from lissajous_env.wording import require
from lissajous_env.world.robots.faults import COAST, is_coasting
from lissajous_env.world.robots.motion import WALL, begin_path, end_motion, stop_at_walls
from lissajous_env.world.state import WORKING

wp.set_module_options(MOTION)
_DRIVING = module_apart(f"{__name__}.driving", OPTIONS)


@wp.func
def steering_angle(robot: RobotStruct, action: float) -> float:
    """Return the steering angle u delta_max [rad] of an action u."""
    return action * robot.steering_max


@wp.func
def full_reverse(robot: RobotStruct) -> float:
    """Return the throttle above 0 that in reverse leads to `speed_min` below 0: (beta - c speed_min) / alpha."""
    return (robot.offset - robot.drag * robot.speed_min) / robot.drive


@wp.func
def throttle(robot: RobotStruct, action: float) -> float:
    """Return the throttle tau_min + (u + 1) / 2 (tau_max - tau_min) of an action u.

    For cars that reverse it is sign(u) (tau_min + |u| (tau_end - tau_min)). tau_end is tau_max forwards, and in reverse
    the throttle that reaches `speed_min`.
    """
    forwards = robot.throttle_min + 0.5 * (action + 1.0) * (robot.throttle_max - robot.throttle_min)
    end = wp.where(action < 0.0, full_reverse(robot), robot.throttle_max)
    either = wp.sign(action) * (robot.throttle_min + wp.abs(action) * (end - robot.throttle_min))
    return wp.where(robot.speed_min < 0.0, either, forwards)


@wp.func
def steering_and_throttle(robot: RobotStruct, action: wp.vec2) -> wp.vec2:
    """Return steering angle [rad] and throttle of the two components of an action."""
    return wp.vec2(steering_angle(robot, action[0]), throttle(robot, action[1]))


@wp.func
def action_of_throttle(robot: RobotStruct, throttle: float) -> float:
    """Return the action in [-1, 1] of a throttle, clipped to what the car can do: the inverse of `throttle`."""
    least = robot.throttle_min
    forwards = wp.clamp(2.0 * (throttle - least) / (robot.throttle_max - least) - 1.0, -1.0, 1.0)
    end = wp.where(throttle < 0.0, full_reverse(robot), robot.throttle_max)
    either = wp.sign(throttle) * wp.clamp((wp.abs(throttle) - least) / (end - least), 0.0, 1.0)
    return wp.where(robot.speed_min < 0.0, either, forwards)


@wp.func
def action_of_input(robot: RobotStruct, steering: float, throttle: float) -> wp.vec2:
    """Return the action in [-1, 1] of a steering angle [rad] and a throttle, clipped to what the car can do."""
    return wp.vec2(wp.clamp(steering / robot.steering_max, -1.0, 1.0), action_of_throttle(robot, throttle))


@wp.func
def car_action(robot: RobotStruct, steering: float, throttle: float) -> wp.vec2:
    """Return the same for a car that drives forwards: a throttle below 0 coasts, even if the car can reverse."""
    return action_of_input(robot, steering, wp.where(robot.speed_min < 0.0, wp.max(throttle, 0.0), throttle))


@wp.func
def throttle_towards(robot: RobotStruct, speed: float, wanted_speed: float, gain: float) -> float:
    """Return (c wanted + beta + gain (wanted - v)) / alpha by (12), with the beta of models and a gain [1/s]."""
    return (robot.drag * wanted_speed + robot.model_offset + gain * (wanted_speed - speed)) / robot.drive


@part
def motor_acceleration(robot, drive: float, tau: float) -> float:
    """Return the motor's acceleration, alpha tau - beta above the dead zone [m/s^2], equation (12).

    Differs from the paper, which has no dead zone; the authors' plant has one, in which the car coasts. Cars of the
    paper do not reverse either; one that does is pushed in the direction of its throttle, by alpha |tau| - beta.
    """
    acceleration = wp.where(tau > robot.dead_zone, drive * tau - robot.offset, 0.0)
    back = wp.where(tau < -robot.dead_zone, drive * tau + robot.offset, 0.0)
    return wp.where(robot.speed_min < 0.0, wp.max(acceleration, 0.0) + wp.min(back, 0.0), acceleration)


@part
def lowest_speed(robot) -> float:
    """Return the lower limit of a car's speed [m/s]: 0, or practically none for a car that reverses."""
    return wp.where(robot.speed_min < 0.0, -1.0e30, 0.0)


@part
def car_rate(robot, state: wp.vec4, curvature: float, acceleration: float) -> wp.vec4:
    """(x, y, heading, v)' = (v cos heading, v sin heading, v tan(delta) / l, -c v + acceleration), equation (12).

    `curvature` is tan(delta) / l [1/m]. The yaw rate is limited by grip to a_lat / |v|; with `robot.speed_min` = 0 a
    car does not reverse.
    """
    speed = wp.max(state[3], lowest_speed(robot))
    yaw_rate = speed * curvature
    if wp.abs(speed * yaw_rate) > robot.lateral_acceleration_max:
        yaw_rate = wp.sign(yaw_rate) * robot.lateral_acceleration_max / wp.abs(speed)
    ahead = cos_sin(state[2])
    return wp.vec4(speed * ahead[0], speed * ahead[1], yaw_rate, acceleration - robot.drag * speed)


@part
def car_step(robot, state: wp.vec4, curvature: float, acceleration: float, h: float) -> wp.vec4:
    """Return the state after one step of the classical fourth-order Runge-Kutta method over h [s]."""
    k1 = car_rate(robot, state, curvature, acceleration)
    k2 = car_rate(robot, state + 0.5 * h * k1, curvature, acceleration)
    k3 = car_rate(robot, state + 0.5 * h * k2, curvature, acceleration)
    k4 = car_rate(robot, state + h * k3, curvature, acceleration)
    moved = state + (h / 6.0) * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return wp.vec4(moved[0], moved[1], moved[2], wp.max(moved[3], lowest_speed(robot)))


@part
def read_commands(block, robot, command, robots) -> tuple[Floats, Floats]:
    """Return the curvature of the path [1/m] and the motor's acceleration [m/s^2] of the cars of a block."""
    steering = abreast.entries(block, command, 0)
    throttling = abreast.entries(block, command, 1)
    wheelbase = abreast.floats(block, robots.wheelbase)
    drive = abreast.floats(block, robots.drive)
    curvature = Floats()
    acceleration = Floats()
    for k in range(abreast.ABREAST):
        if k < abreast.width():
            turn = cos_sin(steering_angle(robot, steering[k]))
            curvature[k] = turn[1] / (turn[0] * wheelbase[k])
            acceleration[k] = motor_acceleration(robot, drive[k], throttle(robot, throttling[k]))
    return curvature, acceleration


@stage(ROBOT, writes="robots: curvature, heading, path, position, speed")
def move_cars(block, curve, robot, task, faults, command, clock, robots):
    """Move cars with constant steering and throttle in a step; a failed car stops, or coasts as it steered last."""
    substeps = robots.path.shape[2] - 1
    h = task.step / float(substeps)
    x = abreast.coordinates(block, robots.position, 0)
    y = abreast.coordinates(block, robots.position, 1)
    heading = abreast.floats(block, robots.heading)
    speed = abreast.floats(block, robots.speed)
    working = block.active_mask & abreast.where_equal(block, robots.status, WORKING)
    coasting = block.active_mask & is_coasting(block, faults, robots)
    moving = working | coasting
    begin_path(block, block.active_mask & ~moving, x, y, robots)
    curvature, acceleration = read_commands(block, robot, command, robots)
    if faults.stop == COAST:
        abreast.put_floats(block, working, curvature, robots.curvature)
    if coasting != 0:
        curvatures = abreast.floats(block, robots.curvature)
        for k in range(block.count):
            if abreast.is_in(k, coasting):
                curvature[k] = curvatures[k]
                acceleration[k] = 0.0
    for s in range(substeps):
        for k in range(abreast.ABREAST):
            if k < abreast.width():
                car = car_step(robot, wp.vec4(x[k], y[k], heading[k], speed[k]), curvature[k], acceleration[k], h)
                x[k] = car[0]
                y[k] = car[1]
                heading[k] = car[2]
                speed[k] = car[3]
        if task.boundary == WALL:
            x, y, speed = stop_at_walls(curve, robot.radius, x, y, heading, speed)
        abreast.put_places(block, moving, x, y, s + 1, robots.path)
    end_motion(block, moving, x, y, heading, speed, robots)


_SLOWEST = wp.constant(1.0 / 3.0)
"""Least speed for which the driver computes the steering angle [top speed]; those of a slower car would oscillate."""


@part
def steering_towards(velocity: wp.vec2, heading: float, speed: float, step: float, robot) -> float:
    """Return the steering angle [rad] that turns a car to the direction of a wanted velocity within a step [s].

    By the bicycle (12), heading' = v tan(steering) / l, so steering = arctan(l error / (v step)) at constant steering.
    A velocity of 0 has no direction.
    """
    if wp.length_sq(velocity) == 0.0:
        return 0.0
    error = wrap(atan2(velocity[1], velocity[0]) - heading)
    return wp.atan(robot.wheelbase * error / (wp.max(speed, _SLOWEST * robot.speed_max) * step))


@part
def throttle_for(share: float, robot) -> float:
    """Return the throttle whose steady speed, (drive throttle - offset) / drag, is a share of the top speed."""
    return (robot.drag * robot.speed_max * wp.min(share, 1.0) + robot.offset) / robot.drive


@stage(ROBOT, writes="command", module=_DRIVING)
def follow_velocity(w, i, robot, task, clock, robots, command):
    """Replace the wanted velocity of each car, in `command`, by the steering and throttle of its driver."""
    velocity = wp.vec2(command[w, i, 0], command[w, i, 1])
    pose = robots.measured[w, i]
    steering = steering_towards(velocity, pose[2], pose[3], task.step, robot)
    action = car_action(robot, steering, throttle_for(wp.length(velocity), robot))
    command[w, i, 0] = action[0]
    command[w, i, 1] = action[1]


def check(curve: Curve, formation: Formation, robot: Robot, noise: Noise, task: Task) -> None:
    """Check that a car's motion stays finite: its equations are integrated in float32 by a method of order four.

    Raises:
        ValueError: a field that a rule forbids, by name.
    """
    h = task.step / task.substeps
    require(curve.half_depth <= 0, "curve.half_depth", "must be 0 for cars [m]", curve.half_depth)
    rule = f"must be at most {2.5 / h:g} with integration steps of {h:g} s, which are otherwise unstable [1/s]"
    require(robot.drag * h <= 2.5, "robot.drag", rule, robot.drag)
    at_start = formation.phase_rate * math.hypot(curve.half_width * curve.a, curve.half_height * curve.b)
    rule = "must keep cars on the curve below 100000 m/s [rad/s]"
    require(at_start <= 1e5, "formation.phase_rate", rule, formation.phase_rate)
    # A car's own constants lie at most three deviations from those of the scenario.
    strongest = robot.drive * noise.drive_range[1] * max([1.0, *robot.factors.values()])
    fastest = robot.steady_speed(strongest)
    if fastest > 1e4:
        rule = "must keep every car's top speed, with noise.drive_spread, at most 10000 m/s"
        raise ValueError(f"robot.drive_factors {rule}, got {fastest:g} m/s with {robot.drive_factors}")
    shortest = robot.wheelbase * noise.wheelbase_range[0]
    turn = fastest * h * math.tan(robot.steering_max) / shortest
    rule = f"must keep a car's turn in an integration step below 10000 rad, at {fastest:g} m/s and full steering [m]"
    require(turn <= 1e4, "robot.wheelbase", rule, robot.wheelbase)


def shape(robot: Robot) -> list[tuple[np.ndarray, str | None]]:
    """Return outlines of a car's parts for a radius of 1, heading right, with their colours; None is the car's own."""
    # A body around its axles that stays within the disc of the robot, for any wheelbase.
    half_base = float(np.clip(robot.wheelbase / (2 * robot.radius), 0.4, 0.72))
    length, width = min(half_base + 0.28, 1.0), 0.46
    wheels: list[tuple[np.ndarray, str | None]] = [
        (_rounded(0.19, 0.085, 6.0) + np.array([x, y]), "WHEEL")
        for x in (-half_base, half_base)
        for y in (-width, width)
    ]
    body, rim = _rounded(length, width, 4.5), _rounded(length + 0.05, width + 0.05, 4.5)
    for outline in (body, rim):
        outline[:, 1] *= 1 - 0.16 * (outline[:, 0] > 0) * (outline[:, 0] / length) ** 2
    front = np.array([[0.22, -0.27], [0.45, -0.34], [0.50, 0.0], [0.45, 0.34], [0.22, 0.27]])
    back = np.array([[-0.42, -0.25], [-0.58, -0.30], [-0.60, 0.0], [-0.58, 0.30], [-0.42, 0.25]])
    return [*wheels, (rim, "GROUND"), (body, None), (front, "GLASS"), (back, "GLASS")]


def _rounded(half_length: float, half_width: float, power: float) -> np.ndarray:
    """Return a rectangle with round corners: |x / half_length|^power + |y / half_width|^power = 1."""
    around = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    x, y = np.cos(around), np.sin(around)
    return np.stack(
        [half_length * np.sign(x) * np.abs(x) ** (2 / power), half_width * np.sign(y) * np.abs(y) ** (2 / power)], -1
    )


CAR = register_robot_model(
    RobotModel(
        name="car",
        actions=("steering", "throttle"),
        table=tuple(itertools.product((-1.0, -0.5, 0.0, 0.5, 1.0), (-1.0, 0.0, 1.0))),
        move=move_cars,
        meanings=(
            "steering angle, from steering_max to the right to steering_max to the left [rad]",
            "throttle tau, from throttle_min to throttle_max; if cars reverse, of 0 to 1, and of 0 to -1 in reverse",
        ),
        rest=lambda robot: (0.0, 0.0 if robot.reverses else -1.0),
        driving=(1,),
        speed_unit=lambda curve, formation, robot: robot.top_speed,
        check=check,
        shape=shape,
    )
)
