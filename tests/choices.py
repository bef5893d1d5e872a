"""Policies that play any scenario of their robots."""

from collections.abc import Iterable

from baselines.planning import portfolio
from baselines.policies import registry

FILTERED = ("sweep", "kuramoto-mpcc", "partition-repair", "learned-intruders")
"""Policies that are tested under each collision filter too, one of each kind of memory."""


def playing_all(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names without portfolios: these play one of the others, and not in every scenario."""
    return tuple(name for name in names if registry.unwrapped(name)[0] not in portfolio.NAMES)


def differing(names: Iterable[str]) -> tuple[str, ...]:
    """Return those of `playing_all` without a filter, and each filter on the policies `FILTERED` alone."""
    policies = {name: registry.unwrapped(name) for name in playing_all(names)}
    return tuple(name for name, (policy, suffix) in policies.items() if not suffix or policy in FILTERED)
