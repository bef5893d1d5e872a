"""The scale of a scenario's motion, by which controllers that were tuned on the paper's experiment drive any robots.

Two scenarios that differ only in the units of length and time are the same task, so a controller must drive them alike:
each of its numbers that has a unit is its value in the experiment times powers of the two factors that are computed
here. In the paper's own scenarios both are exactly 1.
"""

import math
from typing import NamedTuple

from lissajous_env import scenario as make_scenario
from lissajous_env.parameters.scenario import Robot, Scenario
from lissajous_env.theory.geometry import curve_length

EXPERIMENT = make_scenario("experiment")
"""The scenario that controllers were tuned on."""


class Scale(NamedTuple):
    """Length and time of a scenario's motion, as multiples of those of the experiment."""

    length: float
    time: float

    @property
    def speed(self) -> float:
        """Speed as a multiple of the experiment's."""
        return self.length / self.time


def motion_scale(scenario: Scenario) -> Scale:
    """Return the scale of how cars move: the room that one needs to turn, and the time in which it drives that far."""
    length = manoeuvring_length(scenario.robot) / manoeuvring_length(EXPERIMENT.robot)
    return Scale(length, length / (mean_speed(scenario) / mean_speed(EXPERIMENT)))


def manoeuvring_length(robot: Robot) -> float:
    """Return the radius of the front axle's tightest circle, l / sin(delta_max), at least the body's diameter [m]."""
    return max(robot.wheelbase / math.sin(robot.steering_max), 2 * robot.radius)


def mean_speed(scenario: Scenario) -> float:
    """Return the mean speed of the formation along the curve [m/s], or the robots' top speed if that is less."""
    formation = scenario.formation.phase_rate * curve_length(scenario.driven) / (2 * math.pi)
    return min(formation, scenario.robot.top_speed)
