"""Plans that are played: a first look with an early end, and the final episodes from which figures are printed."""

import itertools
import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.planning.plans import GROWN, LOST, SETTLED_TIME, Plan, Planned, figures_of
from baselines.policies.patience import StoppedError, patience
from lissajous_env.episodes.evaluation import EpisodeRunner
from lissajous_env.episodes.limits import guaranteed_time_limit
from lissajous_env.parameters import named
from lissajous_env.parameters.assumptions import AssumptionWarning
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import where_raised
from lissajous_env.world.columns import COLLISIONS
from lissajous_env.world.robots.faults import removal_steps
from lissajous_env.world.score import is_open
from lissajous_env.world.simulation import Simulation

EPISODES, MOST_LOSSES = 4, 64
"""Final episodes of a plan without failures, and most episodes with failures."""
_SCREENED, _SCREENED_LOSSES = 2, 8
"""Episodes of a first look without failures, and most of these with failures."""
_LOST_AT = 0.25
"""Share of an episode after which robots are removed: early enough for a gap to grow for more than half of it."""
_SHARE = 0.5
"""Duration of an episode of a first look, over that of a final one."""
_EVERY = 8
"""Steps between two looks at whether an episode may end early."""
_COARSE = 40
"""Cells of a first look along the longer side of the rectangle, if the sensors are not too short for them."""


class _BeyondCutoffError(Exception):
    """Raised in a running episode when the plan is known to be worse than another one."""


@dataclass(frozen=True)
class Episodes:
    """The episodes of every plan: with the same seeds for all, so that plans are compared on the same failures."""

    seed: int = 0
    """Seed of the first episode without failures and of the first with failures."""
    failures: int = 0
    """Robots that fail for good in an episode with failures."""
    count: int = EPISODES

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
    mean_age: float = math.inf
    """Mean over cells and time of how long a target can have been undetected [s], to compare plans without a bound."""
    refusal: str = ""
    """Reason why the plan cannot be played."""

    @property
    def by_worst_case(self) -> tuple[float, ...]:
        """Return numbers by which plans are sorted, without failures first."""
        return self.worst_case, self.settled, self.worst_case_failed, self.mean_age

    @property
    def by_failed(self) -> tuple[float, ...]:
        """Return numbers by which plans are sorted, with failures first."""
        return self.worst_case_failed, self.worst_case, self.settled, self.mean_age

    @property
    def fails(self) -> bool:
        """Return whether the plan is out."""
        return bool(self.refusal) or self.collisions > 0


def look_at(plan: Plan, episodes: Episodes, cutoff: float, stopped: Callable[[], bool]) -> Look:
    """Play a plan for half of its duration on a coarse grid; end at the first collision, or beyond a cutoff [s]."""
    try:
        task = plan.scenario.task
        changed = {"task.contamination": coarse_grid(plan.scenario), "task.grid": (1, 1)}
        scenario = named.build(plan.scenario, **changed)
        until = max(round(_SHARE * task.steps), 1)
        whole = [()] * _SCREENED
        collisions, worst, settled, age = _raced(plan, scenario, episodes.seed, whole, until, cutoff, stopped)
        failed = math.inf if episodes.failures and not collisions else 0.0
        if failed and worst < math.inf:
            scenario, losses = episodes.with_failures(scenario), episodes.losses(scenario)
            losses = losses[:: math.ceil(len(losses) / _SCREENED_LOSSES)]
            _, failed, *_ = _raced(plan, scenario, episodes.seed, losses, task.steps, math.inf, stopped)
        return Look(plan, collisions, worst, failed, settled, age)
    except StoppedError:
        raise
    except Exception as error:  # one policy that fails must not end the search
        return Look(plan, 0, math.inf, math.inf, refusal=reason_of(error))


