"""Rules across the parts of a `Scenario`, which are checked when it is made; each part checks its own fields."""

import math
import operator
from collections.abc import Iterator
from typing import Any

import numpy as np

from lissajous_env.parameters.extensions import TargetEntry, TargetMotion
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.rogues import rogue_of
from lissajous_env.parameters.spreading import TICKS_MAX
from lissajous_env.settings.task import MOST_TARGETS
from lissajous_env.theory import closed_forms
from lissajous_env.wording import require

_EXCESS_MAX = 1.002
"""Factor by which a curve of harmonics may exceed its rectangle; `Curve.through` has an error of up to 0.1 %."""
_STRETCH_MAX = 1.5
"""Largest ratio of the sides of a cell of contamination."""
_ROBOT_FIELDS = "formation.displaced", "robot.drive_factors", "faults.schedule", "faults.removed"
"""Fields of rows that begin with a robot."""
Rules = Iterator[tuple[Any, ...]]
"""Rules in order: whether one holds, its field, the rule in words, and perhaps a value in place of the field's."""


def check_together(scenario: Any) -> None:
    """Check the rules that involve several parts of a `Scenario`.

    Raises:
        ValueError: a scenario violates one; the message names the field, the rule and the value.
    """
    for rules in (_of_harmonics, _of_robots, _of_inset, _of_times, _of_task, _of_contamination, _of_targets):
        for holds, name, rule, *got in rules(scenario):
            require(holds, name, rule, got[0] if got else operator.attrgetter(name)(scenario))


def _of_harmonics(scenario: Any) -> Rules:
    curve = scenario.curve
    if not curve.harmonics:
        return
    gamma = np.linspace(0, 2 * np.pi, 32 * len(curve.harmonics) + 64, endpoint=False)
    extent = np.abs(closed_forms.curve_point(curve, gamma)).max(axis=0)
    holds = (extent <= _EXCESS_MAX * np.array([curve.half_width, curve.half_height])).all()
    rule = f"must stay in the rectangle, {curve.half_width:g} m x {curve.half_height:g} m to each side"
    yield holds, "curve.harmonics", rule, [float(f"{half:.6g}") for half in extent]
    rule = "must be given for a curve of harmonics, because the paper's formulas do not apply"
    yield scenario.robot.count is not None, "robot.count", rule
    yield scenario.sensing.radius is not None, "sensing.radius", rule


def _of_robots(scenario: Any) -> Rules:
    n, kind, ring = scenario.num_robots, scenario.robot.kind, scenario.formation.ring
    yield n <= 1024, "robot.count", f"must be given, from 1 to 1024, because a + b is {n}"
    for name in _ROBOT_FIELDS:
        robots = tuple(row[0] for row in operator.attrgetter(name)(scenario))
        yield max(robots, default=0) < n, name, f"must name robots 0 to {n - 1}", robots
    is_ring = ring is None or sorted(ring) == list(range(n))
    yield is_ring, "formation.ring", f"must contain each of the {n} robots once"
    yield scenario.faults.lost <= n, "faults.lost", f"must be at most the {n} robots"
    is_gradual = scenario.robot.yaw_acceleration_max not in (None, math.inf) and not scenario.robot.stands_for_drive
    rule = "must be None or infinite for cars, which steer at once [rad/s^2]"
    yield kind != "car" or not is_gradual, "robot.yaw_acceleration_max", rule
    yield scenario.faults.stop != "coast" or kind == "car", "faults.stop", f"must be dead for robots of kind {kind}"


def _of_inset(scenario: Any) -> Rules:
    half, inset = min(scenario.curve.half_width, scenario.curve.half_height), scenario.inset
    fits = scenario.task.boundary != "wall" or scenario.robot.radius < half
    yield fits, "robot.radius", f"must be below {half:g}, half of the distance of the walls [m]"
    yield inset < half, "curve.inset", f"must be below {half:g}, half of the rectangle's side [m]", inset
    senses = scenario.sensing.radius is None or scenario.sensing.radius >= inset
    yield senses, "sensing.radius", f"must be at least the inset of {inset:g}, or robots do not sense the edge [m]"


def _of_times(scenario: Any) -> Rules:
    """Yield the rules by which no time rounds to zero steps."""
    step = scenario.task.step
    for fault in scenario.faults.schedule:
        lasts = fault[2] == math.inf or round(fault[2] / step) > round(fault[1] / step)
        rule = f"must contain faults of at least one step of {step:g} s, after both ends are rounded to steps [s]"
        yield lasts, "faults.schedule", rule, fault
    is_short = scenario.noise.message_delay == 0 or 1 <= scenario.delay_steps <= 1000
    yield is_short, "noise.message_delay", f"must be 0 or from 1 to 1000 steps of {step:g} s [s]"


def _of_task(scenario: Any) -> Rules:
    kind, sensed, task = scenario.robot.kind, scenario.sensing_radius, scenario.task
    yield scenario.has_formation or kind == "car", "task.action", f"must be control for robots of kind {kind}"
    yield scenario.sight >= sensed, "sensing.sight", f"must be at least the sensing radius, {sensed:g} [m]"
    if (check := model_of(kind).check) is not None:
        check(scenario.curve, scenario.formation, scenario.robot, scenario.noise, task)


def _of_contamination(scenario: Any) -> Rules:
    targets, grid = scenario.targets, scenario.task.contamination
    if grid is None:
        return
    rule = "must be given if targets have a custom motion and task.contamination is set [m/s]"
    yield targets.custom == 0 or targets.speed_limit is not None, "targets.speed_limit", rule
    rule = "must be above 0 if targets appear anew and their worst case is computed (task.contamination) [1/s]"
    yield targets.arrival_rate > 0 or not targets.respawn, "targets.arrival_rate", rule
    least, largest = sorted((2 * scenario.curve.half_width / grid[0], 2 * scenario.curve.half_height / grid[1]))
    rule = f"must make cells whose sides differ by {_STRETCH_MAX} times at most, not by {largest / least:.3g}"
    yield largest <= _STRETCH_MAX * least, "task.contamination", rule
    moved = scenario.rogue_speed * scenario.task.step
    rule = f"must make cells of at least 1/{TICKS_MAX} of an evading target's motion in a step, {moved:.3g} m"
    yield moved <= TICKS_MAX * least, "task.contamination", rule


def _of_targets(scenario: Any) -> Rules:
    targets, extensions = scenario.targets, scenario.extensions
    laws = [extension.name for extension in extensions if isinstance(extension, TargetEntry)]
    rule = f"must be custom with the law of entry {laws[0]}" if laws else "must not be custom without a target_entry"
    yield (targets.entry == "custom") == bool(laws), "targets.entry", rule
    motions = [extension.name for extension in extensions if isinstance(extension, TargetMotion)]
    if targets.rogues is None:
        rule = (
            f"must be above 0 with the target motion {motions[0]}" if motions else "must be 0 without a target_motion"
        )
        yield (targets.custom > 0) == bool(motions), "targets.custom", rule
    else:
        rogue_of(targets.rogues)
        limit = scenario.rogue_speed
        yield limit > 0, "targets.speed_limit", "must be above 0 if rogues move the targets [m/s]", limit
        yield not motions, "targets.rogues", f"must be None with the target motion {', '.join(motions)}"
    rule = f"must bring at most {MOST_TARGETS} targets per episode, with those of the start and six deviations [1/s]"
    yield scenario.target_capacity <= MOST_TARGETS, "targets.arrival_rate", rule
