"""Dimensionless numbers of a scenario, by which a patrol is chosen.

Lengths are compared with the robots' spacing, which is the side of a square as large as a robot's share of the
rectangle, and speeds with the robots' top speed. So the numbers do not depend on the units of length and time.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lissajous_env import Scenario
from lissajous_env.theory.geometry import turning_radius


@dataclass(frozen=True)
class Feature:
    """A number of a scenario of cars, which is not negative."""

    meaning: str
    of: Callable[[Scenario], float]
    as_logarithm: bool = False
    """True if a network reads the logarithm of the number."""

    def read(self, scenario: Scenario) -> float:
        """Return what a network reads."""
        value = self.of(scenario)
        return math.log(value) if self.as_logarithm else value

    def written(self, value: float) -> str:
        """Return the number that a network reads as `value`, in words."""
        return f"{math.exp(min(value, 700.0)) if self.as_logarithm else value:.4g}"


def spacing(scenario: Scenario) -> float:
    """Return the side of a square that is as large as a robot's share of the rectangle [m]."""
    curve = scenario.curve
    return math.sqrt(4 * curve.half_width * curve.half_height / scenario.num_robots)


def _driven(scenario: Scenario) -> float:
    return scenario.robot.top_speed * scenario.task.duration


def _turning(scenario: Scenario) -> float:
    return turning_radius(scenario.robot.wheelbase, scenario.robot.steering_max)


def _standstill(scenario: Scenario) -> float:
    faults, duration = scenario.faults, scenario.task.duration
    scheduled = sum(max(min(end, duration) - start, 0.0) for _, start, end in faults.schedule)
    return min(faults.rate * faults.mean_duration + scheduled / (scenario.num_robots * duration), 1.0)


FEATURES = {
    "robots": Feature("1 over the number of robots", lambda made: 1 / made.num_robots),
    "elongation": Feature(
        "width of the rectangle over its height", lambda made: made.curve.half_width / made.curve.half_height, True
    ),
    "sensing": Feature(
        "sensing radius over the robots' spacing", lambda made: made.sensing_radius / spacing(made), True
    ),
    "sensing_across": Feature(
        "sensing radius over half of the height", lambda made: made.sensing_radius / made.curve.half_height, True
    ),
    "body": Feature("radius of a body over the robots' spacing", lambda made: made.robot.radius / spacing(made), True),
    "turning": Feature("turning radius over the robots' spacing", lambda made: _turning(made) / spacing(made), True),
    "driven": Feature(
        "distance that a robot can drive in an episode over the robots' spacing",
        lambda made: _driven(made) / spacing(made), True,
    ),
    "target_speed": Feature(
        "targets' top speed over that of the robots", lambda made: min(made.rogue_speed / made.robot.top_speed, 2.0)
    ),
    "wandering": Feature("share of targets that wander", lambda made: made.targets.wandering),
    "fleeing": Feature("share of targets that flee", lambda made: made.targets.fleeing),
    "sight": Feature(
        "distance at which targets flee over the sensing radius, times the share of those that do",
        lambda made: made.targets.fleeing * made.targets.flee_radius / made.sensing_radius,
    ),
    "at_boundary": Feature("1 if targets enter at the boundary", lambda made: made.targets.entry == "boundary"),
    "unseen": Feature("1 if targets enter where no robot senses them", lambda made: made.targets.entry == "unseen"),
    "scattered": Feature(
        "1 if robots do not start in the equilibrium", lambda made: made.formation.start != "equilibrium"
    ),
    "failures": Feature(
        "failures of a robot in an episode",
        lambda made: made.faults.rate * made.task.duration + len(made.faults.schedule) / made.num_robots,
    ),
    "standstill": Feature(
        "share of the time for which a robot has failed", _standstill
    ),
    "lost": Feature(
        "share of robots that fail for good",
        lambda made: (made.faults.lost + len(made.faults.removed)) / made.num_robots,
    ),
    "place_noise": Feature(
        "noise of measured positions over the radius of a body", lambda made: made.noise.position / made.robot.radius
    ),
    "heading_noise": Feature("noise of measured headings [rad]", lambda made: made.noise.heading),
    "unheard": Feature("share of messages that are lost", lambda made: made.noise.message_loss),
}  # fmt: skip
"""Numbers that a network reads, by name."""


def numbers_of(scenario: Scenario) -> np.ndarray:
    """Return what a network reads (F,) of a scenario of cars, in the order of `FEATURES`."""
    return np.array([float(feature.read(scenario)) for feature in FEATURES.values()])
