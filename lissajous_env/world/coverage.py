"""Coverage and idleness of the cells of a grid: a cell is sensed if its centre is in a working robot's disc.

Cells that stay in the discs, which are most of the sensed ones, are counted by whole words of bits; only cells that
enter or leave the discs are processed one by one.
"""

from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.discs import CENTRE, visit_disc
from lissajous_env.device.stage import ROW, stage
from lissajous_env.world.state import NOWHERE, Cells

wp.set_module_options(OPTIONS)
_COUNT_VISITS = """
    typedef unsigned long long Word;
    const int words = cells.coming.shape[1], rows = cells.coming.shape[2], columns = cells.sensed_at.shape[2];
    const auto count = [&](const int lane, const int lanes, Word* __restrict inside, Word* __restrict coming,
                           Word* __restrict sensed, wp::int64* __restrict squares, int* __restrict longest) {
        wp::int64 ended = 0, added = 0;
        for (int word = 0; word < words; ++word, inside += rows, coming += rows, sensed += rows) {
            for (int row = lane; row < rows; row += lanes) {
                const Word before = inside[row], now_inside = coming[row];
                const int staying = wp::bit_count(before & now_inside);  // each for a step
                squares[row] += staying;
                ended += staying;
                longest[row] = wp::max(longest[row], staying > 0 ? 1 : 0);
                added += wp::bit_count(now_inside & ~sensed[row]);
                sensed[row] |= now_inside;
                inside[row] = now_inside;
                coming[row] = before ^ now_inside;
            }
            for (int row = lane; row < rows; row += lanes) {
                int* const sensed_at = &wp::index(cells.sensed_at, w, row, 64 * word);
                for (Word changed = coming[row]; changed != 0; changed &= changed - 1) {
                    const Word lowest = changed & (~changed + 1);
                    const int column = wp::bit_count(lowest - 1);
                    if (inside[row] & lowest) {
                        const int gap = now - sensed_at[column];
                        squares[row] += (wp::int64)gap * gap;
                        ended += gap;
                        longest[row] = wp::max(longest[row], gap);
                    } else
                        sensed_at[column] = now - 1;
                }
                coming[row] = 0;
            }
        }
        return wp::vec_t<2, wp::int64>(ended, added);
    };
    Word *const inside = &wp::index(cells.in_discs, w, 0, 0), *const coming = &wp::index(cells.coming, w, 0, 0);
    Word* const sensed = &wp::index(cells.sensed, w, 0, 0);
    wp::int64* const squares = &wp::index(cells.idle_squares, w, 0);
    int* const longest = &wp::index(cells.idle_max, w, 0);
    // On a CPU, where rows stand side by side, the first loop over them becomes SIMD.
    if (lanes == 1)
        return count(0, 1, inside, coming, sensed, squares, longest);
    return count(lane, lanes, inside, coming, sensed, squares, longest);
"""

Counts = wp.types.vector(2, wp.int64)


@wp.func_native(_COUNT_VISITS)
def count_visits(w: int, lane: int, lanes: int, now: int, cells: Cells) -> Counts:
    """Count the visits that begin or continue in the cells of a lane's rows, and replace `in_discs` by `coming`.

    Returns the idleness that the visits end, summed over cells [step], and the number of cells sensed for the first
    time. It clears `coming`.
    """
    ...


@stage(
    ROW,
    writes="cells: coming, idle_max, idle_squares, in_discs, sensed, sensed_at, sensed_by; latest: idle_ended; "
    "tally: covered, covered_each",
)
def cover(w, lane, lanes, curve, sensing, clock, robots, cells, latest, tally):
    """Mark the cells that are sensed now, row by row, and count their visits."""
    columns, radius = cells.sensed_at.shape[2], sensing.radius
    added_each = wp.int64(0)
    for i in range(robots.sensor.shape[1]):
        place = robots.sensor[w, i]
        if place[0] < NOWHERE:
            added_each += wp.int64(
                visit_disc(place, lane, lanes, curve, radius, columns, CENTRE, cells.coming[w], cells.sensed_by[w, i])
            )
    counts = count_visits(w, lane, lanes, clock.step[w], cells)
    if counts[0] > wp.int64(0):
        wp.atomic_add(latest.idle_ended, w, counts[0])
    if added_each > wp.int64(0):
        wp.atomic_add(tally.covered_each, w, added_each)
        wp.atomic_add(tally.covered, w, counts[1])


def last_sensed(sensed_at: np.ndarray, in_discs: np.ndarray, step: Any) -> np.ndarray:
    """Return the (..., R, C) int32 step in which each cell was last sensed; 0 for never.

    Args:
        sensed_at: (..., R, C) as `Cells` has it.
        in_discs: (..., B, R) as `Cells` has it.
        step: (...) now.
    """
    columns = np.arange(sensed_at.shape[-1])
    inside = (in_discs.swapaxes(-1, -2)[..., columns // 64] >> (columns % 64).astype(np.uint64)) & 1
    return np.where(inside.astype(bool), np.asarray(step, dtype=np.int32)[..., None, None], sensed_at)
