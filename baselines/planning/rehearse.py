"""Rehearsals: how good a plan is, by playing it in simulation.

A search looks at a plan in a few short episodes on a coarse grid, and plays the best ones to the end. A portfolio and a
training compare policies by the cost of their results.
"""

import dataclasses
import itertools
import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baselines.planning.plans import BEYOND, GROWN, LOST, SETTLED_TIME, Plan, Planned, figures_of
from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.settings import PolicySettings
from lissajous_env.episodes.evaluation import EpisodeRunner, evaluate
from lissajous_env.episodes.limits import guaranteed_time_limit
from lissajous_env.parameters import named
from lissajous_env.parameters.assumptions import AssumptionWarning
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import where_raised
from lissajous_env.world.columns import COLLISIONS, DETECTION_TIME, OPEN, WORST_CASE
from lissajous_env.world.robots.faults import removal_steps
from lissajous_env.world.score import is_open
from lissajous_env.world.simulation import Simulation

EPISODES, CONFIRMED, BEST, MOST_LOSSES = 4, 16, 64, 64
"""Final episodes of a plan without failures, those of the best plans and of the first of these, and most episodes with
failures."""
_SCREENED, _SCREENED_LOSSES = 2, 8
"""Episodes of a first look without failures, and most of these with failures."""
_LOST_AT = 0.25
"""Share of an episode after which robots are removed: early enough for a gap to grow for more than half of it."""
_SHARE = 0.5
"""Duration of an episode of a first look, over that of a final one."""
_EVERY = 8
"""Steps between two looks at whether an episode may end early."""
_COARSE, _COARSE_CELLS_IN_A_SENSOR = 40, 2.5
"""Cells of a first look along the longer side of the rectangle, if the sensors are not too short for them."""
DETECTION, GUARANTEE = "detection", "guarantee"
"""Objectives of a portfolio: the mean detection time, and the worst-case undetected time."""
_OPEN = 2.0
"""Worst case that counts where the episodes show no bound [episodes]."""
_COLLISION, MOST_COLLISIONS = 0.1, 20
"""Cost of a collision in an episode, and the largest number of collisions that counts."""


@dataclass(frozen=True)
class Episodes:
    """The episodes of every plan: with the same seeds for all, so that plans are compared on the same failures."""

    seed: int = 0
    """Seed of the first episode without failures and of the first with failures."""
    failures: int = 0
    """Robots that fail for good in an episode with failures."""
    count: int = EPISODES
    clearance: float = 0.0
    """Distance of two bodies below which a plan is ranked after all others [m]."""

    def with_failures(self, scenario: Scenario) -> Scenario:
        """Return a scenario in which so many more robots fail for good; `remove_early` determines which and when."""
        return named.build(scenario, **{"faults.lost": scenario.faults.lost + self.failures})

    def losses(self, scenario: Scenario) -> list[tuple[int, ...]]:
        """Return the robots that are removed in each episode with failures.

        These are all combinations of as many robots as fail, or, of more than `MOST_LOSSES`, so many random ones.
        """
        robots, lost = scenario.num_robots, self.with_failures(scenario).faults.lost
        if self.combinations(scenario) <= MOST_LOSSES:
            return list(itertools.combinations(range(robots), lost))
        draw, chosen = np.random.default_rng(self.seed), {}
        while len(chosen) < MOST_LOSSES:
            chosen[tuple(sorted(draw.choice(robots, lost, replace=False).tolist()))] = None
        return list(chosen)

    def combinations(self, scenario: Scenario) -> int:
        """Return the number of combinations of as many robots as fail in an episode with failures."""
        return math.comb(scenario.num_robots, self.with_failures(scenario).faults.lost)


@dataclass(frozen=True)
class Look:
    """The result of a first look at a plan."""

    plan: Plan
    collisions: int
    worst_case: float
    """Worst-case undetected time [s]; infinite if the episodes show no bound, or ended because others are better."""
    worst_case_failed: float
    """The same with failures; 0 without."""
    settled: float = math.inf
    """Worst-case undetected time of the second half of the episodes [s]."""
    too_close: bool = False
    """True if two bodies come closer than the requested clearance."""
    mean_age: float = math.inf
    """Mean over cells and time of how long a target can have been undetected [s], to compare plans without a bound."""
    refusal: str = ""
    """Reason why the plan cannot be played."""

    @property
    def by_worst_case(self) -> tuple[float, ...]:
        """Return numbers by which plans are sorted, without failures first."""
        return self.too_close, self.worst_case, self.settled, self.worst_case_failed, self.mean_age

    @property
    def by_failed(self) -> tuple[float, ...]:
        """Return numbers by which plans are sorted, with failures first."""
        return self.too_close, self.worst_case_failed, self.worst_case, self.settled, self.mean_age

    @property
    def fails(self) -> bool:
        """Return whether the plan is out."""
        return bool(self.refusal) or self.collisions > 0


