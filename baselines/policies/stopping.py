"""The rule by which differential drives stay inside walls: every action leaves a drive a way to stop.

The centre of a body is inside the walls where it is in K, the rectangle of `lissajous_env.world.robots.inside`. A drive
**can stop** if it stays in K while it brakes to rest and turns to the left or to the right as fast as it can, or keeps
straight on. The rule lets an action pass if the drive is in K during the step and can stop after it, as its motion
predicts for both ends of the spreads of motors and wheels. Otherwise it takes the first action for which this is so:
the yaw rate is blended with that of a way to stop that the drive has now, with the speed that is wanted and then with
half of it. If there is none, the drive stops or goes back, as it stays farthest inside.

With noise, an action is predicted with errors of `DEVIATIONS` standard deviations, and a drive that brakes stays in K
by `DEVIATIONS` standard deviations of the place that it then reaches.

A drive that can stop never meets a wall, if its measurements are exact and its constants are those of the scenario: it
can brake on for the rest of its way, and at rest it can turn on the spot until it may leave. No circle has to fit
between the walls. A drive that is outside K, as at a wall, may do what does not lead it farther outside.

The yaw rate is not observed, so the rule computes it from the actions that it returned, and with noise of actions also
from the deviation of the measured heading from the expected one; at the start it is 0.
"""

import math
from typing import Any

import warp as wp

from baselines.policies.inside import WallRule
from baselines.policies.own_row import Actions, Observation, own_heading, own_position, own_speed, own_works
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct, wrap
from lissajous_env.device.devices import as_device
from lissajous_env.device.structs import RobotStruct
from lissajous_env.device.trig import cos_sin
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.robots.contacts import distance_inside
from lissajous_env.world.robots.differential import commanded_speed, drive_step, ramp, yaw_limit
from lissajous_env.world.robots.inside import DEVIATIONS, ROUNDING, margin_of

wp.set_module_options(OPTIONS)

BLENDS = wp.constant(4)
"""Number of equal changes from the wanted yaw rate to that of a way to stop."""
SPEEDS = wp.constant(2)
"""Number of equal changes from the wanted speed to rest."""


@wp.struct
class Limits:
    """Limits of the motion of drives, and of the rectangle K."""

    half: wp.vec2
    """Half of the width and of the height of K [m]."""
    rounding: wp.float32
    """Bound of the rounding errors of places [m]."""
    pushes: wp.vec2
    """Accelerations of the weakest and of the strongest motor [m/s^2]."""
    yaw_rates: wp.vec2
    """Yaw rates of the widest and of the narrowest drive at an action of 1 [rad/s]."""
    action_error: wp.float32
    """Bound of the noise of an action."""
    heading_error: wp.float32
    """Bound of the error of a measured heading [rad]."""
    turn_action: wp.float32
    """Action of the yaw rate of a way to stop that turns."""
    heading_noise: wp.float32
    """Bound of the change of a heading in an integration step by the noise of an action [rad]."""
    speed_error: wp.float32
    """Bound of the error of a measured speed [m/s]."""
    yaw_error: wp.float32
    """Bound of the noise of a yaw rate [rad/s]."""
    is_exact: wp.int32
    """1 without noise and spreads."""
    substep: wp.float32
    """Time of an integration step [s]."""
    substeps: wp.int32
    """Integration steps in a control step."""
    braking: wp.int32
    """Integration steps in which the weakest motor brakes from the top speed, measured with the largest error."""


@wp.struct
class Drive:
    """State of a drive."""

    pose: wp.vec4
    """x, y [m], heading [rad] and speed [m/s]."""
    yaw_rate: wp.float32
    """Yaw rate [rad/s]."""


@wp.func
def moved(limits: Limits, robot: RobotStruct, drive: Drive, speed: float, turning: float, push: float) -> Drive:
    """Return a drive after an integration step towards a speed [m/s] and a yaw rate [rad/s]."""
    most = yaw_limit(robot, drive.pose[3], ramp(drive.pose[3], speed, push * limits.substep))
    turned = wp.clamp(drive.yaw_rate, -most, most)
    towards = wp.clamp(turning, -most, most)
    after = Drive()
    after.pose = drive_step(robot, drive.pose, turned, speed, towards, push, limits.substep)
    after.yaw_rate = ramp(turned, towards, robot.yaw_acceleration_max * limits.substep)
    return after


