"""Contamination: where a rogue may be that was never seen, whatever it does, and since when.

Of each cell of a grid is known e, the earliest time at which a rogue can have been introduced that may be there now
and was in no working robot's disc since. In the words of the search for evaders a cell with such a rogue is
contaminated, one without is cleared: T. D. Parsons, "Pursuit-evasion in a graph" (Theory and Applications of Graphs,
1978); L. J. Guibas, J.-C. Latombe, S. M. LaValle, D. Lin, R. Motwani, "A visibility-based pursuit-evasion problem"
(Int. J. Computational Geometry & Applications 9, 1999). t - min e is how long a rogue can have gone unseen.

A label is e in control steps times 256, plus what share of a tick the rogue came after the tick before: of two labels
the smaller one is older or, of one age, came earlier. The labels of the latest ticks are kept of each cell, because a
rogue that hops now (`lissajous_env.parameters.spreading`) came to where it hops from some ticks ago. A cell that is
sensed loses them all: a rogue on its way is where it came from, until it arrives.
"""

from typing import Any

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.part_structs import TargetStruct
from lissajous_env.device.structs import place_of
from lissajous_env.parameters import parts
from lissajous_env.parameters.spreading import HOPS, SHARES, Spreading
from lissajous_env.world.coverage import lowest, run_of_bits
from lissajous_env.world.discs import along, mark_disc, mark_way
from lissajous_env.world.sight import planar
from lissajous_env.world.state import NEVER, NOWHERE, Clock, Contamination, Robots

wp.set_module_options(OPTIONS | {"cpu_compiler_flags": OPTIONS["cpu_compiler_flags"].replace("-fno-slp-vectorize ", "")})

MARGIN = wp.constant(2)
"""Cells around the grid in which no rogue is, so that hops need not ask for its edge."""
NONE = wp.constant(0x7FFFFF00)
"""Labels from here on say that there is no rogue."""

SIDE_BY_SIDE = wp.constant(8)
"""Cells of a row that get their labels together."""

_ALL = wp.constant(wp.uint32(2 ** int(SIDE_BY_SIDE) - 1))

Five = wp.types.vector(len(HOPS), wp.int32)

_BOUNDARY = wp.constant(place_of(parts.Targets, "entry", "boundary"))
_SHARES = wp.constant(SHARES)


@wp.struct
class Hops:
    """`lissajous_env.parameters.spreading.Spreading` as kernels see it."""

    columns: int
    radius: float
    ticks: int
    period: int
    ring: int
    swept: int
    """1 where what discs pass over between two ticks is sensed, 0 where what they cover at the ticks alone is."""
    delays: wp.array(dtype=wp.int32)
    shares: wp.array(dtype=wp.int32)


def as_hops(spreading: Spreading, swept: bool, device: Any) -> Hops:
    """Copy hops to a device."""
    hops = Hops()
    for name in ("columns", "radius", "ticks", "period", "ring"):
        setattr(hops, name, getattr(spreading, name))
    hops.swept = int(swept)
    hops.delays = wp.array(spreading.delays, dtype=wp.int32, device=device)
    hops.shares = wp.array(spreading.shares, dtype=wp.int32, device=device)
    return hops


