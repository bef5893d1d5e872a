"""Starts of robots: their phases and positions on the curve, and their headings within walls.

A car that cannot reverse needs room for one of its tightest circles, to the left or to the right, at once or after it
has driven straight on. If all of them leave the hall, it collides with a wall whatever it does. On a curve with bends
that are tighter than cars turn, some would begin like that; they begin turned away from the wall, as little as needed.
"""

import numpy as np
import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import MOTION, OPTIONS, module_apart
from lissajous_env.device.curve import (
    CurveStruct,
    curve_parameter,
    curve_struct,
    point,
    tangent2,
    wrap,
    wrap_phase,
)
from lissajous_env.device.devices import compile_quietly
from lissajous_env.device.stage import ROBOT, WORLD, part, stage
from lissajous_env.device.structs import RobotStruct, code_of, to_struct
from lissajous_env.device.trig import TWO_PI, cos_sin
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.parts import SPREAD_MAX, Formation
from lissajous_env.world.robots.contacts import closest_approach
from lissajous_env.world.state import REMOVED, WORKING, planar

wp.set_module_options(MOTION)
_STARTS = module_apart(f"{__name__}.starts", OPTIONS)

ROTATED = wp.constant(code_of(Formation, "start", "rotated"))
RANDOM = wp.constant(code_of(Formation, "start", "random"))

_CLIP = wp.constant(SPREAD_MAX)
_DRAWS = wp.constant(100)
"""Largest number of starts that are drawn for a robot; the last one remains."""


@part
def place_on_curve(w, i, rate: float, curve, alpha: float, robots):
    """Place a robot at the point of its phase, heading along the curve at phase rate `rate` [rad/s]."""
    gamma = curve_parameter(alpha, robots.phase[w, i])
    tangent = tangent2(curve, gamma) * (alpha * rate)
    robots.position[w, i] = point(curve, gamma)
    robots.speed[w, i] = wp.length(tangent)
    if rate != 0.0:
        robots.heading[w, i] = wp.atan2(tangent[1], tangent[0])


@part
def start_phase(w, i, draw: int, formation, equilibrium, displacements, clock) -> wp.float64:
    """Return the phase of a robot at reset [rad]; each `draw`, counted from 0, has a random displacement of its own."""
    phase = equilibrium[i] + wp.float64(displacements[i])
    if formation.start == ROTATED:  # the same turn for every robot
        turn = randomness.stream(randomness.step_key(clock.seed[w], 0), -1, randomness.START)
        phase += wp.float64(TWO_PI * wp.randf(turn))
    own = randomness.stream(randomness.step_key(clock.seed[w], -draw), i, randomness.START)
    if formation.start == RANDOM:
        phase = wp.float64(TWO_PI * wp.randf(own))
    phase += wp.float64(formation.start_noise * wp.randn(own))
    return wrap_phase(phase)


@part
def begin_on_curve(w, i, phase: wp.float64, curve, formation, top_speeds, robots):
    """Put a robot on the curve at a phase [rad], at the formation's speed or its own top speed if that is lower."""
    alpha = float(formation.alpha)
    robots.phase[w, i] = phase
    # `formation.phase_rate` is the rate of the curve's parameter, which is alpha times the phase.
    place_on_curve(w, i, formation.phase_rate / alpha, curve, alpha, robots)
    robots.speed[w, i] = wp.max(wp.min(robots.speed[w, i], top_speeds[i]), 0.0)
    for s in range(robots.path.shape[2]):
        robots.path[w, i, s] = robots.position[w, i]


@stage(
    ROBOT,
    writes="robots: drive, heading, path, phase, position, speed, status, wheelbase",
)
def reset_robots(
    w, i, curve, formation, robot, noise, equilibrium, displacements, drive_factors, top_speeds, clock, robots
):
    """Place the robots on the curve at the formation's speed or their top speed, and draw each one's own constants."""
    key = randomness.step_key(clock.seed[w], 0)
    phase = start_phase(w, i, 0, formation, equilibrium, displacements, clock)
    begin_on_curve(w, i, phase, curve, formation, top_speeds, robots)
    robots.status[w, i] = wp.where(robots.removed_at[w, i] < 1, REMOVED, WORKING)
    body = randomness.stream(key, i, randomness.BODY)
    # A spread is clipped, so that no car has a wheelbase of zero.
    robots.wheelbase[w, i] = robot.wheelbase * (1.0 + noise.wheelbase_spread * wp.clamp(wp.randn(body), -_CLIP, _CLIP))
    drive = robot.drive * drive_factors[i]
    robots.drive[w, i] = drive * (1.0 + noise.drive_spread * wp.clamp(wp.randn(body), -_CLIP, _CLIP))


@part
def collides_at_once(w, i, time: float, radius: float, places, robots) -> bool:
    """Return whether a robot collides within a time [s] with one of smaller index if all go straight on.

    Only the motion in the plane counts. Robots of the same `places` overlap by design, see `Scenario.places`.
    """
    velocity = robots.speed[w, i] * cos_sin(robots.heading[w, i])
    for j in range(i):
        apart = planar(robots.position[w, i] - robots.position[w, j])
        parting = velocity - robots.speed[w, j] * cos_sin(robots.heading[w, j])
        if places[i] != places[j] and closest_approach(apart, apart + time * parting) < 4.0 * radius * radius:
            return True
    return False


_HEADINGS = wp.constant(64)
"""Number of headings that are tried."""
_HALVINGS = wp.constant(12)
"""Number of bisections between two of these headings."""


