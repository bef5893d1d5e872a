"""Worst-case undetected time of evading targets that a formation in its equilibrium does not detect.

The paper's bounds apply to targets at rest, or to discs that always overlap. For moving targets, the worst case is
computed by the contamination field (`lissajous_env.world.contamination.field`) with points that stay exactly in (2).
"""

import math
from dataclasses import replace
from typing import NamedTuple

from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.parts import Faults, Noise, Robot
from lissajous_env.settings.task import Targets, Task
from lissajous_env.theory.geometry import largest_speed
from lissajous_env.world.episode import is_open
from lissajous_env.world.simulation import Simulation

ROUNDS = 12
"""Length of an episode of the formation in units of T_max; a worst case that still grows then counts as unbounded."""
CELLS = 90
"""Default number of cells along the longer side of the rectangle."""
_HALVINGS = 9


class FormationGuarantee(NamedTuple):
    """Guarantee of a formation with one sensing radius."""

    radius: float
    """Sensing radius r_s [m]."""
    critical_speed: float
    """Speed above which an evading target can stay undetected for ever [m/s]; inf if no tried speed suffices."""
    guaranteed_time: float
    """Longest time for which a target of a given speed can stay undetected [s]; may be infinite."""


def formation_guarantee(
    scenario: str | Scenario, speed: float, radius: float | None = None, cells: int = CELLS
) -> FormationGuarantee:
    """Return the guarantee of the formation of a scenario against targets of a speed [m/s].

    Args:
        scenario: The scenario.
        speed: Speed of the targets [m/s].
        radius: Sensing radius r_s [m]; by default that of the scenario.
        cells: Grid cells along the longer side of the rectangle.
    """
    scenario = named.build(scenario)
    radius = scenario.sensing_radius if radius is None else radius
    critical, longest = critical_speed(scenario, radius, cells), guaranteed_time(scenario, radius, speed, cells)
    return FormationGuarantee(radius, critical, longest)


def check_follows(scenario: str | Scenario) -> None:
    """Raise ValueError if `task.contamination` of a scenario is None."""
    scenario = named.build(scenario)
    if scenario.task.contamination is None:
        raise ValueError(f"task.contamination of {scenario.name} must be (columns, rows), got None")


def in_formation(
    scenario: str | Scenario, radius: float | None = None, speed: float = 0.0, cells: int = CELLS
) -> Scenario:
    """Return a scenario with points in the equilibrium (2), no faults, and targets that may be anywhere at any time.

    Args:
        scenario: The scenario with the curve, formation and times.
        radius: Sensing radius r_s [m]; by default that of the scenario.
        speed: Speed of the targets [m/s].
        cells: Grid cells along the longer side of the rectangle.

    Raises:
        ValueError: the targets are too fast for the grid.
    """
    scenario = named.build(scenario)
    curve, known = scenario.curve, scenario.resolve()
    side = 2 * max(curve.half_width, curve.half_height) / cells
    limit = 30 * side / scenario.task.step
    if speed > limit:
        rule = f"must be at most {limit:.3g} m/s for cells of {side:.3g} m and a step of {scenario.task.step:g} s"
        raise ValueError(f"the speed of targets {rule}, got {speed:g}")
    columns, rows = (max(round(2 * half / side), 1) for half in (curve.half_width, curve.half_height))
    rate = scenario.formation.phase_rate / scenario.alpha
    duration = math.ceil(ROUNDS * scenario.detection_time_bound / scenario.task.step) * scenario.task.step
    return replace(
        known,
        formation=replace(known.formation, start="equilibrium", start_noise=0.0, displaced=()),
        robot=Robot(kind="curve", count=scenario.num_robots, radius=scenario.robot.radius, phase_rate_max=rate),
        sensing=replace(known.sensing, radius=known.sensing.radius if radius is None else radius),
        targets=Targets(count=1, arrival_rate=1.0 / duration, wandering=0.0, speed_limit=speed),
        faults=Faults(),
        noise=Noise(),
        task=Task(duration=duration, step=scenario.task.step, substeps=2, grid=None, contamination=(columns, rows)),
        extensions=(),
    )


def guaranteed_time(
    scenario: str | Scenario, radius: float | None = None, speed: float = 0.0, cells: int = CELLS
) -> float:
    """Return the longest time for which a target can evade the formation in its equilibrium [s]; may be infinite.

    Args:
        scenario: The scenario.
        radius: Sensing radius r_s [m]; by default that of the scenario.
        speed: Speed of the target [m/s].
        cells: Grid cells along the longer side of the rectangle.
    """
    simulation = Simulation(in_formation(scenario, radius, speed, cells), threads=1)
    age = _largest_age(simulation, until_cleared=False)
    return math.inf if age is None else age * simulation.scenario.task.step


def critical_speed(scenario: str | Scenario, radius: float | None = None, cells: int = CELLS) -> float:
    """Return the speed from which on a target can evade the formation for ever [m/s], to 1/500 of the searched range.

    Args:
        scenario: The scenario.
        radius: Sensing radius r_s [m]; by default that of the scenario.
        cells: Grid cells along the longer side of the rectangle.

    Returns:
        0 if even a target at rest can, inf if none up to `fastest_rogue` can.
    """
    scenario = named.scenario(scenario)
    if not _clears(scenario, radius, 0.0, cells):
        return 0.0
    low, high = 0.0, fastest_rogue(scenario, cells)
    if _clears(scenario, radius, high, cells):
        return math.inf
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if _clears(scenario, radius, middle, cells) else (low, middle)
    return (low + high) / 2


def fastest_rogue(scenario: str | Scenario, cells: int = CELLS) -> float:
    """Return the largest speed that `critical_speed` tries [m/s]: 4 times that of the robots or the grid's limit."""
    scenario = named.scenario(scenario)
    curve = scenario.curve
    side = 2 * max(curve.half_width, curve.half_height) / cells
    return min(4 * scenario.formation.phase_rate * largest_speed(curve), 15 * side / scenario.task.step)


def _clears(scenario: Scenario, radius: float | None, speed: float, cells: int) -> bool:
    simulation = Simulation(in_formation(scenario, radius, speed, cells), threads=1)
    return _largest_age(simulation, until_cleared=True) is not None


def _largest_age(simulation: Simulation, until_cleared: bool) -> int | None:
    """Play the formation; return the largest age [step], or None if it still grows at the end.

    The episode ends early when all initial targets are detected, if requested.

    The formation is periodic, so a target that can evade for ever from some moment on could also do so from the start:
    once all targets of the start are detected, none can.
    """
    simulation.action.fill_(1.0)
    field, steps = simulation.contamination, simulation.scenario.task.steps
    for now in range(1, steps + 1):
        simulation.advance()
        if until_cleared and now % 10 == 0 and field.oldest.numpy()[0] > 0:
            return int(field.age_max.numpy()[0])
    longest, at_end = int(field.age_max.numpy()[0]), int(field.age.numpy()[0])
    return None if is_open(longest, at_end, steps) else longest
