"""Policies that play any scenario of their robots."""

from collections.abc import Iterable

from baselines.planning import portfolio
from baselines.policies import registry

FILTERED = ("sweep", "kuramoto-mpcc", "partition-repair")
"""Policies that are tested under each collision filter too, one of each kind of memory."""


TRACKED = ("kuramoto-mpcc", "tracked-reference-mpcc", "consensus-gvf")
"""Combinations of a coordinator and a tracker of cars that are tested for all of them."""


def playing_all(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names without portfolios: these play one of the others, and not in every scenario."""
    return tuple(name for name in names if registry.unwrapped(name)[0] not in portfolio.NAMES)


def differing(names: Iterable[str]) -> tuple[str, ...]:
    """Return those of `playing_all` that share no part with two others.

    These are each coordinator on points, each tracker under the coordinators `TRACKED` alone, and each filter on the
    policies `FILTERED` alone.
    """
    policies = {name: registry.unwrapped(name) for name in playing_all(names)}
    alike = {name for name in policies if name.endswith(("-mpcc", "-gvf")) and name not in TRACKED}
    return tuple(
        name for name, (policy, suffix) in policies.items() if name not in alike and (not suffix or policy in FILTERED)
    )
