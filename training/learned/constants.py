"""Dimensionless numbers of a scenario that a policy for many scenarios reads beside the observation.

An observation is in units of the scenario: a relative position is divided by the rectangle for a ring neighbour, and by
the sensing radius for a robot that is sensed. These numbers state the ratios of the units, so that one network can
drive teams and rectangles of different sizes. They do not change during an episode.
"""

from collections.abc import Callable

import numpy as np

from lissajous_env import Scenario
from lissajous_env.parameters.robot_models import model_of

LARGEST = 4.0
"""Limit of each number."""


def top_speed(scenario: Scenario) -> float:
    """Return the top speed of a car, or that of a point in the equilibrium [m/s]."""
    model = model_of(scenario.robot.kind)
    return model.speed_unit(scenario.driven, scenario.formation, scenario.robot)


CONSTANTS: dict[str, Callable[[Scenario], float]] = {
    "team": lambda scenario: 3.0 / scenario.num_robots,
    "sensing_x": lambda scenario: scenario.sensing_radius / scenario.curve.half_width,
    "sensing_y": lambda scenario: scenario.sensing_radius / scenario.curve.half_height,
    "body": lambda scenario: scenario.robot.radius / scenario.sensing_radius,
    "boundary": lambda scenario: float(scenario.targets.entry == "boundary"),
    "pace": lambda scenario: top_speed(scenario) * scenario.task.step / scenario.sensing_radius,
}
"""Functions of a scenario by name: 3 over the number of robots; the sensing radius in half-widths and half-heights of
the rectangle; the robots' radius in sensing radii; 1 where targets enter at the boundary, on which the loop of `sweep`
depends, too; the distance driven in a control step at top speed, in sensing radii."""


def constants_of(scenario: Scenario, names: tuple[str, ...]) -> np.ndarray:
    """Return the numbers (C,) of a scenario by name, at most `LARGEST`, as float32."""
    values = [min(CONSTANTS[name](scenario), LARGEST) for name in names]
    return np.array(values, dtype=np.float32)
