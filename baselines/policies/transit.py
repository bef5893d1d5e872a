"""Transits: the ways of a team of cars from where they start into loops that are synchronised, without collisions.

Each car gets a path of bounded curvature (`baselines.policies.dubins`) that enters a loop where this loop's reference
is at that time, and a speed that is a quadratic function of time. The assignment of cars to loops minimises the sum of
the fourth powers of the arrival times. The paths are then selected one car after the other, those that arrive last
first: each enters its loop as early as it can without coming near the cars before it.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.policies.dubins import TURNS, dubins_lengths, dubins_poses, dubins_reach
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory import closed_forms
from lissajous_env.world.robots.facing import start_headings

_PROFILE = np.linspace(0, 1, 21)
_TRIES = 24
"""Orders of the cars that are tried."""
_PER_ROBOT = 60
"""Paths of a car that are tried in an order, the earliest first."""


@dataclass(frozen=True)
class Car:
    """Constants of cars for a transit."""

    turning: float
    """Radius of turns [m]."""
    speed: float
    """Largest speed [m/s]."""
    slowest: float
    """Smallest speed [m/s]."""
    top_speed: float
    """Steady speed at full throttle of the weakest car [m/s]."""
    drag: float
    """Damping of the speed [1/s]."""
    within: tuple[float, float] = (math.inf, math.inf)
    """Half width and half height of the rectangle that the car does not leave [m]."""


def start_is_known(scenario: Scenario) -> bool:
    """Return whether all robots know where all of them start, to within a body's diameter at two deviations."""
    formation = scenario.formation
    farthest = scenario.alpha * float(closed_forms.curve_speed(scenario.driven, np.linspace(0, 2 * np.pi, 4096)).max())
    return formation.start == "equilibrium" and formation.start_noise * farthest <= scenario.robot.radius