def _raced(
    plan: Plan,
    scenario: Scenario,
    seed: int,
    losses: Sequence[tuple[int, ...]],
    until: int,
    cutoff: float,
    stopped: Callable[[], bool],
) -> tuple[int, float, float, float]:
    """Return collisions and the worst case, that of the second half, and the mean age [s] of episodes.

    They may end early.
    """
    with patience(stopped):
        policy = plan.settings.make(scenario, len(losses))
    simulation = Simulation(scenario, len(losses), threads=1, seed=seed)
    remove_early(simulation, losses)
    runner = EpisodeRunner(policy, simulation)
    policy.reset()
    settled = 0
    for step in range(1, until + 1):
        runner.step()
        if 2 * step > until:
            settled = max(settled, int(simulation.contamination.age.numpy().max()))
        if step % _EVERY and step < until:
            continue
        if stopped():
            raise StoppedError
        collisions = int(simulation.tally.collisions.numpy().sum())
        longest = simulation.contamination.age_max.numpy()
        if collisions:
            return collisions, math.inf, math.inf, math.inf
        if longest.max() * scenario.task.step > cutoff:
            break
    field = simulation.contamination
    age = float(field.mean_age_sum.numpy().max()) / step * scenario.task.step
    at_end = field.age.numpy()
    if step < until or any(is_open(*each, until) for each in zip(longest, at_end, strict=True)):
        return 0, math.inf, math.inf, age
    return 0, float(longest.max()) * scenario.task.step, settled * scenario.task.step, age


def play(
    plan: Plan,
    episodes: Episodes,
    stopped: Callable[[], bool] = lambda: False,
    cutoff: Callable[[], float] = lambda: math.inf,
) -> Planned | None:
    """Play the final episodes of a plan, all of them to the end.

    Args:
        plan: The plan.
        episodes: The episodes.
        stopped: Returns whether to stop, by raising StoppedError.
        cutoff: Returns a worst-case undetected time [s]; for a plan that exceeds it, or collides where it is not
            infinite, the result is None.
    """
    found = _played(plan, plan.scenario, episodes.seed, [()] * episodes.count, stopped, cutoff)
    if found is None:
        return None
    rows, messages = found
    failed: list[dict[str, Any]] = []
    if episodes.failures and not any(row[COLLISIONS.name] for row in rows):
        scenario = episodes.with_failures(plan.scenario)
        found = _played(plan, scenario, episodes.seed, episodes.losses(plan.scenario), stopped)
        assert found is not None, "without a cutoff every episode is played to the end"
        failed, _ = found
    limit = guaranteed_time_limit(plan.scenario)
    return Planned(plan, figures_of(rows, failed, plan, messages), limit, rows, failed)


def _played(
    plan: Plan,
    scenario: Scenario,
    seed: int,
    losses: Sequence[tuple[int, ...]],
    stopped: Callable[[], bool],
    cutoff: Callable[[], float] = lambda: math.inf,
) -> tuple[list[dict[str, Any]], str] | None:
    """Return the score rows of some episodes, with what `plans` adds to these, and the policy's messages.

    Beyond the cutoff [s], the result is None.
    """
    with patience(stopped):
        policy = plan.settings.make(scenario, len(losses))
    simulation = Simulation(scenario, len(losses), threads=1)
    tally, field = simulation.tally, simulation.contamination
    settled = np.zeros(len(losses), dtype=int)
    before = np.zeros(len(losses), dtype=int)

    def check(taken: int) -> None:
        if taken == 0:
            remove_early(simulation, losses)
        if 2 * taken > scenario.task.steps:
            np.maximum(settled, field.age.numpy(), out=settled)
        if taken == scenario.task.steps - 1:
            before[:] = field.age_max.numpy()
        if taken % _EVERY:
            return
        if stopped():
            raise StoppedError
        most = cutoff()
        longest = float(field.age_max.numpy().max()) * scenario.task.step
        if longest > most or (most < math.inf and tally.collisions.numpy().any()):
            raise _BeyondCutoffError

    try:
        EpisodeRunner(policy, simulation).play(range(seed, seed + len(losses)), check)
    except _BeyondCutoffError:
        return None
    grown = field.age_max.numpy() > before
    rows = [
        {"policy": plan.settings.policy}
        | row
        | {LOST: lost, SETTLED_TIME: float(age) * scenario.task.step, GROWN: bool(grows)}
        for row, lost, age, grows in zip(simulation.score(), losses, settled, grown, strict=True)
    ]
    return rows, policy.communicates


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
    return min(grid(scenario, _COARSE, 2.5), printed)


def quietly() -> warnings.catch_warnings:
    """Return a context without warnings about assumptions of the paper, which plans violate on purpose."""
    return warnings.catch_warnings(action="ignore", category=AssumptionWarning)
