"""The rule by which cars stay inside walls: every action leaves a car a way to a circle that it can drive for ever.

Walls are the edge of the rectangle where it stops bodies, with `task.boundary = wall`, or removes robots, `remove`. The
centre of a body is inside the walls where it is in K, the rectangle without a strip of the radius of a body,
`CLEARANCE`, and `DEVIATIONS` standard deviations of a measured coordinate. A car at speed v turns at best on a circle
of the radius R, with its wheelbase l, its largest steering angle and its grip,

    R(v) = max(l / tan(delta_max), v^2 / a_lat)

and such a circle is in K where its centre is in C, the rectangle K without a strip of the width R. A car has a **way
out** if it can turn to one side, then go straight on, and then drive on a circle in K to the same or the other side.
The turn or the straight line may be missing. The way out is in K, and

* its straight line leads the centre of the circle through C for at least the way L of a step,
* this also holds for all directions of the straight line (of the `HEADINGS` that are tested) within an angle beta, the
  largest turn L / R of a step at this speed or a lower one, unless the turn is missing,
* its turn and its circle are to the same side if grip determines R.

The rule lets an action pass if the car is in K during the step and has a way out after it, as (12) predicts for the
car's own constants. Otherwise it takes the first of the following actions for which this is so: the steering is blended
with that at the beginning of a way out that the car has now, with the throttle that is wanted, and then with the motor
off, or with the throttle for `CREEP`, a low speed, if the car is slower. If there is none, the car follows the way out.

**A car with a way out never meets a wall.** Assume exact measurements, equal cars with `robot.model_offset` as their
`robot.offset`, and no failures. A car that follows a way out with the motor off still has one after a step, so that
there always is an action:

1. On the circle, its centre does not move, so it remains in C.
2. On the straight line, the centre of the circle moves along a line whose part in C is at least L long, so that a step
   cannot cross C. K is convex, so it contains the line from the car, which is in K, to the circle in K.
3. In the turn, the centre of the turn does not move, so the same straight lines are ahead. A step turns the car by beta
   at most, so it ends in one of these directions and not beyond them.
4. If the car slows down, neither L, R nor beta grow. If R shrinks to R', the centre of a circle to the side of the turn
   moves by R - R' at most, while C grows by as much to every side: a line that leads the one through C still leads the
   other. The turn is scaled by R' / R towards the car and remains in K, which is convex.
5. A car whose curvature grows while it slows down on the limit of its grip stays within each of its circles of
   curvature (Kneser's nested circles).

A car that is slower than `CREEP` is treated as if it drove at it, so it may accelerate to it, and does not get stuck. A
car that reverses is treated as one that is turned round: its way out is behind it.

Noise, and cars that differ, add errors that the argument does not cover. The rule uses the strongest motor, predicts
with the shortest and the longest wheelbase that the spreads allow, and requires the circle of the longest. It predicts
an action with errors of `STEP_DEVIATIONS` standard deviations of the steering, the heading and the speed. It does not
cover those of the way out: a circle that covers them does not fit where the walls are little farther apart than it.
What remains appears as a car without a way out, as does a car that begins an episode without one, or stands at a wall.
It backs up if it can reverse and has a way out behind it then; otherwise it turns at `CREEP` to the side whose circle
is nearer to C, and slides along the wall until it can leave it. This can take minutes for a car that has a wall
straight ahead and cannot reverse. A car that has failed and coasts is not driven by anybody. Where the walls are closer
than a circle, no car has a way out, and the rule changes nothing.

Policies of cars apply the rule to their actions (`baselines.policies.inside`). Where actions are velocities, the driver
of the cars applies it to its own (`drive_inside`).
"""

import math
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import wrap
from lissajous_env.device.stage import ROBOT, stage
from lissajous_env.device.structs import RobotStruct
from lissajous_env.device.trig import PI, TWO_PI, cos_sin
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.parts import Robot
from lissajous_env.theory.geometry import turning_radius
from lissajous_env.world.robots.car import (
    action_of_throttle,
    car_step,
    motor_acceleration,
    steering_angle,
    throttle,
    throttle_towards,
)
from lissajous_env.world.robots.placing import way_within
from lissajous_env.world.state import WORKING

wp.set_module_options(OPTIONS)