def across(columns: int) -> int:
    """Cells from a row to the next one: a margin on both sides of as many as are labelled side by side."""
    return -(-columns // int(SIDE_BY_SIDE)) * int(SIDE_BY_SIDE) + 2 * int(MARGIN)


@wp.func
def is_entry(entry: int, row: int, column: int, rows: int, columns: int) -> bool:
    """Whether rogues are introduced in a cell."""
    on_edge = row == 0 or column == 0 or row == rows - 1 or column == columns - 1
    return entry != _BOUNDARY or on_edge


_FORGET_CELLS = f"""
    const int lanes = {int(SIDE_BY_SIDE)};
    for (int tick = 0; tick < labels.shape[1]; ++tick) {{
        if (tick == kept)
            continue;
        int* label = &labels.data[w * (labels.strides[0] / sizeof(int)) + tick * (labels.strides[1] / sizeof(int))
            + (row + {int(MARGIN)}) * (labels.strides[2] / sizeof(int)) + column + {int(MARGIN)}];
        for (int l = 0; l < lanes; ++l)
            label[l] = gone >> l & 1 ? {int(NONE)} : label[l];
    }}
"""


@wp.func_native(_FORGET_CELLS)
def forget_cells(labels: wp.array4d(dtype=wp.int32), w: int, row: int, column: int, gone: wp.uint32, kept: int): ...


@wp.func
def forget_seen(w: int, row: int, latest: int, hops: Hops, contamination: Contamination):
    """Forget who was in the cells of a row that were seen in the tick before, but for who came there since."""
    for word in range(contamination.sensed.shape[2]):
        sensed = contamination.sensed[w, row, word]
        passed = (sensed | contamination.swept[w, row, word]) & ~contamination.wiped[w, row, word]
        for part in range(32 / SIDE_BY_SIDE):
            gone = passed >> wp.uint32(part * SIDE_BY_SIDE)
            if (gone & _ALL) != wp.uint32(0):
                forget_cells(contamination.labels, w, row, 32 * word + part * SIDE_BY_SIDE, gone, latest)
        contamination.wiped[w, row, word] = sensed
        contamination.swept[w, row, word] = wp.uint32(0)
        contamination.sensed[w, row, word] = wp.uint32(0)


@wp.func
def slot_of(step: int, tick: int, hops: Hops) -> int:
    """Where the labels of a tick stand, of those that are kept."""
    return (ticks_passed(step, tick, hops) + hops.ring) % hops.ring


@wp.func
def ticks_passed(step: int, tick: int, hops: Hops) -> int:
    """Ticks since the reset, the given one of the latest step with them."""
    if hops.ticks > 1:
        return (step - 1) * hops.ticks + tick + 1
    return step / hops.period


@wp.kernel
def clear_cells(
    first: int,
    lanes: int,
    curve: CurveStruct,
    hops: Hops,
    tick: int,
    clock: Clock,
    robots: Robots,
    contamination: Contamination,
):
    """Find the cells that are sensed in a tick, and forget the rogues of those that were in the tick before."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    slot = slot_of(clock.step[w], tick, hops)
    # Under the labels of the tick before, in the ring that the first tick of an episode does not have yet.
    latest = (slot - 1 + hops.ring) % hops.ring
    if hops.period > 1 and clock.step[w] % hops.period != 0:
        latest = slot
    rows = contamination.sensed.shape[1]
    for row in range(lane, rows, lanes):
        forget_seen(w, row, latest, hops, contamination)
    cell = 2.0 * wp.min(
        curve.half_width / float(hops.columns), curve.half_height / float(contamination.sensed.shape[1])
    )
    for i in range(robots.sensor.shape[1]):
        if robots.sensor[w, i][0] < 0.5 * NOWHERE:
            end = robots.sensor[w, i]
            start = planar(robots.track[w, i, 0])
            if hops.ticks > 1:
                end = along(robots.track, w, i, float(tick + 1) / float(hops.ticks))
                start = along(robots.track, w, i, float(tick) / float(hops.ticks))
            mark_disc(w, end, lane, lanes, curve, hops.radius, hops.columns, contamination.sensed)
            # On a short way the disc passes over no more than what it covers at its ends, but for a sliver.
            if hops.swept == 1 and wp.length_sq(end - start) > hops.radius * cell:
                pieces = robots.track.shape[2] - 1
                for piece in range(1, pieces + 1):
                    end = along(robots.track, w, i, (float(tick) + float(piece) / float(pieces)) / float(hops.ticks))
                    mark_way(w, start, end, lane, lanes, curve, hops.radius, hops.columns, contamination.swept)
                    start = end


@wp.kernel
def reset_labels(
    first: int,
    lanes: int,
    target: TargetStruct,
    hops: Hops,
    clock: Clock,
    contamination: Contamination,
):
    """Let rogues that are present from the start be wherever they are introduced and no robot senses."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    rows = contamination.sensed.shape[1]
    for row in range(lane, rows, lanes):
        for word in range(contamination.sensed.shape[2]):
            contamination.sensed[w, row, word] = wp.uint32(0)
            contamination.swept[w, row, word] = wp.uint32(0)
            contamination.wiped[w, row, word] = wp.uint32(0)
            contamination.settled[w, row, word] = wp.uint32(0)
        for column in range(hops.columns):
            label = int(NONE)
            if target.count > 0 and is_entry(target.entry, row, column, rows, hops.columns):
                label = 0
            for k in range(hops.ring):
                contamination.labels[w, k, row + MARGIN, column + MARGIN] = label
    if lane == 0:
        contamination.oldest[w] = wp.where(target.count > 0, 0, NEVER)


@wp.struct
class Now:
    """What is the same for all cells of a world in a tick."""

    step: int
    slot: int
    """Where the labels of this tick stand."""
    latest: int
    """Where those stand that rogues who stay have: of the tick before, or of this one where it goes on."""
    aged: int
    """Bits of them that are kept: after a tick, a rogue came a tick ago or more."""
    hops: bool
    """Whether rogues hop in this step."""
    entry: int
    """Label of a rogue that is introduced now."""
    oldest: int
    """Earliest introduction of any rogue of this world."""
    at: Five
    """Where the labels stand that the five lengths of hops ask for."""
    before: Five
    """The same, a tick earlier."""
    shares: Five


@wp.func
def now_of(step: int, tick: int, oldest: int, arrives: bool, hops: Hops) -> Now:
    """Put together what is the same for all cells."""
    now = Now()
    now.step = step
    passed = ticks_passed(step, tick, hops)
    now.slot = passed % hops.ring
    now.latest = now.slot
    now.aged = -1
    moves = step % hops.period == 0 and step > 0
    if moves:
        now.latest = (passed - 1 + hops.ring) % hops.ring
        now.aged = ~_SHARES
    now.hops = moves and hops.delays.shape[0] > 0
    now.entry = wp.where(arrives and step > 0, step * 256 + _SHARES, NONE)
    now.oldest = oldest
    for k in range(hops.delays.shape[0]):
        now.at[k] = (passed - hops.delays[k] + 2 * hops.ring) % hops.ring
        now.before[k] = (passed - hops.delays[k] - 1 + 2 * hops.ring) % hops.ring
        now.shares[k] = hops.shares[k]
    return now


_LABEL_CELLS = f"""
    const int lanes = {int(SIDE_BY_SIDE)}, shares = {SHARES}, none = {int(NONE)};
    const size_t plane = labels.strides[1] / sizeof(int);
    const int across = labels.strides[2] / sizeof(int);
    const int* world = labels.data + w * (labels.strides[0] / sizeof(int))
        + (row + {int(MARGIN)}) * across + column + {int(MARGIN)};
    int label[lanes], same[lanes];
    const int* stayed = world + now.latest * plane;
    for (int l = 0; l < lanes; ++l) {{
        const int kept = stayed[l] < none && (unseen >> l & 1) ? stayed[l] & now.aged : none;
        label[l] = (enter >> l & 1) && now.entry < kept ? now.entry : kept;
    }}
    if (now.hops) {{
        const int offsets[4][{len(HOPS)}] = {{
            {{1, across, across + 1, across + 2, 2 * across + 1}}, {{-1, -across, across - 1, across - 2, 2 * across - 1}},
            {{1, across, 1 - across, 2 - across, 1 - 2 * across}}, {{-1, -across, -across - 1, -across - 2, -2 * across - 1}}}};
        int hopped[lanes];
        for (int l = 0; l < lanes; ++l)
            hopped[l] = none;
        for (int length = 0; length < {len(HOPS)}; ++length) {{
            const int share = now.shares[length], missing = share - shares;
            for (int side = 0; side < (length < 2 ? 2 : 4); ++side) {{
                const int* latest = world + now.at[length] * plane + offsets[side][length];
                const int* before = world + now.before[length] * plane + offsets[side][length];
                for (int l = 0; l < lanes; ++l) {{
                    const int came = before[l] & shares;
                    const int late = came + missing;
                    const int early = before[l] - came + (late > 0 ? late : 0);
                    const int timely = (latest[l] & shares) + share <= shares ? latest[l] + share : none;
                    const int best = early < timely ? early : timely;
                    hopped[l] = best < hopped[l] ? best : hopped[l];
                }}
            }}
        }}
        for (int l = 0; l < lanes; ++l)
            label[l] = label[l] / 256 > now.oldest && hopped[l] < label[l] ? hopped[l] : label[l];
    }}
    int oldest = {int(NEVER)}, ages = 0, settled = 0;
    for (int l = 0; l < lanes; ++l) {{
        label[l] = free >> l & 1 ? label[l] : none;
        const int since = label[l] / 256;
        oldest = label[l] < none && since < oldest ? since : oldest;
        ages += label[l] < none ? now.step - since : 0;
        same[l] = label[l] == now.oldest * 256;
    }}
    for (int l = 0; l < lanes; ++l)
        settled |= same[l] << l;
    if (settled) {{
        for (int tick = 0; tick < labels.shape[1]; ++tick)
            for (int l = 0; l < lanes; ++l)
                same[l] &= tick == now.slot || world[tick * plane + l] == label[l];
        settled = 0;
        for (int l = 0; l < lanes; ++l)
            settled |= same[l] << l;
    }}
    int* out = labels.data + (world - labels.data) + now.slot * plane;
    for (int l = 0; l < lanes; ++l)
        out[l] = label[l];
    return wp::vec_t<3, int>(oldest, ages, settled);
"""


@wp.func_native(_LABEL_CELLS)
def label_cells(
    labels: wp.array4d(dtype=wp.int32),
    w: int,
    row: int,
    column: int,
    free: wp.uint32,
    unseen: wp.uint32,
    enter: wp.uint32,
    now: Now,
) -> wp.vec3i: ...


@wp.func
def entries(entry: int, word: int, row: int, rows: int, columns: int) -> wp.uint32:
    """Bits of the cells of a word in which rogues are introduced."""
    if entry != _BOUNDARY or row == 0 or row == rows - 1:
        return run_of_bits(word, 0, columns - 1)
    return run_of_bits(word, 0, 0) | run_of_bits(word, columns - 1, columns - 1)


@wp.kernel
def spread(
    first: int,
    lanes: int,
    target: TargetStruct,
    hops: Hops,
    tick: int,
    clock: Clock,
    contamination: Contamination,
):
    """Let rogues stay, hop and be introduced where no robot senses."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    now = now_of(clock.step[w], tick, contamination.oldest[w], target.arrival_rate > 0.0, hops)
    rows = contamination.sensed.shape[1]
    labels = contamination.labels
    for row in range(lane, rows, lanes):
        row_oldest = int(NEVER)
        ages = wp.int64(0)
        for word in range(contamination.sensed.shape[2]):
            sensed = contamination.sensed[w, row, word]
            seen = sensed | contamination.swept[w, row, word]
            settled = contamination.settled[w, row, word] & ~seen
            cells = run_of_bits(word, 0, hops.columns - 1)
            todo = cells & ~(sensed & contamination.wiped[w, row, word]) & ~settled
            enter = entries(target.entry, word, row, rows, hops.columns)
            for part in range(32 / SIDE_BY_SIDE):
                shift = wp.uint32(part * SIDE_BY_SIDE)
                if ((todo >> shift) & _ALL) != wp.uint32(0):
                    free = (cells & ~sensed) >> shift
                    column = 32 * word + part * SIDE_BY_SIDE
                    found = label_cells(
                        labels, w, row, column, free, free & ~(seen >> shift), free & (enter >> shift), now
                    )
                    row_oldest = wp.min(row_oldest, found[0])
                    ages += wp.int64(found[1])
                    # Who was seen now is only forgotten in the next tick: its old labels are no reason to settle.
                    settled = settled & ~(_ALL << shift) | wp.uint32(found[2]) << shift & ~seen
                elif ((settled >> shift) & _ALL) != wp.uint32(0):
                    row_oldest = now.oldest
                    ages += wp.int64(int(wp.bit_count((settled >> shift) & _ALL)) * (now.step - now.oldest))
            contamination.settled[w, row, word] = settled
        contamination.row_oldest[w, row] = row_oldest
        contamination.row_ages[w, row] = ages
