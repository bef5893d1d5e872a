"""The labels of the contamination stage, traced backwards: the rough way of its worst rogue.

Of the ways on which the stage lets a rogue of that age go from node to node, the one that stays well away from the
discs is chosen: the sum over ticks of exp(-8 c) is least, with c the distance from the nearest disc in units of a cell.
Nodes that a disc only just leaves free are thus avoided where others will do.
"""

import math
from collections.abc import Sequence

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import compile_quietly
from lissajous_env.episodes.witness.played import Played
from lissajous_env.parameters.spreading import HOPS, TICK_FRACTIONS, Spreading
from lissajous_env.world.contamination.labels import NONE

wp.set_module_options(OPTIONS)

_FRACTIONS = wp.constant(TICK_FRACTIONS)
_STEEP = wp.constant(8.0)
_FAR = wp.constant(1.0)
"""Distance from the discs above which more is no better [cell]."""
_NEAR = wp.constant(0.005)
"""Cost of waiting from which on hops are tried in every tick."""
_SELDOM = wp.constant(4)
"""Ticks after which they are tried everywhere."""
_NOWHERE = wp.constant(1.0e29)
_AWAY = 1e15
_BLOCK = 2
"""Nodes and ticks around a blocked place that a way must avoid."""

Rogue = tuple[int, int]
"""Step in which the stage introduces a rogue, and last step in which it is undetected."""


@wp.struct
class Traces:
    """Rogues, K of them, and the labels of the ticks in which they are undetected."""

    labels: wp.array4d(dtype=wp.int32)
    """(K, Q, R, C) labels, the last tick at the end; NONE where no rogue is."""
    since: wp.array(dtype=wp.int32)
    """Step of the introduction."""
    first: wp.array(dtype=wp.int32)
    """Index of the first tick."""
    discs: wp.array4d(dtype=wp.vec2)
    """(K, Q, P, N) centres of the discs at the ends of the P steps that led to a tick [m]; far away for none."""
    spacing: wp.vec2
    """Distance of columns and of rows [m]."""
    corner: wp.vec2
    """Position of the first node [m]."""
    radius: float
    """[m]."""
    moves: wp.array2d(dtype=wp.int32)
    """(H, 4) hops: columns, rows, ticks, and the fraction of a tick that they last longer."""
    durations: int
    """2 if a hop may take a tick more than its whole ticks."""
    cost: wp.array4d(dtype=float)
    """(K, Q, R, C) least cost of a way."""
    came: wp.array4d(dtype=wp.int8)
    """(K, Q, R, C) hop by which it came, times `durations`, plus 1 if it took a tick more; -1 for none."""
    way: wp.array2d(dtype=wp.vec2i)
    """(K, Q) row and column in each tick, negative before the first."""


@wp.func
def cost_of(k: int, q: int, row: int, column: int, last_alone: bool, traces: Traces) -> float:
    """Return the cost of a node in a tick, or at its end."""
    place = traces.corner + wp.vec2(float(column) * traces.spacing[0], float(row) * traces.spacing[1])
    least = float(1.0e30)
    last = traces.discs.shape[2] - 1
    for s in range(wp.where(last_alone, last, 0), last + 1):
        for i in range(traces.discs.shape[3]):
            least = wp.min(least, wp.length_sq(traces.discs[k, q, s, i] - place))
    away = (wp.sqrt(least) - traces.radius) / wp.min(traces.spacing[0], traces.spacing[1])
    return wp.exp(-_STEEP * wp.clamp(away, -_FAR, _FAR))


@wp.func
def is_there(k: int, q: int, row: int, column: int, traces: Traces) -> bool:
    """Return whether a rogue of the age can be at a node in a tick."""
    return q >= traces.first[k] and traces.labels[k, q, row, column] / 256 <= traces.since[k]


