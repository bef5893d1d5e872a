"""The search: looks at the first plan of each family, the defaults, then more looks, and final episodes of the best."""

import dataclasses
import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
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
from baselines.planning.rehearse import CONFIRMED, Episodes, Look, look_at, play, reason_of
from baselines.policies.patience import StoppedError
from baselines.policies.settings import PolicySettings
from lissajous_env.device.devices import cores
from lissajous_env.parameters.scenario import Scenario

_FIRSTS = 0.7
"""Share of the time after which the looks at the first plan of each family end."""
_DEFAULTS, _LOOKING = 0.7, 0.7
"""Shares of the time after which no default is begun, and after which no plan is looked at."""
_LOOKING_LESS, _OPTIMISING = 0.25, 0.9
"""Shares of the time after which no plan is looked at if free-form paths are optimised, and after which these end."""
_TIMED = DEFAULTS, KNOWN, "partition", "lines"
"""Families that may have plans of timed paths."""
_STARTS = 1
"""Plans from which free-form paths are optimised for each goal besides the default partition, the best first."""
_LATEST = 0.85
"""Share of the time after which the episodes of the defaults are ended."""
_CUTOFF = 3.0
"""Looks and episodes of defaults end where the worst case is beyond that of the best plan by this factor."""
_FEWEST_FINALS = 3
"""Plans that are played to the end after Ctrl-C."""
_STOPPED = "the time ended before it was played to the end"

