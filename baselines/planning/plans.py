"""Plans: a policy with its parameters on a scenario, and the figures that its episodes have."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.policies.as_cars import like_cars
from baselines.policies.patrol_path import SweepParameters, corner_radius, lookahead
from baselines.policies.settings import PolicySettings
from baselines.similarity import motion_scale
from lissajous_env.episodes.limits import robot_speed_limit
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import COLLISIONS, DETECTION_TIME, DISTANCE, OPEN, SEPARATION, WORST_CASE, Column

WHOLE, SETTLED = "whole", "settled"
"""Goals: the worst case of whole episodes, and of their second halves, when all robots have reached their places."""
LOST, SETTLED_TIME, GROWN, BEYOND = "lost", "settled_time", "still_growing", "beyond_edge"
"""Entries of a score row of planning: the robots that are removed, the worst-case undetected time of the second half of
the episode [s], whether the worst case is that of the last moment and longer than any before it, and the largest
distance of any part of a body beyond the edge of the rectangle [m]."""
MESSAGES = "nothing", "phases of ring neighbours", "positions of ring neighbours"
"""Contents of messages, those that are the least to communicate first; any other comes last."""


@dataclass(frozen=True)
class Plan:
    """A patrol that a team can run: a policy with its parameters on the scenario that it was made for."""

    family: str
    """Name of the family that generated it."""
    scenario: Scenario
    settings: PolicySettings
    about: str = ""
    """Description of what distinguishes it within its family."""

    @property
    def key(self) -> tuple:
        """Return what distinguishes it from every other plan."""
        given = self.settings
        return self.scenario.digest(), given.policy, repr(given.parameters), repr(given.coordinator)

    def named(self, name: str) -> "Plan":
        """Return the plan with another name of its scenario."""
        words = f"{self.settings.policy} ({self.about})." if self.about else f"{self.settings.policy}."
        return dataclasses.replace(self, scenario=dataclasses.replace(self.scenario, name=name, description=words))


@dataclass(frozen=True)
class Figures:
    """The figures of a plan from its episodes; a time without a bound is infinite."""

    worst_case: float
    """Worst-case undetected time of all episodes without failures [s]."""
    settled: float
    """The same of the second half of the episodes, when all robots have reached their places [s]."""
    worst_case_failed: float
    """The worst case of the episodes in which robots fail [s]; NaN without failures, infinite if robots collide."""
    detection_time: float
    """Mean detection time, mean over the episodes without failures [s]."""
    collisions: int
    """Collisions of the episodes without failures."""
    collisions_failed: int
    """Collisions of the episodes with failures."""
    clearance: float
    """Smallest distance between two bodies in the episodes without failures [m]; NaN for one robot."""
    outside: float
    """Largest distance of any part of a body beyond the edge of the rectangle in the episodes without failures [m]."""
    too_close: bool
    """True if two bodies come closer than the requested clearance in an episode, also of those with failures."""
    distance: float
    """Distance that a robot drives in a minute, mean over robots and episodes without failures [m/min]."""
    messages: str
    """Content of the messages that the policy uses."""
    detection_low: float = math.nan
    """Lower end of the 95 % interval of `detection_time`, by Student's t over the episodes [s]; NaN below two."""
    detection_high: float = math.nan
    """Upper end of the same [s]."""

    @property
    def objectives(self) -> tuple[float, ...]:
        """Return the numbers that a better plan has less of, the most important one first."""
        failed = 0.0 if math.isnan(self.worst_case_failed) else self.worst_case_failed
        rank = MESSAGES.index(self.messages) if self.messages in MESSAGES else len(MESSAGES)
        detection = math.inf if math.isnan(self.detection_time) else self.detection_time
        return float(self.too_close), self.worst_case, self.settled, failed, detection, self.distance, float(rank)

    @property
    def by_failures(self) -> tuple[float, ...]:
        """Return the same numbers, the worst case with failures first."""
        close, worst_case, settled, failed, *others = self.objectives
        return close, failed, worst_case, settled, *others


@dataclass(frozen=True)
class Planned:
    """A plan that was played to the end, and its figures."""

    plan: Plan
    figures: Figures
    limit: float
    """Lower bound of the worst-case undetected time of every policy [s]; NaN if nothing is proved."""
    rows: list[dict[str, Any]]
    """Score rows of the episodes without failures."""
    failed_rows: list[dict[str, Any]]
    """Score rows of the episodes with failures."""


def top_speed(task: Scenario) -> float:
    """Return the top speed of the robots of a task [m/s]; NaN for models that do not define it."""
    cars = like_cars(task)
    return robot_speed_limit(task) if cars is None else cars.robot.top_speed


UNITS: dict[str, Callable[[Scenario, float], float]] = {
    **dict.fromkeys(("cruise", "speed", "slowest"), lambda task, cruise: top_speed(task)),
    **dict.fromkeys(("inset", "bow", "settle"), lambda task, cruise: task.sensing_radius),
    "corner": corner_radius,
    "lookahead": lambda task, cruise: lookahead(task, cruise, SweepParameters()),
    "gather": lambda task, cruise: motion_scale(task).time,
}
"""Units of relative parameters by name, from a scenario of cars and the patrol's speed [m/s]: the top speed, the
sensing radius, the default of the parameter, or the time of the motion. Other parameters are used as they are."""


