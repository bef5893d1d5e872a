"""Headings of cars at the start of an episode within walls.

A car that cannot reverse needs room for one of its tightest circles, to the left or to the right, now or after some way
straight on: where all of them leave the hall, it meets a wall whatever it does. On a curve that bends more sharply than
cars turn, some would begin like that. They begin turned away from the wall instead, by no more than necessary.
"""

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct, curve_struct, wrap
from lissajous_env.device.devices import compile_quietly
from lissajous_env.device.part_structs import RobotStruct
from lissajous_env.device.stage import ROBOT, part, stage
from lissajous_env.device.structs import to_struct
from lissajous_env.device.trig import cos_sin
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.state import planar

wp.set_module_options(OPTIONS)

_PARTS = wp.constant(64)
"""Parts of a turn in which headings are compared."""
_HALVINGS = wp.constant(12)
"""Halvings of such a part."""


@wp.func
def passes(place: wp.vec2, ahead: wp.vec2, half: wp.vec2) -> bool:
    """Return whether a ray enters, or begins in, the rectangle of half extents `half` [m] around the origin."""
    first = float(0.0)
    last = float(wp.inf)
    for k in range(2):
        if wp.abs(ahead[k]) > 1.0e-6:
            one = (-half[k] - place[k]) / ahead[k]
            other = (half[k] - place[k]) / ahead[k]
            first = wp.max(first, wp.min(one, other))
            last = wp.min(last, wp.max(one, other))
        elif wp.abs(place[k]) > half[k]:
            last = -1.0
    return first <= last


@wp.func
def has_room(place: wp.vec2, heading: float, turning: float, half: wp.vec2) -> bool:
    """Return whether a car can turn inside a rectangle, to the left or to the right, now or after some way straight on.

    `turning` is the radius of its tightest circle [m], and `half` are the half extents within which the circle's middle
    must be [m].
    """
    ahead = cos_sin(heading)
    to_side = turning * wp.vec2(-ahead[1], ahead[0])
    return passes(place + to_side, ahead, half) or passes(place - to_side, ahead, half)


@wp.func
def heading_with_room(place: wp.vec2, heading: float, turning: float, half: wp.vec2) -> float:
    """Return the nearest heading at which a car has room to turn [rad]; the same heading if there is none."""
    if half[0] < 0.0 or half[1] < 0.0 or has_room(place, heading, turning, half):
        return heading
    part = 6.2831853 / float(_PARTS)
    for k in range(1, _PARTS + 1):
        turned = float((k + 1) / 2) * part * wp.where(k % 2 == 0, -1.0, 1.0)
        if has_room(place, heading + turned, turning, half):
            width = wp.sign(turned) * part
            for _halving in range(_HALVINGS):
                width *= 0.5
                if has_room(place, heading + turned - width, turning, half):
                    turned -= width
            return wrap(heading + turned)
    return heading


@part
def turned_inside(place: wp.vec2, heading: float, speed: float, turning: float, curve, robot) -> float:
    """Return the heading at which a car begins within walls, where steering and grip allow circles [rad]."""
    widest = wp.max(turning, speed * speed / robot.lateral_acceleration_max)
    x = wp.min(curve.half_width - robot.radius, curve.reach_x)
    y = wp.min(curve.half_height - robot.radius, curve.reach_y)
    return heading_with_room(place, heading, widest, wp.vec2(x - widest, y - widest))


@stage(ROBOT, writes="robots: heading")
def turn_inside(w, i, curve, robot, turning: float, clock, robots):
    """Turn the robots that begin without room to turn within the walls."""
    place = planar(robots.position[w, i])
    robots.heading[w, i] = turned_inside(place, robots.heading[w, i], robots.speed[w, i], turning, curve, robot)


@wp.kernel
def _turn_all(
    curve: CurveStruct,
    robot: RobotStruct,
    turning: float,
    pose: wp.array(dtype=wp.vec3),
    speed: wp.array(dtype=float),
    heading_out: wp.array(dtype=float),
):
    k = wp.tid()
    place = wp.vec2(pose[k][0], pose[k][1])
    heading_out[k] = turned_inside(place, pose[k][2], speed[k], turning, curve, robot)


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
