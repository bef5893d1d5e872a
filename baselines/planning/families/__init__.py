"""The families of plans."""

from collections.abc import Callable
from functools import partial

from baselines.planning.families.cars import lines, partitions, patrols
from baselines.planning.families.included import best_known, defaults
from baselines.planning.families.lissajous import formations
from baselines.planning.plans import Family
from lissajous_env.parameters.scenario import Scenario

FAMILIES: tuple[Callable[[Scenario], Family], ...] = (defaults, best_known, partitions, lines, formations, patrols)
"""Functions that return each family for a task."""


def families_apart(clearance: float | None) -> tuple[Callable[[Scenario], Family], ...]:
    """Return the same functions, with partitions whose bodies are planned at least a clearance apart [m]."""
    return tuple(partial(partitions, clearance=clearance) if family is partitions else family for family in FAMILIES)