@wp.func
def room_to_stop(limits: Limits, robot: RobotStruct, half: wp.vec2, drive: Drive, turn: float) -> float:
    """Return the least distance from the edge of a rectangle while a drive brakes with an action of the yaw rate [m].

    It is below 0 if the drive leaves the rectangle. With noise, it is less by `DEVIATIONS` standard deviations of the
    place: if the heading deviates by a small angle at one place, all later places turn about it by this angle. The
    deviations of the steps are independent, so the variances of their displacements add up.
    """
    now = drive
    least = float(wp.inf)
    variance = limits.heading_noise * limits.heading_noise
    count = float(0.0)
    sum_of = wp.vec2()
    squares = wp.vec2()
    for _ in range(limits.braking):
        if now.pose[3] == 0.0:
            break
        gone = wp.vec2(now.pose[0] - drive.pose[0], now.pose[1] - drive.pose[1])
        count += 1.0
        sum_of += gone
        squares += wp.cw_mul(gone, gone)
        now = moved(limits, robot, now, 0.0, turn * limits.yaw_rates[0], limits.pushes[0])
        gone = wp.vec2(now.pose[0] - drive.pose[0], now.pose[1] - drive.pose[1])
        spread = count * wp.cw_mul(gone, gone) - 2.0 * wp.cw_mul(gone, sum_of) + squares
        aside = wp.vec2(wp.sqrt(wp.max(variance * spread[1], 0.0)), wp.sqrt(wp.max(variance * spread[0], 0.0)))
        least = wp.min(least, distance_inside(half[0] - aside[0], half[1] - aside[1], now.pose[0], now.pose[1]))
    return least


@wp.func
def yaw_rate_towards(limits: Limits, action: float, side: float) -> float:
    """Return the yaw rate of an action for the wheels that turn a drive farthest to a side, 1 or -1 [rad/s]."""
    return action * wp.where(action * side > 0.0, limits.yaw_rates[1], limits.yaw_rates[0])


@wp.func
def room_after(
    limits: Limits, robot: RobotStruct, half: wp.vec2, drive: Drive, action: wp.vec2, lowest: float, enough: float
) -> float:
    """Return the least distance from the edge of a rectangle during an action and the best way to stop after it [m].

    This is that of the worst motor and wheels. With noise, the drive is faster than measured, goes faster or slower
    than wanted, and heads to the left or to the right of what is measured and wanted, or as measured and wanted: it may
    have ways to stop after turns to the left and to the right, but not between them. A result below `lowest` or above
    `enough` is not computed exactly.
    """
    least = enough
    for k in range(wp.where(limits.is_exact == 1, 1, 12)):  # side: k % 3, motor: k / 3 % 2, faster or slower: k / 6
        side = 1.0 - float(k % 3)
        faster = wp.where((action[0] < 0.0) == (k < 6), -1.0, 1.0)
        if k >= 6 and wp.abs(action[0]) > limits.action_error:
            break  # slower is safer unless it is in the other direction
        now = Drive()
        now.pose = drive.pose
        now.pose[2] += side * limits.heading_error
        now.pose[3] += wp.sign(drive.pose[3]) * limits.speed_error
        now.yaw_rate = yaw_rate_towards(limits, drive.yaw_rate / robot.yaw_rate_max, side)
        speed = commanded_speed(robot, wp.clamp(action[0] + faster * limits.action_error, -1.0, 1.0))
        turning = yaw_rate_towards(limits, wp.clamp(action[1] + side * limits.action_error, -1.0, 1.0), side)
        for _ in range(limits.substeps):
            now = moved(limits, robot, now, speed, turning, limits.pushes[(k / 3) % 2])
            least = wp.min(least, distance_inside(half[0], half[1], now.pose[0], now.pose[1]))
        most = float(-wp.inf)
        for way in range(3):
            if most < least and least >= lowest:
                most = wp.max(most, room_to_stop(limits, robot, half, now, float(way - 1) * limits.turn_action))
        least = wp.min(least, most)
        if least < lowest:
            break
    return least


@wp.func
def turn_to_stop(limits: Limits, robot: RobotStruct, half: wp.vec2, drive: Drive, want: float) -> float:
    """Return the action of the yaw rate of a way to stop: to the wanted side, straight on, or to the other one.

    Without a wanted side, or a way to stop, this is the side of the middle of the rectangle.
    """
    ahead = cos_sin(drive.pose[2])
    middle = wp.where(ahead[0] * drive.pose[1] < ahead[1] * drive.pose[0], limits.turn_action, -limits.turn_action)
    side = wp.where(wp.abs(want) > 1.0e-3, wp.sign(want) * limits.turn_action, middle)
    for k in range(3):
        turn = side * float(1 - k)
        if room_to_stop(limits, robot, half, drive, turn) >= -limits.rounding:
            return turn
    return middle


@wp.func
def stopping(limits: Limits, robot: RobotStruct, drive: Drive, want: wp.vec2) -> wp.vec2:
    """Return the wanted action, or the first of the others after which a drive can stop.

    With noise or spreads there may be none. The drive then takes the action that keeps it farthest inside: it stops, or
    goes back.
    """
    half = wp.vec2(wp.max(limits.half[0], wp.abs(drive.pose[0])), wp.max(limits.half[1], wp.abs(drive.pose[1])))
    enough = -limits.rounding
    if room_after(limits, robot, half, drive, want, enough, enough) >= enough:
        return want
    turning = turn_to_stop(limits, robot, half, drive, want[1])
    for k in range(SPEEDS):
        for n in range(BLENDS + 1):
            share = float(n) / float(BLENDS)
            action = wp.vec2(want[0] * (1.0 - float(k) / float(SPEEDS)), want[1] + share * (turning - want[1]))
            if room_after(limits, robot, half, drive, action, enough, enough) >= enough:
                return action
    best = wp.vec2(0.0, turning)
    most = room_after(limits, robot, limits.half, drive, best, -wp.inf, wp.inf)
    for k in range(wp.where(limits.is_exact == 1, 0, 9)):
        action = wp.vec2(float(k / 3 - 1) * 2.0 * limits.action_error, float(k % 3 - 1) * limits.turn_action)
        room = room_after(limits, robot, limits.half, drive, action, most, wp.inf)
        if room > most:
            most = room
            best = action
    return best


