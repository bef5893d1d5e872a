"""Collisions that a start makes unavoidable: cars that are too close, and too fast, to turn away from each other.

The starts are drawn as `lissajous_env.world.robots.placing` draws them, with random numbers of their own.
"""

import itertools
from functools import lru_cache

import numpy as np

from lissajous_env.settings.parts import Curve, Formation, Robot
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

    Args:
        curve: The curve on which the cars start.
        formation: The formation, with all derived fields filled in.
        robot: The cars, with all derived fields filled in.
        phases: Phases of the equilibrium (2) of the N cars [rad].
        top_speeds: Top speeds of the N cars [m/s].
    """
    is_random = formation.start != "equilibrium" or formation.start_noise > 0
    count = min(max(_PAIRS // len(phases) ** 2, 1), STARTS) if is_random else 1
    speeds = np.array(top_speeds)
    worlds = inseparable(_drawn(curve, formation, robot, np.array(phases), speeds, count), robot, speeds)
    return len(np.unique(worlds)) / count, len(worlds) / count


def inseparable(states: np.ndarray, robot: Robot, top_speeds: np.ndarray) -> np.ndarray:
    """Return the start, from 0 to W - 1, of each pair of cars that no policy can separate.

    Such bodies overlap at the start, or collide although each car steers as far as it can to either side or goes
    straight on, with its motor off or at full throttle.

    Args:
        states: (W, N, 4) x, y [m], heading [rad] and speed [m/s] of the cars at W starts.
        robot: The cars.
        top_speeds: (N,) top speeds of the cars [m/s].
    """
    touch, turning = 2 * robot.radius, geometry.turning_radius(robot.wheelbase, robot.steering_max)
    aside = turning * np.arccos(1 - min(touch / turning, 2.0))
    one, other = np.triu_indices(states.shape[1], 1)
    # Others are so far apart that one of the cars turns out of the way first.
    distance = np.linalg.norm(states[:, one, :2] - states[:, other, :2], axis=-1)
    worlds, pairs = np.nonzero(distance < touch + 2 * aside)
    ends = [(states[worlds, side[pairs]], top_speeds[side[pairs]]) for side in (one, other)]
    longest = np.pi * turning / np.maximum(np.maximum(ends[0][0][:, 3], ends[1][0][:, 3]), 1e-300)
    times = np.minimum(longest, 4 / robot.drag)[:, None] * np.linspace(0, 1, _TIMES)
    left = np.arange(len(worlds))
    ways = [(side / turning, full) for side in (0, -1, 1) for full in (True, False)]
    for pair_of_ways in itertools.product(ways, ways):
        paths = [
            _path(state[left], top[left], times[left], *way, robot.drag)
            for (state, top), way in zip(ends, pair_of_ways, strict=True)
        ]
        left = left[np.linalg.norm(paths[0] - paths[1], axis=-1).min(axis=1) < _TOUCH * touch]
    return worlds[left]


def _drawn(
    curve: Curve, formation: Formation, robot: Robot, phases: np.ndarray, top_speeds: np.ndarray, count: int
) -> np.ndarray:
    """Return x, y [m], heading [rad] and speed [m/s] of the cars at the start of some episodes, (count, N, 4)."""
    random, n = np.random.default_rng(0), len(phases)
    turn = 2 * np.pi * random.random((count, 1)) if formation.start == "rotated" else np.zeros((count, 1))
    places = phases + turn
    for i, angle in formation.displaced:
        places[:, i] += angle

    def draw(i: int, which: np.ndarray) -> np.ndarray:
        """Return states (K, 4) of car i in the starts of a mask, at most at the formation's and at its own speed."""
        phase = 2 * np.pi * random.random(which.sum()) if formation.start == "random" else places[which, i]
        phase = phase + formation.start_noise * random.standard_normal(which.sum())
        gamma = (formation.alpha or 1) * phase
        velocity = closed_forms.curve_derivatives(curve, gamma)[0] * formation.phase_rate
        heading, speed = np.arctan2(velocity[:, 1], velocity[:, 0]), np.hypot(*velocity.T)
        return np.column_stack([closed_forms.curve_point(curve, gamma), heading, np.minimum(speed, top_speeds[i])])

    states = np.stack([draw(i, np.ones(count, bool)) for i in range(n)], axis=1)
    for i in range(1, n) if formation.start_headway > 0 else ():
        for _ in range(_DRAWS - 1):
            straight = _least_straight(states[:, i : i + 1], states[:, :i], formation.start_headway)
            colliding = np.asarray(np.any(straight < 2 * robot.radius, axis=1))
            if not colliding.any():
                break
            states[colliding, i] = draw(i, colliding)
    return states


def _least_straight(one: np.ndarray, other: np.ndarray, time: float) -> np.ndarray:
    """Return the smallest distance of cars that go straight on for a time [s]."""

    def velocity(states: np.ndarray) -> np.ndarray:
        return states[..., 3:] * np.stack([np.cos(states[..., 2]), np.sin(states[..., 2])], axis=-1)

    apart, parting = one[..., :2] - other[..., :2], velocity(one) - velocity(other)
    when = np.clip(-(apart * parting).sum(-1) / np.maximum((parting**2).sum(-1), 1e-300), 0, time)
    return np.linalg.norm(apart + when[..., None] * parting, axis=-1)


def _path(states: np.ndarray, top: np.ndarray, times: np.ndarray, bend: float, full: bool, drag: float) -> np.ndarray:
    """Return positions (K, T, 2) [m] of cars on arcs of a curvature [1/m] by (12): the speed relaxes at rate `drag`."""
    x, y, heading, speed = states.T[..., None]
    steady = top[:, None] * full
    along = steady * times + (speed - steady) * (1 - np.exp(-drag * times)) / drag
    half = 0.5 * bend * along
    chord = along * np.sinc(half / np.pi)
    return np.stack([x + chord * np.cos(heading + half), y + chord * np.sin(heading + half)], axis=-1)
