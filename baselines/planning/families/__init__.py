"""The families of plans."""

from collections.abc import Callable
from functools import partial

from baselines.planning.families.defaults import included
from baselines.planning.families.known import best_known
from baselines.planning.families.lissajous import formations
from baselines.planning.families.loops import patrols
from baselines.planning.families.timed import lines, partitions
from baselines.planning.family import Family
from lissajous_env.parameters.scenario import Scenario

FAMILIES: tuple[Callable[[Scenario], Family], ...] = (included, best_known, partitions, lines, formations, patrols)
"""Functions that return each family for a task."""


def families_apart(clearance: float | None) -> tuple[Callable[[Scenario], Family], ...]:
    """Return the same functions, with partitions whose bodies are planned at least a clearance apart [m]."""
    return tuple(partial(partitions, clearance=clearance) if family is partitions else family for family in FAMILIES)
