"""Planning: the search on the task of each number of robots, and the Pareto-optimal plans that it finds."""

import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from baselines.planning import optimising
from baselines.planning.pareto import pareto_optimal
from baselines.planning.plans import Planned
from baselines.planning.playing import Episodes, quietly
from baselines.planning.request import Request
from baselines.planning.search import Search
from lissajous_env.episodes.limits import guaranteed_time_limit
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import whole_number
from lissajous_env.wording import shown

_LAST_SEED, _LONGEST = 2**31 - 1000, 10**6
"""Largest seed; longest time [s]."""
OnProgress = Callable[[float, "Outcome", Search], None]
"""Called during the planning with the time that has passed [s], the outcome so far, and the running search."""


@dataclass
class Outcome:
    """The result of a planning."""

    request: Request
    episodes: Episodes
    guarantee: float | None = None
    tasks: dict[int, Scenario] = field(default_factory=dict)
    """Scenarios on which plans were compared, by number of robots."""
    limits: dict[int, float] = field(default_factory=dict)
    """Lower bounds of the worst case of every policy [s], by number of robots; NaN if none is proved."""
    finals: list[Planned] = field(default_factory=list)
    """All plans that were played to the end."""
    refusals: dict[int, dict[str, str]] = field(default_factory=dict)
    """Reasons why families have no plan without collisions, by number of robots."""
    untried: dict[int, list[str]] = field(default_factory=dict)
    """Families of which there was no time to try a plan, by number of robots."""
    looks: int = 0
    """Number of plans that were looked at."""
    unplayed: int = 0
    """Number of defaults that were not played for lack of time."""
    broken: list[str] = field(default_factory=list)
    """Reasons of plans whose final episodes failed."""
    interrupted: bool = False

    @property
    def plans(self) -> list[Planned]:
        """Return the Pareto-optimal plans, the shortest worst case first; those with a bound alone if there is one."""
        bounded = [each for each in self.finals if each.figures.worst_case < math.inf]
        return pareto_optimal(bounded) or pareto_optimal(self.finals)

    @property
    def fewest_robots(self) -> int | None:
        """Return the fewest robots of a plan that guarantees the requested time; None if there is no such plan."""
        return min((each.plan.scenario.num_robots for each in self.plans if self.guarantees(each)), default=None)

    def guarantees(self, planned: Planned) -> bool:
        """Return whether a plan guarantees the requested time, also with failures if these were requested."""
        figures = planned.figures
        if self.guarantee is None or figures.collisions:
            return False
        failed = figures.worst_case_failed if self.episodes.failures else 0.0
        return max(figures.worst_case, failed) <= self.guarantee


def plan(
    scenario: str | os.PathLike[str] | Scenario | None = None,
    *,
    seconds: float = 60.0,
    optimise: bool = False,
    fixed_start: bool = False,
    on_progress: OnProgress | None = None,
    **requested: Any,
) -> Outcome:
    """Search for patrols of a team, simulate them, and return the Pareto-optimal plans with their scores.

    Args:
        scenario: Scenario from which missing values are taken; without it, the rectangle and the robots must be given.
        seconds: Duration of the search [s].
        optimise: True to improve free-form paths by CMA-ES too; requires the extra `plan`.
        fixed_start: True to include only plans whose robots begin where the scenario places them.
        on_progress: Called with the time that has passed [s], the outcome so far and the running search.
        **requested: The other arguments of `prepare`.

    Returns:
        The outcome; after Ctrl-C, with the plans that were simulated until then.

    Raises:
        ValueError: a value is invalid or missing.
    """
    check_time("seconds", seconds, 1.0)
    outcome = prepare(scenario, **requested)
    search(outcome, seconds, optimise, fixed_start, on_progress)
    return outcome


