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
from lissajous_env.parameters.assumptions import AssumptionWarning
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.parts import Formation, Robot, Targets, Task
from lissajous_env.theory.candidate import Candidate
from lissajous_env.theory.geometry import curve_length
from lissajous_env.world.columns import (
    COLLISIONS,
    DISTANCE,
    LARGEST_LATERAL_ERROR,
    LATEST_DETECTION,
    TOP_SPEED,
    WITHIN_BOUND,
    WORST_CASE,
    Column,
)

TRIES = ((1.0, 4), (0.5, 2), (0.25, 2))
"""Designs that are simulated until one works: share of the largest phase rate, and number of designs at it.

A formation at the robots' top speed may ask too much of their motors: cars brake by coasting.
"""
EPISODES = 3
"""Episodes of a design that are played."""
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
_START = 0.5
"""Standard deviation of the robots' places along the curve at the start, in body radii; in the paper's experiment 0.6.
"""
_LEAST_DISTANCE = 0.9
"""Part of the formation's distance that the robots of a design that works drive."""
_POLICIES = {"car": "kuramoto-mpcc", "curve": "kuramoto"}
"""The paper's method, by kind of robot."""


@dataclasses.dataclass(frozen=True)
class Played:
    """A design, and the scores of some episodes of it."""

    candidate: Candidate
    scenario: Scenario
    policy: str
    rows: list[dict[str, Any]]

    @property
    def distance_share(self) -> float:
        """Mean distance that robots drove, over that of one which stays in the formation, in the worst episode."""
        formation = self.candidate.mean_speed * self.scenario.task.duration
        return min(self._of(DISTANCE)) / formation

    @property
    def top_speed(self) -> float:
        """Speed of the fastest robot [m/s]."""
        return max(self._of(TOP_SPEED))

    @property
    def collisions(self) -> int:
        """Collisions of all episodes."""
        return sum(self._of(COLLISIONS))

    @property
    def late_share(self) -> float:
        """Share of the targets that were not detected within T_max, in the worst episode; NaN where it is unknown."""
        return 1 - min(self._of(WITHIN_BOUND))

    @property
    def detection_time(self) -> float:
        """Longest detection time of all targets [s]."""
        return max(self._of(LATEST_DETECTION))

    @property
    def undetected_time(self) -> float:
        """Return the worst-case undetected time of all episodes [s]; NaN if contamination was not computed."""
        return max(self._of(WORST_CASE))

    @property
    def failures(self) -> list[str]:
        """Conditions of a design that works which the episodes violate, with their numbers; empty where it works."""
        found, bound = [], self.candidate.detection_time_bound
        if self.collisions > 0:
            off = max(self._of(LARGEST_LATERAL_ERROR))
            allowed = (
                f"(6) allows bodies of {self.candidate.robot_radius_bound:.3g} m for robots that keep their places"
            )
            found.append(f"{self.collisions} collisions; robots left the curve by up to {off:.2g} m, {allowed}")
        if self.distance_share < _LEAST_DISTANCE:
            required = f"{_LEAST_DISTANCE:.0%} is required"
            found.append(f"robots drove {self.distance_share:.0%} of the formation's distance, {required}")
        if self.late_share > 0:
            found.append(f"{self.late_share:.1%} of the targets were not detected within T_max = {bound:.3g} s")
        if self.undetected_time > bound:
            found.append(
                f"a target can have stayed undetected for {self.undetected_time:.3g} s, T_max is {bound:.3g} s"
            )
        return found

    def _of(self, column: Column) -> list[Any]:
        """Return the numbers of a column, one of each episode that has one; NaN if none has."""
        return [row[column.name] for row in self.rows if not math.isnan(row[column.name])] or [math.nan]


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
    unit = candidate.alpha * candidate.mean_speed / candidate.phase_rate  # [m/rad]
    if base is not None:  # robots begin as far from their places as there [m]
        there = base.alpha * curve_length(base.curve) / (2 * math.pi)
        changed["formation.start_noise"] = base.formation.start_noise * there / unit
    if base is None:
        moving = 0.0 if rogue_speed is None else rogue_speed
        base = Scenario(
            name="design",
            formation=Formation(start="rotated", start_noise=_START * candidate.robot_radius / unit),
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
    """Play episodes of a design by the paper's method; None where the package has none for these robots."""
    policy = _POLICIES.get(scenario.robot.kind)
    if policy is None:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AssumptionWarning)  # the command prints what a design violates
        rows = evaluate(registry.make(policy, scenario, EPISODES), scenario, range(seed, seed + EPISODES))
    return Played(candidate, scenario, policy, rows)


def first_that_works(
    candidates: Sequence[Candidate],
    robot: Robot,
    base: Scenario | None,
    rogue_speed: float | None,
    seed: int = 0,
    may_slow_down: bool = True,
) -> tuple[Played | None, list[Played]]:
    """Play designs in the order of `TRIES` until one works.

    Args:
        candidates: What may be played.
        robot: The robots.
        base: Scenario that the designs are made of; None for a plain one.
        rogue_speed: Top speed of the rogues [m/s]; None follows none.
        seed: Seed of the first episode of each.
        may_slow_down: Whether designs are tried at a part of their phase rate too.

    Returns:
        The first that works, None where none does, and those that were played before it.
    """
    refused: list[Played] = []
    tries = TRIES if may_slow_down else TRIES[:1]
    for candidate in (each.slowed(part) for part, count in tries for each in candidates[:count]):
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
