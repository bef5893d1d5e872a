"""Plans: a policy with its parameters on a scenario, the figures that its episodes have, and the families of plans."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from baselines.policies.as_cars import like_cars
from baselines.policies.loops import SweepParameters, corner_radius, lookahead
from baselines.policies.settings import PolicySettings
from baselines.policies.transit import radius_for_all_cars
from baselines.similarity import motion_scale
from lissajous_env.episodes.lower_bounds import robot_speed_limit
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import counted
from lissajous_env.world.columns import OPEN, WORST_CASE

LOST, SETTLED_TIME, GROWN, BEYOND = "lost", "settled_time", "still_growing", "beyond_edge"
"""Entries of a score row of planning: the robots that are removed, the worst-case undetected time of the second half of
the episode [s], whether the worst case of a whole episode is that of its last moment and longer than any before, and
the largest distance of any part of a body beyond the edge of the rectangle [m]."""
MESSAGES = "nothing", "phases of ring neighbours", "positions of ring neighbours"
"""Contents of messages, the smallest first; any other content comes last."""
Variables = Mapping[str, Any]
"""Values of the variables of a family, by name; each family has its own."""
Choices = tuple[float, float] | list[Any]
"""Values that a variable may have: a range of positive numbers, or a list."""
_ELITE = 4
"""Best plans of a family that are changed."""


@dataclass(frozen=True)
class Plan:
    """A patrol that a team can run: a policy with its parameters on the scenario that it was made for."""

    family: str
    """Name of the family that generated it."""
    scenario: Scenario
    settings: PolicySettings
    about: str = ""
    """Description of what distinguishes it within its family."""
    variables: Variables = field(default_factory=dict)
    """The values that its family made it of."""

    @property
    def key(self) -> tuple:
        """Return values by which two plans are the same."""
        given = self.settings
        return self.scenario.digest(), given.policy, repr(sorted(given.parameters.items())), repr(given.coordinator)


@dataclass(frozen=True)
class Figures:
    """Numbers that describe the episodes of a plan; a time without a bound is infinite."""

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
    """Lower end of the 95 % bootstrap interval of `detection_time` over the episodes [s]; NaN below two."""
    detection_high: float = math.nan
    """Upper end of the same [s]."""

    @property
    def objectives(self) -> tuple[float, ...]:
        """Return the numbers to minimise, the most important one first."""
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
    """A plan with the figures of the episodes in which it was played: short ones for a look, whole ones for a final."""

    plan: Plan
    figures: Figures
    rows: list[dict[str, Any]]
    """Score rows of the episodes without failures."""
    failed_rows: list[dict[str, Any]]
    """Score rows of the episodes with failures."""


def robots_top_speed(scenario: Scenario) -> float:
    """Return the top speed of the robots of a scenario, or of the cars that they move like [m/s]; NaN if undefined."""
    cars = like_cars(scenario)
    return robot_speed_limit(scenario) if cars is None else cars.robot.top_speed


UNITS: dict[str, Callable[[Scenario, float], float]] = {
    **dict.fromkeys(("cruise", "speed", "slowest"), lambda scenario, cruise: robots_top_speed(scenario)),
    **dict.fromkeys(("inset", "bow"), lambda scenario, cruise: scenario.sensing_radius),
    "corner": corner_radius,
    "turning": lambda scenario, cruise: radius_for_all_cars(like_cars(scenario) or scenario),
    "lookahead": lambda scenario, cruise: lookahead(scenario, cruise, SweepParameters()),
    "gather": lambda scenario, cruise: motion_scale(scenario).time,
}
"""Units of relative parameters by name, from a scenario of cars and the patrol's speed [m/s]: the top speed, the
sensing radius, the default of the parameter, the tightest turn, or the time of the motion. Other parameters are used as
they are."""


def absolute(relative: PolicySettings, scenario: Scenario, digits: int | None = None) -> PolicySettings:
    """Convert the parameters of a policy for cars from the units `UNITS` to SI units.

    Args:
        relative: The policy with relative parameters.
        scenario: The scenario.
        digits: Significant digits of the parameters; all by default.
    """
    cruise = relative.parameters.get("cruise", 1.0) * robots_top_speed(scenario)
    given = dict(relative.parameters)
    for name in given.keys() & UNITS.keys():
        value = given[name] * UNITS[name](scenario, cruise)
        given[name] = value if digits is None else float(f"{value:.{digits}g}")
    return PolicySettings(relative.policy, given)


def worst_cases(rows: Sequence[dict[str, Any]], name: str = WORST_CASE.name) -> list[float]:
    """Return the worst-case undetected time of each episode [s], by its column; infinite if an episode shows no bound.

    An episode whose time was still growing in its last step shows none, even if it is too short to be open (`OPEN`).
    """
    return [math.inf if row[OPEN.name] or row[GROWN] else row[name] for row in rows]


def pareto_optimal(planned: Sequence[Planned]) -> list[Planned]:
    """Return the plans without collisions that none of these dominates, by their worst-case undetected time.

    Plans that are too close come last. Of plans with equal objectives the first is returned; where plans differ in
    their number of robots, fewer are better.
    """
    by_objectives: dict[tuple[float, ...], Planned] = {}
    for plan in planned:
        if plan.figures.collisions == 0:
            by_objectives.setdefault((*plan.figures.objectives, float(plan.plan.scenario.num_robots)), plan)
    table = np.array(list(by_objectives))
    # A plan is dominated if another one is nowhere worse.
    best = sorted(one for one in by_objectives if (table <= one).all(axis=1).sum() == 1)
    return [by_objectives[objectives] for objectives in best]


def best_of(planned: Sequence[Planned]) -> list[Planned]:
    """Return the Pareto-optimal plans, the shortest worst case first and those that are too close last.

    Only those with a bound are returned, if there are any.
    """
    bounded = [plan for plan in planned if plan.figures.worst_case < math.inf]
    return pareto_optimal(bounded) or pareto_optimal(planned)


def sorted_both_ways(planned: Sequence[Planned]) -> tuple[list[Planned], list[Planned]]:
    """Return plans with the best one first, by their figures without failures and by those with failures."""
    by_worst = sorted(planned, key=lambda plan: plan.figures.objectives)
    return by_worst, sorted(by_worst, key=lambda plan: plan.figures.by_failures)


def in_turn(lists: Sequence[Sequence[Any]]) -> Iterator[Any]:
    """Yield the first of each list, then the second of each."""
    for row in itertools.zip_longest(*lists):
        yield from (item for item in row if item is not None)


@dataclass
class Family:
    """A family of plans for a scenario: it makes each plan of values of its variables, which a search may change."""

    name: str
    make: Callable[[Variables], Plan] | None = None
    """Function that returns the plan of some values, or raises ValueError if there is no such plan."""
    first: Sequence[Variables] = ()
    """Values that are tried first, the most promising ones first; none if the family does not fit the scenario."""
    choices: Mapping[str, Choices] = field(default_factory=dict)
    """Values that the variables may have; empty for a family whose plans are not changed."""
    refusal: str = ""
    """Reason why the family has no plan for the scenario; "" if it may have some."""
    looks: list[Planned] = field(default_factory=list)
    """Plans that were looked at."""
    refused: list[str] = field(default_factory=list)
    """Reasons for which values did not become plans."""

    def plan(self, variables: Variables) -> Plan:
        """Return the plan of some values.

        Raises:
            ValueError: there is no such plan.
        """
        assert self.make is not None
        return dataclasses.replace(self.make(variables), variables=variables)

    @property
    def without_collisions(self) -> list[Planned]:
        """Return the plans that were looked at and did not collide."""
        return [look for look in self.looks if not look.figures.collisions]

    @property
    def best(self) -> float:
        """Return the least worst-case undetected time of plans that are not too close [s]."""
        looks = (look.figures for look in self.without_collisions)
        return min((figures.worst_case for figures in looks if not figures.too_close), default=math.inf)

    def elite(self) -> list[Variables]:
        """Return the values of the best plans, alternately without and with failures."""
        both_ways = in_turn(sorted_both_ways(self.without_collisions))
        return [look.plan.variables for look in itertools.islice(both_ways, 2 * _ELITE)]

    def changed(self, variables: Variables, random: np.random.Generator) -> dict[str, Any]:
        """Return changed values: about a third are drawn anew, numbers within a factor of about 1.25."""
        child, names = dict(variables), list(self.choices)
        for name in random.permutation(names)[: 1 + random.binomial(len(names) - 1, 0.33)]:
            child[str(name)] = _drawn(self.choices[name], child.get(name), random)
        return child

    def reason(self, collided_later: int = 0) -> str:
        """Return the reason why the family has no plan, with numbers.

        Args:
            collided_later: Number of plans that collided when they were played to the end.
        """
        if self.refusal:
            return self.refusal
        if not (self.looks or self.refused):
            return "the search ended before it tried one"
        words = [f"{counted(len(self.looks), 'plan')} tried"]
        if collided := [look for look in self.looks if look.figures.collisions]:
            fewest = min(collided, key=lambda look: look.figures.collisions).plan
            words.append(f"{len(collided)} with collisions, for example {fewest.settings.policy} ({fewest.about})")
        if self.refused:
            words.append(f"{len(self.refused)} cannot be made: {self.refused[0]}")
        if self.without_collisions:
            ends = f"{collided_later} of them collided in simulations" if collided_later else "none was simulated"
            words.append(f"{len(self.without_collisions)} without collisions, but {ends} to the end")
        return "; ".join(words)


def _drawn(choices: Choices, near: Any, random: np.random.Generator) -> Any:
    """Draw a value from choices; in a range, one near the given number if there is one."""
    if isinstance(choices, list):
        return choices[int(random.integers(len(choices)))]
    low, high = choices
    if near is None:
        value = math.exp(random.uniform(math.log(low), math.log(high)))
    else:
        value = near * math.exp(0.22 * random.standard_normal())
    return float(f"{min(max(value, low), high):.4g}")
