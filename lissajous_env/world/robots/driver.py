"""The driver of cars whose actions are velocities (`task.action` = `velocity`)."""

import warp as wp

from lissajous_env.device.car_input import car_action
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import wrap
from lissajous_env.device.part_structs import RobotStruct, TaskStruct
from lissajous_env.device.stage import ROBOT, stage
from lissajous_env.device.trig import atan2
from lissajous_env.world.state import Clock, Robots

wp.set_module_options(OPTIONS)

_SLOWEST = wp.constant(1.0 / 3.0)
"""Least speed for which the driver computes the steering angle [top speed]; a slower car would steer to and fro."""


@wp.func
def steering_towards(wish: wp.vec2, heading: float, speed: float, step: float, robot: RobotStruct) -> float:
    """Return the steering angle [rad] that turns a car to the direction of a wish within a step.

    Of the bicycle (12), heading' = v tan(steering) / l, with the tangent's argument small: steering =
    arctan(l error / (v step)). A wish of 0 has no direction.
    """
    if wp.length_sq(wish) == 0.0:
        return 0.0
    error = wrap(atan2(wish[1], wish[0]) - heading)
    return wp.atan(robot.wheelbase * error / (wp.max(speed, _SLOWEST * robot.speed_max) * step))


@wp.func
def throttle_for(size: float, robot: RobotStruct) -> float:
    """Return the throttle whose steady speed (drive throttle - offset) / drag is a share of the top speed."""
    return (robot.drag * robot.speed_max * wp.min(size, 1.0) + robot.offset) / robot.drive


@stage(ROBOT, writes="command_out", split=True)
def drive(
    w: int,
    i: int,
    robot: RobotStruct,
    task: TaskStruct,
    clock: Clock,
    robots: Robots,
    command_out: wp.array3d(dtype=float),
):
    """Replace the velocity that each car is to have by the steering and throttle of the driver."""
    wish = wp.vec2(command_out[w, i, 0], command_out[w, i, 1])
    pose = robots.measured[w, i]
    steering = steering_towards(wish, pose[2], pose[3], task.step, robot)
    action = car_action(robot, steering, throttle_for(wp.length(wish), robot))
    command_out[w, i, 0] = action[0]
    command_out[w, i, 1] = action[1]