Job = tuple[Family, Settings, Plan]
"""A plan that is to be looked at, with its family and its settings in it."""


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
        self.finals: list[Planned] = []
        self.interrupted = False
        self.unplayed = 0
        """Defaults that the budget left out."""
        self.broken: list[str] = []
        """Reasons of plans whose final episodes failed."""
        self._make_families, self.families = families, []
        self._random = np.random.default_rng(seed)
        self._known: set[tuple] = set()
        """Plans of which the looks, or the final episodes of a default, were begun."""
        self._played: set[tuple] = set()
        """Plans of which the final episodes were begun."""
        self._optimised: list[Plan] = []
        self._longest = 0.0
        """Duration of the longest final episodes of a plan so far [s]."""

    @property
    def looks(self) -> list[Look]:
        """Return all first looks so far."""
        return [look for family in self.families for _, look in family.looks]

    def refusals(self) -> dict[str, str]:
        """Return for each family without a final plan the reason."""
        finals = {each.plan.family for each in self.finals if each.figures.collisions == 0}
        return {family.name: family.why() for family in self.families if family.name not in finals}

    def untried(self) -> list[str]:
        """Return the families of which no plan was tried, although they may have some."""
        return [each.name for each in self.families if each.starts and not (each.looks or each.unmade)]

    def run(
        self,
        budget: Budget,
        on_progress: Callable[[float], None] = lambda _: None,
        free_paths: bool = False,
        is_enough: Callable[[Planned], bool] = lambda _: False,
    ) -> None:
        """Search until the budget is spent.

        Ctrl-C ends the search for plans, and once more the final episodes of the best ones.

        Args:
            budget: Extent of the search.
            on_progress: Called with the share of the search that is done.
            free_paths: True to improve free-form paths too.
            is_enough: Returns whether a plan that was played to the end ends the search.
        """
        self._is_enough, self._budget = is_enough, budget
        self._optimises = free_paths and self.task.robot.kind == "car"
        begin = self._time()
        self._clock = lambda: self._time() - begin
        self.families = [family_of(self.task) for family_of in self._make_families]
        self._on_progress = on_progress
        with ThreadPoolExecutor(min(cores(), AHEAD)) as threads:
            looking = self._look_at_firsts, self._play_defaults, self._look, self._optimise
            for stages in (looking, (self._finish,), (self._confirm,)):
                try:
                    for stage in stages:
                        if not self._is_met or stage == self._confirm:
                            stage(threads)
                except KeyboardInterrupt:
                    self.interrupted = True

    @property
    def _is_met(self) -> bool:
        """Return whether a plan satisfies the required guarantee."""
        return any(self._is_enough(each) for each in self.finals)

    @property
    def best(self) -> float:
        """Return the least worst-case undetected time of a plan that was played to the end and stays clear [s]."""
        figures = [each.figures for each in self.finals]
        safe = [each.worst_case for each in figures if not (each.collisions or each.too_close)]
        return min(safe, default=math.inf)

    def _is_spent(self, share: float) -> bool:
        """Return whether no further plan is tried: their number, or a share of the time, is spent."""
        if self._budget.seconds is None:
            return len(self._known) >= self._budget.plans
        return self._clock() > share * self._budget.seconds

    def _is_late(self, share: float) -> bool:
        """Return whether a share of the time is over, unless no plan was played yet: there is nothing to print."""
        seconds = self._budget.seconds
        return seconds is not None and bool(self.finals) and self._clock() > share * seconds

    def _report(self) -> None:
        """Report the share of the search that is done."""
        budget = self._budget
        if budget.seconds is not None:
            self._on_progress(self._clock() / budget.seconds)
        else:
            self._on_progress((len(self.looks) + len(self.finals)) / (budget.plans + budget.finals))

    def _play_defaults(self, threads: ThreadPoolExecutor) -> None:
        """Play the defaults to the end, and in turn with them the best plans so far.

        Those that turn out to be worse than another plan are not played to the end.
        """
        plans = [family.plan(settings) for family in self._of(DEFAULTS) for settings in family.starts]
        if not plans:
            return
        waiting = in_turn([plans, [look.plan for look in self.ranked()[: len(plans)]]])
        # A default that is worse in a few episodes may be better in more of them, or with failures.
        for look in self._play(threads, waiting, lambda: self._is_spent(_DEFAULTS), _LATEST, _CUTOFF):
            for family in self._of(DEFAULTS) if look.plan.family == DEFAULTS else ():
                family.looks.append(({"policy": look.plan.settings.policy}, look))
        self.unplayed = sum(plan.key not in self._played for plan in plans)
        self._known |= {plan.key for plan in plans}

    def _of(self, name: str) -> list[Family]:
        """Return the family of a name, if the search has it."""
        return [family for family in self.families if family.name == name]

    def _play(
        self,
        threads: ThreadPoolExecutor,
        plans: Iterator[Plan],
        is_over: Callable[[], bool],
        share: float,
        slack: float = math.inf,
    ) -> Iterator[Look]:
        """Play the final episodes of plans, and yield what is known of each.

        Args:
            threads: Threads that play them.
            plans: The plans.
            is_over: Returns whether no further plan begins.
            share: Share of the time at which the episodes end.
            slack: Factor of the best worst case so far beyond which a plan is not played to the end.
        """

        def begun(plan: Plan) -> tuple[Plan, Callable]:
            self._played.add(plan.key)
            self._known.add(plan.key)
            return plan, partial(self._played_within, plan, share, slack * self.best if slack < math.inf else math.inf)

        for plan, ended in in_order(threads, map(begun, plans), is_over, self._report):
            yield self._outcome_of(ended, plan)
            if self._is_met:
                return

    def _played_within(
        self, plan: Plan, share: float, cutoff: float, abandoned: Callable[[], bool]
    ) -> tuple[Planned | None, float]:
        """Play the final episodes of a plan; return the result, and the duration [s]."""
        begin = self._clock()
        planned = play(plan, self.episodes, lambda: abandoned() or self._is_late(share), cutoff)
        return planned, self._clock() - begin

    def _outcome_of(self, ended: Future, plan: Plan) -> Look:
        """Add a plan to the final ones if it was played to the end, and return what is known of it."""
        try:
            planned, duration = ended.result()
        except StoppedError:
            return Look(plan, 0, math.inf, math.inf, refusal=_STOPPED)
        except Exception as error:  # one policy that fails must not end the search
            return Look(plan, 0, math.inf, math.inf, refusal=reason_of(error))
        if planned is None:
            return Look(plan, 0, math.inf, math.inf, refusal="another default is better")
        self.finals.append(planned)
        self._longest = max(self._longest, duration)
        figures = planned.figures
        times = figures.worst_case, figures.worst_case_failed, figures.settled
        return Look(plan, figures.collisions, *times, too_close=figures.too_close)

    def _look_at_firsts(self, threads: ThreadPoolExecutor) -> None:
        """Look at the first plan of each family."""
        families = [family for family in self.families if family.name != DEFAULTS]
        firsts = (
            itertools.islice((job for given in family.starts for job in self._new(family, given)), 1)
            for family in families
        )
        share = min(_FIRSTS, _LOOKING_LESS) if self._optimises else _FIRSTS
        self._look_at(threads, itertools.chain.from_iterable(firsts), share)

    def _look(self, threads: ThreadPoolExecutor) -> None:
        """Look at plans until the budget for it is spent."""
        self._look_at(threads, self._jobs(), _LOOKING_LESS if self._optimises else _LOOKING)

    def _look_at(self, threads: ThreadPoolExecutor, jobs: Iterator[Job], share: float) -> None:
        """Look at the plans of some jobs until their number, or a share of the time, is spent."""

        def is_over() -> bool:
            # Without a plan that may be played to the end there is nothing to print.
            enough = share if any(not look.fails for look in self.looks) else 1.0
            return bool(self.looks) and self._is_spent(enough)

        def look(plan: Plan, cutoff: float, abandoned: Callable[[], bool]) -> Look:
            in_time = self._budget.seconds is not None
            return look_at(plan, self.episodes, cutoff, lambda: abandoned() or (in_time and is_over()))

        begun = ((job, partial(look, job[2], self._cutoff())) for job in jobs)
        for (family, settings, plan), ended in in_order(threads, begun, is_over, self._report):
            try:
                family.looks.append((settings, ended.result()))
            except StoppedError:
                self._known.discard(plan.key)

    def _optimise(self, threads: ThreadPoolExecutor) -> None:
        """Improve free-form paths, from the best plans of timed paths."""
        budget = self._budget
        left = budget.populations if budget.seconds is None else _OPTIMISING * budget.seconds - self._clock()
        if not self._optimises or left <= 0:
            return
        timed = [look for look in self.looks if not look.fails and look.plan.family in _TIMED]
        orders = {WHOLE: lambda look: look.by_worst_case, SETTLED: lambda look: (look.settled, *look.by_worst_case)}
        # The default has a reserve of speed, which the best ones lack.
        default = Plan(DEFAULTS, self.task, PolicySettings("partition"))
        starts = {
            goal: [default, *(look.plan for look in sorted(timed, key=of)[:_STARTS])] for goal, of in orders.items()
        }
        clock = None if budget.seconds is None else self._time
        self._optimised = optimise(starts, left, self._report, self._seed, clock)

    def _cutoff(self) -> float:
        return _CUTOFF * min(self.best, *(family.best for family in self.families))

    def _jobs(self) -> Iterator[Job]:
        """Yield what to look at: the starts of all families in turn, then changed copies of the best."""
        for family, settings in in_turn([[(family, each) for each in family.starts] for family in self.families]):
            if family.name != DEFAULTS:
                yield from self._new(family, settings)
        fruitless = 0
        while fruitless < 200:
            growing = [family for family in self.families if family.space and family.elite()]
            if not growing:
                return
            # The family with the best plan is searched about as much as all others together.
            family = min(growing, key=lambda family: family.best)
            if self._random.random() >= 0.5:
                family = growing[int(self._random.integers(len(growing)))]
            elite = family.elite()
            settings = elite[int(self._random.integers(len(elite)))]
            jobs = list(self._new(family, family.changed(settings, self._random)))
            fruitless = 0 if jobs else fruitless + 1
            yield from jobs

    def _new(self, family: Family, settings: Settings) -> Iterator[Job]:
        """Yield a look at the plan of some settings, unless there is none or it is known."""
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

    def _finish(self, threads: ThreadPoolExecutor) -> None:
        """Play the best plans to the end, the best first, until the budget for it is spent."""
        waiting = [*self._optimised, *(look.plan for look in self.ranked())]
        waiting = [plan for plan in waiting if plan.key not in self._played]
        if self.interrupted or self._budget.seconds is None:
            waiting = waiting[: _FEWEST_FINALS if self.interrupted else self._budget.finals]
        share = math.inf if self.interrupted else 1.0
        looks = list(self._play(threads, iter(waiting), lambda: not self._may_begin(), share))
        self.broken += [look.refusal for look in looks if look.refusal not in ("", _STOPPED)]

    def _confirm(self, threads: ThreadPoolExecutor) -> None:
        """Play the best plans in more episodes until all of them have been: the worst of a few is seldom the worst."""
        confirmed = dataclasses.replace(self.episodes, count=max(CONFIRMED, self.episodes.count))
        longest = self._longest * confirmed.count / self.episodes.count

        def is_over() -> bool:
            seconds = self._budget.seconds
            return self.interrupted or (seconds is not None and self._clock() + longest > seconds)

        while True:
            best = {each.plan.key: each.plan for each in best_of(self.finals) if len(each.rows) < confirmed.count}
            calls = ((plan, partial(play, plan, confirmed)) for plan in best.values())
            again = {plan.key: ended for plan, ended in in_order(threads, calls, is_over, self._report)}
            if not again:
                return
            self.finals = [again[each.plan.key].result() if each.plan.key in again else each for each in self.finals]

    def _may_begin(self) -> bool:
        """Return whether there is time for final episodes of the longest duration so far."""
        seconds = self._budget.seconds
        few = len(self.finals) < _FEWEST_FINALS and (self.interrupted or not self.finals)
        return few or seconds is None or self._clock() + self._longest < seconds

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
