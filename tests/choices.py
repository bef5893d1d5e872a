"""Policies that play any scenario of their robots."""

from collections.abc import Iterable

from baselines.policies import registry
from training.choosing import chooser


def playing_all(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names without learned choices: these play one of the others, and not in every scenario."""
    return tuple(name for name in names if registry.unwrapped(name)[0] not in chooser.names())
