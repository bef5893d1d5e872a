"""Motion in the reference, in float64: the curve, the bicycle with its motor, walls, targets, the closest approach."""

import functools
import itertools
import math

import numpy as np
from scipy.spatial import KDTree

STILL, DRIFTING, WANDERING, FLEEING = range(4)
PROJECTION_LIMIT = 0.1
"""Largest correction of a car's curve parameter in a control step [rad]."""


def wrapped(angle: float) -> float:
    """The same angle in (-pi, pi] [rad]."""
    return math.remainder(angle, 2 * math.pi)


def extents(curve) -> tuple[float, float]:
    """A and B of (3): half of the rectangle without the inset [m]."""
    inset = curve.inset or 0.0  # None: that of a scenario, which a curve by itself does not have
    return curve.half_width - inset, curve.half_height - inset


def curve_point(curve, gamma: float) -> np.ndarray:
    """Equation (10), which is (3) where C = 0 [m]."""
    A, B = extents(curve)
    return np.array(
        [A * math.cos(curve.a * gamma), B * math.sin(curve.b * gamma), curve.half_depth * math.sin(curve.c * gamma)]
    )


def curve_tangent(curve, gamma: float) -> np.ndarray:
    """Derivative of (3) with respect to its parameter [m/rad]."""
    A, B = extents(curve)
    return np.array([-A * curve.a * math.sin(curve.a * gamma), B * curve.b * math.cos(curve.b * gamma)])


@functools.lru_cache(maxsize=8)
def curve_tree(curve, points: int = 200_000) -> KDTree:
    """Points of a lap of (3) [m], to ask for the nearest of."""
    gamma = np.linspace(0, 2 * math.pi, points)
    A, B = extents(curve)
    x, y = A * np.cos(curve.a * gamma), B * np.sin(curve.b * gamma)
    return KDTree(np.stack([x, y], axis=-1))


def projection(curve, place: np.ndarray, gamma: float) -> float:
    """Newton's step for r'.(q - r) = 0 [rad], limited; where the curve bends much, twice that of Gauss and Newton."""
    tangent, away = curve_tangent(curve, gamma), place - curve_point(curve, gamma)[:2]
    A, B = extents(curve)
    second = np.array([-A * curve.a**2 * math.cos(curve.a * gamma), -B * curve.b**2 * math.sin(curve.b * gamma)])
    slope = tangent @ tangent - second @ away
    lag = float(tangent @ away / max(slope, tangent @ tangent / 2))
    return min(max(lag, -PROJECTION_LIMIT), PROJECTION_LIMIT)


def throttle_of(robot, action: float) -> float:
    """Throttle of an action in [-1, 1]; a car that reverses has one range of throttles for each direction."""
    if not robot.reverses:
        return robot.throttle_min + (action + 1) / 2 * (robot.throttle_max - robot.throttle_min)
    end = robot.throttle_max if action >= 0 else (robot.offset - robot.drag * robot.lowest_speed) / robot.drive
    return math.copysign(robot.throttle_min + abs(action) * (end - robot.throttle_min), action)


def motor_acceleration(robot, throttle: float) -> float:
    """Drive less offset, and nothing in the dead zone [m/s^2]; in reverse the mirror image."""
    if abs(throttle) <= robot.dead_zone or (throttle < 0 and not robot.reverses):
        return 0.0
    push = robot.drive * abs(throttle) - robot.offset
    return push if not robot.reverses else math.copysign(max(push, 0.0), throttle)


def car_rates(robot, state: np.ndarray, steering: float, throttle: float) -> np.ndarray:
    """Right side of (12) for [x, y, heading, speed], with the limit of grip on the yaw rate."""
    _, _, heading, speed = state
    speed = speed if robot.reverses else max(speed, 0.0)
    yaw_rate = speed * math.tan(steering) / robot.wheelbase
    if speed != 0:
        most = robot.lateral_acceleration_max / abs(speed)
        yaw_rate = min(max(yaw_rate, -most), most)
    acceleration = motor_acceleration(robot, throttle) - robot.drag * speed
    return np.array([speed * math.cos(heading), speed * math.sin(heading), yaw_rate, acceleration])


def car_runge_kutta(robot, state: np.ndarray, steering: float, throttle: float, h: float) -> np.ndarray:
    """One step of the classical Runge-Kutta method; without `speed_min` the car does not reverse."""
    first = car_rates(robot, state, steering, throttle)
    second = car_rates(robot, state + h / 2 * first, steering, throttle)
    third = car_rates(robot, state + h / 2 * second, steering, throttle)
    fourth = car_rates(robot, state + h * third, steering, throttle)
    after = state + h * (first + 2 * second + 2 * third + fourth) / 6
    if not robot.reverses:
        after[3] = max(after[3], 0.0)
    return after


