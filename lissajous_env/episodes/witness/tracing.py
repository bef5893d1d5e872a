"""The labels of the contamination stage, traced backwards: the rough way of its worst rogue.

Of the ways on which the stage lets a rogue of that age go from node to node, the one that stays well away from the
discs is chosen: the sum over steps of exp(-8 c) is least, with c the distance from the nearest disc in units of a cell.
Nodes that a disc only just leaves free, and hops through a disc, are thus avoided where others will do.
"""

import math
from collections.abc import Sequence

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import compile_quietly
from lissajous_env.episodes.witness.played import Played
from lissajous_env.parameters.spreading import HOPS, TICK_FRACTIONS, Spreading

wp.set_module_options(OPTIONS)

_FRACTIONS = wp.constant(TICK_FRACTIONS)
_STEEP = wp.constant(8.0)
_FAR = wp.constant(1.0)
"""Distance from the discs above which more is no better [cell]."""
_DEEP = wp.constant(0.5)
"""Depth in a disc below which less is no worse, so that numbers of 32 bits resolve what else there is [cell]."""
_NEAR = wp.constant(2.0e-3)
"""Cost that a hop must be able to save before any is tried."""
_NOWHERE = wp.constant(1.0e29)
_AWAY = 1e15
_BLOCK = wp.constant(2)
"""Nodes and ticks around a blocked place that a way must avoid."""

Rogue = tuple[int, int]
"""Step in which the stage introduces a rogue, and last step in which it is undetected."""


@wp.struct
class Trace:
    """A rogue of the stage, and the labels of the ticks in which it is undetected."""

    labels: wp.array3d(dtype=wp.int32)
    """(Q, R, C) labels."""
    stays: wp.array3d(dtype=wp.uint32)
    """(Q or Q - 1, R, C / 32) bits of the nodes that no disc covers until the next tick."""
    since: int
    """Step of the introduction."""
    blocked: wp.array(dtype=wp.vec3i)
    """(B,) ticks, rows and columns around which no way passes."""
    discs: wp.array3d(dtype=wp.vec2)
    """(Q, P, N) centres of the discs at the ends of the P steps that led to a tick [m]; far away for none."""
    spacing: wp.vec2
    """Distance of columns and of rows [m]."""
    corner: wp.vec2
    """Position of the first node [m]."""
    radius: float
    """[m]."""
    moves: wp.array2d(dtype=wp.int32)
    """(H, 4) hops: columns, rows, ticks, and the fraction of a tick that they last longer, negative for shorter."""
    ticks: int
    """Ticks of the stage in one of these."""
    durations: int
    """2 if a hop may take a tick more than its whole ticks."""
    reach: wp.vec3i
    """Columns, rows and ticks of the widest, the highest and the longest hop."""
    rest: wp.array3d(dtype=float)
    """(Q, R, C) least cost of the ways from there to the last tick."""
    next: wp.array3d(dtype=wp.int16)
    """(Q, R, C) hop with which they begin, times `durations`, plus 1 if it takes a tick more; -1 to wait."""
    late: wp.array3d(dtype=wp.uint8)
    """(Q, R, C) last fraction of a tick at which a rogue may come there for that. Hops one after the other thus are
    no faster than the speed limit, although the labels between them may be those of rogues that came earlier."""
    least: wp.array(dtype=float)
    """(Q,) the least of them in each tick."""
    reached: wp.array2d(dtype=wp.vec2i)
    """(Q, R) first and last column from which a way may go on; the first is above the last where none does."""
    way: wp.array(dtype=wp.vec2i)
    """(Q,) row and column in each tick, negative before the first."""


@wp.func
def cost_of(q: int, ticks: int, row: wp.vec2, column: wp.vec2, most: float, t: Trace) -> float:
    """Return the cost of some ticks, or more than `most` if it is at least that.

    The rogue goes straight and at one speed between two rows and two columns.
    """
    cost = float(0.0)
    scale = 1.0 / wp.min(t.spacing[0], t.spacing[1])
    period = t.discs.shape[1]
    steps = ticks * period
    step = int(1)
    while step <= steps and cost <= most:
        share = float(step) / float(steps)
        place = wp.vec2(wp.lerp(column[0], column[1], share), wp.lerp(row[0], row[1], share))
        place = t.corner + wp.cw_mul(place, t.spacing)
        least = float(1.0e30)
        at = (q + 1) * period + step - 1
        for i in range(t.discs.shape[2]):
            least = wp.min(least, wp.length_sq(t.discs[at / period, at % period, i] - place))
        away = (wp.sqrt(least) - t.radius) * scale
        cost += wp.exp(-_STEEP * wp.clamp(away, -_DEEP, _FAR))
        step += 1
    return cost


