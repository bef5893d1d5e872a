"""The best known plans of shipped scenarios, stored as folders; `README.md` beside them has the commands."""

from collections.abc import Sequence
from pathlib import Path

from baselines.planning.families.base import Choices, Settings
from baselines.planning.plans import Plan
from baselines.policies import stored
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.shipped import SHIPPED

NAME = "best known"
FOLDER = Path(__file__).parent.parent / "known"


class Known:
    """The stored plans of the scenario that the task is, unless something was changed in it."""

    name = NAME

    def starts(self, task: Scenario) -> Sequence[Settings]:
        """Return the stored plans of the task."""
        shipped = {each.name: each for each in SHIPPED}.get(task.name)
        if shipped is None or shipped.digest() != task.digest():
            return []
        return [{"stored": path.parent.name} for path in sorted(FOLDER.glob(f"{task.name}*/{stored.FILE}"))]

    def space(self, task: Scenario) -> dict[str, Choices]:
        """Return nothing: stored plans are not changed."""
        return {}

    def plan(self, task: Scenario, settings: Settings) -> Plan:
        """Return a stored plan with the formation from which it starts."""
        folder = FOLDER / settings["stored"]
        home = named.build(str(folder / stored.HOME))
        made = named.build(task, curve=home.curve, formation=home.formation, **{"robot.count": home.robot.count})
        return Plan(self.name, made, stored.read(folder), "best known")

    def refusal(self, task: Scenario) -> str:
        """Return the reason for a task without a stored plan."""
        return "" if self.starts(task) else "none is stored for this scenario"