DEVIATIONS = 3.0
"""Standard deviations of a measured coordinate by which a body stays away from a wall."""
STEP_DEVIATIONS = 2.0
"""Standard deviations of the steering, the heading and the speed with which an action is predicted; with three, loops
that pass near a wall are left too often."""
CLEARANCE = 0.01
"""Least distance of a body from a wall, as a share of its radius; a body that slides along a wall is in contact."""
CREEP = 0.2
"""Lowest speed of a way out, as a share of the top speed and of the speed at which grip limits the tightest turn."""
SPEED_GAIN = 4.0
"""Gain of the speed error of a car of the paper's experiment that drives towards a place [1/s]."""
BLENDS = wp.constant(4)
"""Number of equal changes from the wanted steering to that of a way out."""
HEADINGS = wp.constant(64)
"""Number of headings at which a turn may end; a multiple of 4, so that they contain those at which it is at the edge of
K."""
ROUNDING = 1e-5
"""Bound of the rounding errors of places, relative to the rectangle."""


@wp.struct
class Walls:
    """Constants of the rule."""

    half_width: wp.float32
    """Half of the width of K [m]."""
    half_height: wp.float32
    """Half of the height of K [m]."""
    rounding: wp.float32
    """Bound of the rounding errors of places [m]."""
    turning: wp.float32
    """Radius of the tightest circle of the car with the longest wheelbase [m]."""
    fastest_turn: wp.float32
    """Speed up to which grip allows this circle [m/s]."""
    shortest: wp.float32
    """Shortest wheelbase that the spread allows [m]."""
    longest: wp.float32
    """Longest wheelbase [m]."""
    strongest: wp.float32
    """Acceleration per throttle of the strongest motor [m/s^2]."""
    creep: wp.float32
    """Lowest speed of a way out [m/s]."""
    speed_gain: wp.float32
    """Gain of the speed error [1/s]."""
    speed_unit: wp.float32
    """Unit of an observed speed [m/s]."""
    errors: wp.vec3
    """Bounds of the errors of an action, a measured heading [rad] and a measured speed [m/s]."""
    step: wp.float32
    """Control step [s]."""
    substeps: wp.int32
    """Integration steps in it."""
    predicted: wp.int32
    """Integration steps for which an action is predicted: those of a step, and those by which a turn is late."""


@wp.func
def circle(walls: Walls, robot: RobotStruct, car: wp.vec4, side: float) -> wp.vec3:
    """Return the centre and the radius [m] of the circle to one side of a car (x, y, heading, v): 1 left, -1 right."""
    speed = wp.max(car[3], walls.creep)
    radius = wp.max(walls.turning, speed * speed / robot.lateral_acceleration_max)
    ahead = cos_sin(car[2])
    return wp.vec3(car[0] - side * radius * ahead[1], car[1] + side * radius * ahead[0], radius)


@wp.func
def beyond(walls: Walls, around: wp.vec3) -> float:
    """Return the distance of a circle's centre from C [m]."""
    x = wp.max(wp.abs(around[0]) - (walls.half_width - around[2]), 0.0)
    y = wp.max(wp.abs(around[1]) - (walls.half_height - around[2]), 0.0)
    return wp.sqrt(x * x + y * y)


@wp.func
def leads_in(walls: Walls, robot: RobotStruct, car: wp.vec4, side: float) -> bool:
    """Return whether a car's way straight ahead leads to a circle to one side, 1 or -1, or to any side, 0."""
    ahead = cos_sin(car[2])
    way = wp.max(car[3], walls.creep) * walls.step
    for k in range(2):
        turn = wp.where(k == 0, 1.0, -1.0)
        around = circle(walls, robot, car, turn)
        half = wp.vec2(walls.half_width - around[2], walls.half_height - around[2])  # of C
        if side != -turn and way_within(wp.vec2(around[0], around[1]), ahead, half) >= way:
            return True
    return False


@wp.func
def is_inside(walls: Walls, x: float, y: float) -> bool:
    """Return whether a place is in K, within the rounding errors."""
    return wp.abs(x) <= walls.half_width + walls.rounding and wp.abs(y) <= walls.half_height + walls.rounding


