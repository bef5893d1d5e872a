"""Detection of a rogue's moves in a window of the fine lattice, exactly, by the discs of moving robots.

`lissajous_env.episodes.witness.tube` describes the moves and the window.
"""

import warp as wp

from lissajous_env.device.discs import swept_run
from lissajous_env.episodes.witness.windows import SIDE, Episodes, Tubes, place_at, run


@wp.func
def collect_pieces(
    k: int,
    corner: wp.vec2i,
    rows: wp.vec2i,
    columns: wp.vec2i,
    begin: int,
    end: int,
    reach: float,
    e: Episodes,
    tubes: Tubes,
) -> int:
    """Store the pieces of the discs' ways that can detect a move of at most `reach` [m]; returns their number.

    The move starts in some rows and columns of a window.
    """
    world = tubes.episode[k]
    pieces = e.track.shape[3] - 1
    radius = e.radius + e.margin + reach
    low = place_at(corner[0] + columns[0], corner[1] + rows[0], e, tubes)
    high = place_at(corner[0] + columns[1], corner[1] + rows[1], e, tubes)
    share = 1.0 / float((end - begin) * pieces)
    found = int(0)
    for step in range(begin + 1, end + 1):
        for i in range(e.track.shape[2]):
            if e.works[world, step, i] == wp.int8(0):
                continue
            for s in range(pieces):
                a = e.track[world, step, i, s]
                b = e.track[world, step, i, s + 1]
                if wp.max(a[0], b[0]) + radius < low[0] or wp.min(a[0], b[0]) - radius > high[0]:
                    continue
                if wp.max(a[1], b[1]) + radius < low[1] or wp.min(a[1], b[1]) - radius > high[1]:
                    continue
                tubes.pieces[k, found] = wp.vec4(a[0], a[1], b[0], b[1])
                tubes.shares[k, found] = share * float((step - begin - 1) * pieces + s)
                found += 1
    return found


@wp.func
def clear_starts(
    k: int,
    corner: wp.vec2i,
    rows: wp.vec2i,
    pieces: int,
    share: float,
    d: wp.vec2,
    more: float,
    e: Episodes,
    tubes: Tubes,
):
    """Clear in `left` the starts from which a move by d [m] is detected, by discs with `more` around them [m].

    The ways of the discs are the first `pieces` that are stored, each of which lasts a `share` of the move.
    """
    radius = e.radius + e.margin + more
    for j in range(pieces):
        piece = tubes.pieces[k, j]
        a = wp.vec2(piece[0], piece[1]) - tubes.shares[k, j] * d
        b = wp.vec2(piece[2], piece[3]) - (tubes.shares[k, j] + share) * d
        low = wp.ceil((wp.min(a[1], b[1]) - radius + e.half[1]) / tubes.spacing[1]) - float(corner[1])
        high = wp.floor((wp.max(a[1], b[1]) + radius + e.half[1]) / tubes.spacing[1]) - float(corner[1])
        first_row = wp.max(rows[0], int(wp.clamp(low, 0.0, float(SIDE))))
        last_row = wp.min(rows[1], int(wp.clamp(high, -1.0, float(SIDE))))
        for row in range(first_row, last_row + 1):
            if tubes.left[k, row] != wp.uint64(0):
                y = float(corner[1] + row) * tubes.spacing[1] - e.half[1]
                x = swept_run(a, b, radius, y)
                if x[0] <= x[1]:
                    first = wp.ceil((x[0] + e.half[0]) / tubes.spacing[0]) - float(corner[0])
                    last = wp.floor((x[1] + e.half[0]) / tubes.spacing[0]) - float(corner[0])
                    seen = run(int(wp.max(first, 0.0)), int(wp.clamp(last, -1.0, float(SIDE))))
                    tubes.left[k, row] = tubes.left[k, row] & ~seen


@wp.func
def is_undetected(k: int, start: wp.vec2, d: wp.vec2, begin: int, end: int, e: Episodes, tubes: Tubes) -> bool:
    """Return whether a move by d from a place [m] is undetected."""
    world = tubes.episode[k]
    pieces = e.track.shape[3] - 1
    radius = e.radius + 0.5 * e.margin
    count = float((end - begin) * pieces)
    for step in range(begin + 1, end + 1):
        for i in range(e.track.shape[2]):
            if e.works[world, step, i] == wp.int8(0):
                continue
            for s in range(pieces):
                share = float((step - begin - 1) * pieces + s)
                a = start + (share / count) * d - e.track[world, step, i, s]
                b = start + ((share + 1.0) / count) * d - e.track[world, step, i, s + 1]
                way = b - a
                nearest = wp.clamp(-wp.dot(a, way) / wp.max(wp.dot(way, way), 1.0e-20), 0.0, 1.0)
                if wp.length_sq(a + nearest * way) < radius * radius:
                    return False
    return True
