"""Periodic paths of any form: each car goes around a closed path that Fourier coefficients describe, all in one period.

Robot i is to be at

    x(t) = x_0 + sum over k = 1, 2 ... of a_k cos(2 pi k t / T) + b_k sin(2 pi k t / T)

and at y(t) likewise, where T is the common period. The paths are timed (`baselines.policies.timed_paths`), and the cars
drive to them at once, under the collision filter if they do not know where the others start.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.policies.loops import arrival_steps, speed_of
from baselines.policies.path_tables import PathTables, path_tables
from baselines.policies.registry import register
from baselines.policies.timed_paths import TimedPaths
from baselines.policies.transit import start_is_known
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, rows, whole
from lissajous_env.theory import closed_forms


def _as_path(entry: Any) -> tuple[float, ...] | None:
    row = tuple(float(number) for number in entry)
    fits = len(row) >= 6 and len(row) % 4 == 2 and all(abs(number) <= 1e4 for number in row)
    return row if fits else None


@dataclass(frozen=True)
class PathParameters(Checked):
    """Parameters of periodic paths; without them, every robot goes around the formation's curve."""

    period: int | None = whole(None, 4, 2**20)
    """Control steps of a period; None means those of a lap of the formation."""
    paths: tuple[tuple[float, ...], ...] | None = rows(
        None, "must contain a row for each robot: x_0, y_0, then a_k, b_k of x and of y for k = 1, 2 ... [m]", _as_path
    )
    """Fourier coefficients of the path of each robot: x_0, y_0, and for each harmonic a_k, b_k of x, a_k, b_k of y [m];
    None means the places of the formation on its curve."""


def _loop(scenario: Scenario, parameters: PathParameters) -> np.ndarray:
    """Return the places (N, K, 2) of the robots at the control steps of a period [m]."""
    lap = 2 * math.pi / scenario.formation.phase_rate / scenario.task.step
    period = parameters.period or max(round(lap), 4)
    turn = 2 * np.pi * np.arange(period) / period
    if parameters.paths is not None:
        if len(parameters.paths) != scenario.num_robots:
            rule = f"paths must contain a row for each of the {scenario.num_robots} robots"
            raise ValueError(f"{rule}, got {len(parameters.paths)}")
        paths = [(row[:2], np.reshape(row[2:], (-1, 4))) for row in parameters.paths]
        return np.array([middle + closed_forms.series(harmonics, turn) for middle, harmonics in paths])
    gamma = scenario.alpha * scenario.equilibrium[:, None] + turn
    return closed_forms.curve_point(scenario.driven, gamma)


@register("periodic-paths", on_request=True)
class PeriodicPaths(TimedPaths):
    """Cars on timed closed paths of any form, given by Fourier coefficients; by default those of the formation.

    Raises:
        ValueError: another number of paths than of robots.
    """

    Parameters = PathParameters

    def timed(self, scenario: Scenario) -> PathTables:
        """Return the timed paths."""
        loop = _loop(scenario, self.parameters)
        arrival = arrival_steps(scenario, loop, speed_of(loop, scenario.task.step))
        return path_tables(scenario, loop, filtered_until=0.0 if start_is_known(scenario) else float(arrival))
