"""The interface of a family of plans, and what its settings may be."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from baselines.planning.plans import Plan
from lissajous_env.parameters.scenario import Scenario

Settings = Mapping[str, Any]
"""The settings of a plan within its family, by name."""
Choices = tuple[float, float] | list[Any]
"""A range of positive numbers, or a list of values."""
FILTERS = "", "-safe"
"""Suffixes of a policy of cars: without and with the collision filter."""


class Family(Protocol):
    """A family of plans for a task: each of its plans is made of settings, which a search may change."""

    @property
    def name(self) -> str:
        """Return the name of the family."""
        ...

    def starts(self, task: Scenario) -> Sequence[Settings]:
        """Return the settings that are tried first, the most promising ones first; none if the family does not fit."""
        ...

    def space(self, task: Scenario) -> dict[str, Choices]:
        """Return what the settings may be; empty for a family whose plans are not changed."""
        ...

    def plan(self, task: Scenario, settings: Settings) -> Plan:
        """Make the plan of some settings.

        Raises:
            ValueError: there is no such plan.
        """
        ...

    def refusal(self, task: Scenario) -> str:
        """Return the reason why the family has no plan for a task; "" if it may have some."""
        ...


def changed(settings: Settings, space: Mapping[str, Choices], random: np.random.Generator) -> dict[str, Any]:
    """Return settings of which about a third differ, by a factor of about 1.25 where they are numbers."""
    child = dict(settings)
    names = list(space)
    for name in random.permutation(names)[: 1 + random.binomial(len(names) - 1, 0.33)]:
        child[name] = _drawn(space[name], child.get(name), random)
    return child


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
