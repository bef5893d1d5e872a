"""Rules across the parts of a `Scenario`, which are checked when it is made; each part checks its own fields."""

import math
from typing import Any

import numpy as np

from lissajous_env.parameters.extensions import TargetEntry, TargetMotion
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.rogues import rogue_of
from lissajous_env.settings.task import MOST_TARGETS
from lissajous_env.theory import closed_forms

_OUTSIDE = 1.002
"""Factor by which a curve of harmonics may exceed its rectangle; `Curve.through` has an error of up to 0.1 %."""


def check_together(scenario: Any) -> None:
    """Check the rules that involve several parts of a `Scenario`.

    Raises:
        ValueError: a scenario violates one; the message names the field, the rule and the value.
    """
    _check_harmonics(scenario)
    _check_robots(scenario)
    _check_inset(scenario)
    _check_times(scenario)
    if scenario.task.action == "velocity" and scenario.robot.kind != "car":
        raise ValueError(f"task.action must be control for robots of kind {scenario.robot.kind}, got velocity")
    if scenario.sight < scenario.sensing_radius:
        rule = f"must be at least the sensing radius, {scenario.sensing_radius:g} [m]"
        raise ValueError(f"sensing.sight {rule}, got {scenario.sensing.sight}")
    model_of(scenario.robot.kind).check(
        scenario.curve, scenario.formation, scenario.robot, scenario.noise, scenario.task
    )
    _check_contamination(scenario)
    _check_entry(scenario)
    _check_rogues(scenario)
    if scenario.target_capacity > MOST_TARGETS:
        rule = f"must bring at most {MOST_TARGETS} targets per episode, with those of the start and six deviations"
        raise ValueError(f"targets.arrival_rate {rule} [1/s], got {scenario.targets.arrival_rate}")


def _check_harmonics(scenario: Any) -> None:
    if not scenario.curve.harmonics:
        return
    curve = scenario.curve
    gamma = np.linspace(0, 2 * np.pi, 32 * len(curve.harmonics) + 64, endpoint=False)
    extent = np.abs(closed_forms.curve_point(curve, gamma)).max(axis=0)
    if (extent > _OUTSIDE * np.array([curve.half_width, curve.half_height])).any():
        rule = f"must stay in the rectangle, {curve.half_width:g} m x {curve.half_height:g} m to each side"
        raise ValueError(f"curve.harmonics {rule}, got a curve that reaches {extent[0]:.6g} m x {extent[1]:.6g} m")


def _check_robots(scenario: Any) -> None:
    if scenario.curve.harmonics:
        for name, value in (("robot.count", scenario.robot.count), ("sensing.radius", scenario.sensing.radius)):
            if value is None:
                raise ValueError(
                    f"{name} must be given for a curve of harmonics, because the paper's formulas do not apply"
                )
    n = scenario.num_robots
    if n > 1024:
        raise ValueError(f"robot.count must be given, from 1 to 1024, because a + b is {n}, got None")
    named = [
        ("formation.ring", scenario.formation.ring or ()),
        ("formation.displaced", [robot for robot, _ in scenario.formation.displaced]),
        ("robot.drive_factors", [robot for robot, _ in scenario.robot.drive_factors]),
        ("faults.schedule", [robot for robot, _, _ in scenario.faults.schedule]),
        ("faults.removed", [robot for robot, _ in scenario.faults.removed]),
    ]
    for name, robots in named:
        if any(robot >= n for robot in robots):
            raise ValueError(f"{name} must name robots 0 to {n - 1}, got {tuple(robots)}")
    ring = scenario.formation.ring
    if ring is not None and sorted(ring) != list(range(n)):
        raise ValueError(f"formation.ring must contain each of the {n} robots once, got {ring}")
    if scenario.faults.lost > n:
        raise ValueError(f"faults.lost must be at most the {n} robots, got {scenario.faults.lost}")
    if scenario.faults.stop == "coast" and scenario.robot.kind != "car":
        raise ValueError(f"faults.stop must be dead for robots of kind {scenario.robot.kind}, got coast")


def _check_inset(scenario: Any) -> None:
    half, radius = min(scenario.curve.half_width, scenario.curve.half_height), scenario.robot.radius
    if scenario.task.boundary == "wall" and radius >= half:
        raise ValueError(f"robot.radius must be below {half:g}, half of the distance of the walls [m], got {radius}")
    if scenario.inset >= half:
        raise ValueError(
            f"curve.inset must be below {half:g}, half of the rectangle's side [m], got {scenario.inset:g}"
        )
    if scenario.sensing.radius is not None and scenario.sensing.radius < scenario.inset:
        rule = f"must be at least the inset of {scenario.inset:g}, or robots do not sense the edge [m]"
        raise ValueError(f"sensing.radius {rule}, got {scenario.sensing.radius}")


def _check_contamination(scenario: Any) -> None:
    if scenario.task.contamination is not None and scenario.targets.custom > 0 and scenario.targets.speed_limit is None:
        rule = "must be given if targets have a custom motion and task.contamination is set"
        raise ValueError(f"targets.speed_limit {rule} [m/s], got None")
    if scenario.task.contamination is not None and scenario.targets.respawn and scenario.targets.arrival_rate == 0:
        rule = "must be above 0 if targets appear anew and task.contamination is set [1/s]"
        raise ValueError(f"targets.arrival_rate {rule}, got 0")
    _ = scenario.spreading


def _check_entry(scenario: Any) -> None:
    laws = [each.name for each in scenario.extensions if isinstance(each, TargetEntry)]
    if (scenario.targets.entry == "custom") != bool(laws):
        rule = (
            f"must be custom with the law of entry {laws[0]}" if laws else "must not be custom without a target_entry"
        )
        raise ValueError(f"targets.entry {rule}, got {scenario.targets.entry}")


def _check_rogues(scenario: Any) -> None:
    name = scenario.targets.rogues
    if name is None:
        return
    rogue = rogue_of(name)
    if scenario.rogue_speed <= 0:
        raise ValueError(
            f"targets.speed_limit must be above 0 if rogues move the targets [m/s], got {scenario.rogue_speed}"
        )
    if rogue is not None and rogue.needs_contamination and scenario.task.contamination is None:
        raise ValueError(f"task.contamination must be given for the rogue {name}, got None")
    for each in scenario.extensions:
        if isinstance(each, TargetMotion):
            raise ValueError(f"targets.rogues must be None with the target motion {each.name}, got {name}")


def _check_times(scenario: Any) -> None:
    """Check that times do not round to zero steps."""
    step = scenario.task.step
    for fault in scenario.faults.schedule:
        if fault[2] < math.inf and round(fault[2] / step) == round(fault[1] / step):
            rule = f"must contain faults of at least one step of {step:g} s, after both ends are rounded to steps [s]"
            raise ValueError(f"faults.schedule {rule}, got {fault}")
    delay = scenario.noise.message_delay
    if delay > 0 and not 1 <= round(delay / step) <= 1000:
        raise ValueError(f"noise.message_delay must be 0 or from 1 to 1000 steps of {step:g} s [s], got {delay}")