@wp.func
def turns_out(walls: Walls, robot: RobotStruct, car: wp.vec4, side: float) -> bool:
    """Return whether a car has a way out that begins with a turn to one side, 1 or -1."""
    around = circle(walls, robot, car, side)
    if beyond(walls, around) <= walls.rounding:
        return True
    speed = wp.max(car[3], walls.creep)
    wanted = wp.min(speed, walls.fastest_turn) * walls.step / walls.turning
    to = wp.where(speed > walls.fastest_turn, side, 0.0)
    spacing = TWO_PI / float(HEADINGS)
    first = wp.ceil(side * car[2] / spacing)
    begin = float(1.0e30)
    for k in range(HEADINGS):
        turned = side * (first + float(k)) * spacing
        out = cos_sin(turned)
        x = around[0] + side * around[2] * out[1]
        y = around[1] - side * around[2] * out[0]
        if not is_inside(walls, x, y):
            return False
        if leads_in(walls, robot, wp.vec4(x, y, turned, car[3]), to):
            begin = wp.min(begin, float(k))
            if (float(k) - begin) * spacing >= wanted:
                return True
        else:
            begin = 1.0e30
    return False


@wp.func
def has_way_out(walls: Walls, robot: RobotStruct, car: wp.vec4, first: int) -> bool:
    """Return whether a car has a way out that begins with a turn to the right or left, -1 or 1, or without one, 0."""
    if not is_inside(walls, car[0], car[1]):
        return False
    if first == 0:
        return leads_in(walls, robot, car, 0.0)
    return turns_out(walls, robot, car, float(first))


@wp.func
def as_driven(car: wp.vec4) -> wp.vec4:
    """Return a car with its direction of travel as its heading; one that reverses drives like a car turned round."""
    if car[3] < 0.0:
        return wp.vec4(car[0], car[1], wrap(car[2] + PI), -car[3])
    return car


@wp.func
def is_safe(walls: Walls, robot: RobotStruct, car: wp.vec4) -> bool:
    """Return whether a car has a way out, in its direction of travel."""
    driven = as_driven(car)
    if has_way_out(walls, robot, driven, 0):
        return True
    return has_way_out(walls, robot, driven, 1) or has_way_out(walls, robot, driven, -1)


@wp.func
def is_safe_after(walls: Walls, robot: RobotStruct, car: wp.vec4, action: wp.vec2) -> bool:
    """Return whether a car is in K during an action and has a way out after it, with any wheelbase of the spread.

    With noise, the car is faster than measured, and heads and steers to the left or to the right of what is measured
    and wanted, or as measured and wanted.
    """
    acceleration = motor_acceleration(robot, walls.strongest, throttle(robot, action[1]))
    for k in range(6):
        if (k >= 3 and walls.longest == walls.shortest) or (k % 3 > 0 and walls.errors[0] + walls.errors[1] == 0.0):
            continue
        side = 1.0 - float(k % 3)
        slope = wp.tan(steering_angle(robot, wp.clamp(action[0] + side * walls.errors[0], -1.0, 1.0)))
        curvature = slope / wp.where(k < 3, walls.shortest, walls.longest)
        after = car
        after[2] += side * walls.errors[1]
        after[3] += wp.sign(car[3]) * walls.errors[2]
        for _ in range(walls.predicted):
            after = car_step(robot, after, curvature, acceleration, walls.step / float(walls.substeps))
            if not is_inside(walls, after[0], after[1]):
                return False
        if not is_safe(walls, robot, after):
            return False
    return True


@wp.func
def steering_out(walls: Walls, robot: RobotStruct, driven: wp.vec4, want: float) -> tuple[float, bool]:
    """Return the steering, -1, 0 or 1, at the beginning of the way out that is nearest to the wanted steering.

    The second value is False without a way out; the first one is then the side whose circle is nearer to C, the left if
    both are as near.
    """
    chosen = float(4.0)
    for first in range(-1, 2):
        if wp.abs(float(first) - want) < wp.abs(chosen - want) and has_way_out(walls, robot, driven, first):
            chosen = float(first)
    if chosen < 4.0:
        return chosen, True
    left = beyond(walls, circle(walls, robot, driven, 1.0))
    right = beyond(walls, circle(walls, robot, driven, -1.0))
    return wp.where(left <= right, 1.0, -1.0), False


@wp.func
def creeping(walls: Walls, robot: RobotStruct, speed: float, direction: float) -> float:
    """Return the action of the throttle that leads to `CREEP` in a direction, 1 or -1; with the motor off if faster."""
    tau = float(0.0)
    if direction * speed < walls.creep:
        tau = direction * throttle_towards(robot, direction * speed, walls.creep, walls.speed_gain)
    return action_of_throttle(robot, tau)


