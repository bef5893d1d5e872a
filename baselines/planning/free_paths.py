"""Free-form periodic paths: Fourier coefficients of every robot's path, improved by CMA-ES from the best plans.

A population of teams is simulated together, each in a world of its own. What is minimised
is the worst-case undetected time, of whole episodes in one half of the time and of their second halves in the other,
with a part of its mean over time, by which teams of the same worst case differ, and penalties for collisions and for
paths that the cars cannot drive: above the top speed, tighter than their turns, too near to each other, or outside of
the rectangle.

Each search has two stages. The first moves, stretches and delays the paths of each of the first plans, five numbers a
robot, with several periods. The second improves all Fourier coefficients of the best of these.

N. Hansen, A. Ostermeier, "Completely derandomized self-adaptation in evolution strategies", Evolutionary Computation 9
(2001).
"""

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baselines.planning.plans import SETTLED, Plan, in_turn
from baselines.planning.rehearse import EPISODES, on_coarse_grid
from baselines.policies.path_tables import FINE, path_tables
from baselines.policies.periodic_paths import coefficients_of, derivative_of, places_of
from baselines.policies.settings import PolicySettings
from baselines.policies.timed_paths import TimedPaths
from baselines.policies.transit import arrival_steps, required_distance, speed_of, start_is_known, turning_radius_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.plugins import missing
from lissajous_env.world.simulation import Simulation