@wp.func
def source(k: int, q: int, row: int, column: int, hop: int, more: int, traces: Traces) -> float:
    """Return the least cost of a hop that ends at a node in a tick, and lasts whole ticks or one more."""
    other = row + traces.moves[hop, 1]
    beside = column + traces.moves[hop, 0]
    came = q - traces.moves[hop, 2] - more
    if other < 0 or beside < 0 or other >= traces.labels.shape[2] or beside >= traces.labels.shape[3]:
        return _NOWHERE
    for tick in range(came, q):
        if not is_there(k, tick, other, beside, traces):
            return _NOWHERE
    share = (traces.labels[k, came, other, beside] & _FRACTIONS) + traces.moves[hop, 3]
    if more == 0 and share > _FRACTIONS:
        return _NOWHERE
    return traces.cost[k, came, other, beside]


@wp.func
def standing(k: int, traces: Traces) -> wp.vec2i:
    """Return the node of least cost at which a rogue can wait from the first tick to the last, negative if none is."""
    node = wp.vec2i(-1, -1)
    least = float(_NOWHERE)
    last = traces.labels.shape[1]
    for row in range(traces.labels.shape[2]):
        for column in range(traces.labels.shape[3]):
            q = int(traces.first[k])
            while q < last and is_there(k, q, row, column, traces):
                q += 1
            if q < last:
                continue
            cost = float(0.0)
            q = int(traces.first[k])
            while q < last and cost < least:
                cost += cost_of(k, q, row, column, q == traces.first[k], traces)
                q += 1
            if cost < least:
                least = cost
                node = wp.vec2i(row, column)
    return node


@wp.func
def improve(k: int, q: int, row: int, column: int, traces: Traces):
    """Find the least cost of the ways to a node in a tick, by waiting there or by hops."""
    best = float(_NOWHERE)
    how = int(-1)
    waits = float(0.0)
    if is_there(k, q - 1, row, column, traces):
        waits = cost_of(k, q, row, column, False, traces)
        best = traces.cost[k, q - 1, row, column] + waits
    # Where no disc is near, waiting costs next to nothing: hops to a cheaper node may come a little later.
    if best == _NOWHERE or waits > _NEAR or q % _SELDOM == 0:
        arrives = cost_of(k, q, row, column, True, traces)
        for j in range(traces.durations * traces.moves.shape[0]):
            hop = j / traces.durations
            cost = source(k, q, row, column, hop, j % traces.durations, traces)
            cost += arrives * float(traces.moves[hop, 2])
            if cost < best:
                best = cost
                how = j
    traces.cost[k, q, row, column] = best
    traces.came[k, q, row, column] = wp.int8(how)


@wp.kernel
def trace(traces: Traces):
    """Find the way of least cost from the first tick to the last one that any way reaches."""
    k = wp.tid()
    ticks = traces.labels.shape[1]
    node = standing(k, traces)
    if node[0] >= 0:
        for q in range(traces.first[k], ticks):
            traces.way[k, q] = node
        return
    at = int(-1)
    for q in range(traces.first[k], ticks):
        least = float(_NOWHERE)
        for row in range(traces.labels.shape[2]):
            for column in range(traces.labels.shape[3]):
                if is_there(k, q, row, column, traces):
                    if q == traces.first[k]:
                        traces.cost[k, q, row, column] = cost_of(k, q, row, column, True, traces)
                        traces.came[k, q, row, column] = wp.int8(-1)
                    else:
                        improve(k, q, row, column, traces)
                    if traces.cost[k, q, row, column] < least:
                        least = traces.cost[k, q, row, column]
                        node = wp.vec2i(row, column)
                        at = q
    while at >= traces.first[k]:
        traces.way[k, at] = node
        how = int(traces.came[k, at, node[0], node[1]])
        if how < 0:
            at -= 1
        else:
            hop = how / traces.durations
            at -= traces.moves[hop, 2] + how % traces.durations
            node = wp.vec2i(node[0] + traces.moves[hop, 1], node[1] + traces.moves[hop, 0])