@wp.func
def cost_of_waiting(q: int, row: int, column: int, most: float, t: Trace) -> float:
    """Return the cost of waiting at a node until the next tick, or more than `most` if it is at least that."""
    rows = wp.vec2(float(row), float(row))
    return cost_of(q, 1, rows, wp.vec2(float(column), float(column)), most, t)


@wp.func
def is_there(q: int, row: int, column: int, t: Trace) -> bool:
    """Return whether a rogue of the age can be at a node in a tick."""
    if t.labels[q, row, column] / 256 > t.since:
        return False
    for k in range(t.blocked.shape[0]):
        away = t.blocked[k] - wp.vec3i(q, row, column)
        if wp.max(wp.max(wp.abs(away[0]), wp.abs(away[1])), wp.abs(away[2])) <= _BLOCK:
            return False
    return True


@wp.func
def can_stay(q: int, row: int, column: int, t: Trace) -> bool:
    """Return whether a rogue of the age can be at a node in a tick and until the next one."""
    bit = (t.stays[q, row, column / 32] >> wp.uint32(column % 32)) & wp.uint32(1)
    return bit == wp.uint32(1) and is_there(q, row, column, t)


@wp.func
def rest_of(q: int, row: int, column: int, t: Trace) -> float:
    """Return the least cost of the ways from a node in a tick, `_NOWHERE` or more if there is none."""
    if q >= t.labels.shape[0]:
        return _NOWHERE
    run = t.reached[q, row]
    if column < run[0] or column > run[1]:
        return _NOWHERE
    return t.rest[q, row, column]


@wp.func
def latest(q: int, row: int, column: int, hop: int, more: int, t: Trace) -> int:
    """Return the last fraction of a tick at which a rogue may come to where a hop to a node begins, or less than 0."""
    then = int(t.late[q + t.moves[hop, 2] + more, row, column])
    return wp.min(then + more * _FRACTIONS - t.moves[hop, 3], _FRACTIONS)


@wp.func
def hop_cost(q: int, row: int, column: int, hop: int, more: int, best: float, t: Trace) -> float:
    """Return the least cost from a node by a hop that lasts whole ticks or one more; more than `best` for no less."""
    other = row + t.moves[hop, 1]
    beside = column + t.moves[hop, 0]
    lasts = t.moves[hop, 2] + more
    if other < 0 or beside < 0 or other >= t.labels.shape[1] or beside >= t.labels.shape[2]:
        return _NOWHERE
    cost = rest_of(q + lasts, other, beside, t)
    if cost >= best:
        return _NOWHERE
    came = t.labels[q, row, column] & _FRACTIONS
    if came > 0 and t.ticks > 1:  # of the last tick of a step
        came = _FRACTIONS - (_FRACTIONS - came) / t.ticks
    if came > latest(q, other, beside, hop, more, t):
        return _NOWHERE
    for k in range(lasts):
        if not can_stay(q + k, row, column, t):
            return _NOWHERE
    rows = wp.vec2(float(row), float(other))
    return cost + cost_of(q, lasts, rows, wp.vec2(float(column), float(beside)), best - cost, t)


@wp.func
def standing(t: Trace) -> wp.vec2i:
    """Return the node of least cost at which a rogue can wait from the first tick to the last, negative if none is."""
    node = wp.vec2i(-1, -1)
    least = float(_NOWHERE)
    last = t.labels.shape[0] - 1
    for row in range(t.labels.shape[1]):
        for column in range(t.labels.shape[2]):
            if not is_there(last, row, column, t):
                continue
            q = int(0)
            while q < last and can_stay(q, row, column, t):
                q += 1
            if q < last:
                continue
            cost = float(0.0)
            q = int(0)
            while q < last and cost < least:
                cost += cost_of_waiting(q, row, column, least - cost, t)
                q += 1
            if cost < least:
                least = cost
                node = wp.vec2i(row, column)
    return node


