"""Plans that are there before a search: the included classical policies with their defaults, and the best known plans.

They are played on the task as it is, so no plan is printed that is worse.
"""

from collections.abc import Sequence

from baselines.benchmark.bounds import BEST_KNOWN, BestKnown, known_plans
from baselines.planning.plans import Family, Plan
from baselines.policies import registry
from baselines.policies.settings import PolicySettings
from lissajous_env.parameters.scenario import Scenario

DEFAULTS = "defaults"
_FIRST = "partition", "line-abreast", "kuramoto-mpcc"
"""Policies that are usually the best: the others are played only until they are known to be worse."""
_FILTERED = "kuramoto-mpcc"
"""The policy that is also played with the collision filters."""


def defaults(task: Scenario) -> Family:
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


def best_known(task: Scenario) -> Family:
    """Return the stored plans of a task as a family of plans, unless something was changed in it."""
    return as_family(task, known_plans(task))


def as_family(task: Scenario, plans: Sequence[BestKnown]) -> Family:
    """Return stored plans as a family of plans on a task."""
    if not plans:
        return Family(BEST_KNOWN, refusal="none is stored for this scenario")
    settings = {plan.name: plan.settings for plan in plans}
    starts = [{"stored": name} for name in settings]
    return Family(BEST_KNOWN, lambda given: Plan(BEST_KNOWN, task, settings[given["stored"]], "best known"), starts)
