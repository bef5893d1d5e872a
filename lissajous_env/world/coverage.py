"""Coverage and idleness of the cells of a grid: a cell is sensed when its centre lies in a working robot's disc."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.part_structs import SensingStruct
from lissajous_env.world.state import Cells, Clock, Latest, Robots, Tally

wp.set_module_options(OPTIONS)


@wp.func
def run_of_bits(word: int, low: int, high: int) -> wp.uint32:
    """Bits of columns low ... high that fall into the word with columns 32 word ... 32 word + 31."""
    start = wp.max(low - 32 * word, 0)
    stop = wp.min(high - 32 * word, 31)
    if start > stop:
        return wp.uint32(0)
    return (~wp.uint32(0) >> wp.uint32(31 - (stop - start))) << wp.uint32(start)


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
            for i in range(cells.sensed_by.shape[2]):
                cells.sensed_by[w, row, i, word] = wp.uint32(0)
        cells.idle_squares[w, row] = wp.int64(0)
        cells.idle_max[w, row] = 0


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
    """Mark the cells that are sensed now, row by row: a robot's disc meets a row in one run of columns."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    now = clock.step[w]
    rows = cells.sensed_at.shape[1]
    columns = cells.sensed_at.shape[2]
    cell_width = 2.0 * curve.half_width / float(columns)
    cell_height = 2.0 * curve.half_height / float(rows)
    ended = wp.int64(0)
    fresh = wp.int64(0)
    fresh_each = wp.int64(0)
    for row in range(lane, rows, lanes):
        y = (float(row) + 0.5) * cell_height - curve.half_height
        squares = cells.idle_squares[w, row]
        longest = cells.idle_max[w, row]
        for i in range(robots.sensor.shape[1]):
            place = robots.sensor[w, i]
            half = sensing.radius * sensing.radius - (y - place[1]) * (y - place[1])
            if half > 0.0:
                half = wp.sqrt(half)
                middle = place[0] + curve.half_width
                # Clamped before they are whole numbers: a far place or a wide disc lies beyond all of these.
                low = int(wp.clamp(wp.ceil((middle - half) / cell_width - 0.5), 0.0, float(columns)))
                high = int(wp.clamp(wp.floor((middle + half) / cell_width - 0.5), -1.0, float(columns - 1)))
                for word in range(wp.min(low, columns - 1) / 32, wp.max(high, 0) / 32 + 1):
                    run = run_of_bits(word, low, high)
                    mine = cells.sensed_by[w, row, i, word]
                    others = cells.sensed[w, row, word]
                    fresh_each += wp.int64(wp.bit_count(run & ~mine))
                    fresh += wp.int64(wp.bit_count(run & ~others))
                    cells.sensed_by[w, row, i, word] = mine | run
                    cells.sensed[w, row, word] = others | run
                for column in range(low, high + 1):
                    gap = now - cells.sensed_at[w, row, column]
                    cells.sensed_at[w, row, column] = now
                    squares += wp.int64(gap) * wp.int64(gap)
                    longest = wp.max(longest, gap)
                    ended += wp.int64(gap)
        cells.idle_squares[w, row] = squares
        cells.idle_max[w, row] = longest
    if ended > wp.int64(0):
        wp.atomic_add(latest.idle_ended, w, ended)
    if fresh_each > wp.int64(0):
        wp.atomic_add(tally.covered_each, w, fresh_each)
        wp.atomic_add(tally.covered, w, fresh)
