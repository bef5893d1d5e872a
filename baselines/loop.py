"""The loop that a patrol goes around, with corners that a car can drive."""

import math

import numpy as np

from lissajous_env import theory
from lissajous_env.scenario import Scenario

_CRUISE = 0.85
"""Share of the limit at which a patrol goes, so that a car which fell behind can catch up."""
_ROOM = 1.15
"""Corners are wider than a car's tightest turn by this factor."""


def cruising_speed(scenario: Scenario) -> float:
    """Speed of a patrol [m/s]: below the cars' top speed, and below the formation's where the curve is fastest."""
    lap = np.linspace(0, 2 * math.pi, 4096)
    formation = scenario.formation.phase_rate * theory.curve_speed(scenario.curve, lap).max()
    return _CRUISE * min(scenario.robot.speed_max, formation)


def corner_radius(scenario: Scenario) -> float:
    """Radius of the loop's corners [m]: what steering and, at cruising speed, grip allow, with some room."""
    robot = scenario.robot
    by_steering = robot.wheelbase / math.tan(robot.steering_max)
    by_grip = cruising_speed(scenario) ** 2 / robot.lateral_acceleration_max
    return _ROOM * max(by_steering, by_grip)


def patrol_loop(scenario: Scenario, points: int = 2048) -> np.ndarray:
    """(points, 2) evenly spaced points of the loop [m], counter-clockwise.

    Around the rectangle, so far inside that a disc still reaches the boundary, where targets enter at the boundary or
    a disc on that way reaches the middle; else up and down in lanes two sensing radii apart and back along one side.
    """
    curve, radius = scenario.curve, scenario.sensing_radius
    A, B = curve.half_width, curve.half_height
    corner = corner_radius(scenario)
    inset = max(min(0.7 * radius, B - corner, A - corner), 0.0)
    if scenario.targets.entry == "boundary" or B - inset <= radius:
        corners = [(-A + inset, -B + inset), (A - inset, -B + inset), (A - inset, B - inset), (-A + inset, B - inset)]
    else:
        # An even number of lanes ends on the side where it began; the way back runs beside their turns.
        lanes = 2 * math.ceil((B - inset) / (2 * radius) + 0.5)
        near, far = -A + inset + 2 * corner, A - inset
        corners = [(-A + inset, B - inset), (-A + inset, -B + inset)]
        for k, y in enumerate(np.linspace(-B + inset, B - inset, lanes)):
            corners += [(near, y), (far, y)] if k % 2 == 0 else [(far, y), (near, y)]
        del corners[2]  # the first lane goes straight on from the way back
        corners.pop()  # and the last one into it
    return _resampled(_rounded(np.array(corners), corner), points)


def _rounded(corners: np.ndarray, radius: float) -> np.ndarray:
    """Replace each corner by an arc, as wide as `radius` or as half of its shorter side allows."""
    path = []
    for before, at, after in zip(np.roll(corners, 1, axis=0), corners, np.roll(corners, -1, axis=0), strict=True):
        to_before, to_after = before - at, after - at
        sides = np.linalg.norm(to_before), np.linalg.norm(to_after)
        u, v = to_before / sides[0], to_after / sides[1]
        half = math.acos(np.clip(u @ v, -1, 1)) / 2
        cut = min(radius / math.tan(half), min(sides) / 2)
        centre = at + (u + v) / np.linalg.norm(u + v) * (cut / math.cos(half))
        start, stop = at + cut * u - centre, at + cut * v - centre
        turn = math.atan2(start[0] * stop[1] - start[1] * stop[0], start @ stop)
        for t in np.linspace(0, turn, 16):
            path.append(centre + math.cos(t) * start + math.sin(t) * np.array([-start[1], start[0]]))
    return np.array(path)


def _resampled(corners: np.ndarray, points: int) -> np.ndarray:
    closed = np.vstack([corners, corners[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], points, endpoint=False)
    return np.column_stack([np.interp(at, along, closed[:, 0]), np.interp(at, along, closed[:, 1])])
