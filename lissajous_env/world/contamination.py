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
from lissajous_env.world.discs import along, mark
from lissajous_env.world.state import NEVER, NOWHERE, Clock, Contamination, Robots

wp.set_module_options(OPTIONS)

MARGIN = wp.constant(2)
"""Cells around the grid in which no rogue is, so that hops need not ask for its edge."""
NONE = wp.constant(0x7FFFFF00)
"""Labels from here on say that there is no rogue."""

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


@wp.func
def place_of_cell(row: int, column: int, columns: int) -> int:
    """Where a cell stands among those of its world, the margin with them."""
    return (row + MARGIN) * (columns + 2 * MARGIN) + column + MARGIN


@wp.func
def is_entry(entry: int, row: int, column: int, rows: int, columns: int) -> bool:
    """Whether rogues are introduced in a cell."""
    on_edge = row == 0 or column == 0 or row == rows - 1 or column == columns - 1
    return entry != _BOUNDARY or on_edge


@wp.func
def forget_seen(w: int, row: int, latest: int, hops: Hops, contamination: Contamination):
    """Forget who was in the cells of a row that were seen in the tick before, but for who came there since."""
    for word in range(contamination.sensed.shape[2]):
        sensed = contamination.sensed[w, row, word]
        passed = (sensed | contamination.swept[w, row, word]) & ~contamination.wiped[w, row, word]
        while passed != wp.uint32(0):
            place = place_of_cell(row, 32 * word + lowest(passed), hops.columns)
            passed &= passed - wp.uint32(1)
            for k in range(hops.ring):
                if k != latest:
                    contamination.labels[w, k, place] = NONE
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
            end = along(robots.track, w, i, float(tick + 1) / float(hops.ticks))
            mark(w, end, end, lane, lanes, curve, hops.radius, hops.columns, contamination.sensed)
            # On a short way the disc passes over no more than what it covers at its ends, but for a sliver.
            start = along(robots.track, w, i, float(tick) / float(hops.ticks))
            way = wp.length_sq(robots.sensor[w, i] - along(robots.track, w, i, 0.0)) / float(hops.ticks * hops.ticks)
            if hops.swept == 1 and way > hops.radius * cell:
                pieces = robots.track.shape[2] - 1
                for piece in range(1, pieces + 1):
                    end = along(robots.track, w, i, (float(tick) + float(piece) / float(pieces)) / float(hops.ticks))
                    mark(w, start, end, lane, lanes, curve, hops.radius, hops.columns, contamination.swept)
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
            place = place_of_cell(row, column, hops.columns)
            for k in range(hops.ring):
                contamination.labels[w, k, place] = label
    if lane == 0:
        contamination.oldest[w] = wp.where(target.count > 0, 0, NEVER)


@wp.func
def hopped(place: int, now: wp.array(dtype=int), before: wp.array(dtype=int), share: int) -> int:
    """Label of a rogue that hops here from a cell at `place`.

    A hop takes some ticks and a share of one. `now` are the labels of that many ticks ago, `before` those of a tick
    earlier: who came within the share that is missing has not arrived yet.
    """
    came = before[place] & _SHARES
    label = before[place] - came + wp.max(came + share - _SHARES, 0)
    latest = now[place]
    if (latest & _SHARES) + share <= _SHARES:
        label = wp.min(label, latest + share)
    return label


@wp.func
def oldest_hop(
    w: int, place: int, up: int, at: Five, earlier: Five, shares: Five, labels: wp.array3d(dtype=int)
) -> int:
    """Oldest of the labels that hop here from the sixteen cells around, `up` cells from a row to the next one."""
    label = int(NONE)
    now, before, share = labels[w, at[0]], labels[w, earlier[0]], shares[0]
    label = wp.min(label, hopped(place + 1, now, before, share))
    label = wp.min(label, hopped(place - 1, now, before, share))
    now, before, share = labels[w, at[1]], labels[w, earlier[1]], shares[1]
    label = wp.min(label, hopped(place + up, now, before, share))
    label = wp.min(label, hopped(place - up, now, before, share))
    now, before, share = labels[w, at[2]], labels[w, earlier[2]], shares[2]
    label = wp.min(label, hopped(place + up + 1, now, before, share))
    label = wp.min(label, hopped(place + up - 1, now, before, share))
    label = wp.min(label, hopped(place - up + 1, now, before, share))
    label = wp.min(label, hopped(place - up - 1, now, before, share))
    now, before, share = labels[w, at[3]], labels[w, earlier[3]], shares[3]
    label = wp.min(label, hopped(place + up + 2, now, before, share))
    label = wp.min(label, hopped(place + up - 2, now, before, share))
    label = wp.min(label, hopped(place - up + 2, now, before, share))
    label = wp.min(label, hopped(place - up - 2, now, before, share))
    now, before, share = labels[w, at[4]], labels[w, earlier[4]], shares[4]
    label = wp.min(label, hopped(place + 2 * up + 1, now, before, share))
    label = wp.min(label, hopped(place + 2 * up - 1, now, before, share))
    label = wp.min(label, hopped(place - 2 * up + 1, now, before, share))
    label = wp.min(label, hopped(place - 2 * up - 1, now, before, share))
    return label


@wp.func
def is_same(w: int, place: int, label: int, slot: int, labels: wp.array3d(dtype=int)) -> bool:
    """Whether the labels of a cell in all ticks but that of a slot are the same one."""
    same = bool(True)
    for k in range(labels.shape[1]):
        same = same and (k == slot or labels[w, k, place] == label)
    return same


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


@wp.func
def label_of(w: int, place: int, up: int, seen: bool, enters: bool, now: Now, labels: wp.array3d(dtype=int)) -> int:
    """Oldest of the rogues that stay in a cell, hop to it and are introduced there; who stayed may have been seen."""
    label = int(NONE)
    if not seen:
        label = labels[w, now.latest, place]
        if label < NONE:
            label &= now.aged
    if enters:
        label = wp.min(label, now.entry)
    # What is as old as any in this world gets no older.
    if now.hops and label / 256 > now.oldest:
        label = wp.min(label, oldest_hop(w, place, up, now.at, now.before, now.shares, labels))
    return label


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
            if settled != wp.uint32(0):
                row_oldest = now.oldest
                ages += wp.int64(int(wp.bit_count(settled)) * (now.step - now.oldest))
            todo = run_of_bits(word, 0, hops.columns - 1) & ~(sensed & contamination.wiped[w, row, word]) & ~settled
            while todo != wp.uint32(0):
                bit = todo & (~todo + wp.uint32(1))
                column = 32 * word + lowest(todo)
                todo &= ~bit
                place = place_of_cell(row, column, hops.columns)
                label = int(NONE)
                if (sensed & bit) == wp.uint32(0):
                    enters = is_entry(target.entry, row, column, rows, hops.columns)
                    was_seen = (seen & bit) != wp.uint32(0)
                    label = label_of(w, place, hops.columns + 2 * MARGIN, was_seen, enters, now, labels)
                    if label < NONE:
                        row_oldest = wp.min(row_oldest, label / 256)
                        ages += wp.int64(now.step - label / 256)
                        if label == now.oldest * 256 and is_same(w, place, label, now.slot, labels):
                            settled |= bit
                labels[w, now.slot, place] = label
            contamination.settled[w, row, word] = settled
        contamination.row_oldest[w, row] = row_oldest
        contamination.row_ages[w, row] = ages
