"""Coverage and idleness of the cells of a grid: a cell is sensed when its centre lies in a working robot's disc.

A cell is touched when it comes into the discs and when it leaves them; what stays in them, most of what is sensed, is
counted by whole words of bits.
"""

from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.part_structs import SensingStruct
from lissajous_env.world.bits import lowest
from lissajous_env.world.discs import visit_disc
from lissajous_env.world.state import NOWHERE, Cells, Clock, Latest, Robots, Tally

wp.set_module_options(OPTIONS)


@wp.kernel
def reset_cells(first: int, lanes: int, clock: Clock, cells: Cells):
    """Forget every visit."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    for row in range(lane, cells.sensed_at.shape[1], lanes):
        for column in range(cells.sensed_at.shape[2]):
            cells.sensed_at[w, row, column] = 0
        for word in range(cells.sensed.shape[2]):
            cells.sensed[w, row, word] = wp.uint32(0)
            cells.in_discs[w, row, word] = wp.uint32(0)
            for i in range(cells.sensed_by.shape[2]):
                cells.sensed_by[w, row, i, word] = wp.uint32(0)
        cells.idle_squares[w, row] = wp.int64(0)
        cells.idle_max[w, row] = 0


@wp.func
def count_visits(w: int, row: int, now: int, cells: Cells) -> wp.int64:
    """Count the visits of a row's cells, from what is sensed now and what was; returns the idleness that they end."""
    ended = wp.int64(0)
    squares = cells.idle_squares[w, row]
    longest = cells.idle_max[w, row]
    for word in range(cells.in_discs.shape[2]):
        before = cells.in_discs[w, row, word]
        after = cells.coming[w, row, word]
        staying = wp.int64(wp.bit_count(before & after))
        if staying > wp.int64(0):  # each for a step
            squares += staying
            ended += staying
            longest = wp.max(longest, 1)
        changed = before ^ after
        while changed != wp.uint32(0):
            column = 32 * word + lowest(changed)
            if (before & changed & (~changed + wp.uint32(1))) != wp.uint32(0):
                cells.sensed_at[w, row, column] = now - 1
            else:
                gap = now - cells.sensed_at[w, row, column]
                squares += wp.int64(gap) * wp.int64(gap)
                ended += wp.int64(gap)
                longest = wp.max(longest, gap)
            changed &= changed - wp.uint32(1)
        cells.in_discs[w, row, word] = after
    cells.idle_squares[w, row] = squares
    cells.idle_max[w, row] = longest
    return ended


@wp.kernel
def cover(
    first: int,
    lanes: int,
    curve: CurveStruct,
    sensing: SensingStruct,
    clock: Clock,
    robots: Robots,
    cells: Cells,
    latest: Latest,
    tally: Tally,
):
    """Mark the cells that are sensed now, row by row, and count their visits."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    rows = cells.sensed_at.shape[1]
    columns = cells.sensed_at.shape[2]
    ended = wp.int64(0)
    fresh = wp.int64(0)
    fresh_each = wp.int64(0)
    for row in range(lane, rows, lanes):
        for word in range(cells.coming.shape[2]):
            cells.coming[w, row, word] = wp.uint32(0)
    for i in range(robots.sensor.shape[1]):
        place = robots.sensor[w, i]
        if place[0] < 0.5 * NOWHERE:
            fresh_each += wp.int64(
                visit_disc(w, i, place, lane, lanes, curve, sensing.radius, columns, cells.coming, cells.sensed_by)
            )
    for row in range(lane, rows, lanes):
        ended += count_visits(w, row, clock.step[w], cells)
        for word in range(cells.sensed.shape[2]):
            new = cells.in_discs[w, row, word] & ~cells.sensed[w, row, word]
            if new != wp.uint32(0):
                fresh += wp.int64(wp.bit_count(new))
                cells.sensed[w, row, word] |= new
    if ended > wp.int64(0):
        wp.atomic_add(latest.idle_ended, w, ended)
    if fresh_each > wp.int64(0):
        wp.atomic_add(tally.covered_each, w, fresh_each)
        wp.atomic_add(tally.covered, w, fresh)


def last_sensed(sensed_at: np.ndarray, in_discs: np.ndarray, step: Any, columns: Any = None) -> np.ndarray:
    """(..., R, C) int32 step in which each cell was last sensed; 0 for never.

    Args:
        sensed_at: (..., R, C) as `Cells` has it.
        in_discs: (..., R, B) as `Cells` has it.
        step: (...) now.
        columns: (C,) which columns of the grid these are; all by default.
    """
    columns = np.arange(sensed_at.shape[-1]) if columns is None else columns
    inside = (in_discs[..., columns // 32] >> (columns % 32).astype(np.uint32)) & 1
    return np.where(inside.astype(bool), np.asarray(step, dtype=np.int32)[..., None, None], sensed_at)