def formation_starts(scenario: Scenario, turned: Any = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return poses (..., N, 3), x, y [m] and heading [rad], and speeds (..., N) [m/s] of a start in the equilibrium.

    `turned` (...) are angles by which the whole formation is turned [rad].
    """
    displaced = np.array([dict(scenario.formation.displaced).get(i, 0.0) for i in scenario.ring])
    gamma = scenario.alpha * (scenario.equilibrium + displaced + np.asarray(turned)[..., None])
    velocity = closed_forms.curve_derivatives(scenario.driven, gamma)[0] * scenario.formation.phase_rate
    heading = np.arctan2(velocity[..., 1], velocity[..., 0])
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    pose = np.concatenate([closed_forms.curve_point(scenario.driven, gamma)[..., :2], heading[..., None]], axis=-1)
    pose[..., 2] = start_headings(scenario, pose, speed)
    return pose, speed


def loop_poses(loop: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the poses (N, K, 3), x, y [m] and heading [rad], and speeds (N, K) [m/s] on loops (N, K, 2)."""
    velocity = (np.roll(loop, -1, axis=1) - np.roll(loop, 1, axis=1)) / (2 * step)
    heading = np.arctan2(velocity[..., 1], velocity[..., 0])
    pieces = np.linalg.norm(np.diff(loop, axis=1, append=loop[:, :1]), axis=2)
    return np.concatenate([loop, heading[..., None]], axis=-1), (pieces + np.roll(pieces, 1, axis=1)) / (2 * step)


def transit(
    start: np.ndarray,
    speed: np.ndarray,
    loop: np.ndarray,
    car: Car,
    apart: float,
    step: float,
    longest: int,
    assignments: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the lead-in (N, L, 2) of each robot and the loop that it goes around, by robot; None if there is none.

    Args:
        start: (N, 3) x, y [m] and heading [rad] of the robots at the start.
        speed: (N,) speeds at the start [m/s].
        loop: (N, K, 2) places on the loops at control steps 0, 1 ... of the episode [m].
        car: Constants of the cars.
        apart: Least distance of two robots [m]; less where two start nearer.
        step: Control step [s].
        longest: Longest transit [control steps].
        assignments: (A, N) loops of the robots that may be chosen; all by default.

    Returns:
        (N, L, 2) places at control steps 0 to L - 1 [m], and the loop (N,) of each robot.
    """
    pose, loop_speed = loop_poses(loop, step)
    times = np.arange(2, longest + 1)
    at = times % loop.shape[1]
    entry, entry_speed = pose[:, at], loop_speed[:, at, None]
    arrival = []
    for place, before in zip(start, speed, strict=True):  # one by one: all together need gigabytes for large teams
        _, possible = _drivable(place, before, entry, entry_speed, times, car, step)
        arrival.append(np.where(possible.any(axis=2), times, np.inf).min(axis=1))
    arrival = np.array(arrival)
    if not np.isfinite(arrival).any(axis=1).all():
        return None
    cost = np.where(np.isfinite(arrival), arrival, 100.0 * longest) ** 4
    robots = np.arange(len(start))
    if assignments is None:
        from scipy.optimize import linear_sum_assignment  # slow to import

        chosen = linear_sum_assignment(cost)[1]
    else:
        chosen = assignments[np.argmin(cost[robots, assignments].sum(axis=1))]
    if not np.isfinite(arrival[robots, chosen]).all():
        return None
    ways = [
        _Ways(i, start[i], speed[i], loop[k], entry[[k]], entry_speed[[k]], loop_speed[k], times, car, step)
        for i, k in enumerate(chosen)
    ]
    draw, order = np.random.default_rng(0), np.argsort(-arrival[robots, chosen], kind="stable")
    for _ in range(_TRIES):
        found = _selected([ways[i] for i in order], apart)
        if isinstance(found, dict):
            last = max(way[1] for way in found.values())
            return np.stack([found[int(i)][0][: 2 * last : 2] for i in robots]), chosen
        # The car without a way goes first in the next order.
        rest = [i for i in order if i != found]
        order = np.array([found, *(rest if draw.random() < 0.5 else draw.permutation(rest))], dtype=int)
    return None


def _drivable(
    start: np.ndarray,
    before: float,
    pose: np.ndarray,
    after: np.ndarray,
    times: np.ndarray,
    car: Car,
    step: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pieces (M, T, 6, 3) of a robot's paths into M loops [m], and which of these it can drive (M, T, 6).

    Args:
        start: (3,) pose at the start.
        before: Speed at the start [m/s].
        pose: (M, T, 3) poses on the loops at the times of arrival.
        after: (M, T, 1) speeds there [m/s].
        times: (T,) times of arrival [control step].
        car: Constants of the cars.
        step: Control step [s].
    """
    pieces = dubins_lengths(start, pose, car.turning)
    lengths, duration = pieces.sum(axis=-1), (times * step)[:, None]
    swell = lengths / duration - (before + after) / 2
    possible = np.isfinite(lengths)
    if np.isfinite(car.within).all():
        reach = dubins_reach(start, np.where(possible[..., None], pieces, 0.0), TURNS, np.array(car.turning))
        possible &= (reach <= np.maximum(car.within, np.abs(start[:2])) * (1 + 1e-9)).all(axis=-1)
    for share in _PROFILE:
        speed = before + (after - before) * share + 6 * swell * share * (1 - share)
        gain = (after - before + 6 * swell * (1 - 2 * share)) / duration
        possible &= speed >= np.minimum(car.slowest, 0.9 * np.minimum(before, after)) - 1e-9 * car.speed
        possible &= speed <= np.maximum(car.speed, np.maximum(before, after)) * (1 + 1e-9)
        possible &= (gain <= car.drag * (car.top_speed - speed)) & (gain >= -0.85 * car.drag * speed)
    return pieces, possible


class _Ways:
    """The drivable ways of a robot into its loop, the earliest first."""

    def __init__(self, robot, start, speed, loop, entry, entry_speed, loop_speed, times, car, step):
        self.robot, self.car, self.step = robot, car, step
        self.start, self.speed, self.loop, self.loop_speed, self.times = start, speed, loop, loop_speed, times
        (self.pieces,), (possible,) = _drivable(start, speed, entry, entry_speed, times, car, step)
        which = np.argwhere(possible)
        lengths = self.pieces.sum(axis=-1)[which[:, 0], which[:, 1]]
        self.which = which[np.lexsort((lengths, which[:, 0]))][:_PER_ROBOT]

    def places(self, k: int, halves: int) -> tuple[np.ndarray, int]:
        """Return the places (halves, 2) at every half control step of way k [m], and its arrival [control step]."""
        row, word = self.which[k]
        arrives = int(self.times[row])
        duration, count = arrives * self.step, len(self.loop)
        pieces = self.pieces[row, word]
        after = self.loop_speed[arrives % count]
        swell = pieces.sum() / duration - (self.speed + after) / 2
        share = np.arange(2 * arrives) / (2 * arrives)
        along = duration * (
            self.speed * share + (after - self.speed) * share**2 / 2 + swell * share**2 * (3 - 2 * share)
        )
        lead = dubins_poses(self.start, pieces, TURNS[word], np.array(self.car.turning), along)[:, :2]
        onward = np.arange(2 * arrives, max(halves, 2 * arrives))
        ends = self.loop[onward // 2 % count], self.loop[(onward + 1) // 2 % count]
        return np.concatenate([lead, (ends[0] + ends[1]) / 2]), arrives


def _selected(ways: list[_Ways], apart: float) -> dict[int, tuple[np.ndarray, int]] | int:
    """Return the places and the arrival of each robot, selected in an order, or the robot that has no way."""
    halves = 2 * int(ways[0].times[-1]) + 2 * len(ways[0].loop)
    found: dict[int, tuple[np.ndarray, int]] = {}
    for way in ways:
        for k in range(len(way.which)):
            places, arrives = way.places(k, halves)
            clear = True
            for other, _ in found.values():
                distance = np.linalg.norm(places - other, axis=1)
                if (distance < min(apart, 0.999 * distance[0])).any():
                    clear = False
                    break
            if clear:
                found[way.robot] = places, arrives
                break
        else:
            return way.robot
    return found
