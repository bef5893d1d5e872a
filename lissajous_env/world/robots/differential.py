"""Differential drives: speed and yaw rate with limits on both and on their changes; action = speed, yaw rate."""

import itertools
import math

import numpy as np
import warp as wp

from lissajous_env.device import abreast
from lissajous_env.device.abreast import Floats
from lissajous_env.device.compilation import MOTION, OPTIONS, module_apart
from lissajous_env.device.stage import ROBOT, part, stage
from lissajous_env.device.structs import RobotStruct
from lissajous_env.device.trig import cos_sin
from lissajous_env.parameters.robot_models import AsCar, RobotModel, register_robot_model
from lissajous_env.settings.parts import Curve, Formation, Noise, Robot
from lissajous_env.settings.task import Task
from lissajous_env.wording import require
from lissajous_env.world.robots.motion import WALL, begin_path, end_motion, stop_at_walls
from lissajous_env.world.state import WORKING

wp.set_module_options(MOTION)
_ACTING = module_apart(f"{__name__}.acting", OPTIONS)


@part
def commanded_speed(robot, share: float) -> float:
    """Return the speed [m/s] of a share u of the top speed: u speed_max forwards, |u| speed_min in reverse."""
    return share * wp.where(share < 0.0, -robot.speed_min, robot.speed_max)


@wp.func
def ramp(before: float, wanted: float, max_change: float) -> float:
    """Return a value that has changed from `before` towards `wanted`, by at most `max_change`."""
    return before + wp.clamp(wanted - before, -max_change, max_change)


@wp.func
def integral_of_ramp(before: float, wanted: float, rate: float, t: float) -> float:
    """Return the integral over a time t of a value that changes from `before` to `wanted` at a rate and then stays."""
    change = wp.clamp(wanted - before, -rate * t, rate * t)
    return (before + change) * t - 0.5 * change * wp.abs(change) / rate


@part
def yaw_limit(robot, before: float, after: float) -> float:
    """Return the largest yaw rate that grip allows, a_lat / v at the larger of two speeds [rad/s]."""
    return robot.lateral_acceleration_max / wp.max(wp.max(wp.abs(before), wp.abs(after)), 1.0e-6)


@part
def drive_step(
    robot, pose: wp.vec4, yaw_rate: float, wanted_speed: float, wanted_yaw_rate: float, acceleration: float, h: float
) -> wp.vec4:
    """Return x, y [m], heading [rad], v [m/s] after a step h [s] towards a wanted speed [m/s] and yaw rate [rad/s].

    v changes at up to `acceleration` [m/s^2] and the yaw rate at up to `yaw_acceleration_max`, so v and the heading are
    known at all times of the step. The displacement is the integral of v (cos heading, sin heading) by Simpson's rule,
    corrected along the heading in the middle so that straight paths are exact.
    """
    yaw_acceleration = robot.yaw_acceleration_max
    middle_speed = ramp(pose[3], wanted_speed, 0.5 * acceleration * h)
    last_speed = ramp(pose[3], wanted_speed, acceleration * h)
    middle_heading = pose[2] + integral_of_ramp(yaw_rate, wanted_yaw_rate, yaw_acceleration, 0.5 * h)
    last_heading = pose[2] + integral_of_ramp(yaw_rate, wanted_yaw_rate, yaw_acceleration, h)
    first = cos_sin(pose[2])
    middle = cos_sin(middle_heading)
    last = cos_sin(last_heading)
    distance = integral_of_ramp(pose[3], wanted_speed, acceleration, h)
    missed = distance - h / 6.0 * (pose[3] + 4.0 * middle_speed + last_speed)
    dx = h / 6.0 * (pose[3] * first[0] + 4.0 * middle_speed * middle[0] + last_speed * last[0])
    dy = h / 6.0 * (pose[3] * first[1] + 4.0 * middle_speed * middle[1] + last_speed * last[1])
    return wp.vec4(pose[0] + dx + missed * middle[0], pose[1] + dy + missed * middle[1], last_heading, last_speed)


@part
def read_commands(block, robot, command, robots) -> tuple[Floats, Floats, Floats]:
    """Return wanted speeds [m/s], wanted yaw rates [rad/s] and accelerations [m/s^2] of the drives of a block.

    The acceleration is proportional to a drive's own motor, `robots.drive`, and its yaw rate inversely proportional to
    the distance of its wheels, which varies as `robots.wheelbase`.
    """
    speed = abreast.entries(block, command, 0)
    yaw_rate = abreast.entries(block, command, 1)
    acceleration = abreast.floats(block, robots.drive)
    wheelbase = abreast.floats(block, robots.wheelbase)
    for k in range(abreast.ABREAST):
        if k < abreast.width():
            speed[k] = commanded_speed(robot, speed[k])
            yaw_rate[k] = robot.wheelbase / wheelbase[k] * robot.yaw_rate_max * yaw_rate[k]
            acceleration[k] = acceleration[k] / robot.drive * robot.acceleration_max
    return speed, yaw_rate, acceleration