@wp.kernel
def leave_a_way_to_stop(
    limits: Limits,
    robot: RobotStruct,
    curve: CurveStruct,
    observation: Observation,
    yaw_rate: wp.array2d(dtype=float),
    heading: wp.array2d(dtype=float),
    action: Actions,
):
    """Change the speeds and the yaw rates by the rule; an action that is not finite passes."""
    w, i = wp.tid()
    want = wp.vec2(action[w, i, 0], action[w, i, 1])
    if not wp.isfinite(want[0]) or not wp.isfinite(want[1]):
        return
    place = own_position(w, i, curve, observation)
    drive = Drive()
    drive.pose = wp.vec4(
        place[0], place[1], own_heading(w, i, observation), own_speed(w, i, robot.speed_max, observation)
    )
    if own_works(w, i, observation):  # otherwise it is at rest, but may resume in this step
        drive.yaw_rate = yaw_rate[w, i]
        if heading[w, i] != 0.0:
            missed = wrap(drive.pose[2] - heading[w, i]) / (float(limits.substeps) * limits.substep)
            drive.yaw_rate += wp.clamp(missed, -limits.yaw_error, limits.yaw_error)
    clipped = wp.vec2(wp.clamp(want[0], -1.0, 1.0), wp.clamp(want[1], -1.0, 1.0))
    chosen = stopping(limits, robot, drive, clipped)
    if chosen[0] != clipped[0] or chosen[1] != clipped[1]:
        action[w, i, 0] = chosen[0]
        action[w, i, 1] = chosen[1]
    for _ in range(limits.substeps):
        speed = commanded_speed(robot, chosen[0])
        drive = moved(limits, robot, drive, speed, chosen[1] * robot.yaw_rate_max, robot.acceleration_max)
    yaw_rate[w, i] = drive.yaw_rate
    heading[w, i] = drive.pose[2]


class Stopping(WallRule):
    """The rule for the differential drives of a scenario with walls; arguments as for `Inside`."""

    kernel = leave_a_way_to_stop
    remembers = "yaw_rate", "heading"

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu"):
        super().__init__(scenario, num_worlds, device, limits_of(scenario))
        self.yaw_rate = wp.zeros(self.shape, dtype=wp.float32, device=as_device(device))
        """(W, N) yaw rates before the next action [rad/s]; 0 when an episode begins."""
        self.heading = wp.zeros(self.shape, dtype=wp.float32, device=as_device(device))
        """(W, N) headings that are expected after the latest action [rad]; 0 when an episode begins."""

    @staticmethod
    def suits(scenario: Scenario) -> bool:
        """Return whether the robots are differential drives between walls that are farther apart than a body."""
        if scenario.actuation != "differential" or scenario.task.boundary == "open":
            return False
        return margin_of(scenario) < min(scenario.curve.half_width, scenario.curve.half_height)


def limits_of(scenario: Scenario) -> Any:
    """Return the constants of the rule."""
    robot, noise, curve, task = scenario.robot, scenario.noise, scenario.curve, scenario.task
    limits: Any = Limits()
    margin = margin_of(scenario)
    limits.half = wp.vec2(curve.half_width - margin, curve.half_height - margin)
    limits.rounding = ROUNDING * (curve.half_width + curve.half_height)
    motors, (shortest, longest) = scenario.drive_factors, noise.wheelbase_range
    weakest = robot.top_acceleration * noise.drive_range[0] * float(motors.min())
    limits.pushes = wp.vec2(weakest, robot.top_acceleration * noise.drive_range[1] * float(motors.max()))
    limits.yaw_rates = wp.vec2(robot.top_yaw_rate / longest, robot.top_yaw_rate / shortest)
    limits.action_error, limits.heading_error = DEVIATIONS * noise.actuator, DEVIATIONS * noise.heading
    limits.yaw_error = limits.action_error * robot.top_yaw_rate
    limits.heading_noise = limits.action_error * robot.top_yaw_rate * task.step / math.sqrt(task.substeps)
    limits.speed_error = DEVIATIONS * noise.speed
    limits.turn_action = min(math.sqrt(robot.top_yaw_acceleration) / robot.top_yaw_rate, 1.0)
    spreads = noise.wheelbase_spread, noise.drive_spread, *(factor - 1 for factor in motors)
    limits.is_exact = int(not any((noise.actuator, noise.heading, noise.speed, *spreads)))
    limits.substep, limits.substeps = task.step / task.substeps, task.substeps
    measured = max(robot.top_speed, -robot.lowest_speed) + DEVIATIONS * noise.speed
    limits.braking = math.ceil((measured + limits.speed_error) / (weakest * limits.substep)) + 1
    return limits
