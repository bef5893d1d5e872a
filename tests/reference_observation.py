"""Observations of the reference robots in float64, written from the table and not from the kernel."""

import functools
import math

import numpy as np
from reference_motion import curve_tangent


def rows(world) -> np.ndarray:
    """(N, D) rows of a `reference.World`, as the table in `lissajous_env.world.observation`."""
    unit = _speed_unit(world.scenario)
    return np.array([_row(world, i, unit) for i in range(world.n)])


@functools.cache
def _speed_unit(scenario) -> float:
    robot, curve = scenario.robot, scenario.curve
    if robot.kind == "car":
        return (robot.drive * robot.throttle_max - robot.offset) / robot.drag
    if robot.kind == "differential":
        return robot.speed_max
    speeds = [float(np.linalg.norm(curve_tangent(curve, gamma))) for gamma in np.linspace(0, 2 * math.pi, 20001)]
    return max(speeds) * scenario.formation.phase_rate


def _row(world, i: int, unit: float) -> list[float]:
    scenario, own = world.scenario, world.robots[i]
    width, height = scenario.curve.half_width, scenario.curve.half_height
    sensing = scenario.sensing

    def far(value):
        return min(max(value, -4.0), 4.0)

    row = [far(own.position[0] / width), far(own.position[1] / height)]
    row += [math.cos(own.heading), math.sin(own.heading), far(own.speed / unit)]
    row += [math.cos(own.phase), math.sin(own.phase), float(world.works(i))]
    for heard in world.heard[i]:
        if heard is None or world.removed(i):
            row += [0.0] * 6
            continue
        at, (phase, x, y, _) = heard
        row += [1.0, min((world.now - at) * world.dt, 1.0)]
        row += [math.cos(phase - own.phase), math.sin(phase - own.phase)]
        row += [far((x - own.position[0]) / (2 * width)), far((y - own.position[1]) / (2 * height))]
    robots, targets = [], []
    if world.works(i):
        robots = [r for j, r in enumerate(world.robots) if j != i and not world.removed(j)]
        targets = [t for t in world.targets if t.in_sight]
    row += _nearest(own, robots, sensing.robots_seen, sensing.radius, unit)
    row += _nearest(own, targets, sensing.targets_seen, sensing.radius, None)
    for heard in world.heard[i]:
        is_there = heard is not None and not world.removed(i)
        row += heard[1][3] if is_there else [0.0] * scenario.messages.size
    return row


def _nearest(own, others: list, room: int, radius: float, unit: float | None) -> list[float]:
    width = 3 if unit is None else 5
    offsets = [(other.position[:2] - own.position[:2], other) for other in others]
    near = sorted((pair for pair in offsets if np.linalg.norm(pair[0]) < radius), key=lambda p: np.linalg.norm(p[0]))
    row: list[float] = []
    for offset, other in near[:room]:
        row += [1.0, *(offset / radius)]
        if unit is not None:
            relative = (_velocity(other) - _velocity(own)) / (2 * unit)
            row += list(np.clip(relative, -1, 1))
    return row + [0.0] * (width * room - len(row))


def _velocity(robot) -> np.ndarray:
    return robot.speed * np.array([math.cos(robot.heading), math.sin(robot.heading)])
