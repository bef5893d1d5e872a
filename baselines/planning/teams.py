"""Teams on periodic paths: the limits of their cars, and what a simulation of many teams at once scores them by."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baselines.planning.plans import SETTLED
from baselines.planning.playing import coarse_grid
from baselines.policies.partition import FilteredPaths
from baselines.policies.partition_plan import PartitionParameters, required_distance, turning_radius_of
from baselines.policies.path_tables import path_tables
from baselines.policies.periodic_paths import arrival_steps, derivative_of, places_of
from baselines.policies.transit import start_is_known
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.simulation import Simulation

_FASTEST = 0.9
"""Largest speed on a path, over the top speed of the weakest car."""
_CLEARANCE = 0.2
"""Least distance of two bodies, over the radius of one."""
_ROUNDS = 2
"""Periods that count, at the end of a simulation."""


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
        top = min(task.robot.top_speed, task.robot.steady_speed(task.robot.drive * float(task.drive_factors.min())))
        return cls(_FASTEST * top, turning_radius_of(task), required_distance(task, room), half, task.task.step)


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


class Scores(NamedTuple):
    """Scores (P,) of P teams."""

    worst: np.ndarray
    """Worst-case undetected time [s]."""
    mean: np.ndarray
    """Mean of the undetected time over time [s], by which teams of the same worst case differ."""
    collisions: np.ndarray
    """Collisions."""


class Teams:
    """Simulates teams on periodic paths of one period on a coarse grid, each in a world of its own.

    The cars drive from the start of the task to their paths at once, under the collision filter if they do not know
    where the others start. If no robots of the task fail, the episodes end some periods after the arrival.

    Args:
        task: The task, of cars.
        period: Period of the paths [control step].
        worlds: P.
        goal: `plans.WHOLE` or `plans.SETTLED`.
    """

    def __init__(self, task: Scenario, period: int, worlds: int, goal: str = SETTLED):
        self.task = named.build(task, **{"task.contamination": coarse_grid(task), "task.grid": (1, 1)})
        self.simulation = Simulation(self.task, worlds)
        self.period, self.goal = period, goal

    def scores(self, loop: np.ndarray, seed: int = 0) -> Scores:
        """Return the scores of loops (P, N, K, 2) [m] in the episode of a seed."""
        task, simulation = self.task, self.simulation
        arrived, knows = arrival_steps(task, loop), start_is_known(task)
        tables, until = path_tables(task, loop), 0.0 if knows else float(arrived)
        policy = FilteredPaths(task, len(loop), tables=tables, filtered_until=until)
        fails = task.faults.schedule or task.faults.removed or task.faults.rate or task.faults.lost
        steps = task.task.steps if fails else min(task.task.steps, arrived + _ROUNDS * self.period)
        simulation.reset(seeds=[seed] * simulation.num_worlds)
        found = []
        for _ in range(steps):
            simulation.step(policy.act(simulation.observation))
            found.append(simulation.contamination.age.numpy().copy())
        ages = np.array(found) * task.task.step
        if self.goal == SETTLED:
            ages = ages[steps // 2 :] if fails else ages[-_ROUNDS * self.period :]
        return Scores(ages.max(axis=0), ages.mean(axis=0), simulation.tally.collisions.numpy().astype(float))
