"""Control laws by which classical policies drive cars: towards a place, at a desired speed."""

import warp as wp

from baselines.policies.own_row import Actions, Observation, own_heading, own_position, own_speed
from lissajous_env.device.curve import CurveStruct, wrap
from lissajous_env.device.structs import RobotStruct
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.robots.car import car_action, throttle_towards


def weakest_top_speed(scenario: Scenario, factor: float = 1.0) -> float:
    """Return the top speed of a car with a factor on its drive and the weakest motor that the spread allows [m/s]."""
    return scenario.robot.steady_speed(scenario.robot.drive * scenario.noise.drive_range[0] * factor)


def slowest_top_speed(scenario: Scenario) -> float:
    """Return the top speed of the slowest car that the factors and the spread of the drive allow [m/s]."""
    return weakest_top_speed(scenario, float(scenario.drive_factors.min()))


@wp.func
def steady_speed(robot: RobotStruct) -> float:
    """Return the steady speed of a car at full throttle [m/s], the unit of its observed speed."""
    return (robot.drive * robot.throttle_max - robot.offset) / robot.drag


@wp.func
def drive_towards(
    w: int,
    i: int,
    curve: CurveStruct,
    robot: RobotStruct,
    speed_gain: float,
    goal: wp.vec2,
    wanted_speed: float,
    observation: Observation,
    action_out: Actions,
):
    """Act towards a goal [m]: pure pursuit, delta = atan(2 l sin(e) / d), and `throttle_towards` a speed [m/s].

    A car that grip does not let turn round in 0.7 of the rectangle's shorter side at this speed drives slower.
    """
    fastest = wp.sqrt(0.7 * robot.lateral_acceleration_max * wp.min(curve.half_width, curve.half_height))
    away = goal - own_position(w, i, curve, observation)
    distance = wp.max(wp.length(away), 2.0 * robot.wheelbase)
    bearing = wrap(wp.atan2(away[1], away[0]) - own_heading(w, i, observation))
    steering = wp.atan(2.0 * robot.wheelbase * wp.sin(bearing) / distance)
    if wp.abs(bearing) > 1.5707963:
        steering = wp.sign(bearing) * robot.steering_max
    speed = own_speed(w, i, steady_speed(robot), observation)
    action = car_action(robot, steering, throttle_towards(robot, speed, wp.min(wanted_speed, fastest), speed_gain))
    action_out[w, i, 0] = action[0]
    action_out[w, i, 1] = action[1]
