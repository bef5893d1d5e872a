"""Rehearsals: episodes of a plan in simulation, from which its figures follow.

A look at a plan plays a few short episodes on a coarse grid; the best plans are played to the end.
"""

import dataclasses
import itertools
import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.benchmark.statistics import summarize
from baselines.planning.plans import (
    BEYOND,
    GROWN,
    LOST,
    SETTLED_TIME,
    Figures,
    Plan,
    Planned,
    worst_cases,
)
from lissajous_env.episodes.evaluation import EpisodeRunner
from lissajous_env.episodes.guarantee import cells
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import COLLISIONS, DETECTION_TIME, DISTANCE, MEAN, SEPARATION
from lissajous_env.world.robots.faults import removal_steps
from lissajous_env.world.simulation import Simulation

FINAL_EPISODES = 4
"""Episodes of a plan that is played to the end."""
CONFIRMING_EPISODES = 16
"""Episodes of a plan that no other dominates."""
BEST_EPISODES = 64
"""Episodes of the first of these plans."""
MOST_LOSSES = 64
"""Most episodes with failures."""
_SCREENED, _SCREENED_LOSSES = 2, 8
"""Episodes of a first look without failures, and most of these with failures."""
_LOST_AT = 0.25
"""Share of an episode after which robots are removed: early enough for a gap to grow for more than half of it."""
_SHARE = 0.5
"""Duration of an episode of a first look, as a share of that of a final one."""
_EVERY = 8
"""Steps between two looks at whether an episode may end early."""
_COARSE, _COARSE_CELLS_IN_A_SENSOR = 40, 2.5
"""Cells of a first look along the longer side of the rectangle, if the sensors are not too short for them."""


class LateError(Exception):
    """End of episodes of which no result is needed any more."""


@dataclass(frozen=True)
class Episodes:
    """The episodes of every plan: with the same seeds for all, so that plans are compared on the same failures."""

    seed: int = 0
    """Seed of the first episode without failures and of the first with failures."""
    failures: int = 0
    """Robots that fail for good in an episode with failures, besides those that the scenario removes."""
    count: int = FINAL_EPISODES
    """Episodes without failures of a plan that is played to the end."""
    clearance: float = 0.0
    """Distance of two bodies below which a plan is ranked after all others [m]."""
    is_late: Callable[[], bool] = lambda: False
    """Function that returns whether no result is needed any more."""

    def lost(self, scenario: Scenario) -> int:
        """Return the number of robots that are removed in an episode with failures."""
        return scenario.faults.lost + self.failures

    def losses(self, scenario: Scenario) -> list[tuple[int, ...]]:
        """Return the robots that are removed in each episode with failures; none without failures.

        These are all combinations of as many robots as fail. If there are more than `MOST_LOSSES` of them, that many
        are drawn at random.
        """
        if not self.failures:
            return []
        robots, lost = scenario.num_robots, self.lost(scenario)
        if math.comb(robots, lost) <= MOST_LOSSES:
            return list(itertools.combinations(range(robots), lost))
        draw, chosen = np.random.default_rng(self.seed), {}
        while len(chosen) < MOST_LOSSES:
            chosen[tuple(sorted(draw.choice(robots, lost, replace=False).tolist()))] = None
        return list(chosen)


