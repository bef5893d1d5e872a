"""The scripted rogue `hide`, which knows where the contaminated age is largest."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.part_structs import SensingStruct, TargetStruct, TaskStruct
from lissajous_env.device.program import PARTS
from lissajous_env.parameters.rogues import Rogue, register_rogue
from lissajous_env.world.contamination.labels import MARGIN, NONE, Hops, slot_of
from lissajous_env.world.rogues.rows import ROBOT, ROBOTS
from lissajous_env.world.rogues.scripted import Rules, is_sensing, nearest_sensing, own_place, robot_away, rules_of
from lissajous_env.world.state import Clock, Contamination, Rogues

wp.set_module_options(OPTIONS)

_CLEARANCE = wp.constant(0.5)
"""Distance from every disc of the cells to which it goes, and from which on it goes around a disc [sensing radius]."""


@wp.func
def age_of(w: int, row: int, column: int, slot: int, now: int, conservative: int, contamination: Contamination) -> int:
    """Return for how long a target in a cell can have been undetected [step]; 0 for a cell that is cleared."""
    label = contamination.labels[w, slot, row + MARGIN, column + MARGIN]
    there = contamination.there[w, row + MARGIN, column / 32 + 1, slot] >> wp.uint32(column % 32)
    if label >= NONE or (conservative == 0 and (there & wp.uint32(1)) == wp.uint32(0)):
        return 0
    return now - label / 256


@wp.func
def is_clear(w: int, t: int, offset: wp.vec2, rules: Rules, rogues: Rogues) -> bool:
    """Return whether a place relative to a rogue [m] is clear of all discs."""
    least = (1.0 + _CLEARANCE) * rules.radius
    entry = int(ROBOTS)
    while entry < rogues.observation.shape[2]:
        away = robot_away(w, t, entry, rules, rogues) - offset
        if is_sensing(w, t, entry, rogues) and wp.dot(away, away) < least * least:
            return False
        entry += ROBOT
    return True


@wp.func
def around(w: int, t: int, ahead: wp.vec2, rules: Rules, rogues: Rogues) -> wp.vec2:
    """Return a direction that leads around the disc of the nearest working robot instead of towards it."""
    entry = nearest_sensing(w, t, rogues)
    if entry < 0:
        return ahead
    away = robot_away(w, t, entry, rules, rogues)
    if wp.length(away) > (1.0 + _CLEARANCE) * rules.radius:
        return ahead
    towards = wp.normalize(away)
    # Its part towards the robot is turned away from it.
    return wp.normalize(ahead - (wp.abs(wp.dot(ahead, towards)) + wp.dot(ahead, towards)) * towards - towards)


@wp.kernel
def hide(
    first: int,
    lanes: int,
    begin: int,
    end: int,
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
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    rules = rules_of(curve, sensing, target, task, speed_unit)
    rows = contamination.row_ages.shape[1]
    now = clock.step[w] - 1  # the labels and the rows are of the end of the step before
    slot = slot_of(now, hops.ticks - 1, hops)
    cell = wp.vec2(2.0 * curve.half_width / float(hops.columns), 2.0 * curve.half_height / float(rows))
    for t in range(begin + lane, end, lanes):
        if rogues.observation[w, t, 0] > 0.0:
            here = own_place(w, t, rules, rogues)
            best = wp.vec2(0.0, 0.0)
            most = float(-1.0e30)
            for row in range(rows):
                for column in range(hops.columns):
                    x = (float(column) + 0.5) * cell[0] - curve.half_width - here[0]
                    offset = wp.vec2(x, (float(row) + 0.5) * cell[1] - curve.half_height - here[1])
                    age = float(age_of(w, row, column, slot, now, task.conservative, contamination)) * task.step
                    value = age - wp.length(offset) / rules.speed
                    if value > most:
                        if is_clear(w, t, offset, rules, rogues):
                            most = value
                            best = offset
            ahead = around(w, t, best / wp.max(wp.length(best), rules.speed * rules.step), rules, rogues)
            rogues.action[w, t, 0] = ahead[0]
            rogues.action[w, t, 1] = ahead[1]


register_rogue(
    Rogue("hide", hide, "goes where a target can have been undetected for longest", PARTS, needs_contamination=True)
)
