"""Planning: the search on the task of each number of robots, and the Pareto-optimal plans that it finds."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from baselines.planning import free_paths
from baselines.planning.budget import Budget
from baselines.planning.families import families_apart
from baselines.planning.plans import Planned, best_of
from baselines.planning.rehearse import quietly
from baselines.planning.request import Request
from baselines.planning.search import Search
from lissajous_env.episodes.limits import guaranteed_time_limit
from lissajous_env.parameters.scenario import Scenario

OnProgress = Callable[[float, "Outcome", Search], None]
"""Called during the planning with the share that is done, the outcome so far, and the running search."""


@dataclass
class Outcome:
    """The result of a planning."""

    request: Request
    tasks: dict[int, Scenario] = field(default_factory=dict)
    """Scenarios on which plans were compared, by number of robots."""
    limits: dict[int, float] = field(default_factory=dict)
    """Lower bounds of the worst case of every policy [s], by number of robots; NaN if none is proved."""
    finals: list[Planned] = field(default_factory=list)
    """All plans that were played to the end."""
    refusals: dict[int, dict[str, str]] = field(default_factory=dict)
    """Reasons why families have no plan without collisions, by number of robots."""
    untried: dict[int, list[str]] = field(default_factory=dict)
    """Families of which no plan was tried, by number of robots."""
    looks: int = 0
    """Number of plans that were looked at."""
    broken: list[str] = field(default_factory=list)
    """Reasons of plans whose final episodes failed."""
    interrupted: bool = False
    budget: Budget = field(default_factory=Budget)
    """Extent of the search."""
    seconds: float = 0.0
    """Duration of the search [s]."""

    @classmethod
    def of(cls, request: Request) -> "Outcome":
        """Return the outcome of a request before the search.

        Raises:
            ValueError: a value that a field of the scenario forbids.
        """
        with quietly():
            tasks = {number: request.task(number) for number in request.numbers}
            return cls(request, tasks, {number: guaranteed_time_limit(task) for number, task in tasks.items()})

    @property
    def plans(self) -> list[Planned]:
        """Return the Pareto-optimal plans, the shortest worst case first; those with a bound alone if there is one."""
        return best_of(self.finals)

    @property
    def fewest_robots(self) -> int | None:
        """Return the fewest robots of a plan that guarantees the requested time; None if there is no such plan."""
        return min((each.plan.scenario.num_robots for each in self.plans if self.guarantees(each)), default=None)

    def guarantees(self, planned: Planned) -> bool:
        """Return whether a plan guarantees the requested time, also with failures if these were requested."""
        figures = planned.figures
        if self.request.guarantee is None or figures.collisions or figures.too_close:
            return False
        failed = figures.worst_case_failed if self.request.failures else 0.0
        return max(figures.worst_case, failed) <= self.request.guarantee

    def search(
        self,
        budget: Budget | None = None,
        optimise: bool = False,
        fixed_start: bool = False,
        on_progress: OnProgress | None = None,
    ) -> None:
        """Search for plans on the task of each number of robots, and add them.

        With a guarantee, the search begins with the fewest robots and ends with those of whom a plan meets it.

        Args:
            budget: Extent of the search: plans for each number of robots, or the duration of all.
            optimise: True to improve free-form paths by CMA-ES too; requires the extra `plan`.
            fixed_start: True to include only plans whose robots begin where the scenario places them.
            on_progress: Called with the share that is done, the outcome so far and the running search.

        Raises:
            MissingExtraError: `optimise`, and the library for it is not installed.
        """
        if optimise:
            free_paths.require_cma()
        self.budget, begin = budget or Budget(), time.monotonic()
        guarantee, seed = self.request.guarantee, self.request.seed
        # A team whose lower bound is above the requested time cannot meet it.
        open_ones = [number for number, limit in self.limits.items() if not (guarantee and limit > guarantee)]
        count = len(open_ones)
        while open_ones and not self.interrupted and self.fewest_robots is None:
            number = open_ones.pop(0)
            families = families_apart(self.request.clearance)
            running = Search(self.tasks[number], self.request.episodes, families, seed, fixed_start)

            def progress(share: float, running: Search = running, before: int = count - len(open_ones) - 1) -> None:
                if on_progress is not None:
                    on_progress((before + min(share, 1.0)) / count, self, running)

            part = self.budget.part(time.monotonic() - begin, len(open_ones) + 1)
            with quietly():
                running.run(part, progress, optimise)
            self.finals += running.finals
            self.untried[number] = running.untried()
            self.refusals[number] = running.refusals()
            self.looks += len(running.looks)
            self.broken += running.broken
            self.interrupted = running.interrupted
        self.seconds = time.monotonic() - begin


def plan(
    scenario: str | os.PathLike[str] | Scenario | None = None,
    *,
    plans: int | None = None,
    seconds: float | None = None,
    optimise: bool = False,
    fixed_start: bool = False,
    on_progress: OnProgress | None = None,
    **requested: Any,
) -> Outcome:
    """Search for patrols of a team, simulate them, and return the Pareto-optimal plans with their scores.

    Args:
        scenario: Scenario from which missing values are taken; without it, the rectangle and the robots must be given.
        plans: Number of plans that are tried for each number of robots, 200 by default; a fifth as many of the best
            ones are then played to the end.
        seconds: Duration of the search [s], in place of a number of plans.
        optimise: True to improve free-form paths by CMA-ES too; requires the extra `plan`.
        fixed_start: True to include only plans whose robots begin where the scenario places them.
        on_progress: Called with the share that is done, the outcome so far and the running search.
        **requested: The other fields of `baselines.planning.request.Request`.

    Returns:
        The outcome; after Ctrl-C, with the plans that were simulated until then.

    Raises:
        ValueError: a value is invalid or missing.
    """
    budget = Budget.of(plans, seconds)
    outcome = Outcome.of(Request(scenario, **requested))
    outcome.search(budget, optimise, fixed_start, on_progress)
    return outcome
