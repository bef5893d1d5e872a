"""Labels of the cells of contamination: their storage, and the update of 32 neighbouring cells, a word of bits.

Two functions are written in C++, so that a CPU processes eight neighbouring cells at once.
"""

from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.stage import named_struct
from lissajous_env.device.structs import to_struct
from lissajous_env.parameters.spreading import HOPS, TICK_FRACTIONS, Spreading
from lissajous_env.world.selection import of_world
from lissajous_env.world.state import NEVER

MARGIN = wp.constant(2)
"""Cells around the grid in which no target is, so that hops need no test for its edge."""
NONE = wp.constant(0x7FFFFF00)
"""Smallest label of a cell without a target."""

SIDE_BY_SIDE = wp.constant(8)
"""Cells of a row that are labelled together."""

PerHop = wp.types.vector(len(HOPS), wp.int32)
"""A number for each length of a hop."""
_FRACTIONS = wp.constant(TICK_FRACTIONS)
PER_STEP = wp.constant(TICK_FRACTIONS + 1)
"""Labels of a step, one for each fraction of a tick."""


@named_struct("hops")
class Hops:
    """`lissajous_env.parameters.spreading.Spreading` for kernels: a grid, its ticks, and the hops of targets."""

    columns: int
    radius: float
    ticks: int
    period: int
    history_length: int
    delays: wp.array(dtype=wp.int32)
    shares: wp.array(dtype=wp.int32)
    edge_gap: float
    moved: float
    """Largest displacement of a target in a step, for `task.conservative` [m]."""
    lags: wp.array(dtype=wp.int32)
    rows_away: wp.array(dtype=wp.int32)
    """Largest number of rows up or down, for each lag."""
    widths: wp.array2d(dtype=wp.int32)
    """(lags, rows up or down)."""


def as_hops(spreading: Spreading, device: Any) -> Hops:
    """Copy hops to a device."""
    hops, reaches = to_struct(Hops, spreading), spreading.reaches
    hops.history_length, hops.edge_gap, hops.moved = spreading.history_length, spreading.edge_gap, reaches.moved
    rows = max(map(len, reaches.widths), default=0)
    widths = np.array([(*row, *[0] * (rows - len(row))) for row in reaches.widths]).reshape(len(reaches.widths), rows)
    hops.widths = wp.array(widths, dtype=wp.int32, device=device)
    rows_away = [len(row) - 1 for row in reaches.widths]
    lists = {"delays": spreading.delays, "shares": spreading.shares, "lags": reaches.lags, "rows_away": rows_away}
    for name, numbers in lists.items():
        setattr(hops, name, wp.array(numbers, dtype=wp.int32, device=device))
    return hops


