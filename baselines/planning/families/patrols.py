"""Loops: cars in file around the boundary or up and down lanes, and cars that go around for themselves."""

from collections.abc import Sequence

from baselines.planning.families.base import FILTERS, Choices, Settings
from baselines.planning.families.lissajous import on_ellipse
from baselines.planning.plans import Plan, top_speed
from baselines.policies.as_cars import like_cars
from baselines.policies.patrol_path import cruising_speed
from baselines.policies.settings import PolicySettings
from lissajous_env.parameters.scenario import Scenario

_POLICIES = "sweep", "laps"
_ELLIPSE = "ellipse"
"""Word for robots that begin evenly spaced on an ellipse, all in the same sense, as the file goes around."""
_FASTEST = 0.9
"""Speed of the start on the ellipse where it is fastest, over the top speed."""


class Patrols:
    """Loops around the boundary or up and down lanes, with the speed, the number of lanes and the inset."""

    name = "loops"

    def starts(self, task: Scenario) -> Sequence[Settings]:
        """Return loops around the boundary and in lanes, in file and each for itself."""
        if like_cars(task) is None:
            return []
        file = {"policy": "sweep", "start": _ELLIPSE, "cruise": 0.8}
        return [
            {**file, "lanes": 2, "inset": 0.5},
            {**file, "lanes": 4, "inset": 0.5},
            {**file, "lanes": 2, "inset": 0.5, "policy": "sweep-safe"},
            {**file, "lanes": 2, "inset": 0.1},
            {**file, "lanes": 6, "inset": 0.5},
            {**file, "lanes": 2, "inset": 0.5, "policy": "laps"},
            {**file, "lanes": 2, "inset": 0.5, "start": "task"},
        ]

    def space(self, task: Scenario) -> dict[str, Choices]:
        """Return shares: of the sensing radius for the inset, of the top speed for the speed."""
        return {
            "policy": [policy + suffix for policy in _POLICIES for suffix in FILTERS],
            "start": [_ELLIPSE, "task"],
            "lanes": [2, 4, 6, 8],
            "inset": (0.02, 1.5),
            "cruise": (0.3, 1.0),
        }

    def plan(self, task: Scenario, settings: Settings) -> Plan:
        """Return the loop, with the robots on the ellipse or where the task places them."""
        fastest = min(_FASTEST * top_speed(task), cruising_speed(like_cars(task) or task))
        made = on_ellipse(task, fastest) if settings["start"] == _ELLIPSE else task
        cruise = settings["cruise"] * top_speed(task)
        inset = min(settings["inset"] * task.sensing_radius, 0.9 * task.curve.half_height, 0.9 * task.curve.half_width)
        given = {"lanes": settings["lanes"], "inset": float(f"{inset:.4g}"), "cruise": float(f"{cruise:.4g}")}
        about = f"{given['lanes']} lanes, inset {inset:.3g} m, {cruise:.3g} m/s"
        return Plan(self.name, made, PolicySettings(settings["policy"], given), about)

    def refusal(self, task: Scenario) -> str:
        """Return the reason for robots that are no cars."""
        if like_cars(task) is not None:
            return ""
        return f"sweep and laps drive cars, and the robots are of kind {task.robot.kind} (give a turning radius)"
