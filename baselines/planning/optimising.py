"""Free-form periodic paths: Fourier coefficients of every robot's path, improved by CMA-ES from the best plans.

A population of teams is simulated together, each in a world of its own, on a coarse grid. Their cars begin on their
paths. What is minimised is the worst-case undetected time of some periods, with a part of its mean over time, by which
teams of the same worst case differ, and penalties for paths that the cars cannot drive: above the top speed, tighter
than their turns, too near to each other, or outside of the rectangle.

N. Hansen, A. Ostermeier, "Completely derandomized self-adaptation in evolution strategies", Evolutionary Computation 9
(2001).
"""

import importlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.planning.families.lissajous import on_ellipse
from baselines.planning.plans import Plan
from baselines.planning.playing import coarse_grid
from baselines.policies.partition_plan import PartitionParameters, required_distance, turning_radius_of
from baselines.policies.path_tables import FINE, path_tables
from baselines.policies.periodic_paths import coefficients_of, derivative_of, places_of
from baselines.policies.settings import PolicySettings
from baselines.policies.timed_paths import TimedPaths
from lissajous_env.extras import missing
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.simulation import Simulation

NAME = "free paths"
_HARMONICS = 2
_FASTEST = 0.9
"""Largest speed on a path, over the top speed."""
_CLEARANCE = 0.2
"""Least distance of two bodies, over the radius of one."""
_PERIODS = (0.75, 0.875, 1.0)
"""Periods that are tried, over that of the plan from which the search begins."""
_ROUNDS = 3
"""Periods of a simulation, after `_SETTLING` control steps."""
_SETTLING = 20
_MEAN = 0.5
"""Weight of the mean over time of the undetected time, against its largest value."""
_PENALTY = 20.0
"""Weight of the relative violation of a limit, in the time in which a car at top speed crosses its sensing disc."""
_SIGMA = 0.02
"""Standard deviation of the first changes, in the smaller half side of the rectangle."""
_TOLERANCE = 0.01
"""Largest relative violation of a team that becomes a plan: the limits of the cars have a reserve."""
_STARTS = 1.0, 1.2, 0.8
"""Speeds of a start on an ellipse where it is fastest, over the largest speed on the paths."""
_WIDER = 1.03
"""Size of the first paths, over that of the plan: those of a partition often turn as tightly as cars can."""
_WORLDS = 24
_BEST = 3
"""Teams of a search that become plans."""


@dataclass(frozen=True)
class Limits:
    """Limits of the paths of cars."""

    speed: float
    """Largest speed [m/s]."""
    turning: float
    """Radius of the tightest turn [m]."""
    apart: float
    """Least distance of two robots [m]."""
    half: tuple[float, float]
    """Half width and half height of the rectangle [m]."""
    step: float
    """Control step [s]."""

    @classmethod
    def of(cls, task: Scenario) -> "Limits":
        """Return the limits of the cars of a task."""
        room = PartitionParameters(clearance=_CLEARANCE * task.robot.radius)
        half = task.curve.half_width, task.curve.half_height
        speed = _FASTEST * task.robot.top_speed
        return cls(speed, turning_radius_of(task), required_distance(task, room), half, task.task.step)


def violation(paths: np.ndarray, period: int, limits: Limits) -> np.ndarray:
    """Return the sum (P,) of the relative violations of the limits by paths (P, N, 2 + 4 K); 0 if all are met.

    Args:
        paths: Fourier coefficients [m].
        period: Period [control step].
        limits: The limits.
    """
    # Half way between two control steps too: two fast cars pass each other within one.
    places = places_of(paths, 2 * period)
    velocity = places_of(derivative_of(paths, period * limits.step), 2 * period)
    change = places_of(derivative_of(derivative_of(paths, period * limits.step), period * limits.step), 2 * period)
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    cross = velocity[..., 0] * change[..., 1] - velocity[..., 1] * change[..., 0]
    curvature = np.abs(cross) / np.maximum(speed, 1e-3 * limits.speed) ** 3
    too_fast = np.maximum(speed / limits.speed - 1, 0).max(axis=(1, 2))
    too_tight = np.minimum(np.maximum(curvature * limits.turning - 1, 0), 3).max(axis=(1, 2))
    outside = np.maximum(np.abs(places) / np.array(limits.half) - 1, 0).max(axis=(1, 2, 3))
    first, second = np.triu_indices(paths.shape[1], 1)
    distance = np.linalg.norm(places[:, first] - places[:, second], axis=-1).min(axis=(1, 2), initial=np.inf)
    return too_fast + too_tight + outside + np.maximum(1 - distance / limits.apart, 0)


