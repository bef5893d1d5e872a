"""Structures of a search for a rogue's way, and windows of 64 x 64 nodes whose rows are words of bits."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS

wp.set_module_options(OPTIONS)

SIDE = wp.constant(64)
"""Rows and columns of a window."""
_ALL = wp.constant(wp.uint64(0xFFFFFFFFFFFFFFFF))


@wp.struct
class Episodes:
    """Episodes of one scenario, E of them, T steps, N robots, S sub-steps."""

    track: wp.array4d(dtype=wp.vec2)
    """(E, T + 1, N, S + 1) positions of the robots through the step that led to a moment [m]."""
    works: wp.array3d(dtype=wp.int8)
    """(E, T + 1, N) 1 for a robot that senses in that step."""
    half: wp.vec2
    """Half width and half height of the rectangle [m]."""
    radius: float
    """Sensing radius [m]."""
    margin: float
    """Increase of the radius that covers rounding to 32 bits [m]."""
    on_edges: int
    """1 if targets appear on the edges alone."""
    arrive: int
    """1 if targets appear after the beginning, too."""


@wp.struct
class Tubes:
    """Searches, K of them, of at most M moves."""

    episode: wp.array(dtype=wp.int32)
    begin: wp.array(dtype=wp.int32)
    """Step at whose end the rogue appears."""
    until: wp.array(dtype=wp.int32)
    """Step after which no further rogue is tried."""
    spacing: wp.vec2
    """Distance of columns and of rows [m]."""
    nodes: wp.vec2i
    """Columns and rows of the lattice."""
    period: int
    """Control steps of a move."""
    moved: float
    """Greatest distance of a rogue in a control step [m]."""
    rough: wp.array2d(dtype=wp.vec2)
    """(K, T + 1) rough way [m]."""
    bits: wp.array3d(dtype=wp.uint64)
    """(K, M + 1, 64) nodes after each move."""
    moments: wp.array2d(dtype=wp.int32)
    """(K, M + 1) ends of the moves [step]."""
    near: wp.array2d(dtype=wp.uint64)
    """(K, 64) nodes that are so near to a disc that not every move from them is undetected."""
    left: wp.array2d(dtype=wp.uint64)
    """(K, 64) starts that are being cleared."""
    pieces: wp.array2d(dtype=wp.vec4)
    """(K, P) first and last positions of the sensors on the pieces of their ways that are near [m]."""
    shares: wp.array2d(dtype=float)
    """(K, P) moments at which these begin, as a share of the move."""
    first: wp.array(dtype=wp.int32)
    """Index of the moment at which the longest way begins; -1 if there is none."""
    last: wp.array(dtype=wp.int32)
    """Index of the moment at which it ends."""
    lost: wp.array(dtype=wp.int32)
    """Last step in which the first rogue is undetected."""
    way: wp.array2d(dtype=wp.vec2i)
    """(K, M + 1) column and row at each moment of the way."""


@wp.func
def run(low: int, high: int) -> wp.uint64:
    """Return the bits low ... high of a word."""
    first = wp.max(low, 0)
    last = wp.min(high, SIDE - 1)
    if first > last:
        return wp.uint64(0)
    return (_ALL >> wp.uint64(SIDE - 1 - last + first)) << wp.uint64(first)


@wp.func
def columns_of(bits: wp.uint64) -> wp.vec2i:
    """Return the first and the last column whose bit is set."""
    first = int(0)
    last = int(SIDE - 1)
    while first < SIDE - 1 and (bits >> wp.uint64(first)) & wp.uint64(1) == wp.uint64(0):
        first += 1
    while last > first and (bits >> wp.uint64(last)) & wp.uint64(1) == wp.uint64(0):
        last -= 1
    return wp.vec2i(first, last)


@wp.func
def shifted(bits: wp.uint64, by: int) -> wp.uint64:
    """Return a row whose nodes are moved by some columns; those that leave the window are lost."""
    if by <= -SIDE or by >= SIDE:
        return wp.uint64(0)
    if by >= 0:
        return bits << wp.uint64(by)
    return bits >> wp.uint64(-by)


@wp.func
def widened(bits: wp.uint64, by: int) -> wp.uint64:
    """Return a row with all nodes that are at most some columns from one of its nodes."""
    wide = bits
    done = int(0)
    while done < by:
        more = wp.min(by - done, 2 * done + 1)
        wide = wide | shifted(wide, more) | shifted(wide, -more)
        done += more
    return wide


@wp.func
def width_at(rows: int, reach: float, up: float, across: float) -> int:
    """Return the columns that a move reaches which goes some rows up or down; -1 for none."""
    square = reach * reach - float(rows * rows) * up * up
    if square < 0.0:
        return -1
    return int(wp.sqrt(square) / across)


@wp.func
def corner_at(k: int, step: int, episodes: Episodes, tubes: Tubes) -> wp.vec2i:
    """Return the first column and row of the window of a step."""
    place = tubes.rough[k, step] + episodes.half
    column = int(wp.round(place[0] / tubes.spacing[0])) - SIDE / 2
    return wp.vec2i(column, int(wp.round(place[1] / tubes.spacing[1])) - SIDE / 2)


@wp.func
def inside(row: int, corner: wp.vec2i, tubes: Tubes) -> wp.uint64:
    """Return the bits of a row of a window that are nodes of the lattice."""
    if corner[1] + row < 0 or corner[1] + row >= tubes.nodes[1]:
        return wp.uint64(0)
    return run(-corner[0], tubes.nodes[0] - 1 - corner[0])


@wp.func
def place_at(column: int, row: int, episodes: Episodes, tubes: Tubes) -> wp.vec2:
    """Return the position of a node [m]."""
    return wp.vec2(float(column) * tubes.spacing[0], float(row) * tubes.spacing[1]) - episodes.half