class _Run:
    """Episodes of a plan that run together, one in each world, in which robots may be removed.

    Args:
        plan: The plan.
        scenario: The scenario to play, which may have other grids and faults than that of the plan.
        seed: Seed of the first episode.
        losses: Robots that are removed in each episode.
    """

    def __init__(self, plan: Plan, scenario: Scenario, seed: int, losses: Sequence[tuple[int, ...]]):
        self.step, self.plan, self._losses = 0, plan, losses
        self.policy = plan.settings.make(scenario, len(losses))
        self.simulation = Simulation(scenario, len(losses), threads=1, seed=seed)
        remove_early(self.simulation, losses)
        self.settled = np.zeros(len(losses), dtype=int)
        """Longest undetected time since the middle of the episodes [steps]."""
        self.before = np.zeros(len(losses), dtype=int)
        """Longest undetected time before the last step [steps]."""
        self.beyond = np.zeros(len(losses))
        """Largest distance of any part of a body beyond the edge of the rectangle so far [m]; 0 with walls."""

    @property
    def longest(self) -> np.ndarray:
        """Return the longest undetected time of each episode so far [steps]."""
        return self.simulation.contamination.age_max.numpy()

    @property
    def gap(self) -> float:
        """Return the smallest distance of two bodies so far [m]."""
        robot = self.simulation.scenario.robot
        return float(self.simulation.tally.min_separation.numpy().min()) - 2 * robot.radius

    @property
    def collisions(self) -> int:
        """Return the collisions of all episodes so far."""
        return int(self.simulation.tally.collisions.numpy().sum())

    def play(self, until: int, is_over: Callable[[], bool] = lambda: False) -> bool:
        """Play until a step, and return True; return False where `is_over` has ended the episodes earlier."""
        runner = EpisodeRunner(self.policy, self.simulation)
        has_walls = self.simulation.scenario.task.boundary == "wall"
        self.policy.reset()
        for self.step in range(1, until + 1):
            if self.step == until:
                self.before[:] = self.longest
            runner.step()
            if not has_walls:
                np.maximum(self.beyond, self._beyond_now(), out=self.beyond)
            if 2 * self.step > until:
                np.maximum(self.settled, self.simulation.contamination.age.numpy(), out=self.settled)
            if self.step % _EVERY == 0 and is_over():
                return False
        return True

    def _beyond_now(self) -> np.ndarray:
        """Return by how much a body sticks out of the rectangle in each episode now [m]."""
        curve, robots = self.simulation.scenario.curve, self.simulation.robots.position.numpy()
        over = np.abs(robots[..., :2]) - (curve.half_width, curve.half_height)
        return over.max(axis=(1, 2)) + self.simulation.scenario.robot.radius

    def rows(self) -> list[dict[str, Any]]:
        """Return the score rows of the episodes, with what `plans` adds to these."""
        step, grows = self.simulation.scenario.task.step, self.longest > self.before
        more = zip(self.simulation.score(), self._losses, self.settled, grows, self.beyond, strict=True)
        return [
            {"policy": self.plan.settings.policy}
            | row
            | {LOST: lost, SETTLED_TIME: float(age) * step, GROWN: bool(still), BEYOND: float(beyond)}
            for row, lost, age, still, beyond in more
        ]


def look_at(plan: Plan, episodes: Episodes, cutoff: float) -> Look:
    """Play a plan for half of its duration on a coarse grid; end at the first collision, or beyond a cutoff [s]."""
    try:
        task = plan.scenario.task
        scenario = named.build(plan.scenario, **{"task.contamination": coarse_grid(plan.scenario), "task.grid": (1, 1)})
        until = max(round(_SHARE * task.steps), 1)
        look = _look(plan, scenario, episodes, [()] * _SCREENED, until, cutoff)
        if not episodes.failures or look.collisions:
            return look
        if look.worst_case == math.inf:
            return dataclasses.replace(look, worst_case_failed=math.inf)
        scenario, losses = episodes.with_failures(scenario), episodes.losses(scenario)
        losses = losses[:: math.ceil(len(losses) / _SCREENED_LOSSES)]
        failed = _look(plan, scenario, episodes, losses, task.steps, math.inf)
        too_close = look.too_close or failed.too_close
        return dataclasses.replace(look, worst_case_failed=failed.worst_case, too_close=too_close)
    except Exception as error:  # one policy that fails must not end the search
        return Look(plan, 0, math.inf, math.inf, refusal=reason_of(error))