@stage(ROBOT, writes="robots: heading, path, position, speed, yaw_rate")
def move_drives(block, curve, robot, task, command, clock, robots):
    """Move differential drives towards constant commands in a step; one that has failed stops at once."""
    substeps = robots.path.shape[2] - 1
    h = task.step / float(substeps)
    x = abreast.coordinates(block, robots.position, 0)
    y = abreast.coordinates(block, robots.position, 1)
    heading = abreast.floats(block, robots.heading)
    speed = abreast.floats(block, robots.speed)
    yaw_rate = abreast.floats(block, robots.yaw_rate)
    moving = block.active_mask & abreast.where_equal(block, robots.status, WORKING)
    standing = block.active_mask & ~moving
    abreast.put_floats(block, standing, Floats(), robots.yaw_rate)
    begin_path(block, standing, x, y, robots)
    wanted_speed, wanted_yaw_rate, acceleration = read_commands(block, robot, command, robots)
    for s in range(substeps):
        for k in range(abreast.ABREAST):
            if k < abreast.width():
                after = ramp(speed[k], wanted_speed[k], acceleration[k] * h)
                most = yaw_limit(robot, speed[k], after)
                current = wp.clamp(yaw_rate[k], -most, most)
                towards = wp.clamp(wanted_yaw_rate[k], -most, most)
                pose = wp.vec4(x[k], y[k], heading[k], speed[k])
                pose = drive_step(robot, pose, current, wanted_speed[k], towards, acceleration[k], h)
                x[k] = pose[0]
                y[k] = pose[1]
                heading[k] = pose[2]
                speed[k] = pose[3]
                yaw_rate[k] = ramp(current, towards, robot.yaw_acceleration_max * h)
        if task.boundary == WALL:
            x, y, speed = stop_at_walls(curve, robot.radius, x, y, heading, speed)
        abreast.put_places(block, moving, x, y, s + 1, robots.path)
    end_motion(block, moving, x, y, heading, speed, robots)
    abreast.put_floats(block, moving, yaw_rate, robots.yaw_rate)


@part
def drive_action(robot, speed: float, yaw_rate: float) -> wp.vec2:
    """Return the action in [-1, 1] of a speed [m/s] and a yaw rate [rad/s], clipped to what the drive can do."""
    top = wp.where(speed < 0.0, wp.max(-robot.speed_min, 1.0e-6), robot.speed_max)
    least = wp.where(robot.speed_min < 0.0, -1.0, 0.0)
    return wp.vec2(wp.clamp(speed / top, least, 1.0), wp.clamp(yaw_rate / robot.yaw_rate_max, -1.0, 1.0))


@wp.kernel(module=_ACTING)
def act(
    robot: RobotStruct,
    heading: wp.array2d(dtype=float),
    speed: wp.array2d(dtype=float),
    yaw_rate: wp.array2d(dtype=float),
    action_out: wp.array3d(dtype=float),
):
    """Write the actions for speeds [m/s] and yaw rates [rad/s]; `heading` is an argument of every `AsCar.act`."""
    w, i = wp.tid()
    action = drive_action(robot, speed[w, i], yaw_rate[w, i])
    action_out[w, i, 0] = action[0]
    action_out[w, i, 1] = action[1]


def check(curve: Curve, formation: Formation, robot: Robot, noise: Noise, task: Task) -> None:
    """Check that a drive's motion is in the plane and its integration accurate.

    Raises:
        ValueError: a field that a rule forbids, by name.
    """
    require(curve.half_depth <= 0, "curve.half_depth", "must be 0 for differential drives [m]", curve.half_depth)
    h = task.step / task.substeps
    turn = robot.top_yaw_rate * h / noise.wheelbase_range[0]
    rule = f"must turn a drive by at most pi in an integration step of {h:g} s, not by {turn:.3g} rad [rad/s]"
    require(turn <= math.pi, "robot.yaw_rate_max", rule, robot.top_yaw_rate)


def turning_radius(robot: Robot) -> float:
    """Return the radius of the tightest circle that car policies drive at top speed [m]: v / omega or v / sqrt(alpha).

    The latter is that of the circle on which a drive of top speed v and yaw acceleration alpha is after
    one radius of driving, if it went straight before. Policies of cars expect that their cars are on it at once.
    """
    return robot.top_speed / min(robot.top_yaw_rate, math.sqrt(robot.top_yaw_acceleration))


def shape(robot: Robot) -> list[tuple[np.ndarray, str | None]]:
    """Return outlines of a drive's parts for a radius of 1, heading right: a round body, two wheels, a sensor ahead."""
    around = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    disc = np.stack([np.cos(around), np.sin(around)], axis=-1)
    wheel = np.array([[-0.36, -0.1], [0.36, -0.1], [0.36, 0.1], [-0.36, 0.1]])
    sensor = np.array([[0.34, -0.3], [0.62, -0.24], [0.72, 0.0], [0.62, 0.24], [0.34, 0.3]])
    wheels: list[tuple[np.ndarray, str | None]] = [(wheel + np.array([0.0, y]), "WHEEL") for y in (-0.8, 0.8)]
    return [(disc, "GROUND"), (0.93 * disc, None), *wheels, (sensor, "GLASS")]


DIFFERENTIAL = register_robot_model(
    RobotModel(
        name="differential",
        actions=("speed", "yaw rate"),
        table=tuple(itertools.product((-1.0, 0.0, 0.5, 1.0), (-1.0, -0.5, 0.0, 0.5, 1.0))),
        move=move_drives,
        meanings=(
            "commanded speed, from speed_min to speed_max; 0 is rest [m/s]",
            "commanded yaw rate, from yaw_rate_max to the right to yaw_rate_max to the left [rad/s]",
        ),
        driving=(0,),
        speed_unit=lambda curve, formation, robot: robot.top_speed,
        check=check,
        shape=shape,
        as_car=AsCar(
            act,
            turning_radius=turning_radius,
            acceleration=lambda robot: robot.top_acceleration,
            has_yaw_limit=True,
        ),
    )
)
