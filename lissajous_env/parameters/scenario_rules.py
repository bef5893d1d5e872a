"""Rules across the parts of a `Scenario`, which are checked when it is made; each part checks its own fields."""

import math
import operator
from typing import Any

import numpy as np

from lissajous_env.parameters.extensions import TargetEntry, TargetMotion
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.rogues import rogue_of
from lissajous_env.settings.task import MOST_TARGETS
from lissajous_env.theory import closed_forms

_OUTSIDE = 1.002
"""Factor by which a curve of harmonics may exceed its rectangle; `Curve.through` has an error of up to 0.1 %."""
_ROBOTS = "formation.ring", "formation.displaced", "robot.drive_factors", "faults.schedule", "faults.removed"
"""Fields that name robots, alone or first in a row."""


def check_together(scenario: Any) -> None:
    """Check the rules that involve several parts of a `Scenario`.

    Raises:
        ValueError: a scenario violates one; the message names the field, the rule and the value.
    """
    _check_harmonics(scenario)
    _check_robots(scenario)
    _check_inset(scenario)
    _check_times(scenario)
    curve, kind, sensed, task = scenario.curve, scenario.robot.kind, scenario.sensing_radius, scenario.task
    is_driven = task.action != "velocity" or kind == "car"
    _require(is_driven, scenario, "task.action", f"must be control for robots of kind {kind}")
    rule = f"must be at least the sensing radius, {sensed:g} [m]"
    _require(scenario.sight >= sensed, scenario, "sensing.sight", rule)
    if (check := model_of(kind).check) is not None:
        check(curve, scenario.formation, scenario.robot, scenario.noise, task)
    _check_targets(scenario)


def _require(holds: bool, scenario: Any, name: str, rule: str) -> None:
    """Raise ValueError with the dotted name, the rule and the value of a field whose rule does not hold."""
    if not holds:
        raise ValueError(f"{name} {rule}, got {operator.attrgetter(name)(scenario)}")


def _check_harmonics(scenario: Any) -> None:
    curve = scenario.curve
    if not curve.harmonics:
        return
    gamma = np.linspace(0, 2 * np.pi, 32 * len(curve.harmonics) + 64, endpoint=False)
    extent = np.abs(closed_forms.curve_point(curve, gamma)).max(axis=0)
    if (extent > _OUTSIDE * np.array([curve.half_width, curve.half_height])).any():
        rule = f"must stay in the rectangle, {curve.half_width:g} m x {curve.half_height:g} m to each side"
        raise ValueError(f"curve.harmonics {rule}, got a curve that reaches {extent[0]:.6g} m x {extent[1]:.6g} m")
    rule = "must be given for a curve of harmonics, because the paper's formulas do not apply"
    for name in ("robot.count", "sensing.radius"):
        _require(operator.attrgetter(name)(scenario) is not None, scenario, name, rule)


def _check_robots(scenario: Any) -> None:
    n, kind, ring = scenario.num_robots, scenario.robot.kind, scenario.formation.ring
    _require(n <= 1024, scenario, "robot.count", f"must be given, from 1 to 1024, because a + b is {n}")
    for name in _ROBOTS:
        rows = operator.attrgetter(name)(scenario) or ()
        robots = tuple(row[0] if isinstance(row, tuple) else row for row in rows)
        if any(robot >= n for robot in robots):
            raise ValueError(f"{name} must name robots 0 to {n - 1}, got {robots}")
    is_ring = ring is None or sorted(ring) == list(range(n))
    _require(is_ring, scenario, "formation.ring", f"must contain each of the {n} robots once")
    _require(scenario.faults.lost <= n, scenario, "faults.lost", f"must be at most the {n} robots")
    stops = scenario.faults.stop != "coast" or kind == "car"
    _require(stops, scenario, "faults.stop", f"must be dead for robots of kind {kind}")


def _check_inset(scenario: Any) -> None:
    half, inset = min(scenario.curve.half_width, scenario.curve.half_height), scenario.inset
    fits = scenario.task.boundary != "wall" or scenario.robot.radius < half
    _require(fits, scenario, "robot.radius", f"must be below {half:g}, half of the distance of the walls [m]")
    if inset >= half:
        raise ValueError(f"curve.inset must be below {half:g}, half of the rectangle's side [m], got {inset:g}")
    senses = scenario.sensing.radius is None or scenario.sensing.radius >= inset
    rule = f"must be at least the inset of {inset:g}, or robots do not sense the edge [m]"
    _require(senses, scenario, "sensing.radius", rule)


def _check_times(scenario: Any) -> None:
    """Check that times do not round to zero steps."""
    step, delay = scenario.task.step, scenario.noise.message_delay
    for fault in scenario.faults.schedule:
        if fault[2] < math.inf and round(fault[2] / step) == round(fault[1] / step):
            rule = f"must contain faults of at least one step of {step:g} s, after both ends are rounded to steps [s]"
            raise ValueError(f"faults.schedule {rule}, got {fault}")
    is_short = delay == 0 or 1 <= round(delay / step) <= 1000
    _require(is_short, scenario, "noise.message_delay", f"must be 0 or from 1 to 1000 steps of {step:g} s [s]")


def _check_targets(scenario: Any) -> None:
    targets, name = scenario.targets, scenario.targets.rogues
    if scenario.task.contamination is not None:
        is_limited = targets.custom == 0 or targets.speed_limit is not None
        rule = "must be given if targets have a custom motion and task.contamination is set [m/s]"
        _require(is_limited, scenario, "targets.speed_limit", rule)
        rule = "must be above 0 if targets appear anew and task.contamination is set [1/s]"
        _require(targets.arrival_rate > 0 or not targets.respawn, scenario, "targets.arrival_rate", rule)
    _ = scenario.spreading  # which checks the grid
    laws = [extension.name for extension in scenario.extensions if isinstance(extension, TargetEntry)]
    rule = f"must be custom with the law of entry {laws[0]}" if laws else "must not be custom without a target_entry"
    _require((targets.entry == "custom") == bool(laws), scenario, "targets.entry", rule)
    if name is not None:
        rogue_of(name)
        if scenario.rogue_speed <= 0:
            rule = "must be above 0 if rogues move the targets [m/s]"
            raise ValueError(f"targets.speed_limit {rule}, got {scenario.rogue_speed}")
        for extension in scenario.extensions:
            is_free = not isinstance(extension, TargetMotion)
            _require(is_free, scenario, "targets.rogues", f"must be None with the target motion {extension.name}")
    rule = f"must bring at most {MOST_TARGETS} targets per episode, with those of the start and six deviations [1/s]"
    _require(scenario.target_capacity <= MOST_TARGETS, scenario, "targets.arrival_rate", rule)
