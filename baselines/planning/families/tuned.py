"""Policies of cars that plan the team's motion beforehand, with their parameters changed: partitions and lines."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from baselines.planning.families.base import Choices, Settings
from baselines.planning.families.lissajous import on_ellipse
from baselines.planning.plans import Plan, top_speed
from baselines.policies.as_cars import like_cars
from baselines.policies.settings import PolicySettings
from lissajous_env.parameters.scenario import Scenario

_STARTS = [0.0, 0.5, 0.7, 0.9]
"""Speeds of a start on an ellipse where it is fastest, over the top speed; 0 for the start of the task."""
_SHARES = {"speed": top_speed, "settle": lambda task: task.sensing_radius}
"""Parameters that are settings as shares, each of what."""


@dataclass(frozen=True)
class Tuned:
    """A family of one or more policies on the task as it is, by their parameters."""

    name: str
    policies: tuple[str, ...]
    first: tuple[Mapping[str, Any], ...]
    """Parameters that are tried first, the defaults aside."""
    choices: Callable[[Scenario], dict[str, Choices]]
    """Function that returns what the parameters may be."""

    def starts(self, task: Scenario) -> Sequence[Settings]:
        """Return the first parameters with each policy."""
        fitting = self._fitting(task)
        return [{"policy": policy, **given} for given in self.first for policy in fitting]

    def space(self, task: Scenario) -> dict[str, Choices]:
        """Return the policies and what their parameters may be."""
        return {"policy": self._fitting(task), "start": _STARTS, **self.choices(task)}

    def plan(self, task: Scenario, settings: Settings) -> Plan:
        """Return the policy with the parameters."""
        given = {name: value for name, value in settings.items() if name not in ("policy", "start")}
        start = settings.get("start", 0.0)
        made = on_ellipse(task, start * top_speed(task)) if start else task
        given |= {name: float(f"{given[name] * of(task):.4g}") for name, of in _SHARES.items() if name in given}
        about = ", ".join(f"{name.replace('_', ' ')} {_short(value)}" for name, value in given.items())
        about += f", start on an ellipse at {start * top_speed(task):.3g} m/s" if start else ""
        return Plan(self.name, made, PolicySettings(settings["policy"], given), about)

    def refusal(self, task: Scenario) -> str:
        """Return the reason for robots that no policy of the family drives."""
        if self._fitting(task):
            return ""
        words = " and ".join(self.policies)
        return f"{words} drive cars, and the robots are of kind {task.robot.kind} (give a turning radius)"

    def _fitting(self, task: Scenario) -> list[str]:
        return list(self.policies) if like_cars(task) is not None else []


def _short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _of_partition(task: Scenario) -> dict[str, Choices]:
    extents = [0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9]
    return {
        "speed": (0.3, 1.0),
        "rows": list(range(1, task.num_robots + 1)),
        "extent_x": extents,
        "extent_y": extents,
        "lanes": [2, 4, 6],
    }


def _of_lines(task: Scenario) -> dict[str, Choices]:
    return {
        "speed": (0.3, 0.98),
        "lines": list(range(1, min(task.num_robots, 4) + 1)),
        "grip": (0.4, 1.0),
        "settle": [0.0, 0.1, 0.25, 0.5],
    }


PARTITIONS = Tuned(
    "partition",
    ("partition", "partition-repair"),
    ({"speed": 0.9}, {"speed": 0.9, "start": 0.7}, {"speed": 0.6}, {"speed": 0.97}, {"speed": 0.8}),
    _of_partition,
)
LINES = Tuned(
    "lines", ("line-abreast",), ({"lines": 1}, {"lines": 2}, {"speed": 0.6}, {"lines": 3}, {"speed": 0.8}), _of_lines
)
