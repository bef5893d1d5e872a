"""Designs as scenarios: how one is made of a candidate, played by the paper's method, and judged by what it did."""

import dataclasses
import math
import warnings
from collections.abc import Sequence
from typing import Any

from baselines.policies import registry
from lissajous_env.episodes.evaluation import evaluate
from lissajous_env.episodes.guarantee import CELLS
from lissajous_env.parameters import named
from lissajous_env.parameters.parts import Formation, Robot, Targets, Task
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory.assumptions import AssumptionWarning
from lissajous_env.theory.candidate import Candidate

TRIES = 6
"""Designs that are played at most until one works."""
_LAPS = 1.5
"""Laps of a played episode."""
_MOST_STEPS = 20_000
"""Most control steps of a played episode."""
_PHASE_STEP = 0.09
"""Phase of the curve's faster oscillation that passes in a control step [rad], as in the paper's experiment."""
_REACH_STEP = 0.25
"""Largest part of a sensor's radius that a robot moves in a control step."""
_LAG_STEP = 1.0
"""Largest control step of a car in time constants of its motor, 1 / drag."""
_GRID = 36
"""Cells of the coverage grid along the longer side of the rectangle."""
_TARGETS = 100
_LEAST_DISTANCE = 0.9
"""Part of the formation's distance that the robots of a design that works drive."""
_POLICIES = {"car": "kuramoto-mpcc", "curve": "kuramoto"}
"""The paper's method, by kind of robot."""


@dataclasses.dataclass(frozen=True)
class Played:
    """A design, and the score of an episode of it."""

    candidate: Candidate
    scenario: Scenario
    policy: str
    row: dict[str, Any]

    @property
    def formation_distance(self) -> float:
        """Distance that a robot drives which stays in the formation [m]."""
        return self.candidate.mean_speed * self.scenario.task.duration

    @property
    def failures(self) -> list[str]:
        """Conditions of a design that works which the episode violates, with their numbers; empty where it works."""
        row, bound, found = self.row, self.candidate.detection_time_bound, []
        if row["collisions"] > 0:
            found.append(f"{row['collisions']} collisions, none is allowed")
        share = row["distance_mean"] / self.formation_distance
        if share < _LEAST_DISTANCE:
            found.append(f"robots drove {share:.0%} of the formation's distance, {_LEAST_DISTANCE:.0%} is required")
        if row["detected_within_bound"] < 1:  # NaN where no target was there for T_max
            found.append(f"{1 - row['detected_within_bound']:.1%} of the targets were not detected within T_max")
        if row["guaranteed_detection_time"] > bound:
            worst = row["guaranteed_detection_time"]
            found.append(f"a rogue can have stayed undetected for {worst:.3g} s, T_max is {bound:.3g} s")
        return found


def scenario_of(candidate: Candidate, robot: Robot, base: Scenario | None, rogue_speed: float | None) -> Scenario:
    """Make the scenario of a design: `base`, or a plain one, with its curve, its formation and its robots.

    Without a base its control step is in proportion to the motion: the paper's for the paper's experiment.
    """
    step = _step(candidate, robot) if base is None else base.task.step
    steps = min(math.ceil(_LAPS * candidate.lap_time / step), _MOST_STEPS)
    task = Task(step=step) if base is None else base.task
    changed = candidate.overrides | {
        "robot.kind": robot.kind,
        "task.duration": float(f"{step * steps:.9g}"),
        "task.grid": _cells(candidate, _GRID),
    }
    if base is None:
        moving = 0.0 if rogue_speed is None else rogue_speed
        base = Scenario(
            name="design",
            formation=Formation(start="rotated", start_noise=0.02),
            targets=Targets(count=_TARGETS, wandering=1.0 if moving else 0.0, speed=moving),
            task=task,
        )
    if rogue_speed is not None:
        changed["targets.speed_limit"] = rogue_speed
    if rogue_speed is not None or task.contamination is not None:
        changed["task.contamination"] = _cells(candidate, CELLS)
    sides = f"{2 * candidate.curve.half_width:g} m x {2 * candidate.curve.half_height:g} m"
    words = f"{candidate.num_robots} robots on {candidate.curve.a}:{candidate.curve.b} in {sides}"
    made = named.build(dataclasses.replace(base, extensions=()), **changed)
    return dataclasses.replace(made, description=f"{words}: T_max = {candidate.detection_time_bound:.3g} s.")


def play(candidate: Candidate, scenario: Scenario, seed: int = 0) -> Played | None:
    """Play an episode of a design by the paper's method; None where the package has none for these robots."""
    policy = _POLICIES.get(scenario.robot.kind)
    if policy is None:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AssumptionWarning)  # the command prints what a design violates
        (row,) = evaluate(registry.make(policy, scenario), scenario, [seed])
    return Played(candidate, scenario, policy, row)


def first_that_works(
    candidates: Sequence[Candidate], robot: Robot, base: Scenario | None, rogue_speed: float | None, seed: int = 0
) -> tuple[Played | None, list[Played]]:
    """Play designs in their order until one works, `TRIES` at most.

    Returns:
        The first that works, None where none does, and those that were played before it.
    """
    refused: list[Played] = []
    for candidate in candidates[:TRIES]:
        played = play(candidate, scenario_of(candidate, robot, base, rogue_speed), seed)
        if played is None or not played.failures:
            return played, refused
        refused.append(played)
    return None, refused


def _step(candidate: Candidate, robot: Robot) -> float:
    """Control step of a design that is given none [s]."""
    oscillation = max(candidate.curve.a, candidate.curve.b) * candidate.phase_rate
    limits = [_PHASE_STEP / oscillation, _REACH_STEP * candidate.sensor_radius / candidate.top_speed]
    return float(f"{min(limits + ([_LAG_STEP / robot.drag] if robot.kind == 'car' else [])):.3g}")


def _cells(candidate: Candidate, longest: int) -> tuple[int, int]:
    """Columns and rows of a grid of about square cells."""
    halves = candidate.curve.half_width, candidate.curve.half_height
    columns, rows = (max(round(longest * half / max(halves)), 1) for half in halves)
    return columns, rows
