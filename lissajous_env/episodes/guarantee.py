"""How long a rogue that can think stays unseen: by a policy as time passes, and by a formation in its equilibrium.

The paper's bounds are of rogues at rest, or of discs that overlap at any time; against rogues that move the answer is
computed, by the field of `lissajous_env.world.contamination.field`, of a formation with points that keep (2) exactly.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from lissajous_env.episodes.evaluation import ActingPolicy, Referee
from lissajous_env.parameters import named
from lissajous_env.parameters.parts import Faults, Noise, Robot, Targets, Task
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory.geometry import largest_speed
from lissajous_env.world.score import is_open
from lissajous_env.world.simulation import Simulation

ROUNDS = 12
"""Times T_max that a formation is followed for: a guarantee that is open then counts as none."""
CELLS = 90
"""Cells along the longer side of the rectangle, unless they are asked for."""
_HALVINGS = 9


class Reach(NamedTuple):
    """What a formation with one sensor guarantees."""

    radius: float
    """r_s [m]."""
    critical_speed: float
    """How fast a rogue must be to stay unseen for ever [m/s]; inf where none that was tried can."""
    guaranteed_time: float
    """Longest time for which a rogue of a given speed can stay unseen [s]; inf for ever."""


def reach_of(scenario: str | Scenario, speed: float, radius: float | None = None, cells: int = CELLS) -> Reach:
    """What the formation of a scenario guarantees against rogues of a speed [m/s].

    Args:
        scenario: Whose formation.
        speed: Of the rogues [m/s].
        radius: r_s [m]; that of the scenario by default.
        cells: Of the grid, along the longer side of the rectangle.
    """
    scenario = named.scenario(scenario)
    radius = scenario.sensing_radius if radius is None else radius
    return Reach(radius, critical_speed(scenario, radius, cells), guaranteed_time(scenario, radius, speed, cells))


def unseen_over_time(
    policy: ActingPolicy, scenario: str | Scenario, seeds: Sequence[int], device: Any = "cpu"
) -> np.ndarray:
    """How long a rogue can have gone unseen at the reset and after each control step, t - min e.

    Args:
        policy: What acts, in as many worlds as there are seeds.
        scenario: With `task.contamination`.
        seeds: Of the episodes.
        device: Warp device of the simulation.

    Returns:
        (episodes, steps + 1) [s].

    Raises:
        ValueError: the scenario does not follow contamination.
    """
    scenario = named.scenario(scenario)
    check_follows(scenario)
    simulation = Simulation(scenario, policy.num_worlds, device=device)
    ages: list[np.ndarray] = []
    Referee(policy, simulation).play(seeds, lambda taken: ages.append(simulation.contamination.age.numpy().copy()))
    return np.stack(ages, axis=1) * scenario.task.step


def check_follows(scenario: str | Scenario) -> None:
    """Raise ValueError where a scenario does not follow contamination."""
    scenario = named.scenario(scenario)
    if scenario.task.contamination is None:
        raise ValueError(f"task.contamination of {scenario.name} must be (columns, rows), got None")


def in_formation(
    scenario: str | Scenario, radius: float | None = None, speed: float = 0.0, cells: int = CELLS
) -> Scenario:
    """Points in the equilibrium (2) of a scenario, without faults, among rogues that may be anywhere at any time.

    Args:
        scenario: Whose curve, formation and times.
        radius: r_s [m]; that of the scenario by default.
        speed: Of the rogues [m/s].
        cells: Of the grid, along the longer side of the rectangle.

    Raises:
        ValueError: rogues that are too fast for the grid.
    """
    scenario = named.scenario(scenario)
    curve, known = scenario.curve, scenario.resolve()
    side = 2 * max(curve.half_width, curve.half_height) / cells
    limit = 30 * side / scenario.task.step
    if speed > limit:
        rule = f"must be at most {limit:.3g} m/s where cells are {side:.3g} m and a step {scenario.task.step:g} s"
        raise ValueError(f"the speed of rogues {rule}, got {speed:g}")
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
    """Longest time for which a rogue can stay unseen by the formation in its equilibrium [s]; inf where for ever.

    Args:
        scenario: Whose formation.
        radius: r_s [m]; that of the scenario by default.
        speed: Of the rogue [m/s].
        cells: Of the grid, along the longer side of the rectangle.
    """
    simulation = Simulation(in_formation(scenario, radius, speed, cells), threads=1)
    ages = _played(simulation, until_cleared=False)
    return math.inf if ages is None else ages * simulation.scenario.task.step


def critical_speed(scenario: str | Scenario, radius: float | None = None, cells: int = CELLS) -> float:
    """Speed from which on a rogue can stay unseen by the formation for ever [m/s], to a part in 500 of the range.

    Args:
        scenario: Whose formation.
        radius: r_s [m]; that of the scenario by default.
        cells: Of the grid, along the longer side of the rectangle.

    Returns:
        0 where even one at rest can, inf where none up to `fastest_rogue` can.
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
    """Speed up to which `critical_speed` looks [m/s]: four times the robots' own, or what the grid can follow."""
    scenario = named.scenario(scenario)
    curve = scenario.curve
    side = 2 * max(curve.half_width, curve.half_height) / cells
    return min(4 * scenario.formation.phase_rate * largest_speed(curve), 15 * side / scenario.task.step)


def _clears(scenario: Scenario, radius: float | None, speed: float, cells: int) -> bool:
    simulation = Simulation(in_formation(scenario, radius, speed, cells), threads=1)
    return _played(simulation, until_cleared=True) is not None


def _played(simulation: Simulation, until_cleared: bool) -> int | None:
    """Return the longest age of an episode, or up to when the start's rogues were all seen [step]; None where open.

    The formation repeats itself, so what a rogue can do for ever from some moment on, one of the start can do from the
    beginning on: once these were all seen, none can.
    """
    simulation.action.fill_(1.0)
    field, steps = simulation.contamination, simulation.scenario.task.steps
    for now in range(1, steps + 1):
        simulation.advance()
        if until_cleared and now % 10 == 0 and field.oldest.numpy()[0] > 0:
            return int(field.age_max.numpy()[0])
    longest, at_end = int(field.age_max.numpy()[0]), int(field.age.numpy()[0])
    return None if is_open(longest, at_end, steps) else longest
