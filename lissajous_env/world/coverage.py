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
            cells.sensed[w, row, word] = wp.uint64(0)
            cells.in_discs[w, row, word] = wp.uint64(0)
            for i in range(cells.sensed_by.shape[1]):
                cells.sensed_by[w, i, row, word] = wp.uint64(0)
        cells.idle_squares[w, row] = wp.int64(0)
        cells.idle_max[w, row] = 0


_COUNT_VISITS = """
    typedef unsigned long long Word;
    const int rows = cells.sensed_at.shape[1], columns = cells.sensed_at.shape[2], most = 64;
    const auto count = [&](const int lane, const int lanes, const int words, Word* __restrict before,
                           Word* __restrict after, Word* __restrict ever, wp::int64* __restrict squares,
                           int* __restrict longest, int* __restrict sensed_at) {
        wp::int64 ended = 0, fresh = 0;
        for (int row = lane; row < rows; row += lanes)
            for (int word = 0; word < words; ++word) {
                const int at = row * words + word;
                const Word inside = after[at];
                const int staying = wp::bit_count(before[at] & inside);
                squares[row] += staying;
                ended += staying;
                longest[row] = wp::max(longest[row], staying > 0 ? 1 : 0);
                fresh += wp::bit_count(inside & ~ever[at]);
                ever[at] |= inside;
                after[at] = before[at] ^ inside;
                before[at] = inside;
            }
        for (int row = lane; row < rows; row += lanes)
            for (int word = 0; word < words; ++word) {
                Word changed = after[row * words + word];
                const Word inside = before[row * words + word];
                after[row * words + word] = 0;
                while (changed) {
                    const Word first = changed & (~changed + 1);
                    int* const cell = sensed_at + row * columns + 64 * word + wp::bit_count(first - 1);
                    const bool comes = (inside & first) != 0;
                    if (comes) {
                    const int gap = now - *cell;
                    squares[row] += (wp::int64)gap * gap;
                    ended += gap;
                    longest[row] = longest[row] < gap ? gap : longest[row];
                    } else
                        *cell = now - 1;
                    changed ^= first;
                }
            }
        return wp::vec_t<2, wp::int64>(ended, fresh);
    };
    Word *const before = &wp::index(cells.in_discs, w, 0, 0), *const after = &wp::index(cells.coming, w, 0, 0);
    Word* const ever = &wp::index(cells.sensed, w, 0, 0);
    wp::int64* const squares = &wp::index(cells.idle_squares, w, 0);
    int *const longest = &wp::index(cells.idle_max, w, 0), *const sensed_at = &wp::index(cells.sensed_at, w, 0, 0);
    if (lanes == 1 && cells.coming.shape[2] == 1)
        return count(0, 1, 1, before, after, ever, squares, longest, sensed_at);
    return count(lane, lanes, cells.coming.shape[2], before, after, ever, squares, longest, sensed_at);
"""

Counts = wp.types.vector(2, wp.int64)


@wp.func_native(_COUNT_VISITS)
def count_visits(w: int, lane: int, lanes: int, now: int, cells: Cells) -> Counts:
    """Count the visits of a row's cells, from what is sensed now and what was; returns the idleness that they end."""
    ...


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
    fresh_each = wp.int64(0)
    for i in range(robots.sensor.shape[1]):
        place = robots.sensor[w, i]
        if place[0] < 0.5 * NOWHERE:
            fresh_each += wp.int64(
                visit_disc(w, i, place, lane, lanes, curve, sensing.radius, columns, cells.coming, cells.sensed_by)
            )
    counts = count_visits(w, lane, lanes, clock.step[w], cells)
    ended = counts[0]
    fresh = counts[1]
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
    inside = (in_discs[..., columns // 64] >> (columns % 64).astype(np.uint64)) & 1
    return np.where(inside.astype(bool), np.asarray(step, dtype=np.int32)[..., None, None], sensed_at)