@wp.func
def improve(q: int, row: int, column: int, t: Trace) -> float:
    """Find the least cost of the ways from a node in a tick, by waiting there or by hops."""
    best = float(_NOWHERE)
    how = int(-1)
    late = int(_FRACTIONS)
    later = rest_of(q + 1, row, column, t)
    if later < _NOWHERE and can_stay(q, row, column, t):
        best = later + cost_of_waiting(q, row, column, _NOWHERE, t)
    # No hop leads to a node from which less is left than from the best of the ticks in which hops end.
    least = float(_NOWHERE)
    for then in range(q + 1, wp.min(q + 1 + t.reach[2], t.labels.shape[0])):
        least = wp.min(least, t.least[then])
    if best > least + _NEAR:
        for j in range(t.durations * t.moves.shape[0]):
            cost = hop_cost(q, row, column, j / t.durations, j % t.durations, best, t)
            if cost < best:
                best = cost
                how = j
    if how >= 0:
        hop = how / t.durations
        late = latest(q, row + t.moves[hop, 1], column + t.moves[hop, 0], hop, how % t.durations, t)
    t.next[q, row, column] = wp.int16(how)
    t.late[q, row, column] = wp.uint8(late)
    return best


@wp.func
def run_within_reach(q: int, row: int, t: Trace) -> wp.vec2i:
    """Return the first and last column of a row from which a way can go on in a tick."""
    columns = t.labels.shape[2]
    ticks = t.labels.shape[0]
    if q == ticks - 1:
        return wp.vec2i(0, columns - 1)
    run = wp.vec2i(columns, -1)
    for tick in range(q + 1, wp.min(q + 1 + t.reach[2], ticks)):
        for other in range(wp.max(row - t.reach[1], 0), wp.min(row + t.reach[1] + 1, t.labels.shape[1])):
            each = t.reached[tick, other]
            if each[0] <= each[1]:
                run = wp.vec2i(wp.min(run[0], each[0] - t.reach[0]), wp.max(run[1], each[1] + t.reach[0]))
    return wp.vec2i(wp.max(run[0], 0), wp.min(run[1], columns - 1))


@wp.kernel
def trace(t: Trace):
    """Find the way of least cost from the first tick to the last, backwards: of nodes from which the end is reached."""
    ticks = t.labels.shape[0]
    node = standing(t)
    if node[0] >= 0:
        for q in range(ticks):
            t.way[q] = node
        return
    reached_tick = int(ticks - 1)
    for back in range(ticks):
        q = ticks - 1 - back
        least = float(_NOWHERE)
        for row in range(t.labels.shape[1]):
            run = run_within_reach(q, row, t)
            reached = wp.vec2i(t.labels.shape[2], -1)
            for column in range(run[0], run[1] + 1):
                rest = float(_NOWHERE)
                if is_there(q, row, column, t):
                    if back == 0:
                        rest = 0.0
                        t.next[q, row, column] = wp.int16(-1)
                        t.late[q, row, column] = wp.uint8(_FRACTIONS)
                    else:
                        rest = improve(q, row, column, t)
                t.rest[q, row, column] = rest
                if rest < _NOWHERE:
                    reached = wp.vec2i(wp.min(reached[0], column), column)
                if rest < least:
                    least = rest
                    node = wp.vec2i(row, column)
            t.reached[q, row] = reached
        t.least[q] = least
        if least < _NOWHERE:
            reached_tick = q
        if reached_tick > q + t.reach[2]:
            return
    # Targets of the beginning may be on a hop then, and those that appear between two ticks hop from the first of them.
    if reached_tick > t.reach[2]:
        return
    q = int(reached_tick)
    while q < ticks:
        t.way[q] = node
        how = int(t.next[q, node[0], node[1]])
        if how < 0:
            q += 1
        else:
            hop = how / t.durations
            q += t.moves[hop, 2] + how % t.durations
            node = wp.vec2i(node[0] + t.moves[hop, 1], node[1] + t.moves[hop, 0])