NAME = "free paths"
_HARMONICS = 2, 5
"""Fewest and most harmonics: as few as describe the first paths."""
_DESCRIBED = 0.15
"""Largest error of that description, over the sensing radius."""
_SHORTER = 0.93
"""The shortest period that is tried, over that in which the first paths take the largest speed of the cars; this one
and that of the plan from which the search begins are tried too."""
_MEAN = 0.5
"""Weight of the mean over time of the undetected time, against its largest value."""
_PENALTY, _COLLISION, _MOST_COLLISIONS = 20.0, 0.1, 20
"""Weight of the relative violation of a limit, in the time in which a car at top speed drives its sensing radius;
weight of a collision, over that; and most collisions that count."""
_MOVES, _SIGMA = 0.05, 0.02
"""Standard deviations of the first changes: of moves, stretches and delays, and of coefficients in the smaller half
side of the rectangle."""
_TOLERANCE = 0.01
"""Largest relative violation of a team that becomes a plan: the limits of the cars have a reserve."""
_WIDER = 1.03
"""Size of first paths that break a limit, over that of the plan: partitions often turn as tightly as cars can."""
_WORLDS = 24
_FIRST = 0.4
"""Share of the budget for the first stage."""
_KEPT = 3
"""Results of the first stage that the second improves, and teams of a goal that become plans."""
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
    """Half width and half height of the rectangle without its inset [m]."""
    step: float
    """Control step [s]."""

    @classmethod
    def of(cls, task: Scenario) -> "Limits":
        """Return the limits of the cars of a task."""
        half = task.driven.half_width, task.driven.half_height
        top = min(task.robot.top_speed, task.robot.steady_speed(task.robot.drive * float(task.drive_factors.min())))
        return cls(
            _FASTEST * top,
            turning_radius_of(task),
            required_distance(task, _CLEARANCE * task.robot.radius),
            half,
            task.task.step,
        )


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
        self.task = on_coarse_grid(task)
        self.simulation = Simulation(self.task, worlds)
        self.period, self.goal = period, goal

    def scores(self, loop: np.ndarray, seed: int = 0) -> Scores:
        """Return the scores of loops (P, N, K, 2) [m] in the episode of a seed."""
        task, simulation = self.task, self.simulation
        arrived, knows = arrival_steps(task, loop, speed_of(loop, task.task.step)), start_is_known(task)
        tables, until = path_tables(task, loop), 0.0 if knows else float(arrived)
        policy = TimedPaths(task, len(loop), tables=tables, by_world=True, filtered_until=until)
        fails = task.faults.schedule or task.faults.removed or task.faults.rate or task.faults.lost
        steps = task.task.steps if fails else min(task.task.steps, arrived + _ROUNDS * self.period)
        simulation.reset(seeds=[seed] * simulation.num_worlds)
        moments = []
        for _ in range(steps):
            simulation.step(policy.act(simulation.observation))
            moments.append(simulation.contamination.age.numpy().copy())
        ages = np.array(moments) * task.task.step
        if self.goal == SETTLED:
            ages = ages[steps // 2 :] if fails else ages[-_ROUNDS * self.period :]
        return Scores(ages.max(axis=0), ages.mean(axis=0), simulation.tally.collisions.numpy().astype(float))


@dataclass(frozen=True)
class _Team:
    """A team that meets the limits and did not collide."""

    value: float
    task: Scenario
    """Scenario with the start."""
    paths: np.ndarray
    """(N, 2 + 4 K) Fourier coefficients [m]."""
    period: int

    @property
    def plan(self) -> Plan:
        """Return its plan."""
        rows = [[float(f"{number:.5g}") for number in row] for row in self.paths]
        given = {"period": self.period, "paths": rows}
        about = f"period {self.period * self.task.task.step:.3g} s, {(self.paths.shape[1] - 2) // 4} harmonics"
        return Plan(NAME, self.task, PolicySettings("periodic-paths", given), about)


def optimise(
    starts: Mapping[str, Sequence[Plan]],
    budget: float,
    on_progress: Callable[[], None] = lambda: None,
    seed: int = 0,
    clock: Callable[[], float] | None = None,
) -> list[Plan]:
    """Return plans of free-form paths, the best of each goal in turn.

    Args:
        starts: For each goal, the plans of timed paths from which the search begins; others are left out.
        budget: Populations that are simulated, or with a clock the duration of the search [s].
        on_progress: Called before each population.
        seed: Seed of the search.
        clock: Returns the time [s]; None to count populations in its place.

    Raises:
        MissingExtraError: the library `cma` is not installed.
    """
    require_cma()
    lists: list[list[Plan]] = []
    for goal, plans in starts.items():
        search = _Search(goal, budget / len(starts), on_progress, seed, clock)
        lists.append([team.plan for team in search.run(plans)[:_KEPT]])
    return list(in_turn(lists))


def loop_of(plan: Plan) -> np.ndarray | None:
    """Return the loops (N, K, 2) of a plan of timed paths [m]; None for another plan, or one that does not fit."""
    try:
        policy = plan.settings.make(plan.scenario)
    except ValueError:  # it does not fit the scenario
        return None
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


def moved(paths: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Return paths (P, N, 2 + 4 K) [m] that are moved, stretched and delayed.

    Args:
        paths: (N, 2 + 4 K) Fourier coefficients [m].
        changes: (P, N, 5) moves along x and y [m], logarithms of the stretches of x and y, and delays [period].
    """
    count = (paths.shape[1] - 2) // 4
    waves = paths[:, 2:].reshape(len(paths), count, 2, 2)  # harmonic, coordinate, cosine and sine
    stretched = waves * np.exp(changes[:, :, None, 2:4, None])
    turn = 2 * np.pi * np.arange(1, count + 1) * changes[:, :, 4:]
    cos, sin = np.cos(turn)[..., None], np.sin(turn)[..., None]
    delayed = np.stack(
        [stretched[..., 0] * cos - stretched[..., 1] * sin, stretched[..., 0] * sin + stretched[..., 1] * cos], axis=-1
    )
    return np.concatenate([paths[:, :2] + changes[:, :, :2], delayed.reshape(*changes.shape[:2], 4 * count)], axis=-1)


class _Search:
    """A search with one goal."""

    def __init__(
        self,
        goal: str,
        budget: float,
        on_progress: Callable[[], None],
        seed: int,
        clock: Callable[[], float] | None,
    ):
        self.goal, self.budget, self.on_progress, self.seed = goal, budget, on_progress, seed
        self.populations = 0
        """Populations that were simulated."""
        begin = 0.0 if clock is None else clock()
        self.spent = lambda: float(self.populations) if clock is None else clock() - begin

    def run(self, plans: Sequence[Plan]) -> list[_Team]:
        """Return the best teams of each stage, the best first."""
        loops = [(plan.scenario, loop) for plan in plans if (loop := loop_of(plan)) is not None]
        described = [(task, _described(task, loop), loop.shape[1]) for task, loop in loops]
        begun = [(task, paths, tried) for task, paths, period in described for tried in _periods(task, paths, period)]
        first = []
        for k, (task, paths, period) in enumerate(begun):
            until = _FIRST * self.budget * (k + 1) / len(begun)
            first += self._moved(task, paths, period, until)
        best = sorted(first, key=lambda team: team.value)[:_KEPT]
        begin, second = self.spent(), []
        for k, team in enumerate(best):
            second += self._bent(team, begin + (self.budget - begin) * (k + 1) / len(best))
        return sorted([*best, *second], key=lambda team: team.value)

    def _moved(self, task: Scenario, paths: np.ndarray, period: int, until: float) -> list[_Team]:
        """Return the best team of paths that are moved, stretched and delayed, if there is one."""
        size = np.array([min(task.curve.half_width, task.curve.half_height)] * 2 + [1.0] * 3)
        start = np.zeros(5 * len(paths))
        return self._improved(
            task, lambda x: moved(paths, x.reshape(len(x), len(paths), 5) * size), start, _MOVES, period, until
        )

    def _bent(self, team: _Team, until: float) -> list[_Team]:
        """Return the best team of other coefficients, if there is one."""
        task, start, shape = team.task, team.paths.ravel(), team.paths.shape
        sigma = _SIGMA * min(task.curve.half_width, task.curve.half_height)
        return self._improved(task, lambda x: x.reshape(len(x), *shape), start, sigma, team.period, until)

    def _improved(
        self,
        task: Scenario,
        paths_of: Callable[[np.ndarray], np.ndarray],
        start: np.ndarray,
        sigma: float,
        period: int,
        until: float,
    ) -> list[_Team]:
        """Return the best team of one run of CMA-ES, if there is one that meets the limits."""
        options = {"popsize": _WORLDS, "seed": self.seed + 1, "verbose": -9}
        search = require_cma().CMAEvolutionStrategy(start, sigma, options)
        limits, weight = Limits.of(task), _PENALTY * task.sensing_radius / task.robot.top_speed
        teams, best, drawn = Teams(task, period, _WORLDS, self.goal), None, 0
        while self.spent() < until and not search.stop():
            self.on_progress()
            asked = search.ask() if drawn else [start] * _WORLDS  # the start itself is the first that is scored
            paths = paths_of(np.array(asked))
            broken = violation(paths, period, limits)
            worst, mean, collisions = teams.scores(places_of(paths, period), self.seed + drawn % EPISODES)
            values = worst + _MEAN * mean
            values = values + weight * (broken + _COLLISION * np.minimum(collisions, _MOST_COLLISIONS))
            if drawn:
                search.tell(asked, values.tolist())
            drawn += 1
            self.populations += 1
            allowed = np.where((broken < _TOLERANCE) & (collisions == 0), values, np.inf)
            k = int(allowed.argmin())
            if allowed[k] < (np.inf if best is None else best.value):
                best = _Team(float(allowed[k]), task, paths[k], period)
        return [] if best is None else [best]


def _periods(task: Scenario, paths: np.ndarray, period: int) -> list[int]:
    """Return the periods that are tried for paths (N, 2 + 4 K) of a period [control step]."""
    speed = np.linalg.norm(places_of(derivative_of(paths, period * task.task.step), period), axis=-1).max()
    shortest = min(float(speed) / Limits.of(task).speed, 1.0) * period
    return sorted({max(round(tried), 4) for tried in (period, shortest, _SHORTER * shortest)}, reverse=True)


def _described(task: Scenario, loop: np.ndarray) -> np.ndarray:
    """Return the Fourier coefficients of loops, a little wider if these break a limit of the cars."""
    paths = coefficients_of(loop, _HARMONICS[0])
    for count in range(_HARMONICS[0], _HARMONICS[1] + 1):
        paths = coefficients_of(loop, count)
        if np.abs(places_of(paths, loop.shape[1]) - loop).max() < _DESCRIBED * task.sensing_radius:
            break
    if violation(paths[None], loop.shape[1], Limits.of(task))[0] >= _TOLERANCE:
        paths[:, 2:] *= _WIDER
    return paths