def _look(
    plan: Plan, scenario: Scenario, episodes: Episodes, losses: Sequence[tuple[int, ...]], until: int, cutoff: float
) -> Look:
    """Return the collisions, the worst cases and the mean age [s] of some episodes, which may end early."""
    run, step = _Run(plan, scenario, episodes.seed, losses), scenario.task.step
    ended = run.play(until, lambda: bool(run.collisions) or run.longest.max() * step > cutoff)
    if run.collisions:
        return Look(plan, run.collisions, math.inf, 0.0)
    field = run.simulation.contamination
    too_close = run.gap < episodes.clearance
    age = float(field.mean_age_sum.numpy().max()) / run.step * step
    at_end = zip(run.longest, field.age.numpy(), strict=True)
    if not (ended or run.step == until) or any(is_open(*each, until) for each in at_end):
        return Look(plan, 0, math.inf, 0.0, too_close=too_close, mean_age=age)
    worst_case, settled = float(run.longest.max()) * step, int(run.settled.max()) * step
    return Look(plan, 0, worst_case, 0.0, settled, too_close, age)


def play(plan: Plan, episodes: Episodes) -> Planned:
    """Play the final episodes of a plan, all of them to the end."""
    run = _Run(plan, plan.scenario, episodes.seed, [()] * episodes.count)
    run.play(plan.scenario.task.steps)
    rows, failed = run.rows(), []
    if episodes.failures and not run.collisions:
        scenario = episodes.with_failures(plan.scenario)
        lossy = _Run(plan, scenario, episodes.seed, episodes.losses(plan.scenario))
        lossy.play(scenario.task.steps)
        failed = lossy.rows()
    figures = figures_of(rows, failed, plan, run.policy.communicates, episodes.clearance)
    return Planned(plan, figures, guaranteed_time_limit(plan.scenario), rows, failed)


def remove_early(simulation: Simulation, losses: Sequence[tuple[int, ...]]) -> None:
    """Let the robots that each world loses be removed after a quarter of the episode, in place of random ones.

    An empty loss leaves a world as it is.
    """
    task, faults = simulation.scenario.task, simulation.scenario.faults
    removed_at = simulation.robots.removed_at.numpy().copy()
    for row, lost in zip(removed_at, losses, strict=True):
        if lost:
            row[:] = removal_steps(faults, len(row), task.step)
            row[list(lost)] = np.minimum(row[list(lost)], round(_LOST_AT * task.steps))
    simulation.robots.removed_at.assign(removed_at)


def grid(scenario: Scenario, longest: int, cells_in_a_sensor: float) -> tuple[int, int]:
    """Return columns and rows of about square cells.

    Args:
        scenario: The scenario.
        longest: Cells along the longer side of the rectangle, more for short sensors.
        cells_in_a_sensor: Least sensing radius [cell].
    """
    halves = scenario.curve.half_width, scenario.curve.half_height
    longest = max(longest, min(math.ceil(2 * max(halves) * cells_in_a_sensor / scenario.sensing_radius), 2 * longest))
    columns, rows = (max(round(longest * half / max(halves)), 1) for half in halves)
    return columns, rows


def reason_of(error: Exception) -> str:
    """Return why a plan cannot be played."""
    return str(error) if isinstance(error, ValueError) else where_raised(error)


def coarse_grid(scenario: Scenario) -> tuple[int, int]:
    """Return columns and rows of the contamination grid of a first look."""
    printed = scenario.task.contamination or (1, 1)
    return min(grid(scenario, _COARSE, _COARSE_CELLS_IN_A_SENSOR), printed)


def quietly() -> warnings.catch_warnings:
    """Return a context without warnings about assumptions of the paper, which plans violate on purpose."""
    return warnings.catch_warnings(action="ignore", category=AssumptionWarning)


class Result(NamedTuple):
    """The result of a policy in some episodes."""

    time: float
    """Mean detection time, or largest worst-case undetected time [s]; infinite if nothing was detected."""
    collisions: float
    """Collisions in an episode."""

    def cost(self, step: float) -> float:
        """Return the cost, with a time of at least a control step [s]: below, collisions alone decide."""
        return float(cost_of(max(self.time, step), self.collisions))


def cost_of(time: Any, collisions: Any) -> Any:
    """Return the logarithm of a time, and a tenth for each collision in an episode."""
    return np.log(time) + _COLLISION * np.minimum(collisions, MOST_COLLISIONS)


def result_of(
    settings: PolicySettings, task: Scenario, episodes: int, objective: str, first_seed: int
) -> Result | None:
    """Play a policy and return its result; None for a scenario that does not suit the policy."""
    try:
        policy = settings.make(task, episodes)
    except UnsuitableScenarioError:
        return None
    rows = evaluate(policy, task, range(first_seed, first_seed + episodes))
    collisions = sum(row[COLLISIONS.name] for row in rows) / episodes
    if objective == GUARANTEE:
        is_open = any(row[OPEN.name] for row in rows)
        return Result(_OPEN * task.task.duration if is_open else max(row[WORST_CASE.name] for row in rows), collisions)
    times = [row[DETECTION_TIME.name] for row in rows if math.isfinite(row[DETECTION_TIME.name])]
    return Result(sum(times) / len(times) if times else math.inf, collisions)
