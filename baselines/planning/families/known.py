"""The best known plans of a scenario as a family."""

from collections.abc import Sequence

from baselines.benchmark.bounds import BEST_KNOWN, BestKnown, known_plans
from baselines.planning.family import Family, without_plans
from baselines.planning.plans import Plan
from lissajous_env.parameters.scenario import Scenario


def best_known(task: Scenario) -> Family:
    """Return the stored plans of a task as a family of plans, unless something was changed in it."""
    return as_family(task, known_plans(task))


def as_family(task: Scenario, plans: Sequence[BestKnown]) -> Family:
    """Return stored plans as a family of plans on a task."""
    if not plans:
        return without_plans(BEST_KNOWN, "none is stored for this scenario")
    settings = {plan.name: plan.settings for plan in plans}
    starts = [{"stored": name} for name in settings]
    return Family(BEST_KNOWN, lambda given: Plan(BEST_KNOWN, task, settings[given["stored"]], "best known"), starts)
