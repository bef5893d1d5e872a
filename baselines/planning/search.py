"""The search for plans, which looks at plans of all families, and plays the best ones to the end and then more often.

There is a search for each number of robots; the outcome of a request has the plans that no other dominates.
"""

import dataclasses
import os
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from baselines.benchmark.best_known import BEST_KNOWN
from baselines.planning.families import DEFAULTS, families_of
from baselines.planning.plans import Family, Plan, Planned, Variables, best_of, in_turn, sorted_both_ways
from baselines.planning.rehearse import BEST_EPISODES, CONFIRMING_EPISODES, Episodes, LateError, look_at, play
from baselines.planning.request import PLANS, Request
from lissajous_env.device.devices import cores
from lissajous_env.episodes.lower_bounds import worst_case_lower_bound
from lissajous_env.parameters.assumptions import quietly
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import where_raised

AHEAD = 8
"""Plans that are begun before the first of them has ended; a search for a duration begins at most one for each core."""
_FINALS, _FEWEST_FINALS = 5, 3
"""Plans that are tried for one that is played to the end, and plans that are played to the end at least."""
_LOOKING = 0.7
"""Share of the time after which no plan is looked at."""
_CUTOFF = 3.0
"""Factor of the best plan's worst case beyond which looks end, and default policies are not played to the end."""
_FRUITLESS = 200
"""Changed plans in a row that cannot be made or are known already, after which the search stops."""
_LEAST = 1.0
"""Shortest duration of a search [s]."""


