"""Search for a rogue's way on a fine lattice, near a way that is known roughly: a kernel, one thread for each search.

The nodes in which a rogue can be undetected are followed in a window of 64 x 64 nodes that moves along the rough way.
The bits of a row of the window are one word. A move lasts one or several control steps, in which the rogue goes
straight at one speed and each robot goes along its track, as when the simulation detects targets. Relative to such a
robot, whose place is o(s) at the share s of the move, a rogue that moves by d is detected if it starts within the
radius of the polyline o(s) - s d. So the starts from which no disc detects a move are found exactly, for

* all moves that the speed limit allows, from nodes that are farther from each disc than a rogue moves;
* no move and the longest moves in all directions, from all other nodes.
"""

import math
from collections.abc import Sequence

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import compile_quietly
from lissajous_env.device.discs import swept_run
from lissajous_env.episodes.witness.moves import clear_starts, collect_pieces, is_undetected
from lissajous_env.episodes.witness.played import Played, Way
from lissajous_env.episodes.witness.windows import (
    SIDE,
    Episodes,
    Tubes,
    columns_of,
    corner_at,
    inside,
    place_at,
    run,
    shifted,
    widened,
    width_at,
)

wp.set_module_options(OPTIONS)

_MARGIN = 4e-6
"""Share of all lengths by which discs are made larger, for numbers of 32 bits."""
_ROUNDING = 1e-6
"""Relative increase of the speed limit, for numbers of 32 bits: a whole number of nodes stays one."""
_SHARE = 0.75
"""Distance of a move, unless a rogue goes farther in a control step [cell]."""
_STILL = 1e-3
"""Distance of a move of a target at rest, which defines the lattice [cell]."""
_DIAGONAL = wp.constant(0.71)
"""Share of the longest move up to which its rows and columns are all tried."""


@wp.func
def add_left(
    k: int, m: int, rows: wp.vec2i, d: wp.vec2i, width: int, after: wp.vec2i, e: Episodes, tubes: Tubes
) -> bool:
    """Add the nodes that a move by d, or by some columns more or less, reaches from `left`; returns whether any are."""
    corner = corner_at(k, tubes.moments[k, m], e, tubes)
    any_is_left = bool(False)
    for row in range(rows[0], rows[1] + 1):
        other = row + corner[1] + d[1] - after[1]
        if tubes.left[k, row] != wp.uint64(0) and other >= 0 and other < SIDE:
            moved = shifted(widened(tubes.left[k, row], width), corner[0] + d[0] - after[0])
            moved = moved & inside(other, after, tubes)
            tubes.bits[k, m + 1, other] = tubes.bits[k, m + 1, other] | moved
            any_is_left = any_is_left or moved != wp.uint64(0)
    return any_is_left


@wp.func
def move(k: int, m: int, begin: int, end: int, reach: float, e: Episodes, tubes: Tubes) -> bool:
    """Find the nodes that a rogue reaches undetected by a move of at most `reach` [m]; returns whether any are."""
    corner = corner_at(k, begin, e, tubes)
    after = corner_at(k, end, e, tubes)
    across = tubes.spacing[0]
    up = tubes.spacing[1]
    rows = wp.vec2i(SIDE, -1)
    used = wp.uint64(0)
    for row in range(SIDE):
        tubes.bits[k, m + 1, row] = wp.uint64(0)
        tubes.left[k, row] = tubes.bits[k, m, row]
        used = used | tubes.bits[k, m, row]
        if tubes.bits[k, m, row] != wp.uint64(0):
            rows = wp.vec2i(wp.min(rows[0], row), row)
    share = 1.0 / float((end - begin) * (e.track.shape[3] - 1))
    pieces = collect_pieces(k, corner, rows, columns_of(used), begin, end, reach, e, tubes)
    clear_starts(k, corner, rows, pieces, share, wp.vec2(0.0, 0.0), reach, e, tubes)
    is_left = bool(False)
    most = int(reach / up)
    for away in range(-most, most + 1):
        width = width_at(away, reach, up, across)
        is_left = add_left(k, m, rows, wp.vec2i(0, away), width, after, e, tubes) or is_left
    contested = wp.vec2i(SIDE, -1)
    used = wp.uint64(0)
    for row in range(rows[0], rows[1] + 1):
        tubes.near[k, row] = tubes.bits[k, m, row] & ~tubes.left[k, row]
        used = used | tubes.near[k, row]
        if tubes.near[k, row] != wp.uint64(0):
            contested = wp.vec2i(wp.min(contested[0], row), row)
    if contested[1] < 0:
        return is_left
    pieces = collect_pieces(k, corner, contested, columns_of(used), begin, end, reach, e, tubes)
    steep = int(_DIAGONAL * float(most))
    for j in range(4 * (2 * steep + 1) + 1):
        away = j / 4 - steep
        d = wp.vec2i(0, 0)  # the last of all
        if away <= steep:
            sign = 2 * (j % 2) - 1
            d = wp.vec2i(sign * width_at(away, reach, up, across), away)
            if j % 4 > 1:
                d = wp.vec2i(away, sign * width_at(away, reach, across, up))
        for row in range(contested[0], contested[1] + 1):
            tubes.left[k, row] = tubes.near[k, row]
        moved = wp.vec2(float(d[0]) * across, float(d[1]) * up)
        clear_starts(k, corner, contested, pieces, share, moved, 0.0, e, tubes)
        is_left = add_left(k, m, contested, d, 0, after, e, tubes) or is_left
    return is_left


