"""The included classical policies with their defaults, on the task as it is: no plan is printed that is worse."""

from baselines.planning.family import Family
from baselines.planning.plans import Plan
from baselines.policies import registry
from baselines.policies.settings import PolicySettings
from lissajous_env.parameters.scenario import Scenario

DEFAULTS = "defaults"
_FIRST = "partition", "line-abreast", "kuramoto-mpcc"
"""Policies that are usually the best: the others are played only until they are known to be worse."""
_FILTERED = "kuramoto-mpcc"
"""The policy that is also played with the collision filters."""


def included(task: Scenario) -> Family:
    """Return the policies that drive the robots, first those that are usually the best."""
    names = sorted(default_policies(task), key=lambda name: not name.startswith(_FIRST))
    starts = [{"policy": name} for name in names]
    return Family(DEFAULTS, lambda given: Plan(DEFAULTS, task, PolicySettings(given["policy"]), "defaults"), starts)


def default_policies(task: Scenario) -> list[str]:
    """Return the names of the included classical policies that drive the robots of a task.

    Of those with a collision filter, the paper's method alone. Policies that are played on request alone are left out.
    """
    names = [name for name in registry.names(task) if registry.is_classical(name) and registry.ships(name)]
    names = [name for name in names if registry.made_for(name, task.name)]
    return [name for name in names if not registry.unwrapped(name)[1] or registry.unwrapped(name)[0] == _FILTERED]
