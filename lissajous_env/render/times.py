"""Times of a picture, proportional to those of the scenario."""

import math

import numpy as np

from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory import closed_forms


def trail_time(scenario: Scenario) -> float:
    """Return the time in which a robot at nominal speed covers 0.55 of the rectangle's shorter side [s].

    That is how long a trail is; those of many robots are a fifth of it.
    """
    lap = np.linspace(0, 2 * np.pi, 512)
    speed = scenario.formation.phase_rate * closed_forms.curve_speed(scenario.driven, lap).mean()
    return float(1.1 * min(scenario.curve.half_width, scenario.curve.half_height) / speed)


def flash_time(scenario: Scenario) -> float:
    """Return the time for which a detection is shown [s]: a quarter of T_max, at most a twentieth of the episode."""
    task = scenario.task
    return max(min(scenario.detection_time_bound / 4, task.duration / 20), task.step)


def decimals_of(step: float) -> int:
    """Return the number of decimals that distinguishes the times of control steps [s]."""
    return max(math.ceil(-math.log10(step) - 1e-9), 0)