@wp.func
def appear(k: int, m: int, begin: int, e: Episodes, tubes: Tubes) -> bool:
    """Find the nodes at which a rogue can appear undetected at the end of a step; returns whether there are any."""
    tubes.moments[k, m] = begin
    corner = corner_at(k, begin, e, tubes)
    last = e.track.shape[3] - 1
    radius = e.radius + e.margin
    any_is_there = bool(False)
    for row in range(SIDE):
        line = corner[1] + row
        there = inside(row, corner, tubes)
        if e.on_edges == 1 and line != 0 and line != tubes.nodes[1] - 1:
            right = tubes.nodes[0] - 1 - corner[0]
            there = there & (run(-corner[0], -corner[0]) | run(right, right))
        for i in range(e.track.shape[2]):
            if there != wp.uint64(0) and e.works[tubes.episode[k], begin, i] != wp.int8(0):
                place = e.track[tubes.episode[k], begin, i, last]
                x = swept_run(place, place, radius, float(line) * tubes.spacing[1] - e.half[1])
                if x[0] <= x[1]:
                    first = wp.ceil((x[0] + e.half[0]) / tubes.spacing[0]) - float(corner[0])
                    final = wp.floor((x[1] + e.half[0]) / tubes.spacing[0]) - float(corner[0])
                    there = there & ~run(int(wp.max(first, 0.0)), int(wp.clamp(final, -1.0, float(SIDE))))
        tubes.bits[k, m, row] = there
        any_is_there = any_is_there or there != wp.uint64(0)
    return any_is_there


@wp.func
def farthest(k: int, m: int, e: Episodes, tubes: Tubes) -> wp.vec2i:
    """Return the node after the last move that is farthest from all discs a step later."""
    now = tubes.moments[k, m]
    corner = corner_at(k, now, e, tubes)
    then = wp.min(now + 1, e.track.shape[1] - 1)
    best = wp.vec2i(-1, -1)
    most = float(-1.0)
    for row in range(SIDE):
        bits = tubes.bits[k, m, row]
        for column in range(SIDE):
            if (bits >> wp.uint64(column)) & wp.uint64(1) == wp.uint64(1):
                place = place_at(corner[0] + column, corner[1] + row, e, tubes)
                least = float(1.0e30)
                for i in range(e.track.shape[2]):
                    if e.works[tubes.episode[k], then, i] != wp.int8(0):
                        away = e.track[tubes.episode[k], then, i, e.track.shape[3] - 1] - place
                        least = wp.min(least, wp.length_sq(away))
                if least > most:
                    most = least
                    best = wp.vec2i(corner[0] + column, corner[1] + row)
    return best


@wp.func
def before(k: int, m: int, node: wp.vec2i, reach: float, e: Episodes, tubes: Tubes) -> wp.vec2i:
    """Return a node from which a move leads to a node undetected: one of the nearest rows."""
    begin = tubes.moments[k, m]
    end = tubes.moments[k, m + 1]
    corner = corner_at(k, begin, e, tubes)
    place = place_at(node[0], node[1], e, tubes)
    for j in range(2 * int(reach / tubes.spacing[1]) + 1):
        up = wp.where(j % 2 == 1, (j + 1) / 2, -j / 2)
        width = width_at(up, reach, tubes.spacing[1], tubes.spacing[0])
        row = node[1] + up - corner[1]
        if width < 0 or row < 0 or row >= SIDE:
            continue
        for i in range(2 * width + 1):
            column = node[0] + wp.where(i % 2 == 1, (i + 1) / 2, -i / 2) - corner[0]
            if column >= 0 and column < SIDE:  # noqa: SIM102 - a shift needs a column of the window
                if (tubes.bits[k, m, row] >> wp.uint64(column)) & wp.uint64(1) == wp.uint64(1):
                    start = place_at(corner[0] + column, corner[1] + row, e, tubes)
                    if is_undetected(k, start, place - start, begin, end, e, tubes):
                        return wp.vec2i(corner[0] + column, corner[1] + row)
    return wp.vec2i(-1, -1)


@wp.func
def trace_back(k: int, first: int, last: int, e: Episodes, tubes: Tubes):
    """Trace the way from the last moment back to the first."""
    node = farthest(k, last, e, tubes)
    tubes.way[k, last] = node
    for back in range(last - first):
        at = last - 1 - back
        reach = float(tubes.moments[k, at + 1] - tubes.moments[k, at]) * tubes.moved
        node = before(k, at, node, reach, e, tubes)
        if node[0] < 0:
            tubes.last[k] = -1
            return
        tubes.way[k, at] = node


