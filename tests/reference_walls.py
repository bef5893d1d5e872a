"""The boundary in the reference world: who is outside, contacts with walls, and robots that are blocked."""

import math

import numpy as np


def leave(world) -> None:
    """Find the robots that are wholly outside, and remove them if the boundary removes robots."""
    half = np.array([world.scenario.curve.half_width, world.scenario.curve.half_height])
    for i, car in enumerate(world.robots):
        nearest = np.clip(car.position[:2], -half, half)
        is_out = math.dist(nearest, car.position[:2]) > world.scenario.robot.radius
        world.outside[i] = is_out and not world.removed(i)
        world.outside_steps += world.outside[i]
        sticks_out = (np.abs(car.position[:2]) + 0.999 * world.scenario.robot.radius > half).any()
        world.partly_outside_steps += bool(sticks_out) and not world.removed(i)
        if world.outside[i] and world.scenario.task.boundary == "remove":
            car.left = True


def watch_walls(world, command: np.ndarray) -> None:
    """Count the contacts with walls, and the steps in which a robot is driven but does not get ahead."""
    half = np.array([world.scenario.curve.half_width, world.scenario.curve.half_height])
    radius, task = world.scenario.robot.radius, world.scenario.task
    for i, car in enumerate(world.robots):
        if world.removed(i):
            continue
        for place in car.way[1:]:
            gap = min(half - np.abs(place[:2])) - radius
            car.touches = car.touches and gap <= 0.05 * radius
            if gap < 0.001 * radius and not car.touches:
                car.touches = True
                world.wall_contacts += 1
        progress = car.driven_from is None or math.dist(car.position[:2], car.driven_from) >= radius
        if progress or not world.works(i):
            car.driven_from, car.driven = car.position[:2].copy(), 0
        elif requested_speed(world.scenario.robot, command[i]) * task.blocked_after >= 2 * radius:
            car.driven += 1
            world.blocked_steps += car.driven * task.step > task.blocked_after + 1e-9


def requested_speed(robot, command: np.ndarray) -> float:
    """Speed that an action requests, linear from rest to the end of either direction [m/s]."""
    share = command[0] if robot.kind == "differential" else command[1]
    if not robot.reverses and robot.kind != "differential":
        share = (share + 1) / 2
    return float(share * (robot.lowest_speed if share < 0 else robot.speed_max))