def absolute(relative: PolicySettings, task: Scenario, digits: int | None = None) -> PolicySettings:
    """Return a policy for cars whose parameters are in the units `UNITS` with parameters in SI units.

    Args:
        relative: The policy with relative parameters.
        task: The scenario.
        digits: Significant digits of the parameters; all by default.
    """
    cruise = relative.parameters.get("cruise", 1.0) * top_speed(task)
    given = dict(relative.parameters)
    for name in given.keys() & UNITS.keys():
        value = given[name] * UNITS[name](task, cruise)
        given[name] = value if digits is None else float(f"{value:.{digits}g}")
    return PolicySettings(relative.policy, given)


def figures_of(
    rows: Sequence[dict[str, Any]], failed: Sequence[dict[str, Any]], plan: Plan, messages: str, clearance: float
) -> Figures:
    """Return the figures of a plan.

    Args:
        rows: Score rows of the episodes without failures.
        failed: Those with failures.
        plan: The plan.
        messages: Content of the messages that its policy uses.
        clearance: Least distance of two bodies [m].
    """
    duration, body = plan.scenario.task.duration, 2 * plan.scenario.robot.radius
    detection_low, detection_high = t_interval(_of(DETECTION_TIME, rows))
    collisions_failed = sum(_of(COLLISIONS, failed))
    return Figures(
        worst_case=worst_case(rows),
        settled=max(bounds_of(rows, SETTLED_TIME)),
        worst_case_failed=math.inf if collisions_failed else worst_case(failed),
        detection_time=_mean(_of(DETECTION_TIME, rows)),
        collisions=sum(_of(COLLISIONS, rows)),
        collisions_failed=collisions_failed,
        clearance=min(_of(SEPARATION, rows)) - body,
        too_close=min(_of(SEPARATION, [*rows, *failed])) - body < clearance,
        outside=max(row[BEYOND] for row in rows),
        distance=_mean(_of(DISTANCE, rows)) / duration * 60,
        messages=messages,
        detection_low=detection_low,
        detection_high=detection_high,
    )


def worst_case(rows: Sequence[dict[str, Any]]) -> float:
    """Return the worst-case undetected time of some episodes [s]; infinite if one shows no bound, NaN for none."""
    return max(bounds_of(rows), default=math.nan)


def bounds_of(rows: Sequence[dict[str, Any]], name: str = WORST_CASE.name) -> list[float]:
    """Return a worst-case undetected time of each episode [s]; infinite if an episode shows no bound.

    That is so, too, where the time was still growing at the end, for less than half of the episode.
    """
    return [math.inf if row[OPEN.name] or row[GROWN] else row[name] for row in rows]


def t_interval(values: Sequence[float]) -> tuple[float, float]:
    """Return the ends of the 95 % interval of the mean of values, by Student's t; NaN for fewer than two.

    There are too few episodes of a plan for a bootstrap. Values that are NaN are left out.
    """
    from scipy.special import stdtrit  # slow to import

    known = np.array([value for value in values if not math.isnan(value)])
    if len(known) < 2:
        return math.nan, math.nan
    off = float(stdtrit(len(known) - 1, 0.975) * known.std(ddof=1) / math.sqrt(len(known)))
    return float(known.mean()) - off, float(known.mean()) + off


def _of(column: Column, rows: Sequence[dict[str, Any]]) -> list[Any]:
    return [row[column.name] for row in rows]


def _mean(values: Sequence[float]) -> float:
    """Return the mean of the values that are not NaN."""
    known = [value for value in values if not math.isnan(value)]
    return sum(known) / len(known) if known else math.nan


def dominates(one: Sequence[float], other: Sequence[float]) -> bool:
    """Return whether the objectives of one are nowhere worse than those of another, and somewhere better."""
    return all(a <= b for a, b in zip(one, other, strict=True)) and tuple(one) != tuple(other)


def pareto_optimal(planned: Sequence[Planned]) -> list[Planned]:
    """Return the plans without collisions that none of these dominates, by their worst-case undetected time.

    Of plans with equal objectives the first is returned; where plans differ in their number of robots, fewer are
    better.
    """
    by_objectives: dict[tuple[float, ...], Planned] = {}
    for plan in planned:
        if plan.figures.collisions == 0:
            by_objectives.setdefault((*plan.figures.objectives, float(plan.plan.scenario.num_robots)), plan)
    best = [one for one in by_objectives if not any(dominates(other, one) for other in by_objectives)]
    return [by_objectives[each] for each in sorted(best)]


def best_of(planned: Sequence[Planned]) -> list[Planned]:
    """Return the Pareto-optimal plans, the shortest worst case first; those with a bound alone if there is one."""
    bounded = [plan for plan in planned if plan.figures.worst_case < math.inf]
    return pareto_optimal(bounded) or pareto_optimal(planned)


def in_turn(lists: Sequence[Sequence[Any]]) -> Iterator[Any]:
    """Yield the first of each list, then the second of each."""
    nothing = object()
    for row in itertools.zip_longest(*lists, fillvalue=nothing):
        yield from (each for each in row if each is not nothing)
