"""The search: looks at plans of all families, plays the best ones to the end, and the very best in more episodes."""

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np

from baselines.benchmark.bounds import BEST_KNOWN as KNOWN
from baselines.planning.budget import Budget
from baselines.planning.families import FAMILIES
from baselines.planning.families.defaults import DEFAULTS
from baselines.planning.family import Family, Settings
from baselines.planning.free_paths import optimise
from baselines.planning.in_order import AHEAD, in_order
from baselines.planning.plans import SETTLED, WHOLE, Plan, Planned, best_of, in_turn
from baselines.planning.rehearse import BEST, CONFIRMED, Episodes, Look, look_at, play, reason_of
from baselines.policies.settings import PolicySettings
from lissajous_env.device.devices import cores
from lissajous_env.parameters.scenario import Scenario

_LOOKING = 0.7
"""Share of the time after which no plan is looked at."""
_LOOKING_LESS, _OPTIMISING = 0.25, 0.9
"""The same if free-form paths are optimised, and the share after which these end."""
_TIMED = DEFAULTS, KNOWN, "partition", "lines"
"""Families that may have plans of timed paths."""
_CUTOFF = 3.0
"""Looks end where the worst case is beyond that of the best plan by this factor, and worse defaults are not played."""
_FEWEST_FINALS = 3
"""Plans that are played to the end after Ctrl-C."""
_FRUITLESS = 200
"""Changed plans in a row that are none, or known, after which no family has more."""


