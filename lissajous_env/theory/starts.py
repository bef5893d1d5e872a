"""Collisions that a start makes unavoidable: cars that are too close, and too fast, to turn away from each other.

The starts are drawn as `lissajous_env.world.robots.placing` draws them, with random numbers of their own.
"""

import itertools
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from lissajous_env.settings.parts import Curve, Formation
from lissajous_env.settings.robot import Robot
from lissajous_env.theory import closed_forms, geometry

STARTS = 64
"""Starts of episodes that are drawn, fewer of large teams."""
_PAIRS = 2_000_000
"""Limit on the pairs of robots of all starts."""
_DRAWS = 100
"""Displacements of a robot that are drawn at most, as at a reset."""
_TIMES = 48
"""Times at which the distance of two cars is computed."""
_TOUCH = 0.99
"""Share of the sum of two radii below which a distance counts as a collision here, to allow for rounding."""


@lru_cache(maxsize=256)
def unavoidable(
    curve: Curve, formation: Formation, robot: Robot, phases: tuple[float, ...], top_speeds: tuple[float, ...]
) -> tuple[float, float]:
    """Return the share of episodes that start with a pair of cars that no policy can separate, and such pairs in one.

    A pair counts if its bodies overlap at the start, or if they collide although each car steers as far as it can to
    either side or goes straight on, with its motor off or at full throttle.

    Args:
        curve: The curve on which the cars start.
        formation: The formation, with all derived fields filled in.
        robot: The cars, with all derived fields filled in.
        phases: Phases of the equilibrium (2) of the N cars [rad].
        top_speeds: Top speeds of the N cars [m/s].
    """
    n = len(phases)
    is_random = formation.start != "equilibrium" or formation.start_noise > 0
    count = min(max(_PAIRS // n**2, 1), STARTS) if is_random else 1
    states = _drawn(curve, formation, robot, phases, np.array(top_speeds), count)
    one, other = np.triu_indices(n, 1)
    worlds, pairs = _are_near(states, one, other, robot)
    first, second = states[worlds, one[pairs]], states[worlds, other[pairs]]
    collide = _collide_anyway(first, second, robot, np.array(top_speeds)[np.stack([one, other])[:, pairs]])
    worlds = worlds[collide]
    return len(np.unique(worlds)) / count, len(worlds) / count


def _drawn(
    curve: Curve, formation: Formation, robot: Robot, phases: Sequence[float], top_speeds: np.ndarray, count: int
) -> np.ndarray:
    """Return x, y [m], heading [rad] and speed [m/s] of the cars at the start of some episodes, (count, N, 4)."""
    random, n = np.random.default_rng(0), len(phases)
    turn = 2 * np.pi * random.random((count, 1)) if formation.start == "rotated" else np.zeros((count, 1))
    places = np.array(phases) + turn
    for i, angle in formation.displaced:
        places[:, i] += angle

    def draw(i: int, which: np.ndarray) -> np.ndarray:
        phase = 2 * np.pi * random.random(which.sum()) if formation.start == "random" else places[which, i]
        return _states(
            curve, formation, phase + formation.start_noise * random.standard_normal(which.sum()), top_speeds[i]
        )

    states = np.stack([draw(i, np.ones(count, bool)) for i in range(n)], axis=1)
    for i in range(1, n) if formation.start_headway > 0 else ():
        for _ in range(_DRAWS - 1):
            straight = _least_straight(states[:, i : i + 1], states[:, :i], formation.start_headway)
            colliding = np.asarray(np.any(straight < 2 * robot.radius, axis=1))
            if not colliding.any():
                break
            states[colliding, i] = draw(i, colliding)
    return states


def _states(curve: Curve, formation: Formation, phase: np.ndarray, top_speed: float) -> np.ndarray:
    """Return the states (K, 4) of a car at phases (K,), at most at the formation's speed and at its top speed."""
    gamma = (formation.alpha or 1) * phase
    velocity = closed_forms.curve_derivatives(curve, gamma)[0] * formation.phase_rate
    heading, speed = np.arctan2(velocity[:, 1], velocity[:, 0]), np.hypot(*velocity.T)
    return np.column_stack([closed_forms.curve_point(curve, gamma), heading, np.minimum(speed, top_speed)])


def _velocity(states: np.ndarray) -> np.ndarray:
    return states[..., 3:] * np.stack([np.cos(states[..., 2]), np.sin(states[..., 2])], axis=-1)


def _least_straight(one: np.ndarray, other: np.ndarray, time: float) -> np.ndarray:
    """Return the smallest distance of cars that go straight on for a time [s]."""
    apart, parting = one[..., :2] - other[..., :2], _velocity(one) - _velocity(other)
    square = np.maximum((parting**2).sum(-1), 1e-300)
    when = np.clip(-(apart * parting).sum(-1) / square, 0, time)
    return np.linalg.norm(apart + when[..., None] * parting, axis=-1)


def _are_near(states: np.ndarray, one: np.ndarray, other: np.ndarray, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Return start and number of the pairs that could collide before one of the cars has turned out of the way."""
    turning = geometry.turning_radius(robot.wheelbase, robot.steering_max)
    aside = turning * np.arccos(1 - min(2 * robot.radius / turning, 2.0))
    apart = states[:, one, :2] - states[:, other, :2]
    worlds, pairs = np.nonzero((apart**2).sum(-1) < (2 * robot.radius + 2 * aside) ** 2)
    return worlds, pairs


def _collide_anyway(one: np.ndarray, other: np.ndarray, robot: Robot, top_speeds: np.ndarray) -> np.ndarray:
    """Return whether pairs (K,) of cars collide with each combination of steering and throttle that is tried."""
    turning = geometry.turning_radius(robot.wheelbase, robot.steering_max)
    longest = np.pi * turning / np.maximum(np.maximum(one[:, 3], other[:, 3]), 1e-300)
    times = np.minimum(longest, 4 / robot.drag)[:, None] * np.linspace(0, 1, _TIMES)
    collide = np.ones(len(one), bool)
    ways = [(side / turning, full) for side in (0, -1, 1) for full in (True, False)]
    for first, second in itertools.product(ways, ways):
        left = np.flatnonzero(collide)
        paths = [
            _path(states[left], top[left], times[left], *way, robot.drag)
            for states, top, way in zip((one, other), top_speeds, (first, second), strict=True)
        ]
        distance = np.linalg.norm(paths[0] - paths[1], axis=-1).min(axis=1)
        collide[left] = distance < _TOUCH * 2 * robot.radius
    return collide


def _path(states: np.ndarray, top: np.ndarray, times: np.ndarray, bend: float, full: bool, drag: float) -> np.ndarray:
    """Return positions (K, T, 2) [m] of cars on arcs of a curvature [1/m] by (12): the speed relaxes at rate `drag`."""
    x, y, heading, speed = states.T[..., None]
    steady = top[:, None] * full
    along = steady * times + (speed - steady) * (1 - np.exp(-drag * times)) / drag
    half = 0.5 * bend * along
    chord = along * np.sinc(half / np.pi)
    return np.stack([x + chord * np.cos(heading + half), y + chord * np.sin(heading + half)], axis=-1)
