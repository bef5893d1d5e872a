"""Policies that play any scenario of their robots."""

from collections.abc import Iterable

import numpy as np

import baselines
from baselines.planning import portfolio
from baselines.policies import registry

FILTERED = ("sweep", "kuramoto-mpcc", "partition-repair")
"""Policies that are tested under each collision filter too, one of each kind of memory."""

TRACKED = ("kuramoto-mpcc", "tracked-reference-mpcc", "consensus-gvf")
"""Combinations of a coordinator and a tracker of cars that are tested for all of them."""


def playing_all(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names without portfolios: these play one of the others, and not in every scenario."""
    return tuple(name for name in names if registry.split_suffix(name)[0] not in portfolio.NAMES)


def differing(names: Iterable[str]) -> tuple[str, ...]:
    """Return those of `playing_all` that share no part with two others.

    These are each coordinator on points, each tracker under the coordinators `TRACKED` alone, and each filter on the
    policies `FILTERED` alone.
    """
    policies = {name: registry.split_suffix(name) for name in playing_all(names)}
    alike = {name for name in policies if name.endswith(("-mpcc", "-gvf")) and name not in TRACKED}
    return tuple(
        name for name, (policy, suffix) in policies.items() if name not in alike and (not suffix or policy in FILTERED)
    )


class Reckless(baselines.Policy):
    """Drives at random, for some time in the same way; a subclass implements `draw`."""

    def __init__(self, scenario, num_worlds=1, device="cpu"):
        super().__init__(scenario, num_worlds, device)
        self.random = np.random.default_rng(5)
        self.wanted = np.zeros(self.action.shape)

    def decide(self, observation):
        anew = self.random.random(self.shape) < 0.1
        self.wanted[anew] = self.draw()[anew]
        return self.wanted
