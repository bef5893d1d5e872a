"""Teams on periodic paths: the limits of their cars, and what a simulation of many teams at once scores them by."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baselines.planning.playing import coarse_grid
from baselines.policies.partition import FilteredPaths, start_is_known
from baselines.policies.partition_plan import PartitionParameters, required_distance, turning_radius_of
from baselines.policies.path_tables import FINE, path_tables
from baselines.policies.periodic_paths import derivative_of, filtered_steps, lead_in_of, places_of
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.simulation import Simulation

WHOLE, SETTLED = "whole", "settled"
"""Goals: the worst case of whole episodes, and that of their second halves, when all robots are in their places."""
_FASTEST = 0.9
"""Largest speed on a path, over the top speed of the weakest car."""
_CLEARANCE = 0.2
"""Least distance of two bodies, over the radius of one."""
_TRIES = 2
"""Orders of the robots in which ways from the start are sought."""
_ROUNDS = 2
"""Periods that count, at the end of a simulation."""
_SETTLING = 20
"""Control steps and a period before these."""


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
    """Collisions; infinite for a team without a way from its start into its paths."""


class Teams:
    """Simulates teams on periodic paths of one period on a coarse grid, each in a world of its own.

    For the settled worst case cars begin on their paths, unless robots of the task fail. Otherwise the episodes are
    those of the task, with the way from the start into the paths; without faults they end after some periods.

    Args:
        task: The task, of cars.
        period: Period of the paths [control step].
        worlds: P.
        goal: WHOLE or SETTLED.
    """

    def __init__(self, task: Scenario, period: int, worlds: int, goal: str = SETTLED):
        faults = task.faults
        self.fails = bool(faults.schedule or faults.removed or faults.rate or faults.lost)
        self.on_paths = goal == SETTLED and not self.fails
        steps = _SETTLING + (_ROUNDS + 1) * period if self.on_paths else task.task.steps
        changed = {"task.contamination": coarse_grid(task), "task.grid": (1, 1)}
        self.task = named.build(
            task, **changed, **{"task.duration": (steps + 2) * task.task.step if self.on_paths else task.task.duration}
        )
        self.simulation = Simulation(self.task, worlds)
        self.period, self.steps, self.goal = period, steps, goal

    def scores(self, loop: np.ndarray, seed: int = 0, drivable: np.ndarray | None = None) -> Scores:
        """Return the scores of loops (P, N, K, 2) [m] in the episode of a seed.

        For teams that are not `drivable` (P,) no way from the start is sought.
        """
        if self.on_paths:
            tables = path_tables(self.task, loop)
            ages, collisions = self._played(FilteredPaths(self.task, len(loop), tables=tables), self.steps, seed)
            counted = ages[-_ROUNDS * self.period :]
            return Scores(counted.max(axis=0), counted.mean(axis=0), collisions)
        policy, arrived, lost = self._from_start(loop, np.ones(len(loop), bool) if drivable is None else drivable)
        steps = self.steps if self.fails else min(self.steps, arrived + (_ROUNDS + 1) * self.period)
        ages, collisions = self._played(policy, steps, seed)
        counted = ages[steps // 2 :] if self.goal == SETTLED else ages
        return Scores(counted.max(axis=0), counted.mean(axis=0), np.where(lost, np.inf, collisions))

    def _from_start(self, loop: np.ndarray, drivable: np.ndarray) -> tuple[FilteredPaths, int, np.ndarray]:
        """Return the policy, when all cars are on their paths [control step], and which teams (P,) have no way."""
        lost = np.zeros(len(loop), dtype=bool)
        if not start_is_known(self.task):
            until = filtered_steps(self.task, loop)
            policy = FilteredPaths(self.task, len(loop), tables=path_tables(self.task, loop), filtered_until=until)
            return policy, int(until), lost
        ways = [lead_in_of(self.task, each, _TRIES) if can else None for each, can in zip(loop, drivable, strict=True)]
        longest = max((lead_in.shape[1] for lead_in, _ in filter(None, ways)), default=1)
        lead_ins, loops = np.empty((*loop.shape[:2], longest, 2)), np.empty_like(loop)
        for k, way in enumerate(ways):
            lead_in, chosen = way or (loop[k, :, :0], np.arange(loop.shape[1]))
            lost[k], early = way is None, lead_in.shape[1]
            onward = loop[k][chosen][:, np.arange(early, longest) % self.period]
            lead_ins[k] = np.concatenate([lead_in, onward], axis=1)
            loops[k] = np.roll(loop[k][chosen], -longest, axis=1)
        return FilteredPaths(self.task, len(loop), tables=path_tables(self.task, loops, lead_ins)), longest, lost

    def _played(self, policy: FilteredPaths, steps: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the undetected time after each step (steps, P) [s], and the collisions (P,)."""
        simulation = self.simulation
        simulation.reset(seeds=[seed] * simulation.num_worlds)
        if self.on_paths:  # where they are to be a control step before the first
            _place(simulation, policy.tables.pose[:, :, -FINE])
            simulation.step(np.zeros(simulation.action_shape, dtype=np.float32))
        ages = []
        for _ in range(steps):
            simulation.step(policy.act(simulation.observation))
            ages.append(simulation.contamination.age.numpy().copy())
        return np.array(ages) * self.task.task.step, simulation.tally.collisions.numpy().astype(float)


def _place(simulation: Simulation, pose: np.ndarray) -> None:
    """Put cars at poses (W, N, 4): x, y [m], heading [rad], speed [m/s]."""
    position = np.zeros((*pose.shape[:2], 3), dtype=np.float32)
    position[..., :2] = pose[..., :2]
    simulation.robots.position.assign(position)
    simulation.robots.heading.assign(pose[..., 2].astype(np.float32))
    simulation.robots.speed.assign(pose[..., 3].astype(np.float32))
