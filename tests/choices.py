"""Policies that play any scenario of their robots."""

from collections.abc import Iterable

from baselines.policies import registry
from training.choosing import chooser

FILTERED = ("sweep", "kuramoto-mpcc", "partition-repair", "learned-intruders")
"""Policies that are tested under each collision filter too, one of each kind of memory."""


def playing_all(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names without learned choices: these play one of the others, and not in every scenario."""
    return tuple(name for name in names if registry.unwrapped(name)[0] not in chooser.names())


def differing(names: Iterable[str]) -> tuple[str, ...]:
    """Return those of `playing_all` without a filter, and each filter on the policies `FILTERED` alone."""
    policies = {name: registry.unwrapped(name) for name in playing_all(names)}
    return tuple(name for name, (policy, suffix) in policies.items() if not suffix or policy in FILTERED)