class Search:
    """A search for plans on one task.

    The plans of a budget in plans, and their figures, depend on the seed alone, not on the speed of the machine.

    Args:
        task: The scenario on which plans are compared.
        episodes: The episodes of every plan.
        families: Functions that return the families of plans for a task.
        seed: Seed of the random changes.
        fixed_start: True for plans alone whose robots begin where the task places them.
        clock: Returns the time [s].
    """

    def __init__(
        self,
        task: Scenario,
        episodes: Episodes,
        families: Sequence[Callable[[Scenario], Family]] = FAMILIES,
        seed: int = 0,
        fixed_start: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ):
        self.task, self.episodes, self.fixed_start, self._seed = task, episodes, fixed_start, seed
        self._time = clock
        self._finals: dict[tuple, Planned] = {}
        self.interrupted = False
        self.broken: list[str] = []
        """Reasons of plans whose final episodes failed."""
        self._make_families, self.families = families, []
        self._random = np.random.default_rng(seed)
        self._known: set[tuple] = set()
        """Plans of which the looks were begun."""
        self._optimised: list[Plan] = []

    @property
    def looks(self) -> list[Look]:
        """Return all looks so far."""
        return [look for family in self.families for _, look in family.looks]

    @property
    def finals(self) -> list[Planned]:
        """Return the plans that were played to the end."""
        return list(self._finals.values())

    def refusals(self) -> dict[str, str]:
        """Return for each family without a final plan the reason."""
        finals = {each.plan.family for each in self.finals if each.figures.collisions == 0}
        return {family.name: family.why() for family in self.families if family.name not in finals}

    def untried(self) -> list[str]:
        """Return the families of which no plan was tried, although they may have some."""
        return [each.name for each in self.families if each.starts and not (each.looks or each.unmade)]

    def run(
        self, budget: Budget, on_progress: Callable[[float], None] = lambda _: None, free_paths: bool = False
    ) -> None:
        """Search until the budget is spent.

        Ctrl-C ends the search for plans, and once more the final episodes of the best ones.

        Args:
            budget: Extent of the search.
            on_progress: Called with the share of the search that is done.
            free_paths: True to improve free-form paths too.
        """
        self._budget, self._on_progress = budget, on_progress
        begin = self._time()
        self._clock = lambda: self._time() - begin
        self._ahead = AHEAD if budget.seconds is None else cores()
        self._optimises = free_paths and self.task.robot.kind == "car"
        self.families = [family_of(self.task) for family_of in self._make_families]
        with ThreadPoolExecutor(min(cores(), AHEAD)) as threads:
            for stage in (self._look, self._optimise, self._finish, self._confirm):
                if self.interrupted and stage != self._finish:
                    continue
                try:
                    stage(threads)
                except KeyboardInterrupt:
                    self.interrupted = True

    def _is_late(self, share: float = 1.0) -> bool:
        """Return whether a share of the time is over."""
        return self._budget.seconds is not None and self._clock() > share * self._budget.seconds

    def _report(self) -> None:
        """Report the share of the search that is done."""
        budget = self._budget
        if budget.seconds is not None:
            self._on_progress(self._clock() / budget.seconds)
        else:
            self._on_progress((len(self.looks) + len(self.finals)) / (budget.plans + budget.finals))

    def _look(self, threads: ThreadPoolExecutor) -> None:
        """Look at plans until their number, or a share of the time, is spent."""

        def is_over() -> bool:
            if self._budget.seconds is None:
                return len(self._known) >= self._budget.plans
            # Without a plan that may be played to the end there is nothing to print.
            share = _LOOKING_LESS if self._optimises else _LOOKING
            return bool(self.looks) and self._is_late(share if any(not look.fails for look in self.looks) else 1.0)

        calls = (
            ((family, settings), partial(look_at, plan, self.episodes, self._cutoff()))
            for family, settings, plan in self._plans()
        )
        for (family, settings), ended in in_order(threads, calls, is_over, self._report, self._ahead):
            family.looks.append((settings, ended.result()))

    def _cutoff(self) -> float:
        """Return the worst case beyond which a plan is not among the best ones [s]."""
        return _CUTOFF * min(family.best for family in self.families)

    def _plans(self) -> Iterator[tuple[Family, Settings, Plan]]:
        """Yield what to look at: the starts of all families in turn, then changed copies of the best."""
        for family, settings in in_turn([[(family, each) for each in family.starts] for family in self.families]):
            yield from self._new(family, settings)
        fruitless = 0
        while fruitless < _FRUITLESS:
            growing = [family for family in self.families if family.space and family.elite()]
            if not growing:
                return
            # The family with the best plan is searched about as much as all others together.
            family = min(growing, key=lambda family: family.best)
            if self._random.random() >= 0.5:
                family = growing[int(self._random.integers(len(growing)))]
            elite = family.elite()
            settings = elite[int(self._random.integers(len(elite)))]
            plans = list(self._new(family, family.changed(settings, self._random)))
            fruitless = 0 if plans else fruitless + 1
            yield from plans

    def _new(self, family: Family, settings: Settings) -> Iterator[tuple[Family, Settings, Plan]]:
        """Yield the plan of some settings with these, unless there is none or it is known."""
        try:
            plan = family.plan(settings)
        except ValueError as error:
            family.unmade.append(str(error))
            return
        if self.fixed_start and plan.scenario.digest() != self.task.digest():
            family.unmade.append("robots would begin elsewhere")
        elif plan.key not in self._known:
            self._known.add(plan.key)
            yield family, settings, plan

    def _optimise(self, threads: ThreadPoolExecutor) -> None:
        """Improve free-form paths, from the best plan of timed paths and the default, which has a reserve of speed."""
        budget = self._budget
        left = budget.plans if budget.seconds is None else _OPTIMISING * budget.seconds - self._clock()
        if not self._optimises or left <= 0:
            return
        timed = [look for look in self.looks if not look.fails and look.plan.family in _TIMED]
        orders = {WHOLE: lambda look: look.by_worst_case, SETTLED: lambda look: (look.settled, *look.by_worst_case)}
        default = Plan(DEFAULTS, self.task, PolicySettings("partition"))
        starts = {goal: [default, *(look.plan for look in sorted(timed, key=of)[:1])] for goal, of in orders.items()}
        clock = None if budget.seconds is None else self._time
        self._optimised = optimise(starts, left, self._report, self._seed, clock)

    def _finish(self, threads: ThreadPoolExecutor) -> None:
        """Play the best plans to the end, and all defaults that may be among them: no printed plan is worse."""
        looks, cutoff = self.ranked(), self._cutoff()
        defaults = [look.plan for look in looks if look.plan.family == DEFAULTS and look.worst_case <= cutoff]
        plans = [*self._optimised, *(look.plan for look in looks)]
        if self.interrupted:
            plans, defaults = plans[:_FEWEST_FINALS], []
        elif self._budget.seconds is None:
            plans = plans[: self._budget.finals]
        self._play(threads, [(plan, self.episodes) for plan in [*plans, *defaults]])

    def _confirm(self, threads: ThreadPoolExecutor) -> None:
        """Play the best plans in more episodes until all of them have been: the worst of a few is seldom the worst."""
        more = True
        while more:
            best = best_of(self.finals)
            counts = [max(count, self.episodes.count) for count in (BEST, *[CONFIRMED] * (len(best) - 1))]
            more = self._play(threads, [
                (each.plan, dataclasses.replace(self.episodes, count=count))
                for each, count in zip(best, counts, strict=False) if len(each.rows) < count
            ])  # fmt: skip

    def _play(self, threads: ThreadPoolExecutor, plans: Sequence[tuple[Plan, Episodes]]) -> bool:
        """Play plans to the end while there is time, and put them among the finals; return whether any was played."""
        distinct = {plan.key: (plan, partial(play, plan, episodes)) for plan, episodes in plans}

        def is_over() -> bool:
            return bool(self._finals) and not self.interrupted and self._is_late()

        played = False
        for plan, ended in in_order(threads, iter(distinct.values()), is_over, self._report, self._ahead):
            played = True
            try:
                self._finals[plan.key] = ended.result()
            except Exception as error:  # one policy that fails must not end the search
                self._finals.pop(plan.key, None)
                self.broken.append(reason_of(error))
        return played

    def ranked(self) -> list[Look]:
        """Return the plans that are worth to be played to the end, the most important ones first.

        These are the best without and with failures, the best of each family and of each policy, then all by their
        worst-case undetected time.
        """
        alive = sorted((look for look in self.looks if not look.fails), key=lambda look: look.by_worst_case)
        by_failed = sorted(alive, key=lambda look: look.by_failed)
        firsts = _first_of_each(alive, lambda look: look.plan.family)
        known = [look for look in alive if look.plan.family == KNOWN]
        policies = _first_of_each(alive, lambda look: look.plan.settings.policy)
        order = [*alive[:1], *known, *alive[1:2], *by_failed[:2], *firsts, *in_turn([alive, by_failed, policies])]
        return list({look.plan.key: look for look in order}.values())


def _first_of_each(looks: Sequence[Look], of: Callable[[Look], Any]) -> list[Look]:
    """Return the first look of each group."""
    return list({of(look): look for look in reversed(looks)}.values())[::-1]
