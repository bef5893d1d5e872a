"""Knowledge of the families of plans during a search."""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any

from baselines.planning.families.base import Family, Settings
from baselines.planning.plans import Plan, Planned
from baselines.planning.playing import Look, reason_of
from baselines.policies.patience import StoppedError
from lissajous_env.parameters.scenario import Scenario

_ELITE = 4
"""Best plans of a family that are changed."""


@dataclass
class Tried:
    """Knowledge of a family in a search."""

    family: Family
    looks: list[tuple[Settings, Look]] = field(default_factory=list)
    unmade: list[str] = field(default_factory=list)
    """Reasons of settings of which there is no plan."""

    def elite(self) -> list[Settings]:
        """Return the settings of the best plans, alternately without and with failures."""
        alive = [each for each in self.looks if not each[1].fails]
        by_worst = sorted(alive, key=lambda each: each[1].by_worst_case)
        by_failed = sorted(alive, key=lambda each: each[1].by_failed)
        mixed = itertools.chain.from_iterable(zip(by_worst, by_failed, strict=True))
        return [settings for settings, _ in itertools.islice(mixed, 2 * _ELITE)]

    @property
    def best(self) -> float:
        """Return the least worst-case undetected time [s]."""
        return min((look.worst_case for _, look in self.looks if not look.fails), default=math.inf)


def outcome_of(ended: Future, plan: Plan) -> tuple[Planned | None, Look]:
    """Return a default that was played to the end, None for one that was not, and what is known of it."""
    try:
        found = ended.result()
    except StoppedError:
        return None, Look(plan, 0, math.inf, math.inf, refusal="there was no time to play it to the end")
    except Exception as error:  # one policy that fails must not end the search
        return None, Look(plan, 0, math.inf, math.inf, refusal=reason_of(error))
    if found is None:
        return None, Look(plan, 0, math.inf, math.inf, refusal="another default is better")
    figures = found.figures
    return found, Look(plan, figures.collisions, figures.worst_case, figures.worst_case_failed, figures.settled)


def first_of_each(looks: Sequence[Look], of: Callable[[Look], Any]) -> list[Look]:
    """Return the first look of each group."""
    return list({of(look): look for look in reversed(looks)}.values())[::-1]


def in_turn(lists: Sequence[Sequence[Any]]) -> Iterator[Any]:
    """Yield the first of each list, then the second of each."""
    nothing = object()
    for row in itertools.zip_longest(*lists, fillvalue=nothing):
        yield from (each for each in row if each is not nothing)


def why(tried: Tried, task: Scenario) -> str:
    """Return the reason why a family has no plan, with numbers."""
    if refused := tried.family.refusal(task):
        return refused
    looks = [look for _, look in tried.looks]
    collided = [look for look in looks if look.collisions]
    refusals = [*tried.unmade, *(look.refusal for look in looks if look.refusal)]
    if not (looks or tried.unmade):
        return "there was no time to try one"
    alive = [look for look in looks if not look.fails]
    words = [f"{len(looks)} plans were looked at"]
    if collided:
        fewest = min(collided, key=lambda look: look.collisions)
        words.append(f"{len(collided)} collide, for example {fewest.plan.settings.policy} ({fewest.plan.about})")
    if refusals:
        words.append(f"{len(refusals)} cannot be made: {refusals[0]}")
    if alive:
        words.append(f"{len(alive)} remain, but none of them was played to the end")
    return "; ".join(words)
