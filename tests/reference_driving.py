"""Actions that the simulation and its reference are driven with."""

import math

import numpy as np
from reference_motion import curve_point


def smooth_actions(shape: tuple[int, int], steps: int, seed: int) -> np.ndarray:
    """(steps, *shape) actions that change smoothly: three sines of random rates for each, mostly in [-1, 1]."""
    draw = np.random.default_rng(seed)
    rates, turns = draw.uniform(0.02, 0.3, (2, 3, *shape)) * np.array([1, 20])[:, None, None, None]
    times = np.arange(steps)[:, None, None, None]
    waves = np.sin(rates * times + turns).sum(axis=1) / 2
    return waves.astype(np.float32)


def pursuit(world) -> np.ndarray:
    """(N, 2) actions that drive each car towards the point of the curve 0.4 m ahead of it, at 1 m/s.

    `world` is a `reference.World`. Keeps cars near the curve, where the point of the curve that is nearest to a car is
    well defined.
    """
    robot, rows = world.scenario.robot, []
    for car in world.robots:
        gamma = world.alpha * car.phase
        aim = curve_point(world.scenario.curve, gamma)[:2]
        while np.linalg.norm(aim - car.position[:2]) < 0.4:
            gamma += 0.01
            aim = curve_point(world.scenario.curve, gamma)[:2]
        way = aim - car.position[:2]
        angle = math.atan2(way[1], way[0]) - car.heading
        steering = math.atan2(2 * robot.wheelbase * math.sin(angle), float(np.linalg.norm(way)))
        throttle = (robot.drag + robot.offset) / robot.drive + 0.03 * (1.0 - car.speed)
        span = robot.throttle_max - robot.throttle_min
        rows.append([steering / robot.steering_max, 2 * (throttle - robot.throttle_min) / span - 1])
    return np.array(rows)
