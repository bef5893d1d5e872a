"""Worst-case undetected time of evading targets that a formation in its equilibrium does not detect.

The paper's bounds apply to targets at rest, or to discs that always overlap. For moving targets, the worst case is
computed by the contamination field (`lissajous_env.world.contamination.field`) with points that stay exactly in (2).
"""

import math
from bisect import bisect_left
from dataclasses import replace

import numpy as np

from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.parts import Faults, Noise, Robot
from lissajous_env.settings.task import Targets, Task
from lissajous_env.theory.geometry import largest_speed
from lissajous_env.wording import require
from lissajous_env.world.episode import is_open
from lissajous_env.world.simulation import Simulation

ROUNDS = 12
"""Length of an episode of the formation in units of T_max; a worst case that still grows then counts as unbounded."""
CELLS, CELLS_IN_A_SENSOR = 90, 5.0
"""Default number of cells along the longer side of the rectangle, and least sensing radius [cell]."""
_SPEEDS = 513
"""Number of speeds, evenly spaced, among which a critical speed is searched."""


def cells(scenario: Scenario, longest: int = CELLS, cells_in_a_sensor: float = CELLS_IN_A_SENSOR) -> tuple[int, int]:
    """Return columns and rows of about square cells, by default those of a grid for the worst-case undetected time.

    Args:
        scenario: The scenario.
        longest: Cells along the longer side of the rectangle, at most twice as many for short sensors.
        cells_in_a_sensor: Least sensing radius [cell].
    """
    halves = scenario.curve.half_width, scenario.curve.half_height
    longest = max(longest, min(math.ceil(2 * max(halves) * cells_in_a_sensor / scenario.sensing_radius), 2 * longest))
    columns, rows = (max(round(longest * half / max(halves)), 1) for half in halves)
    return columns, rows


class IdealFormation:
    """Points that stay exactly in the equilibrium (2) of a scenario, against targets that may be anywhere at any time.

    Args:
        scenario: The scenario with the curve, formation and times.
        radius: Sensing radius r_s [m]; by default that of the scenario.
        cells: Grid cells along the longer side of the rectangle.

    Raises:
        ValueError: no policy of the scenario follows the curve.
    """

    def __init__(self, scenario: str | Scenario, radius: float | None = None, cells: int = CELLS):
        self.scenario = named.build(scenario)
        name, action = f"task.action of {self.scenario.name}", self.scenario.task.action
        require(self.scenario.has_formation, name, "must be control for a policy that follows the curve", action)
        self.radius = self.scenario.sensing_radius if radius is None else radius
        curve, self._step, self._longest = self.scenario.curve, self.scenario.task.step, cells
        self._side = 2 * max(curve.half_width, curve.half_height) / cells
        self._limit = 30 * self._side / self._step  # of the speed [m/s]: almost TICKS_MAX cells in a step

    @property
    def fastest_rogue(self) -> float:
        """Largest speed that `critical_speed` tries [m/s]: 4 times that of robots, at most half of the grid's limit."""
        top_speed = self.scenario.formation.phase_rate * largest_speed(self.scenario.driven)
        return min(4 * top_speed, self._limit / 2)

    def against(self, speed: float) -> Scenario:
        """Return the scenario with these points, no faults, and targets of a speed [m/s].

        Raises:
            ValueError: the targets are too fast for the grid.
        """
        scenario, limit = self.scenario.resolve(), self._limit
        rule = f"must be at most {limit:.3g} m/s for cells of {self._side:.3g} m and a step of {self._step:g} s"
        require(speed <= limit, "the speed of targets", rule, float(speed))
        grid = cells(scenario, self._longest, 0.0)
        rate = scenario.formation.phase_rate / scenario.alpha
        duration = math.ceil(ROUNDS * scenario.detection_time_bound / self._step) * self._step
        return replace(
            scenario,
            formation=replace(scenario.formation, start="equilibrium", start_noise=0.0, displaced=()),
            robot=Robot(kind="curve", count=scenario.num_robots, radius=scenario.robot.radius, phase_rate_max=rate),
            sensing=replace(scenario.sensing, radius=self.radius),
            targets=Targets(count=1, arrival_rate=1.0 / duration, wandering=0.0, speed_limit=speed),
            faults=Faults(),
            noise=Noise(),
            task=Task(duration=duration, step=self._step, substeps=2, grid=None, contamination=grid),
            extensions=(),
        )

    def guaranteed_time(self, speed: float, until_cleared: bool = False) -> float:
        """Return the longest time [s] that a target of a speed [m/s], as of `against`, can stay undetected, or inf.

        The formation is periodic, so a target that can evade for ever from some moment on could also do so from the
        start: once all targets of the start are detected, none can. With `until_cleared` the episode ends there, and
        the result is the longest time so far.
        """
        simulation = Simulation(self.against(speed), threads=1)
        simulation.action.fill_(1.0)
        field, steps = simulation.contamination, simulation.scenario.task.steps
        for now in range(1, steps + 1):
            simulation.advance()
            if until_cleared and now % 10 == 0 and field.oldest.numpy()[0] > 0:
                return int(field.age_max.numpy()[0]) * self._step
        longest, at_end = int(field.age_max.numpy()[0]), int(field.age.numpy()[0])
        return math.inf if is_open(longest, at_end, steps) else longest * self._step

    def critical_speed(self) -> float:
        """Return the speed from which on a target, which can do all that a slower one can, evades for ever [m/s].

        Returns:
            0 if even a target at rest can, inf if none up to `fastest_rogue` can; within 1/500 of that.
        """
        speeds = np.linspace(0.0, self.fastest_rogue, _SPEEDS)
        first = bisect_left(speeds, math.inf, key=lambda speed: self.guaranteed_time(speed, until_cleared=True))
        return math.inf if first == _SPEEDS else float(speeds[max(first - 1, 0) : first + 1].mean())