def prepare(
    scenario: str | os.PathLike[str] | Scenario | None = None,
    *,
    width: float | None = None,
    height: float | None = None,
    robots: int | Sequence[int] | None = None,
    robot_radius: float | None = None,
    sensor_radius: float | None = None,
    speed: float | None = None,
    turning_radius: float | None = None,
    rogue_speed: float | None = None,
    entry: str | None = None,
    failures: int = 0,
    guarantee: float | None = None,
    seed: int = 0,
) -> Outcome:
    """Check a request and make its tasks; return the outcome before the search.

    Args:
        scenario: Scenario from which missing values are taken; without it, the rectangle and the robots must be given.
        width: Width of the rectangle [m].
        height: Height of the rectangle [m].
        robots: Number of robots, or a pair of the smallest and the largest number.
        robot_radius: Radius of a robot's body [m].
        sensor_radius: Sensing radius [m].
        speed: Top speed of the robots [m/s].
        turning_radius: Radius of a car's tightest circle [m]; None for points on the curve, or the scenario's robots.
        rogue_speed: Top speed of evading targets [m/s].
        entry: Place where targets appear, as in `targets.entry`.
        failures: Robots that fail for good: each combination of as many is removed in an episode of its own, after a
            quarter of it; of more than 64 combinations, 64 are drawn at random.
        guarantee: Time within which every target must be detected [s]; the search ends at the smallest number of robots
            that achieves it.
        seed: Seed of the episodes and of the search.

    Raises:
        ValueError: a value is invalid or missing.
    """
    made = None if scenario is None else named.build(scenario)
    pair = (robots, robots) if isinstance(robots, int) else robots
    if pair is not None and (len(pair) != 2 or not all(isinstance(each, int) for each in pair)):
        raise ValueError(f"robots must be a number or a pair, the fewest and the most, got {shown(robots)}")
    request = Request(
        made, width, height, None if pair is None else (pair[0], pair[1]), robot_radius, sensor_radius, speed,
        turning_radius, rogue_speed, entry,
    )  # fmt: skip
    check_time("guarantee", guarantee, 1e-3)
    if not isinstance(failures, int) or not 0 <= failures < request.numbers[0]:
        rule = f"failures must be a whole number from 0 to {request.numbers[0] - 1}, fewer than the robots"
        raise ValueError(f"{rule}, got {shown(failures)}")
    outcome = Outcome(request, Episodes(whole_number("seed", seed, 0, _LAST_SEED), failures), guarantee)
    with quietly():
        for number in request.numbers:
            task = outcome.tasks[number] = request.task(number)
            outcome.limits[number] = guaranteed_time_limit(task)
    return outcome


def check_time(name: str, value: float | None, least: float) -> None:
    """Raise ValueError for a time that is out of its range [s]."""
    if value is not None and not least <= value <= _LONGEST:
        raise ValueError(f"{name} must be from {least:g} to {_LONGEST} [s], got {shown(value)}")


def search(
    outcome: Outcome,
    seconds: float,
    optimise: bool = False,
    fixed_start: bool = False,
    on_progress: OnProgress | None = None,
) -> None:
    """Search for plans for a time [s], and add them to an outcome; with a guarantee, until a team meets it.

    Raises:
        MissingExtraError: `optimise`, and the library for it is not installed.
    """
    check_time("seconds", seconds, 1.0)
    if optimise:
        optimising.require_cma()
    with quietly():
        _search(outcome, seconds, optimise, fixed_start, on_progress)


def _search(
    outcome: Outcome, seconds: float, optimise: bool, fixed_start: bool, on_progress: OnProgress | None
) -> None:
    """Search on the task of each number of robots; with a guarantee, from the fewest until one meets it."""
    begin = time.monotonic()
    # A team whose lower bound is above the requested time cannot meet it.
    open_ones = [n for n, limit in outcome.limits.items() if not (outcome.guarantee and limit > outcome.guarantee)]
    while open_ones and not outcome.interrupted and outcome.fewest_robots is None:
        number = open_ones.pop(0)
        gone = time.monotonic() - begin
        running = Search(outcome.tasks[number], outcome.episodes, seed=outcome.episodes.seed, fixed_start=fixed_start)
        running.run(
            max(seconds - gone, 0.0) / (len(open_ones) + 1),
            lambda passed, running=running, before=gone: (
                None if on_progress is None else on_progress(before + passed, outcome, running)
            ),
            optimise,
            outcome.guarantees,
        )
        outcome.finals += running.finals
        outcome.untried[number] = running.untried()
        outcome.refusals[number] = running.refusals()
        outcome.looks += len(running.looks)
        outcome.broken += running.broken
        outcome.unplayed += running.unplayed
        outcome.interrupted = running.interrupted
