"""The scripted rogue `hide`, which reads from the grid where the contaminated age is largest."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.part_structs import SensingStruct, TargetStruct, TaskStruct
from lissajous_env.device.stage import TARGET, stage
from lissajous_env.device.trig import cos_sin
from lissajous_env.parameters.rogues import Rogue, register_rogue
from lissajous_env.world.contamination.labels import MARGIN, NONE, Hops, slot_of
from lissajous_env.world.rogues.rows import ROBOT, ROBOTS
from lissajous_env.world.rogues.scripted import (
    DIRECTIONS,
    TURN,
    Rules,
    follow_gap,
    is_sensing,
    least_gap,
    own_place,
    robot_away,
    rules_of,
)
from lissajous_env.world.state import Clock, Contamination, Rogues

wp.set_module_options(OPTIONS)

_DEPTH = wp.constant(0.5)
"""Distance to which the cells around the one where it goes count [sensing radius]."""
_MARGIN = wp.constant(0.2)
"""Distance from every disc that it preserves, if it can [sensing radius]."""


@wp.func
def age_of(w: int, row: int, column: int, slot: int, now: int, conservative: int, contamination: Contamination) -> int:
    """Return for how long a target in a cell can have been undetected [step]; 0 for a cell that is cleared."""
    label = contamination.labels[w, slot, row + MARGIN, column + MARGIN]
    there = contamination.there[w, row + MARGIN, column / 32 + 1, slot] >> wp.uint32(column % 32)
    if label >= NONE or (conservative == 0 and (there & wp.uint32(1)) == wp.uint32(0)):
        return 0
    return now - label / 256


@wp.func
def age_around(
    w: int,
    row: int,
    column: int,
    aside: int,
    up: int,
    columns: int,
    slot: int,
    now: int,
    conservative: int,
    contamination: Contamination,
) -> int:
    """Return the smallest age of a cell and of the four that are so many columns aside or rows up or down [step]."""
    rows = contamination.row_ages.shape[1]
    age = age_of(w, row, column, slot, now, conservative, contamination)
    for k in range(4):
        sign = 1 - 2 * (k % 2)
        near_row = wp.clamp(row + wp.where(k < 2, sign * up, 0), 0, rows - 1)
        near_column = wp.clamp(column + wp.where(k < 2, 0, sign * aside), 0, columns - 1)
        age = wp.min(age, age_of(w, near_row, near_column, slot, now, conservative, contamination))
    return age


@wp.func
def is_clear(w: int, t: int, offset: wp.vec2, rules: Rules, rogues: Rogues) -> bool:
    """Return whether a place relative to a rogue [m] is clear of all discs."""
    least = (1.0 + _MARGIN) * rules.radius
    entry = int(ROBOTS)
    while entry < rogues.observation.shape[2]:
        away = robot_away(w, t, entry, rules, rogues) - offset
        if is_sensing(w, t, entry, rogues) and wp.dot(away, away) < least * least:
            return False
        entry += ROBOT
    return True


@wp.func
def around(w: int, t: int, wanted: wp.vec2, rules: Rules, rogues: Rogues) -> wp.vec2:
    """Return the direction nearest to a wanted one in which no disc comes close; without any, that of `follow_gap`."""
    best = follow_gap(w, t, 0, rules, rogues)
    nearest = float(-1.0e30)
    for k in range(-1, DIRECTIONS + 1):
        ahead = cos_sin(TURN * float(k) / float(DIRECTIONS))
        if k == -1:
            ahead = wanted
        elif k == DIRECTIONS:
            ahead = wp.vec2(0.0, 0.0)
        if wp.dot(ahead, wanted) <= nearest:
            continue
        if least_gap(w, t, ahead, rules, rogues) > _MARGIN * rules.radius:
            nearest = wp.dot(ahead, wanted)
            best = ahead
    return best


@stage(TARGET, writes="rogues: action", split=True)
def hide(
    w: int,
    t: int,
    curve: CurveStruct,
    sensing: SensingStruct,
    target: TargetStruct,
    task: TaskStruct,
    speed_unit: float,
    hops: Hops,
    clock: Clock,
    contamination: Contamination,
    rogues: Rogues,
):
    """Go to the cell clear of all discs in which a target can be undetected for longest when the rogue arrives."""
    rules = rules_of(curve, sensing, target, task, speed_unit)
    rows = contamination.row_ages.shape[1]
    now = clock.step[w] - 1  # the labels and the rows are of the end of the step before
    slot = slot_of(now, hops.ticks - 1, hops)
    cell = wp.vec2(2.0 * curve.half_width / float(hops.columns), 2.0 * curve.half_height / float(rows))
    aside = int(_DEPTH * sensing.radius / cell[0])
    up = int(_DEPTH * sensing.radius / cell[1])
    if rogues.observation[w, t, 0] > 0.0:
        here = own_place(w, t, rules, rogues)
        best = wp.vec2(0.0, 0.0)
        most = float(-1.0e30)
        for row in range(rows):
            for column in range(hops.columns):
                x = (float(column) + 0.5) * cell[0] - curve.half_width - here[0]
                offset = wp.vec2(x, (float(row) + 0.5) * cell[1] - curve.half_height - here[1])
                takes = wp.length(offset) / rules.speed
                age = age_of(w, row, column, slot, now, task.conservative, contamination)
                if float(age) * task.step - takes > most:
                    age = age_around(
                        w, row, column, aside, up, hops.columns, slot, now, task.conservative, contamination
                    )
                    value = float(age) * task.step - takes
                    if value > most and is_clear(w, t, offset, rules, rogues):
                        most = value
                        best = offset
        ahead = around(w, t, best / wp.max(wp.length(best), rules.speed * rules.step), rules, rogues)
        rogues.action[w, t, 0] = ahead[0]
        rogues.action[w, t, 1] = ahead[1]


register_rogue(
    Rogue("hide", hide, "goes where a target can have been undetected for longest", needs_contamination=True)
)
