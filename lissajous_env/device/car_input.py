"""The input of a car: its action in [-1, 1] as steering angle and throttle, and the way back."""

import warp as wp

from lissajous_env.device.part_structs import RobotStruct


@wp.func
def steering_angle(robot: RobotStruct, action: float) -> float:
    """Return the steering angle u delta_max [rad] of an action u."""
    return action * robot.steering_max


@wp.func
def throttle(robot: RobotStruct, action: float) -> float:
    """Return the throttle tau_min + (u + 1) / 2 (tau_max - tau_min) of an action u."""
    return robot.throttle_min + 0.5 * (action + 1.0) * (robot.throttle_max - robot.throttle_min)


@wp.func
def steering_and_throttle(robot: RobotStruct, action: wp.vec2) -> wp.vec2:
    """Return steering angle [rad] and throttle of the two components of an action."""
    return wp.vec2(steering_angle(robot, action[0]), throttle(robot, action[1]))


@wp.func
def car_action(robot: RobotStruct, steering: float, throttle: float) -> wp.vec2:
    """Return the action in [-1, 1] of a steering angle [rad] and a throttle, clipped to what the car can do."""
    span = robot.throttle_max - robot.throttle_min
    return wp.vec2(
        wp.clamp(steering / robot.steering_max, -1.0, 1.0),
        wp.clamp(2.0 * (throttle - robot.throttle_min) / span - 1.0, -1.0, 1.0),
    )