def ramped(before: float, wanted: float, rate: float, times: np.ndarray) -> np.ndarray:
    """Values at some times of a quantity that changes towards another value at a rate."""
    return before + np.clip(wanted - before, -rate * times, rate * times)


def drive_way(robot, state: np.ndarray, action: np.ndarray, motor: float, wheels: float, h: float) -> np.ndarray:
    """[x, y, heading, speed, yaw rate] of a differential drive after h [s], by the trapezoidal rule in 400 steps.

    Its motor and the distance of its wheels are relative to the scenario's.
    """
    x, y, heading, speed, yaw_rate = state
    times = np.linspace(0, h, 401)
    wanted = action[0] * robot.speed_max if action[0] > 0 else -action[0] * robot.speed_min
    speeds = ramped(speed, wanted, motor * robot.acceleration_max, times)
    grip = robot.lateral_acceleration_max / max(abs(speeds[0]), abs(speeds[-1]), 1e-6)
    turning = np.clip([yaw_rate, action[1] * robot.yaw_rate_max / wheels], -grip, grip)
    rates = ramped(*turning, robot.yaw_acceleration_max, times)
    headings = heading + np.concatenate([[0.0], np.cumsum((rates[1:] + rates[:-1]) / 2)]) * times[1]
    x += np.trapezoid(speeds * np.cos(headings), times)
    y += np.trapezoid(speeds * np.sin(headings), times)
    return np.array([x, y, headings[-1], speeds[-1], rates[-1]])


def closest_approach(before: np.ndarray, after: np.ndarray) -> float:
    """Shortest distance of the origin from the straight way between two offsets [m]."""
    way = after - before
    length = float(np.linalg.norm(way))
    if length == 0:
        return float(np.linalg.norm(before))
    along = min(max(-float(before @ way) / length, 0.0), length)
    return float(np.linalg.norm(before + along * way / length))


def first_within(before: np.ndarray, after: np.ndarray, radius: float) -> float | None:
    """Return the first time in [0, 1] at which an offset that changes linearly is no longer than a radius [m]."""
    if np.linalg.norm(before) <= radius:
        return 0.0
    way = after - before
    crossings = np.roots([way @ way, 2 * before @ way, before @ before - radius**2])
    times = [float(t.real) for t in crossings if abs(t.imag) < 1e-12 and 0 <= t.real <= 1]
    return min(times, default=None)


def meetings(before: np.ndarray, after: np.ndarray, ways: dict[int, list], radius: float) -> dict[int, float]:
    """Return the share of the step at which each robot first has a target in its disc; all move straight in
    sub-steps."""
    met = {}
    for i, way in ways.items():
        offsets = [before + (after - before) * s / (len(way) - 1) - place[:2] for s, place in enumerate(way)]
        for s, (start, end) in enumerate(itertools.pairwise(offsets)):
            share = first_within(start, end, radius)
            if share is not None:
                met[i] = (s + share) / (len(way) - 1)
                break
    return met


def stopped_by_walls(curve, radius: float, state: np.ndarray) -> np.ndarray:
    """The state with the body put back to the wall, and the velocity projected on it."""
    x, y, heading, speed = state
    velocity = speed * np.array([math.cos(heading), math.sin(heading)])
    place = []
    for k, (at, half) in enumerate([(x, curve.half_width - radius), (y, curve.half_height - radius)]):
        if abs(at) > half and at * velocity[k] > 0:
            velocity[k] = 0.0
        place.append(max(-half, min(at, half)))
    return np.array([*place, heading, math.copysign(math.hypot(*velocity), speed)])


def move_target(scenario, target, sensors: dict[int, np.ndarray]) -> None:
    """Move a target of the reference over a step; `sensors` are the places of the robots that sense [m]."""
    curve, rules, dt = scenario.curve, scenario.targets, scenario.task.step
    half = np.array([curve.half_width, curve.half_height])
    if target.motion == STILL:
        return
    if target.motion == FLEEING and sensors:
        nearest = min(sensors.values(), key=lambda place: float(np.linalg.norm(place - target.position)))
        away = target.position - nearest
        distance = float(np.linalg.norm(away))
        if distance < rules.flee_radius:
            fled = target.position + rules.flee_speed * dt * away / distance
            target.position = np.clip(fled, -half, half)
            target.heading = math.atan2(away[1], away[0])
            return
    if target.motion != DRIFTING and rules.turn_rate > 0:
        raise ValueError("the reference does not follow random turns")
    x, y = target.position + rules.speed * dt * np.array([math.cos(target.heading), math.sin(target.heading)])
    if abs(x) > curve.half_width:
        x = math.copysign(2 * curve.half_width, x) - x
        target.heading = math.pi - target.heading
    if abs(y) > curve.half_height:
        y = math.copysign(2 * curve.half_height, y) - y
        target.heading = -target.heading
    target.position = np.array([x, y])
