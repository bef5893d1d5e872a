"""The best known plans of included scenarios (`baselines.planning.best_known`)."""

from collections.abc import Sequence

from baselines.planning.best_known import known_plans
from baselines.planning.families.base import Choices, Settings
from baselines.planning.plans import Plan
from lissajous_env.parameters.scenario import Scenario

NAME = "best known"


class Known:
    """The stored plans of the scenario that the task is, unless something was changed in it."""

    name = NAME

    def starts(self, task: Scenario) -> Sequence[Settings]:
        """Return the stored plans of the task."""
        return [{"stored": each.name} for each in known_plans(task)]

    def space(self, task: Scenario) -> dict[str, Choices]:
        """Return nothing: stored plans are not changed."""
        return {}

    def plan(self, task: Scenario, settings: Settings) -> Plan:
        """Return a stored plan on the task."""
        (best,) = (each for each in known_plans(task) if each.name == settings["stored"])
        return Plan(self.name, task, best.settings, "best known")

    def refusal(self, task: Scenario) -> str:
        """Return the reason for a task without a stored plan."""
        return "" if known_plans(task) else "none is stored for this scenario"
