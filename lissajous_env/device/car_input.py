"""The input of a car: its action in [-1, 1] as steering angle and throttle, and the way back."""

import warp as wp

from lissajous_env.device.structs import RobotStruct


@wp.func
def steering_angle(robot: RobotStruct, action: float) -> float:
    """Return the steering angle u delta_max [rad] of an action u."""
    return action * robot.steering_max


@wp.func
def full_reverse(robot: RobotStruct) -> float:
    """Return the throttle (beta - c speed_min) / alpha with which a car that reverses reaches `speed_min`, above 0."""
    return (robot.offset - robot.drag * robot.speed_min) / robot.drive


@wp.func
def throttle(robot: RobotStruct, action: float) -> float:
    """Return the throttle tau_min + (u + 1) / 2 (tau_max - tau_min) of an action u.

    For cars that reverse it is the sign of u times tau_min + |u| (tau_end - tau_min). tau_end is tau_max forwards, and
    in reverse the throttle that reaches `speed_min`.
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
    """Return (c wanted + beta + gain (wanted - v)) / alpha, a throttle by (12): a proportional law, `gain` in [1/s]."""
    return (robot.drag * wanted_speed + robot.model_offset + gain * (wanted_speed - speed)) / robot.drive