@wp.func
def way_within(place: wp.vec2, ahead: wp.vec2, half: wp.vec2) -> float:
    """Return the length [m] of the part of a ray in the rectangle of half extents `half` [m]; below 0 for none.

    The ray begins at `place` [m] in the direction `ahead`; the rectangle is around the origin.
    """
    if wp.min(half[0], half[1]) < 0.0:
        return -1.0
    begin = float(0.0)
    end = float(1.0e30)
    for axis in range(2):
        if wp.abs(ahead[axis]) > 1.0e-6:
            middle = -place[axis] / ahead[axis]
            reach = wp.abs(half[axis] / ahead[axis])
            begin = wp.max(begin, middle - reach)
            end = wp.min(end, middle + reach)
        elif wp.abs(place[axis]) > half[axis]:
            return -1.0
    return end - begin


@wp.func
def can_turn(place: wp.vec2, heading: float, turning_radius: float, half: wp.vec2) -> bool:
    """Return whether a car can turn in a rectangle, to the left or to the right, at once or after driving straight on.

    `turning_radius` is that of its tightest circle [m]. The circle's centre must be within the half extents `half` [m].
    """
    ahead = cos_sin(heading)
    to_side = turning_radius * wp.vec2(-ahead[1], ahead[0])
    return way_within(place + to_side, ahead, half) >= 0.0 or way_within(place - to_side, ahead, half) >= 0.0


@part
def heading_from_walls(place: wp.vec2, heading: float, speed: float, turning_radius, curve, robot) -> float:
    """Return the heading at which a car begins between walls [rad]: the nearest with room for its tightest circle.

    Its steering (`turning_radius` [m]) or, at its speed [m/s], its grip limits that circle. The car on it stays in the
    rectangle without the inset, and its body within the walls. Without such a heading, it is that on the curve.
    """
    radius = wp.max(turning_radius, speed * speed / robot.lateral_acceleration_max)
    x = wp.min(curve.half_width - robot.radius, curve.reach_x)
    y = wp.min(curve.half_height - robot.radius, curve.reach_y)
    half = wp.vec2(x - radius, y - radius)
    if half[0] < 0.0 or half[1] < 0.0 or can_turn(place, heading, radius, half):
        return heading
    spacing = TWO_PI / float(_HEADINGS)
    for k in range(1, _HEADINGS + 1):
        turned = float((k + 1) / 2) * spacing * wp.where(k % 2 == 0, -1.0, 1.0)
        if can_turn(place, heading + turned, radius, half):
            width = wp.sign(turned) * spacing
            for _halving in range(_HALVINGS):
                width *= 0.5
                if can_turn(place, heading + turned - width, radius, half):
                    turned -= width
            return wrap(heading + turned)
    return heading


@part
def face_inwards(w, i, curve, robot, turning_radius, robots):
    """Turn a robot away from the walls if it would begin without room to turn."""
    place = planar(robots.position[w, i])
    robots.heading[w, i] = heading_from_walls(
        place, robots.heading[w, i], robots.speed[w, i], turning_radius, curve, robot
    )


@stage(ROBOT, writes="robots: heading", module=_STARTS)
def turn_from_walls(w, i, curve, robot, turning_radius, clock, robots):
    """Turn the robots that would begin without room to turn away from the walls."""
    face_inwards(w, i, curve, robot, turning_radius, robots)


@stage(WORLD, writes="robots: heading, path, phase, position, speed", module=_STARTS)
def redraw_colliding_starts(
    w, curve, formation, robot, turning_radius, equilibrium, displacements, top_speeds, places, clock, robots
):
    """Draw the start of each robot again while it would collide within `formation.start_headway`."""
    for i in range(1, robots.status.shape[1]):
        for draw in range(1, _DRAWS):
            if not collides_at_once(w, i, formation.start_headway, robot.radius, places, robots):
                break
            phase = start_phase(w, i, draw, formation, equilibrium, displacements, clock)
            begin_on_curve(w, i, phase, curve, formation, top_speeds, robots)
            if turning_radius > 0.0:
                face_inwards(w, i, curve, robot, turning_radius, robots)


@wp.kernel(module=_STARTS)
def _turn_all(
    curve: CurveStruct,
    robot: RobotStruct,
    turning_radius: float,
    pose: wp.array(dtype=wp.vec3),
    speed: wp.array(dtype=float),
    heading_out: wp.array(dtype=float),
):
    k = wp.tid()
    place = wp.vec2(pose[k][0], pose[k][1])
    heading_out[k] = heading_from_walls(place, pose[k][2], speed[k], turning_radius, curve, robot)


def start_headings(scenario: Scenario, pose: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Return the headings (...) with which cars begin [rad], for a resolved scenario.

    Args:
        scenario: The scenario.
        pose: (..., 3) x, y [m] and heading [rad] on the curve.
        speed: (...) speeds at the start [m/s].
    """
    if scenario.start_turning == 0:
        return pose[..., 2]
    with compile_quietly():
        curve, robot = curve_struct(scenario.curve, "cpu"), to_struct(RobotStruct, scenario.robot)
        poses = wp.array(pose.reshape(-1, 3), dtype=wp.vec3, device="cpu")
        speeds = wp.array(speed.reshape(-1), dtype=float, device="cpu")
        heading = wp.zeros(poses.shape, dtype=float, device="cpu")
        given = [curve, robot, scenario.start_turning, poses, speeds]
        wp.launch(_turn_all, poses.shape, given, [heading], device="cpu")
    return heading.numpy().reshape(speed.shape).astype(float)