@dataclass(eq=False)
class Search:
    """A search for plans on one scenario.

    The plans of a budget in plans, and their figures, depend on the seed alone, not on the speed of the machine.
    """

    scenario: Scenario
    """Scenario on which plans are compared."""
    families: Sequence[Family]
    """Families of plans for the scenario."""
    episodes: Episodes = field(default_factory=Episodes)
    """Episodes of every plan."""
    plans: int = PLANS
    """Plans that are tried; a fifth as many of the best ones are then played to the end."""
    seconds: float | None = None
    """Duration of the search [s], in place of a number of plans."""
    seed: int = 0
    """Seed of the random changes."""
    fixed_start: bool = False
    """True to accept only plans whose robots begin where the scenario places them."""
    clock: Callable[[], float] = time.monotonic
    """Function that returns the time [s]."""
    interrupted: bool = field(default=False, init=False)
    """True after Ctrl-C."""
    broken: list[str] = field(default_factory=list, init=False)
    """Reasons of plans whose final episodes failed."""

    def __post_init__(self) -> None:
        self._finals: dict[tuple, Planned] = {}
        self._finals_max = max(_FEWEST_FINALS, self.plans // _FINALS)
        self._random = np.random.default_rng(self.seed)
        self._known: set[tuple] = set()
        """Keys of the plans that were looked at, or are being looked at."""

    @property
    def looks(self) -> list[Planned]:
        """Return all looks so far."""
        return [look for family in self.families for look in family.looks]

    @property
    def finals(self) -> list[Planned]:
        """Return the plans that were played to the end."""
        return list(self._finals.values())

    def refusals(self) -> dict[str, str]:
        """Return the reason for each family without a final plan that does not collide."""
        good = {final.plan.family for final in self.finals if final.figures.collisions == 0}
        played = Counter(final.plan.family for final in self.finals)
        return {family.name: family.reason(played[family.name]) for family in self.families if family.name not in good}

    def untried(self) -> list[str]:
        """Return the families of which no plan was tried, although they may have some."""
        return [family.name for family in self.families if family.first and not (family.looks or family.refused)]

    def run(self, on_progress: Callable[[float], None] = lambda _: None) -> None:
        """Search until the number of plans, or in its place the duration, is spent.

        The first Ctrl-C ends the search for plans, and a second one ends the final episodes of the best ones.

        Args:
            on_progress: Called with the share of the search that is done.
        """
        self._on_progress, self._begin = on_progress, self.clock()
        with ThreadPoolExecutor(min(cores(), AHEAD)) as threads:
            for stage in (self._look, self._finish, self._confirm):
                if self.interrupted and stage != self._finish:
                    continue
                try:
                    stage(threads)
                except KeyboardInterrupt:
                    self.interrupted = True

    def _done(self) -> float:
        """Return the share of the search that is done."""
        if self.seconds is not None:
            return (self.clock() - self._begin) / self.seconds
        return (len(self.looks) + len(self.finals)) / (self.plans + self._finals_max)

    def _is_late(self, results: Callable[[], Collection]) -> bool:
        """Return whether the time is over and there are results already, so that no others are needed."""
        return self.seconds is not None and self._done() > 1 and not self.interrupted and bool(results())

    def _look(self, threads: ThreadPoolExecutor) -> None:
        """Look at plans until their number, or a share of the time, is spent."""

        def is_over() -> bool:
            if self.seconds is None:
                return len(self._known) >= self.plans
            # Without a plan that may be played to the end there is nothing to print.
            return bool(self.looks) and self._done() > (_LOOKING if self._without_collisions() else 1.0)

        episodes = dataclasses.replace(self.episodes, is_late=partial(self._is_late, self._without_collisions))
        calls = ((family, partial(look_at, plan, episodes, self._cutoff())) for family, plan in self._plans())
        for family, look in self._in_order(threads, calls, is_over):
            if isinstance(look, str):
                family.refused.append(look)
            else:
                family.looks.append(look)

    def _without_collisions(self) -> list[Planned]:
        """Return the looks of all families without collisions."""
        return [look for family in self.families for look in family.without_collisions]

    def _cutoff(self) -> float:
        """Return the worst case beyond which a plan is not among the best ones [s]."""
        return _CUTOFF * min(family.best for family in self.families)

    def _plans(self) -> Iterator[tuple[Family, Plan]]:
        """Yield plans to look at: the first ones of all families in turn, then changed copies of the best."""
        for family, variables in in_turn([[(family, first) for first in family.first] for family in self.families]):
            yield from self._new(family, variables)
        fruitless = 0
        while fruitless < _FRUITLESS:
            growing = [family for family in self.families if family.choices and family.elite()]
            if not growing:
                return
            # The family with the best plan is searched about as much as all others together.
            family = min(growing, key=lambda family: family.best)
            if self._random.random() >= 0.5:
                family = growing[int(self._random.integers(len(growing)))]
            elite = family.elite()
            variables = elite[int(self._random.integers(len(elite)))]
            plans = list(self._new(family, family.changed(variables, self._random)))
            fruitless = 0 if plans else fruitless + 1
            yield from plans

    def _new(self, family: Family, variables: Variables) -> Iterator[tuple[Family, Plan]]:
        """Yield the plan of some values of a family, unless there is none or it was looked at."""
        try:
            plan = family.plan(variables)
        except ValueError as error:
            family.refused.append(str(error))
            return
        if self.fixed_start and plan.scenario.digest() != self.scenario.digest():
            family.refused.append("robots would begin elsewhere")
        elif plan.key not in self._known:
            self._known.add(plan.key)
            yield family, plan

    def _finish(self, threads: ThreadPoolExecutor) -> None:
        """Play the best plans to the end, and defaults that may be as good, so that none beats the printed plans."""
        looks, cutoff = self.ranked(), self._cutoff()
        defaults = [look.plan for look in looks if look.plan.family == DEFAULTS and look.figures.worst_case <= cutoff]
        plans = [look.plan for look in looks]
        if self.interrupted:
            plans, defaults = plans[:_FEWEST_FINALS], []
        elif self.seconds is None:
            plans = plans[: self._finals_max]
        self._play(threads, [(plan, self.episodes) for plan in [*plans, *defaults]])

    def _confirm(self, threads: ThreadPoolExecutor) -> None:
        """Play the best plans in more episodes until all of them have been: the worst of a few is seldom the worst."""
        more = True
        while more:
            best = best_of(self.finals)
            least = [BEST_EPISODES, *[CONFIRMING_EPISODES] * (len(best) - 1)]
            counts = [max(count, self.episodes.count) for count in least]
            more = self._play(threads, [
                (plan.plan, dataclasses.replace(self.episodes, count=count))
                for plan, count in zip(best, counts, strict=False) if len(plan.rows) < count
            ])  # fmt: skip

    def _play(self, threads: ThreadPoolExecutor, plans: Sequence[tuple[Plan, Episodes]]) -> bool:
        """Play plans to the end while there is time, and put them among the finals; return whether any was played."""
        late = partial(self._is_late, lambda: self._finals)
        calls = ((plan, partial(play, plan, dataclasses.replace(more, is_late=late))) for plan, more in plans)
        distinct = {plan.key: (plan, call) for plan, call in calls}
        played = False
        for plan, final in self._in_order(threads, iter(distinct.values()), late):
            played = True
            if isinstance(final, str):
                self._finals.pop(plan.key, None)
                self.broken.append(final)
            else:
                self._finals[plan.key] = final
        return played

    def _in_order(
        self,
        threads: ThreadPoolExecutor,
        calls: Iterator[tuple[Any, Callable[[], Planned]]],
        is_over: Callable[[], bool],
    ) -> Iterator[tuple[Any, Planned | str]]:
        """Run calls in threads, and yield the subject of each with its result, in the order in which they began.

        In place of a result, the reason of a failure is yielded: one policy that fails must not end the search. After
        the time of the search, results are left out.

        In a search for a number of plans, a call is taken from the iterator when the result of the one `AHEAD` before
        it has been used, whatever the number of cores and their load. So the results on which the next call depends
        are the same on every machine.
        """
        ahead = AHEAD if self.seconds is None else min(cores(), AHEAD)
        waiting: deque[tuple[Any, Future]] = deque()
        try:
            while True:
                while len(waiting) < ahead and not is_over() and (call := next(calls, None)) is not None:
                    waiting.append((call[0], threads.submit(call[1])))
                if not waiting:
                    return
                subject, future = waiting.popleft()
                if (result := _result_of(future)) is not None:
                    yield subject, result
                self._on_progress(self._done())
        finally:
            for _, future in waiting:
                future.cancel()

    def ranked(self) -> list[Planned]:
        """Return the plans that are worth playing to the end, the most important ones first.

        These are the best without and with failures, the best of each family and of each policy, then all by their
        worst-case undetected time.
        """
        collision_free, by_failed = sorted_both_ways(self._without_collisions())
        known = [look for look in collision_free if look.plan.family == BEST_KNOWN]
        families, policies = {}, {}
        for look in collision_free:
            families.setdefault(look.plan.family, look)
            policies.setdefault(look.plan.settings.policy, look)
        order = [*collision_free[:1], *known, *collision_free[1:2], *by_failed[:2], *families.values()]
        order += in_turn([collision_free, by_failed, list(policies.values())])
        return list({look.plan.key: look for look in order}.values())


def _result_of(future: Future) -> Planned | str | None:
    """Return the plan that was played, or the reason why it cannot be played; None if it is late."""
    try:
        return future.result()
    except LateError:
        return None
    except ValueError as error:
        return str(error)
    except Exception as error:  # a policy of a user may raise anything
        return where_raised(error)


@dataclass
class PlanOutcome:
    """The result of a search for plans."""

    request: Request
    scenarios: dict[int, Scenario] = field(default_factory=dict)
    """Scenarios on which plans were compared, by number of robots."""
    lower_bounds: dict[int, float] = field(default_factory=dict)
    """Lower bounds of the worst case of every policy [s], by number of robots; NaN if none is proved."""
    searches: dict[int, Search] = field(default_factory=dict)
    """Searches that were begun, by number of robots."""
    finals: list[Planned] = field(default_factory=list)
    """All plans that were played to the end by searches that have ended."""
    seconds: float = 0.0
    """Duration of the search [s]."""

    @classmethod
    def of(cls, request: Request) -> "PlanOutcome":
        """Return the outcome of a request before the search.

        Raises:
            ValueError: a value that a field of the scenario forbids.
        """
        with quietly():
            scenarios = {number: request.scenario_of(number) for number in request.team_sizes}
            bounds = {number: worst_case_lower_bound(scenario) for number, scenario in scenarios.items()}
        return cls(request, scenarios, bounds)

    @property
    def plans(self) -> list[Planned]:
        """Return the Pareto-optimal plans in the order of `best_of`; only those with a bound, if any."""
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

    def search(self, on_progress: Callable[[float, "PlanOutcome"], None] = lambda _, __: None) -> None:
        """Search for plans for each number of robots, and add them.

        With a guarantee, the search begins with the fewest robots, and ends at the first number for which a plan meets
        it.

        Args:
            on_progress: Called with the share that is done and the outcome so far.
        """
        request, begin = self.request, time.monotonic()
        # A team whose lower bound is above the requested time cannot meet it.
        numbers = [n for n, bound in self.lower_bounds.items() if not (request.guarantee and bound > request.guarantee)]
        for k, number in enumerate(numbers):

            def progress(share: float, before: int = k) -> None:
                on_progress((before + min(share, 1.0)) / len(numbers), self)

            with quietly():
                scenario = self.scenarios[number]
                families = families_of(scenario, request.required_clearance)
                left = (request.seconds or 0.0) - (time.monotonic() - begin)
                seconds = max(left / (len(numbers) - k), _LEAST) if request.seconds else None
                budget = request.plans or PLANS, seconds
                search = Search(scenario, families, request.episodes, *budget, request.seed, request.fixed_start)
                self.searches[number] = search
                search.run(progress)
            self.finals += search.finals
            if search.interrupted or self.fewest_robots is not None:
                break
        self.seconds = time.monotonic() - begin


def plan(
    scenario: str | os.PathLike[str] | Scenario | None = None,
    *,
    on_progress: Callable[[float, PlanOutcome], None] = lambda _, __: None,
    **requested: Any,
) -> PlanOutcome:
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
    outcome = PlanOutcome.of(Request(scenario, **requested))
    outcome.search(on_progress)
    return outcome