class Teams:
    """Simulates teams on periodic paths of one period, each in a world of its own."""

    def __init__(self, task: Scenario, period: int, worlds: int, seed: int = 0):
        steps = _SETTLING + _ROUNDS * period
        changed = {"task.contamination": coarse_grid(task), "task.grid": (1, 1)}
        self.task = named.build(task, **changed, **{"task.duration": (steps + 2) * task.task.step})
        self.simulation = Simulation(self.task, worlds)
        self.period, self.steps, self.seeds = period, steps, [seed] * worlds

    def scores(self, loop: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the worst-case undetected time (P,) and its mean over time (P,) [s] of loops (P, N, K, 2)."""
        tables = path_tables(self.task, loop)
        policy = TimedPaths(self.task, len(loop), tables=tables)
        simulation = self.simulation
        simulation.reset(seeds=self.seeds)
        _place(simulation, tables.pose[:, :, -FINE])  # where they are to be a control step before the first
        simulation.step(np.zeros(simulation.action_shape, dtype=np.float32))
        ages = []
        for _ in range(self.steps):
            simulation.step(policy.act(simulation.observation))
            ages.append(simulation.contamination.age.numpy().copy())
        found = np.array(ages) * self.task.task.step
        return found.max(axis=0), found[-2 * self.period :].mean(axis=0)


def _place(simulation: Simulation, pose: np.ndarray) -> None:
    """Put cars at poses (W, N, 4): x, y [m], heading [rad], speed [m/s]."""
    position = np.zeros((*pose.shape[:2], 3), dtype=np.float32)
    position[..., :2] = pose[..., :2]
    simulation.robots.position.assign(position)
    simulation.robots.heading.assign(pose[..., 2].astype(np.float32))
    simulation.robots.speed.assign(pose[..., 3].astype(np.float32))


def optimise(
    task: Scenario,
    starts: Sequence[Plan],
    seconds: float,
    stopped: Callable[[], bool] = lambda: False,
    seed: int = 0,
) -> list[Plan]:
    """Return plans of free-form paths that are better than those of the given plans, by the settled worst case.

    Args:
        task: The task, of cars.
        starts: Plans of timed paths, from which the search begins.
        seconds: Duration of the search [s].
        stopped: Returns whether to stop.
        seed: Seed of the search.

    Raises:
        MissingExtraError: the library `cma` is not installed.
    """
    loops = [loop for plan in starts if (loop := loop_of(plan)) is not None]
    begun = [(loop, share) for share in _PERIODS for loop in loops]
    begin, found = time.monotonic(), []
    for k, (loop, share) in enumerate(begun):
        period = max(round(loop.shape[1] * share), 4)
        until = begin + seconds * (k + 1) / len(begun)
        found += _improved(task, loop, period, until, stopped, seed)
    found.sort(key=lambda each: each[0])
    return [_plan(task, paths, period) for _, paths, period in found[:_BEST]]


def loop_of(plan: Plan) -> np.ndarray | None:
    """Return the loops (N, K, 2) of a plan of timed paths [m]; None for another plan."""
    policy = plan.settings.make(plan.scenario)
    if not isinstance(policy, TimedPaths):
        return None
    tables = policy.tables
    return tables.pose[0, :, FINE * tables.lead_in :: FINE, :2]


def require_cma() -> Any:
    """Return the library for CMA-ES.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        return importlib.import_module("cma")
    except ImportError as error:
        raise missing("free-form paths (--optimise)", "plan", error) from None


def _improved(
    task: Scenario, loop: np.ndarray, period: int, until: float, stopped: Callable[[], bool], seed: int
) -> list[tuple[float, np.ndarray, int]]:
    """Return the best teams of one search, each with its score."""
    cma = require_cma()
    limits, teams = Limits.of(task), Teams(task, period, _WORLDS, seed)
    start = coefficients_of(loop, _HARMONICS)
    start[:, 2:] *= _WIDER
    weight = _PENALTY * task.sensing_radius / task.robot.top_speed
    options = {"popsize": _WORLDS, "seed": seed + 1, "verbose": -9}
    search = cma.CMAEvolutionStrategy(start.ravel(), _SIGMA * min(limits.half), options)
    found: list[tuple[float, np.ndarray, int]] = []
    while time.monotonic() < until and not stopped() and not search.stop():
        asked = search.ask()
        paths = np.array(asked).reshape(_WORLDS, *start.shape)
        places = places_of(paths, period)
        broken = violation(paths, period, limits)
        worst, mean = teams.scores(places)
        values = worst + _MEAN * mean + weight * broken
        search.tell(asked, values.tolist())
        kept = np.flatnonzero(broken < _TOLERANCE)
        found += [(float(worst[k] + _MEAN * mean[k]), paths[k], period) for k in kept]
        found = sorted(found, key=lambda each: each[0])[:_BEST]
    return found


def _plan(task: Scenario, paths: np.ndarray, period: int) -> Plan:
    """Return the plan of some paths, with a start from which the cars can drive into them without collisions."""
    rows = [[float(f"{number:.5g}") for number in row] for row in paths]
    settings = PolicySettings("periodic-paths", {"period": period, "paths": rows})
    about = f"period {period * task.task.step:.3g} s, {_HARMONICS} harmonics"
    moved = np.linalg.norm(np.diff(places_of(paths, period), axis=1), axis=2).max()
    fastest = [min(share * float(moved) / task.task.step, task.robot.top_speed) for share in _STARTS]
    for made in (task, *(on_ellipse(task, speed) for speed in fastest)):
        if settings.make(made).communicates == "nothing":  # no collision filter is needed on the way
            return Plan(NAME, made, settings, about)
    return Plan(NAME, task, settings, about)