def rough_way(played: Played, rogue: Rogue, blocked: Sequence[tuple[int, np.ndarray]]) -> np.ndarray | None:
    """Return the rough way (T + 1, 2) of a rogue of an episode [m], None if there is none.

    Before it appears and after the last tick, a rogue waits.

    Args:
        played: The episode.
        rogue: The rogue of the stage.
        blocked: Steps and positions [m] that the way must avoid.
    """
    scenario, (since, until) = played.scenario, rogue
    hops, half = scenario.spreading, np.array([scenario.curve.half_width, scenario.curve.half_height])
    spacing = 2 * half / (np.array([hops.columns, hops.rows]) - 1 + 2 * hops.inset)
    corner = spacing * hops.inset - half
    first = math.ceil(since / hops.period)
    last = max(first, until // hops.period)
    t = Trace()
    # Copies nothing: the labels of an episode of `hall` take 216 MB.
    t.labels = wp.array(played.labels[first : last + 1], copy=False)
    t.stays = wp.array(played.stays[first : last + 1], copy=False)
    t.since, t.spacing, t.corner, t.radius = since, wp.vec2(*spacing), wp.vec2(*corner), hops.radius
    boxes = [
        (step // hops.period - first, *np.rint((place - corner) / spacing).astype(int)[::-1]) for step, place in blocked
    ]
    t.blocked = wp.array(np.array(boxes, dtype=np.int32).reshape(-1, 3), dtype=wp.vec3i)
    steps = np.arange((first - 1) * hops.period + 1, last * hops.period + 1)
    discs = np.where(played.works[steps, :, None], played.track[steps, :, -1], _AWAY)
    discs[steps < 0] = _AWAY
    t.discs = wp.array(discs.reshape(-1, hops.period, *discs.shape[1:]), dtype=wp.vec2)
    moves = _moves(hops, spacing, scenario.rogue_speed * scenario.task.step)
    t.ticks = hops.ticks
    t.moves, t.durations = wp.array(moves, dtype=wp.int32), 2 if hops.ticks == 1 else 1
    columns, rows, ticks = (int(most) for most in abs(moves[:, :3]).max(axis=0, initial=0))
    t.reach = wp.vec3i(columns, rows, ticks + t.durations - 1)
    shape = t.labels.shape
    t.rest, t.next = wp.empty(shape, dtype=float), wp.empty(shape, dtype=wp.int16)
    t.late, t.least = wp.empty(shape, dtype=wp.uint8), wp.empty(shape[:1], dtype=float)
    t.reached, t.way = wp.empty(shape[:2], dtype=wp.vec2i), wp.full(shape[:1], wp.vec2i(-1, -1))
    with compile_quietly():
        wp.launch(trace, dim=1, inputs=[t])
    way = t.way.numpy()
    known = np.flatnonzero(way[:, 0] >= 0)
    if not len(known):
        return None
    places, at = way[known][:, ::-1] * spacing + corner, (known + first) * hops.period
    steps = np.arange(played.steps + 1)
    return np.stack([np.interp(steps, at, places[:, k]) for k in range(2)], axis=1)


def _moves(hops: Spreading, spacing: np.ndarray, moved: float) -> np.ndarray:
    """Return the hops (H, 4) between ticks whose labels are known: columns, rows, whole ticks, remaining fraction.

    Args:
        hops: The hops of the stage.
        spacing: Distance of columns and of rows [m].
        moved: Greatest distance of a rogue in a control step [m].
    """
    if hops.ticks == 1:
        each = zip(HOPS, hops.delays, hops.shares, strict=False)  # none for targets at rest
        found = {(sx * i, sy * j, d, s) for (i, j), d, s in each for sx in (1, -1) for sy in (1, -1)}
        return np.array(sorted(found), dtype=np.int32).reshape(-1, 4)
    # A hop counts where it ends: one that began in the step before is added to those of a step.
    far = hops.ticks / (hops.delays[0] + hops.shares[0] / TICK_FRACTIONS) + 1.0
    around = range(-int(far), int(far) + 1)
    each = [(i, j) for i in around for j in around if 0 < math.hypot(i, j) <= far]
    return np.array([(i, j, 1, int((math.hypot(*(spacing * (i, j))) / moved - 1) * TICK_FRACTIONS)) for i, j in each])