def label_row_length(columns: int) -> int:
    """Return the length of a row of labels: whole groups of cells labelled side by side, and both margins."""
    return -(-columns // int(SIDE_BY_SIDE)) * int(SIDE_BY_SIDE) + 2 * int(MARGIN)


@wp.func
def ticks_passed(step: int, tick: int, hops: Hops) -> int:
    """Return the number of ticks from the reset to `tick`, counted from 0 within a step."""
    return ((step - 1) * hops.ticks + tick + 1) / hops.period  # at least one of `ticks` and `period` is 1


@wp.func
def ends_tick(step: int, hops: Hops) -> bool:
    """Return whether targets hop in a step; in a step within a tick they stay."""
    return step > 0 and step % hops.period == 0


@wp.func
def latest_slot(step: int, tick: int, hops: Hops) -> int:
    """Return the slot of the labels of targets that stay: that of the tick before or, within a tick, of this one."""
    passed = ticks_passed(step, tick, hops) - wp.where(ends_tick(step, hops), 1, 0)
    return (passed + hops.history_length) % hops.history_length


@wp.struct
class TickContext:
    """Values of a tick that all cells of a world share."""

    step: int
    slot: int
    """Slot of this tick's labels."""
    latest: int
    """Slot of the labels of targets that stay."""
    label_mask: int
    """Mask of the bits of a label that remain: after a tick, the share of a tick is cleared."""
    targets_hop: bool
    """True in a step in which targets hop."""
    entry: int
    """Label of a target that is introduced now."""
    oldest: int
    """Earliest introduction of any undetected target of this world [step]."""
    hop_slots: PerHop
    """Slots of the labels from which hops of each length come."""
    earlier_hop_slots: PerHop
    """Slots of the labels a tick before those."""
    shares: PerHop
    """`Spreading.shares` of each length."""


@wp.func
def context_of(step: int, tick: int, oldest: int, arrives: bool, hops: Hops) -> TickContext:
    """Return the context of a tick."""
    now = TickContext()
    now.step = step
    passed = ticks_passed(step, tick, hops)
    now.slot = passed % hops.history_length
    now.latest = latest_slot(step, tick, hops)
    now.label_mask = wp.where(ends_tick(step, hops), ~_FRACTIONS, -1)
    now.targets_hop = ends_tick(step, hops) and hops.delays.shape[0] > 0
    now.entry = wp.where(arrives and step > 0, step * PER_STEP + _FRACTIONS, NONE)
    now.oldest = oldest
    for k in range(hops.delays.shape[0]):
        now.hop_slots[k] = (passed - hops.delays[k] + 2 * hops.history_length) % hops.history_length
        now.earlier_hop_slots[k] = (passed - hops.delays[k] - 1 + 2 * hops.history_length) % hops.history_length
        now.shares[k] = hops.shares[k]
    return now


_CLEAR_MARKED = f"""
    const int words = labelled.shape[2] - 2, ring = labelled.shape[3];
    unsigned int* bits = &wp::index(labelled, w, row + {int(MARGIN)}, 1, 0);
    for (int word = 0; word < words; ++word, bits += ring) {{
        const unsigned int marked = wp::index(swept, w, word / 2, row) >> 32 * (word & 1), stays = bits[latest];
        for (int tick = 0; tick < ring; ++tick)
            bits[tick] &= ~marked;
        bits[latest] = stays;
    }}
    for (int word = 0; word < sensed.shape[1]; ++word)
        wp::index(sensed, w, word, row) = wp::index(swept, w, word, row) = 0;
"""


@wp.func_native(_CLEAR_MARKED)
def clear_marked(
    w: int,
    row: int,
    latest: int,
    sensed: wp.array3d(dtype=wp.uint64),
    swept: wp.array3d(dtype=wp.uint64),
    labelled: wp.array4d(dtype=wp.uint32),
):
    """Delete labels and marks of the swept cells of a row; the labels in the slot `latest` account for the marks."""


_ONES = 0x01010101
"""The number 1 in each of the four groups of 8 bits of a word."""


def _empty_groups(bits: str) -> str:
    """Return C++ for a mask of the groups of 8 bits of a word in which no bit is set."""
    return f"(((((({bits}) & 0x7f7f7f7fu) + 0x7f7f7f7fu | ({bits})) >> 7 & {_ONES}) ^ {_ONES}) * 255)"


_LABEL_CELLS = f"""
    const int lanes = {int(SIDE_BY_SIDE)}, lengths = {len(HOPS)}, fractions = {TICK_FRACTIONS}, none = {int(NONE)};
    const int columns[lengths] = {{{", ".join(str(hop[0]) for hop in HOPS)}}};
    const int rows[lengths] = {{{", ".join(str(hop[1]) for hop in HOPS)}}};
    const int row_stride = labels.strides[2] / sizeof(int), ring = labelled.shape[3];
    const size_t slot_stride = labels.strides[1] / sizeof(int);
    int* here = &wp::index(labels, w, 0, row + {int(MARGIN)}, 32 * word + {int(MARGIN)});
    unsigned int* bits = &wp::index(labelled, w, row + {int(MARGIN)}, word + 1, 0);
    const int bits_stride = labelled.strides[1] / sizeof(unsigned int);
    const unsigned int cells = todo, all = (1u << lanes) - 1;
    const int oldest_age = now.step - now.oldest;
    int oldest = {int(NEVER)}, ages = 0;
    // `settled` counts, in 8 bits for each group of cells, the latest ticks after which all their labels were those of
    // the oldest target. After more ticks than are stored, they stay so until a robot senses one of these cells.
    const unsigned int is_new = {_empty_groups(f"settled + (127 - ring) * {_ONES} & {_ONES} << 7")};
    const unsigned int settles = {_empty_groups("~unswept")} & ~is_new;
    unsigned int contaminated = cells & settles, same = 0;
    if (contaminated) {{
        oldest = now.oldest;
        ages = wp::bit_count(contaminated) * oldest_age;
        todo &= ~contaminated;
    }}
    if (!todo)
        return wp::vec_t<4, int>(oldest, ages, contaminated, settled & settles);
    // Cells from which a target may hop: a bit for each column from two before this word to two after it, for the rows
    // above and below, and for both slots.
    unsigned long long sources[lengths][2][2];
    if (now.targets_hop)
        for (int length = 0; length < lengths; ++length)
            for (int below = 0; below < 2; ++below)
                for (int earlier = 0; earlier < 2; ++earlier) {{
                    const unsigned int* source = bits + (below ? -rows[length] : rows[length]) * bits_stride
                        + (earlier ? now.earlier_hop_slots[length] : now.hop_slots[length]);
                    sources[length][below][earlier] = source[-ring] >> 30 | (unsigned long long)source[0] << 2
                        | (unsigned long long)source[ring] << 34;
                }}
    const unsigned int stay = bits[now.latest] & unswept;
    // Only cells that can have a target are labelled: the labels of the others are not read, because their bit is 0.
    unsigned int can = stay | (now.entry < none ? enter : 0);
    if (now.targets_hop)
        for (int length = 0; length < lengths; ++length)
            for (int from = 0; from < 4; ++from) {{
                const unsigned long long source = sources[length][from >> 1][from & 1];
                can |= source >> (2 + columns[length]) | source >> (2 - columns[length]);
            }}
    todo &= can;
    for (int first = 0; first < 32; first += lanes, here += lanes) {{
        if (!(todo >> first & all))
            continue;
#if !defined(__CUDA_ARCH__)
        // The labels of many worlds do not fit into a cache: those of the next rows are fetched in advance.
        for (int tick = 0; tick < ring; ++tick)
            for (int further = 0; further <= lanes; further += lanes)
                __builtin_prefetch(here + tick * slot_stride + {int(MARGIN)} * row_stride + further);
#endif
        int label[lanes], hopped[lanes];
        for (int l = 0; l < lanes; ++l) {{
            const int before = here[now.latest * slot_stride + l] & now.label_mask;
            label[l] = stay >> (first + l) & 1 ? before : none;
            hopped[l] = none;
        }}
        if (now.targets_hop) {{
            for (int length = 0; length < lengths; ++length) {{
                const int share = now.shares[length], missing = share - fractions;
                for (int side = 0; side < 4; ++side) {{
                    const int right = side & 1 ? -columns[length] : columns[length];
                    if ((side & 1 && !columns[length]) || (side & 2 && !rows[length]))
                        continue;
                    const unsigned int has = sources[length][side >> 1][0] >> (first + 2 + right) & all;
                    const unsigned int had = sources[length][side >> 1][1] >> (first + 2 + right) & all;
                    if (!(has | had))
                        continue;
                    const int* from = here + (side & 2 ? -rows[length] : rows[length]) * row_stride + right;
                    const int* newer_labels = from + now.hop_slots[length] * slot_stride;
                    const int* older_labels = from + now.earlier_hop_slots[length] * slot_stride;
                    for (int l = 0; l < lanes; ++l) {{
                        const int older = older_labels[l], newer = newer_labels[l], came = older & fractions;
                        const int early = older - came + (came + missing > 0 ? came + missing : 0);
                        const int is_on = (newer & fractions) + share <= fractions ? -(int)(has >> l & 1) : 0;
                        const int was_on = -(int)(had >> l & 1);
                        const int one = (early & was_on) | (none & ~was_on);
                        const int other = ((newer + share) & is_on) | (none & ~is_on);
                        const int best = one < other ? one : other;
                        hopped[l] = best < hopped[l] ? best : hopped[l];
                    }}
                }}
            }}
        }}
        for (int l = 0; l < lanes; ++l) {{
            const int entered = enter >> (first + l) & 1 ? now.entry : none;
            const int stayed = entered < label[l] ? entered : label[l];
            const int earliest = hopped[l] < stayed ? hopped[l] : stayed, since = earliest / {int(PER_STEP)};
            const int counts = (earliest < none ? 1 : 0) & todo >> (first + l);
            const int known = counts ? since : {int(NEVER)};
            oldest = known < oldest ? known : oldest;
            ages += counts ? now.step - since : 0;
            contaminated |= (unsigned int)counts << (first + l);
            same |= (unsigned int)(since == now.oldest ? counts : 0) << (first + l);
            label[l] = earliest;
        }}
        for (int l = 0; l < lanes; ++l)
            here[now.slot * slot_stride + l] = label[l];
    }}
    const unsigned int differs = (cells ^ same) | ~unswept | settles, more = now.label_mask == -1 ? 0 : {_ONES};
    const unsigned int after = (settled & settles) | ((settled + more) & {_empty_groups("differs")});
    return wp::vec_t<4, int>(oldest, ages, contaminated, after);
"""


@wp.func_native(_LABEL_CELLS)
def label_cells(
    labels: wp.array4d(dtype=wp.int32),
    labelled: wp.array4d(dtype=wp.uint32),
    w: int,
    row: int,
    word: int,
    todo: wp.uint32,
    unswept: wp.uint32,
    enter: wp.uint32,
    settled: wp.uint32,
    now: TickContext,
) -> wp.vec4i:
    """Label the cells `todo` of a word; targets stay in the cells `unswept`, and are introduced in the cells `enter`.

    The three are bits, and `settled` is as in `Contamination`. Returns the earliest introduction of any target in these
    cells [step], the time since then summed over the cells [step], the bits of the cells that have a target, and
    `settled` after this tick.
    """
    ...


def introduced_at(simulation: Any, world: int = 0) -> np.ndarray:
    """Return (R, C) int32: the step since which a target that may be in a cell now can have been undetected.

    It is NEVER for a cleared cell. The lowest row comes first. Without `task.contamination`, it is (1, 1) NEVER.
    """
    hops, margin = simulation.scenario.spreading, int(MARGIN)
    if simulation.scenario.task.contamination is None:
        return np.full((1, 1), int(NEVER), dtype=np.int32)
    slot = int(simulation.clock.step.numpy()[world]) * hops.ticks // hops.period % hops.history_length
    inside, columns = slice(margin, hops.rows + margin), np.arange(hops.columns)
    labels = of_world(simulation.contamination.labels, world)[slot, inside, margin : margin + hops.columns]
    there = labels < int(NONE)
    if not simulation.scenario.task.conservative:
        words = of_world(simulation.contamination.labelled, world)[inside, 1:-1, slot]
        there = words[:, columns // 32] >> (columns % 32).astype(np.uint32) & 1 == 1
    return np.where(there, labels // int(PER_STEP), int(NEVER)).astype(np.int32)