class _Run:
    """Episodes of a plan that run together, one in each world, in which robots may be removed.

    Args:
        plan: The plan.
        scenario: The scenario to play, which may have other grids and faults than that of the plan.
        episodes: Seed of the first episode, and whether no result is needed any more.
        losses: Robots that are removed in each episode.
    """

    def __init__(self, plan: Plan, scenario: Scenario, episodes: Episodes, losses: Sequence[tuple[int, ...]]):
        self.step, self.plan, self._episodes, self._losses = 0, plan, episodes, losses
        self.policy = plan.settings.make(scenario, len(losses))
        self.simulation = Simulation(scenario, len(losses), threads=1, seed=episodes.seed)
        remove_early(self.simulation, losses)
        self._ages: list[np.ndarray] = []
        """(2, W) undetected time and the longest one so far, after each step [steps]."""
        self._beyond = np.zeros(len(losses))
        """(W,) largest distance of any part of a body beyond the edge of the rectangle so far [m]; 0 with walls."""

    @property
    def longest(self) -> float:
        """Return the longest undetected time of all episodes so far [s]."""
        return self._ages[-1][1].max() * self.simulation.scenario.task.step

    @property
    def collisions(self) -> int:
        """Return the collisions of all episodes so far."""
        return int(self.simulation.tally.collisions.numpy().sum())

    def play(self, until: int, is_over: Callable[[], bool] = lambda: False) -> None:
        """Play until a step, or until `is_over`; raise LateError if no result is needed any more."""
        runner, scenario = EpisodeRunner(self.policy, self.simulation), self.simulation.scenario
        half, field = (scenario.curve.half_width, scenario.curve.half_height), self.simulation.contamination
        self.policy.reset()
        for self.step in range(1, until + 1):
            runner.step()
            self._ages.append(np.stack([field.age.numpy(), field.age_max.numpy()]))
            if scenario.task.boundary != "wall":
                over = np.abs(self.simulation.robots.position.numpy()[..., :2]) - half
                np.maximum(self._beyond, over.max(axis=(1, 2)) + scenario.robot.radius, out=self._beyond)
            if self.step % _EVERY == 0:
                if self._episodes.is_late():
                    raise LateError
                if is_over():
                    return

    def rows(self) -> list[dict[str, Any]]:
        """Return the score rows of the episodes, with what `plans` adds to these."""
        task, ages = self.simulation.scenario.task, np.array(self._ages)
        settled = ages[len(ages) // 2 :, 0].max(axis=0) * task.step
        grows = (np.ptp(ages[-2:, 1], axis=0) > 0) & (self.step == task.steps)
        more = zip(self.simulation.score(), self._losses, settled, grows, self._beyond, strict=True)
        return [
            {"policy": self.plan.settings.policy}
            | row
            | {LOST: lost, SETTLED_TIME: round(float(late), 12), GROWN: bool(still), BEYOND: float(beyond)}
            for row, lost, late, still, beyond in more
        ]


def look_at(plan: Plan, episodes: Episodes, cutoff: float) -> Planned:
    """Play half of some episodes of a plan on a coarse grid; they end at the first collision, or beyond a cutoff [s].

    If the worst case exceeds the cutoff, the result has no bound. A plan without a bound is not played with failures:
    its worst case with failures is infinite, too. Episodes with failures are played to the end, on the same grid.
    """
    full, until = plan.scenario.task.contamination or (1, 1), max(round(_SHARE * plan.scenario.task.steps), 1)
    coarse = min(cells(plan.scenario, _COARSE, _COARSE_CELLS_IN_A_SENSOR), full)
    scenario = named.build(plan.scenario, **{"task.contamination": coarse, "task.grid": (1, 1)})
    run = _Run(plan, scenario, episodes, [()] * _SCREENED)
    run.play(until, lambda: run.collisions > 0 or run.longest > cutoff)
    planned = _planned(run, episodes)
    if planned.figures.collisions:
        return planned
    if run.longest > cutoff or planned.figures.worst_case == math.inf:
        without = dict.fromkeys(("worst_case", "settled", "worst_case_failed"), math.inf)
        return dataclasses.replace(planned, figures=dataclasses.replace(planned.figures, **without))
    losses = episodes.losses(plan.scenario)
    return _planned(run, episodes, losses[:: math.ceil(len(losses) / _SCREENED_LOSSES) or 1])


def play(plan: Plan, episodes: Episodes) -> Planned:
    """Play the final episodes of a plan, all of them to the end."""
    run = _Run(plan, plan.scenario, episodes, [()] * episodes.count)
    run.play(plan.scenario.task.steps)
    return _planned(run, episodes, [] if run.collisions else episodes.losses(plan.scenario))


def _planned(run: _Run, episodes: Episodes, losses: Sequence[tuple[int, ...]] = ()) -> Planned:
    """Return a plan with the figures of the played episodes, and of others that it plays, with lost robots."""
    plan, scenario, rows, failed = run.plan, run.simulation.scenario, run.rows(), []
    if losses:
        with_losses = named.build(scenario, **{"faults.lost": episodes.lost(scenario)})
        lossy = _Run(plan, with_losses, episodes, losses)
        lossy.play(scenario.task.steps)
        failed = lossy.rows()
    body, all_rows = 2 * plan.scenario.robot.radius, [*rows, *failed]
    detection = summarize([row[DETECTION_TIME.name] for row in rows], MEAN)
    collisions_failed = sum(row[COLLISIONS.name] for row in failed)
    minutes = scenario.task.duration / 60 * run.step / scenario.task.steps
    figures = Figures(
        worst_case=max(worst_cases(rows)),
        settled=max(worst_cases(rows, SETTLED_TIME)),
        worst_case_failed=math.inf if collisions_failed else max(worst_cases(failed), default=math.nan),
        detection_time=detection.value,
        collisions=run.collisions,
        collisions_failed=collisions_failed,
        clearance=min(row[SEPARATION.name] for row in rows) - body,
        too_close=min(row[SEPARATION.name] for row in all_rows) - body < episodes.clearance,
        outside=max(row[BEYOND] for row in rows),
        distance=statistics.fmean(row[DISTANCE.name] for row in rows) / minutes,
        messages=run.policy.communicates,
        detection_low=detection.low,
        detection_high=detection.high,
    )
    return Planned(plan, figures, rows, failed)


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