@wp.func
def action_inside(walls: Walls, robot: RobotStruct, car: wp.vec4, want: wp.vec2) -> wp.vec2:
    """Return the wanted action, or the first of the others that leaves a way out."""
    if is_safe_after(walls, robot, car, want):
        return want
    direction = wp.where(car[3] < 0.0, -1.0, 1.0)
    side, has_way = steering_out(walls, robot, as_driven(car), direction * want[0])
    steering = direction * side
    slow = creeping(walls, robot, car[3], direction)
    slower = wp.where(direction * want[1] < direction * slow, want[1], slow)
    for k in range(2 * BLENDS):
        share = float(k % BLENDS + 1) / float(BLENDS)
        action = wp.vec2(want[0] + share * (steering - want[0]), wp.where(k < BLENDS, want[1], slower))
        if is_safe_after(walls, robot, car, action):
            return action
    if not has_way and robot.speed_min < 0.0:
        for k in range(3):
            action = wp.vec2(wp.where(k == 0, 0.0, wp.where(k == 1, -steering, steering)), -1.0)
            if is_safe_after(walls, robot, car, action):
                return action
    return wp.vec2(steering, slow)


@stage(ROBOT, writes="command")
def drive_inside(w, i, robot, walls: Walls, clock, robots, command):
    """Change the steering and the throttle of the drivers of cars by the rule; a car that has failed has none."""
    car = robots.measured[w, i]
    if robots.status[w, i] == WORKING:
        if robot.speed_min == 0.0:
            car[3] = wp.max(car[3], 0.0)
        chosen = action_inside(walls, robot, car, wp.vec2(command[w, i, 0], command[w, i, 1]))
        command[w, i, 0] = chosen[0]
        command[w, i, 1] = chosen[1]


def scaled_gain(scenario: Scenario, gain: float) -> float:
    """Return a gain for the motor of the experiment, scaled to that of the scenario [1/s], at most 1 over the step."""
    return min(gain * (scenario.robot.drag / Robot().drag), 1 / scenario.task.step)


def margin_of(scenario: Scenario) -> float:
    """Return the width of the strip along the edge in which no centre of a body is, that of K [m].

    It is negative where the edge removes robots, which it does when they are wholly outside, and there is little noise:
    at a corner, a centre may be outside by sqrt(1 / 2) of the radius in both directions.
    """
    rounding = ROUNDING * (scenario.curve.half_width + scenario.curve.half_height)
    body = 1.0 if scenario.task.boundary == "wall" else -math.sqrt(0.5)
    return (body + CLEARANCE) * scenario.robot.radius + DEVIATIONS * scenario.noise.position + 2 * rounding


def walls_of(scenario: Scenario, turns_early: bool = False) -> Any:
    """Return the constants of the rule; `turns_early` if actions account for the time that a yaw rate needs to rise."""
    robot, noise, curve = scenario.robot, scenario.noise, scenario.curve
    walls: Any = Walls()
    walls.rounding = ROUNDING * (curve.half_width + curve.half_height)
    margin = margin_of(scenario)
    walls.half_width, walls.half_height = curve.half_width - margin, curve.half_height - margin
    walls.shortest, walls.longest = (robot.wheelbase * factor for factor in noise.wheelbase_range)
    walls.turning = turning_radius(walls.longest, robot.steering_max)
    walls.fastest_turn = math.sqrt(robot.lateral_acceleration_max * walls.turning)
    walls.strongest = robot.drive * noise.drive_range[1] * float(np.max(scenario.drive_factors))
    walls.creep = CREEP * min(robot.top_speed, walls.fastest_turn)
    walls.speed_gain = scaled_gain(scenario, SPEED_GAIN)
    walls.speed_unit = robot.top_speed
    walls.errors = wp.vec3(*(STEP_DEVIATIONS * deviation for deviation in (noise.actuator, noise.heading, noise.speed)))
    walls.step, walls.substeps = scenario.task.step, scenario.task.substeps
    # A differential drive gains the yaw rate of its tightest turn steadily, so its turn is late by half of that time.
    fastest = min(robot.top_speed, walls.fastest_turn)
    late = 0.0 if turns_early else fastest / (2 * walls.turning * robot.top_yaw_acceleration)
    walls.predicted = walls.substeps + math.ceil(late / walls.step * walls.substeps)
    return walls


def has_room(scenario: Scenario) -> bool:
    """Return whether there are walls that are at least a circle at `CREEP` apart."""
    if scenario.task.boundary == "open":
        return False
    walls = walls_of(scenario)
    return walls.turning < min(walls.half_width, walls.half_height)
