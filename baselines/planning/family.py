"""Families of plans: what a search may try on a task, and what it knows of it."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from baselines.planning.plans import Plan, Planned, in_turn

Settings = Mapping[str, Any]
"""The settings of a plan within its family, by name."""
Choices = tuple[float, float] | list[Any]
"""A range of positive numbers, or a list of values."""
FILTERS = "", "-safe"
"""Suffixes of a policy of cars: without and with the collision filter."""
_ELITE = 4
"""Best plans of a family that are changed."""


def _no_plan(settings: Mapping[str, Any]) -> Plan:
    raise ValueError(f"the family has no plan of {dict(settings)}")


@dataclass
class Family:
    """A family of plans for a task: each of its plans is made of settings, which a search may change."""

    name: str
    plan: Callable[[Settings], Plan] = _no_plan
    """Function that returns the plan of some settings, or raises ValueError if there is no such plan."""
    starts: Sequence[Settings] = ()
    """Settings that are tried first, the most promising ones first; none if the family does not fit the task."""
    space: Mapping[str, Choices] = field(default_factory=dict)
    """Values that the settings may have; empty for a family whose plans are not changed."""
    refusal: str = ""
    """Reason why the family has no plan for the task; "" if it may have some."""
    looks: list[tuple[Settings, Planned]] = field(default_factory=list)
    """Plans that were looked at."""
    unmade: list[str] = field(default_factory=list)
    """Reasons of settings of which there is no plan."""

    @property
    def alive(self) -> list[tuple[Settings, Planned]]:
        """Return the plans that were looked at and did not collide."""
        return [each for each in self.looks if not each[1].figures.collisions]

    @property
    def best(self) -> float:
        """Return the least worst-case undetected time [s]."""
        return min((look.figures.worst_case for _, look in self.alive), default=math.inf)

    def elite(self) -> list[Settings]:
        """Return the settings of the best plans, alternately without and with failures."""
        by_worst = sorted(self.alive, key=lambda each: each[1].figures.objectives)
        by_failed = sorted(self.alive, key=lambda each: each[1].figures.by_failures)
        return [settings for settings, _ in itertools.islice(in_turn([by_worst, by_failed]), 2 * _ELITE)]

    def changed(self, settings: Settings, random: np.random.Generator) -> dict[str, Any]:
        """Return settings of which about a third differ, by a factor of about 1.25 where they are numbers."""
        child, names = dict(settings), list(self.space)
        for name in random.permutation(names)[: 1 + random.binomial(len(names) - 1, 0.33)]:
            child[name] = _drawn(self.space[name], child.get(name), random)
        return child

    def why(self) -> str:
        """Return the reason why the family has no plan, with numbers."""
        if self.refusal:
            return self.refusal
        if not (self.looks or self.unmade):
            return "the search ended before it tried one"
        words = [f"{len(self.looks)} plans were looked at"]
        if collided := [look for _, look in self.looks if look.figures.collisions]:
            fewest = min(collided, key=lambda look: look.figures.collisions).plan
            words.append(f"{len(collided)} collide, for example {fewest.settings.policy} ({fewest.about})")
        if self.unmade:
            words.append(f"{len(self.unmade)} cannot be made: {self.unmade[0]}")
        if self.alive:
            words.append(f"{len(self.alive)} remain, but none of them was played to the end")
        return "; ".join(words)


def _drawn(choices: Choices, near: Any, random: np.random.Generator) -> Any:
    """Draw a value; a number of a range is drawn near another one if there is one."""
    if isinstance(choices, list):
        return choices[int(random.integers(len(choices)))]
    low, high = choices
    if near is None:
        value = math.exp(random.uniform(math.log(low), math.log(high)))
    else:
        value = near * math.exp(0.22 * random.standard_normal())
    return float(f"{min(max(value, low), high):.4g}")