@wp.kernel
def search(e: Episodes, tubes: Tubes):
    """Follow the nodes in which a rogue is undetected until it is detected wherever it goes.

    Then follow those of a rogue that appears a step later, and so on. The way of the longest is traced back.
    """
    k = wp.tid()
    tubes.first[k] = -1
    tubes.last[k] = -1
    tubes.lost[k] = -1
    now = tubes.begin[k]
    steps = e.track.shape[1] - 1
    best = int(-1)
    m = int(0)
    while now <= tubes.until[k] and steps - now > best and (now == tubes.begin[k] or e.arrive == 1):
        first = m
        begin = now
        goes_on = appear(k, m, now, e, tubes)
        is_there = goes_on
        while now < steps and goes_on:
            end = wp.min((now / tubes.period + 1) * tubes.period, steps)
            goes_on = move(k, m, now, end, float(end - now) * tubes.moved, e, tubes)
            while not goes_on and end > now + 1:
                end -= 1
                goes_on = move(k, m, now, end, float(end - now) * tubes.moved, e, tubes)
            if goes_on:
                m += 1
                tubes.moments[k, m] = end
                now = end
        if is_there:
            if now - begin > best:
                best = now - begin
                tubes.first[k] = first
                tubes.last[k] = m
            m += 1
        if begin == tubes.begin[k]:
            tubes.lost[k] = now
        now += 1
    if best >= 0:
        trace_back(k, tubes.first[k], tubes.last[k], e, tubes)


def ways_near(
    episodes: Sequence[Played], rogues: Sequence[tuple[int, int]], rough: np.ndarray, fineness: int
) -> list[tuple[Way | None, int]]:
    """Return the longest way found near each rough way, and the last step in which the first rogue tried is undetected.

    Args:
        episodes: The episodes, of one scenario and of the same length.
        rogues: Step in which the first rogue appears, and step after which none is tried.
        rough: (K, T + 1, 2) rough ways [m].
        fineness: Nodes in the distance of a move.
    """
    scenario, count = episodes[0].scenario, len(episodes)
    half = scenario.curve.half_width, scenario.curve.half_height
    hops, moved = scenario.spreading, scenario.rogue_speed * scenario.task.step
    e = Episodes()
    e.track = wp.array(np.stack([each.track for each in episodes]), dtype=wp.vec2)
    e.works = wp.array(np.stack([each.works for each in episodes]), dtype=wp.int8)
    e.half, e.radius = wp.vec2(*half), scenario.sensing_radius
    e.margin = _MARGIN * (sum(half) + scenario.sensing_radius)
    e.on_edges, e.arrive = int(scenario.targets.entry == "boundary"), int(scenario.targets.arrival_rate > 0)
    tubes = Tubes()
    side = 2 * min(half[0] / hops.columns, half[1] / hops.rows)
    tubes.period = max(min(round(_SHARE * side / moved), scenario.task.steps), 1) if moved > 0 else scenario.task.steps
    distance = max(tubes.period * moved, _STILL * side)
    tubes.moved = moved * (1 + _ROUNDING)
    nodes = [math.ceil(2 * length * fineness / distance) + 1 for length in half]
    tubes.nodes = wp.vec2i(*nodes)
    spacing = [2 * length / (nodes[axis] - 1) for axis, length in enumerate(half)]
    tubes.spacing = wp.vec2(*spacing)
    tubes.episode = wp.array(np.arange(count), dtype=wp.int32)
    tubes.begin, tubes.until = (wp.array([each[k] for each in rogues], dtype=wp.int32) for k in range(2))
    tubes.rough = wp.array(rough, dtype=wp.vec2)
    shape = count, scenario.task.steps + 2
    tubes.bits, tubes.moments = wp.empty((*shape, 64), dtype=wp.uint64), wp.empty(shape, dtype=wp.int32)
    most = tubes.period * e.track.shape[2] * (e.track.shape[3] - 1)
    tubes.pieces, tubes.shares = wp.empty((count, most), dtype=wp.vec4), wp.empty((count, most), dtype=float)
    tubes.near, tubes.left = wp.empty((count, 64), dtype=wp.uint64), wp.empty((count, 64), dtype=wp.uint64)
    tubes.first, tubes.last, tubes.lost = (wp.empty(count, dtype=wp.int32) for _ in range(3))
    tubes.way = wp.empty(shape, dtype=wp.vec2i)
    with compile_quietly():
        wp.launch(search, dim=count, inputs=[e, tubes])
    moments, nodes, found = tubes.moments.numpy(), tubes.way.numpy(), []
    ends = zip(tubes.first.numpy(), tubes.last.numpy(), tubes.lost.numpy(), strict=True)
    for k, (first, last, lost) in enumerate(ends):
        if first < 0:
            found.append((None, int(lost)))
            continue
        if last < 0:
            raise RuntimeError(
                f"the path of a rogue must have a predecessor in each step, but has none in seed {episodes[k].seed}"
            )
        known = slice(first, last + 1)
        places = nodes[k, known] * np.array(spacing) - np.array(half)
        steps = np.arange(moments[k, first], moments[k, last] + 1)
        way = np.stack([np.interp(steps, moments[k, known], places[:, axis]) for axis in range(2)], axis=1)
        found.append((Way(int(moments[k, first]), way), int(lost)))
    return found
