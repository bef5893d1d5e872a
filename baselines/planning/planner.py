"""Planning: the search on the task of each number of robots, and the Pareto-optimal plans that it finds."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from baselines.planning.families import families_apart
from baselines.planning.plans import Planned, best_of
from baselines.planning.rehearse import quietly
from baselines.planning.request import PLANS, Request
from baselines.planning.search import Search
from lissajous_env.episodes.limits import guaranteed_time_limit
from lissajous_env.parameters.scenario import Scenario

_LEAST = 1.0
"""Shortest duration of a search [s]."""
OnProgress = Callable[[float, "Outcome"], None]
"""Called during the planning with the share that is done and the outcome so far."""


@dataclass
class Outcome:
    """The result of a planning."""

    request: Request
    tasks: dict[int, Scenario] = field(default_factory=dict)
    """Scenarios on which plans were compared, by number of robots."""
    limits: dict[int, float] = field(default_factory=dict)
    """Lower bounds of the worst case of every policy [s], by number of robots; NaN if none is proved."""
    searches: dict[int, Search] = field(default_factory=dict)
    """Searches that were begun, by number of robots."""
    finals: list[Planned] = field(default_factory=list)
    """All plans that were played to the end by searches that have ended."""
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
        """Return the Pareto-optimal plans, the shortest worst case first; only those with a bound, if any."""
        return best_of(self.finals)

    @property
    def looks(self) -> int:
        """Return the number of plans that were looked at."""
        return sum(len(search.looks) for search in self.searches.values())

    @property
    def interrupted(self) -> bool:
        """Return whether Ctrl-C ended a search."""
        return any(search.interrupted for search in self.searches.values())

    @property
    def refusals(self) -> dict[int, dict[str, str]]:
        """Return the reasons why families have no plan without collisions, by number of robots."""
        return {number: search.refusals() for number, search in self.searches.items()}

    @property
    def untried(self) -> list[str]:
        """Return the families of which a search tried no plan, although they may have some."""
        return list(dict.fromkeys(name for search in self.searches.values() for name in search.untried()))

    @property
    def fewest_robots(self) -> int | None:
        """Return the fewest robots of a plan that guarantees the requested time; None if there is no such plan."""
        return min((entry.plan.scenario.num_robots for entry in self.plans if self.guarantees(entry)), default=None)

    def guarantees(self, planned: Planned) -> bool:
        """Return whether a plan guarantees the requested time, also with failures if these were requested."""
        figures = planned.figures
        if self.request.guarantee is None or figures.collisions or figures.too_close:
            return False
        failed = figures.worst_case_failed if self.request.failures else 0.0
        return max(figures.worst_case, failed) <= self.request.guarantee

    def search(self, on_progress: OnProgress | None = None) -> None:
        """Search for plans on the task of each number of robots, and add them.

        With a guarantee, the search begins with the fewest robots, and ends at the first number for which a plan meets
        it.

        Args:
            on_progress: Called with the share that is done and the outcome so far.
        """
        request, begin = self.request, time.monotonic()
        # A team whose lower bound is above the requested time cannot meet it.
        guarantee = request.guarantee
        open_ones = [number for number, limit in self.limits.items() if not (guarantee and limit > guarantee)]
        for k, number in enumerate(open_ones):
            families = families_apart(request.clearance)
            search = Search(self.tasks[number], request.episodes, families, request.seed, request.fixed_start)
            self.searches[number] = search
            left = None if request.seconds is None else request.seconds - (time.monotonic() - begin)
            part = None if left is None else max(left / (len(open_ones) - k), _LEAST)

            def progress(share: float, before: int = k) -> None:
                if on_progress is not None:
                    on_progress((before + min(share, 1.0)) / len(open_ones), self)

            with quietly():
                search.run(request.plans or PLANS, part, progress)
            self.finals += search.finals
            if search.interrupted or self.fewest_robots is not None:
                break
        self.seconds = time.monotonic() - begin


def plan(
    scenario: str | os.PathLike[str] | Scenario | None = None,
    *,
    on_progress: OnProgress | None = None,
    **requested: Any,
) -> Outcome:
    """Search for patrols of a team, simulate them, and return the Pareto-optimal plans with their scores.

    Args:
        scenario: Scenario from which missing values are taken; without it, the rectangle and the robots must be given.
        on_progress: Called with the share that is done and the outcome so far.
        **requested: The other fields of `baselines.planning.request.Request`.

    Returns:
        The outcome; after Ctrl-C, with the plans that were simulated until then.

    Raises:
        ValueError: a value is invalid or missing.
    """
    outcome = Outcome.of(Request(scenario, **requested))
    outcome.search(on_progress)
    return outcome