def rough_ways(
    episodes: Sequence[Played], rogues: Sequence[Rogue], blocked: Sequence[Sequence[tuple[int, np.ndarray]]]
) -> list[np.ndarray | None]:
    """Return the rough way (T + 1, 2) of a rogue of each episode [m], None if there is none.

    Before it appears and after the last tick that it reaches, a rogue waits.

    Args:
        episodes: The episodes, of one scenario.
        rogues: The rogues of the stage.
        blocked: For each of them, steps and positions [m] that the way must avoid.
    """
    scenario = episodes[0].scenario
    hops, half = scenario.spreading, np.array([scenario.curve.half_width, scenario.curve.half_height])
    spacing = 2 * half / (np.array([hops.columns, hops.rows]) - 1 + 2 * hops.inset)
    corner = spacing * hops.inset - half
    spans = [(math.ceil(since / hops.period), until // hops.period) for since, until in rogues]
    spans = [(first, max(first, last)) for first, last in spans]
    length = max(last - first for first, last in spans) + 1
    labels = np.full((len(rogues), length, hops.rows, hops.columns), int(NONE), dtype=np.int32)
    discs = np.full((len(rogues), length, hops.period, scenario.num_robots, 2), _AWAY, dtype=np.float32)
    for k, (played, (first, last)) in enumerate(zip(episodes, spans, strict=True)):
        labels[k, length - 1 - last + first :] = played.labels[first : last + 1]
        for step, place in blocked[k]:
            row, column = np.rint((place - corner) / spacing).astype(int)[::-1]
            around = slice(max(row - _BLOCK, 0), row + _BLOCK + 1), slice(max(column - _BLOCK, 0), column + _BLOCK + 1)
            near = step // hops.period - _BLOCK, step // hops.period + _BLOCK + 1
            from_first = (min(max(tick - last + length - 1, 0), length - 1) for tick in near)
            labels[(k, slice(*from_first), *around)] = int(NONE)
        steps = np.arange((first - 1) * hops.period + 1, last * hops.period + 1)
        places = np.where(played.works[steps, :, None], played.track[steps, :, -1], _AWAY)
        places[steps < 0] = _AWAY
        discs[k, length - 1 - last + first :] = places.reshape(-1, *discs.shape[2:])
    traces = Traces()
    traces.spacing, traces.corner, traces.radius = wp.vec2(*spacing), wp.vec2(*corner), hops.radius
    traces.labels, traces.discs = wp.array(labels), wp.array(discs, dtype=wp.vec2)
    traces.since = wp.array([since for since, _ in rogues], dtype=wp.int32)
    traces.first = wp.array([length - 1 - last + first for first, last in spans], dtype=wp.int32)
    traces.moves = wp.array(_moves(hops), dtype=wp.int32)
    traces.durations = 2 if hops.ticks == 1 else 1
    traces.cost, traces.came = wp.empty(labels.shape, dtype=float), wp.empty(labels.shape, dtype=wp.int8)
    traces.way = wp.array(np.full((len(rogues), length, 2), -1), dtype=wp.vec2i)
    with compile_quietly():
        wp.launch(trace, dim=len(rogues), inputs=[traces])
    steps, found = np.arange(episodes[0].steps + 1), []
    for way, (_, last) in zip(traces.way.numpy(), spans, strict=True):
        known = np.flatnonzero(way[:, 0] >= 0)
        places, at = way[known][:, ::-1] * spacing + corner, (known - length + 1 + last) * hops.period
        found.append(np.stack([np.interp(steps, at, places[:, k]) for k in range(2)], axis=1) if len(known) else None)
    return found


def _moves(hops: Spreading) -> np.ndarray:
    """Return the hops (H, 4) between ticks whose labels are known: columns, rows, whole ticks, remaining fraction."""
    if hops.ticks == 1:
        each = zip(HOPS, hops.delays, hops.shares, strict=False)  # none for targets at rest
        found = {(sx * i, sy * j, d, s) for (i, j), d, s in each for sx in (1, -1) for sy in (1, -1)}
        return np.array(sorted(found), dtype=np.int32).reshape(-1, 4)
    # A hop counts where it ends: one that began in the step before is added to those of a step.
    far = hops.ticks / (hops.delays[0] + hops.shares[0] / TICK_FRACTIONS) + 1.0
    around = range(-int(far), int(far) + 1)
    return np.array([(i, j, 1, 0) for i in around for j in around if 0 < math.hypot(i, j) <= far])
