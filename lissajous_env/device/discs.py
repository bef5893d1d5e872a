"""Points of a grid that discs cover, at one place or on their way, as bits of its rows, 64 columns in a word.

Each cell is represented by one point. The outermost points are `edge_gap` cells from the edges of the rectangle, and
points are evenly spaced: with 0.5 they are the centres of the cells, with 0 the outermost ones are on the edges.

C++ computes the cells that a resting disc covers, for eight rows at once, whose bits are adjacent in memory: the bits
of a world are arrays (words, rows). The cells that a moving disc sweeps are rarely required.
"""

import numpy as np
import warp as wp

from lissajous_env.device.curve import CurveStruct

CENTRE = wp.constant(0.5)
"""Distance of the outermost points from the edges where each is the centre of its cell [cell]."""


@wp.func
def run_of_bits(word: int, low: int, high: int) -> wp.uint64:
    """Return the bits of columns low ... high in the word of columns 64 word ... 64 word + 63."""
    start = wp.max(low - 64 * word, 0)
    stop = wp.min(high - 64 * word, 63)
    if start > stop:
        return wp.uint64(0)
    return (~wp.uint64(0) >> wp.uint64(63 - (stop - start))) << wp.uint64(start)


@wp.func
def half_of(bits: wp.uint64, half: int) -> wp.uint32:
    """Return the lower 32 columns of a word if `half` is even, the upper ones if it is odd."""
    return wp.uint32(bits >> wp.uint64(32 * (half & 1)))


@wp.func
def place_along(path: wp.array3d(dtype=wp.vec3), w: int, i: int, share: float) -> wp.vec2:
    """Return the place of a robot at a share of the latest step [m]."""
    last = path.shape[2] - 1
    s = wp.min(int(share * float(last)), last - 1)
    place = wp.lerp(path[w, i, s], path[w, i, s + 1], share * float(last) - float(s))
    return wp.vec2(place[0], place[1])


@wp.func
def disc_run(place: wp.vec2, radius: float, y: float) -> wp.vec2:
    """Return the least and greatest x of a disc at a height y [m]; the first is above the second if there is none."""
    square = radius * radius - (y - place[1]) * (y - place[1])
    if square < 0.0 or radius <= 0.0:
        return wp.vec2(1.0e30, -1.0e30)
    half = wp.sqrt(square)
    return wp.vec2(place[0] - half, place[0] + half)


@wp.func
def swept_run(a: wp.vec2, b: wp.vec2, radius: float, y: float) -> wp.vec2:
    """Return the least and the greatest x [m] at a height y of the area that a disc covers on its way from a to b."""
    way = b - a
    climb = wp.where(wp.abs(way[1]) > 1.0e-6 * radius, way[1], 1.0e-6 * radius)
    above = y - a[1]
    # Shares of the way between which the disc reaches the height, and at which its ends there are outermost.
    enters = wp.max(wp.min((above - radius) / climb, (above + radius) / climb), 0.0)
    leaves = wp.min(wp.max((above - radius) / climb, (above + radius) / climb), 1.0)
    if enters > leaves or radius <= 0.0:
        return wp.vec2(1.0e30, -1.0e30)
    lean = wp.sign(climb) * radius * way[0] / wp.max(wp.length(way), 1.0e-6 * radius)
    left = a + wp.clamp((above - lean) / climb, enters, leaves) * way - wp.vec2(0.0, y)
    right = a + wp.clamp((above + lean) / climb, enters, leaves) * way - wp.vec2(0.0, y)
    square = radius * radius
    low = left[0] - wp.sqrt(wp.max(square - left[1] * left[1], 0.0))
    return wp.vec2(low, right[0] + wp.sqrt(wp.max(square - right[1] * right[1], 0.0)))


@wp.func
def points_per_metre(count: int, edge_gap: float, half: float) -> float:
    """Return how many points of a row or column there are on a metre, for a half width or half height [m]."""
    return (float(count - 1) + 2.0 * edge_gap) / (2.0 * half)


@wp.func
def columns_of(run: wp.vec2, half_width: float, scale: float, edge_gap: float, columns: int) -> wp.vec2i:
    """Return the first and last column with its point in a run of x [m]; the first is above the last if none has.

    `scale` is how many columns there are on a metre.
    """
    low = wp.ceil((run[0] + half_width) * scale - edge_gap)
    high = wp.floor((run[1] + half_width) * scale - edge_gap)
    # Clamped before they are whole numbers: a far place or a wide disc lies beyond all of these.
    first = int(wp.clamp(low, 0.0, float(columns)))
    return wp.vec2i(first, int(wp.clamp(high, -1.0, float(columns - 1))))


def in_discs(x: np.ndarray, y: np.ndarray, places: np.ndarray, radius: float) -> np.ndarray:
    """Return True for the points (K, rows, columns) at x and y [m] that any of N discs covers, at places (N, K, 2)."""
    covered = np.zeros((places.shape[1], len(y), len(x)), dtype=bool)
    for place in places[..., None]:
        covered |= (x - place[:, :1]) ** 2 < radius**2 - (y[:, None] - place[:, 1:]) ** 2
    return covered


_VISIT = """
#if defined(__CUDA_ARCH__)
    const int together = 1;
#else
    const int together = 8;
#endif
    typedef unsigned long long Word;
    const int rows = marks.shape[1];
    const float row_scale = (rows - 1 + 2.0f * edge_gap) / (2.0f * curve.half_height);  // `points_per_metre`
    const float scale = (columns - 1 + 2.0f * edge_gap) / (2.0f * curve.half_width);
    const float low = (place[1] - radius + curve.half_height) * row_scale;
    const float high = (place[1] + radius + curve.half_height) * row_scale;
    const int top = (int)wp::clamp(low, 0.0f, (float)rows), last = (int)wp::clamp(high, -1.0f, rows - 1.0f);
    // Clamped before they are whole numbers: a far place or a wide disc lies beyond all of these.
    const auto first_column = [&](const float half) {
        const float left = ceilf((place[0] - half + curve.half_width) * scale - edge_gap);
        return (int)(left > 0.0f ? (left < columns ? left : (float)columns) : 0.0f);
    };
    const auto last_column = [&](const float half) {
        const float right = floorf((place[0] + half + curve.half_width) * scale - edge_gap);
        const float most = right < columns - 1.0f ? right : columns - 1.0f;
        return (int)(most > -1.0f ? most : -1.0f);
    };
    int added = 0;
    const auto mark_rows = [&](const int lane, const int lanes, const int first_word, const int last_word,
                               Word* __restrict mark, Word* __restrict covered) {
        // Whole blocks, so that those of all discs are the same.
        const int skipped = top > lane ? (top - lane + lanes - 1) / lanes / together * together : 0;
        for (int first = lane + skipped * lanes; first <= last; first += together * lanes) {
            int from[together], to[together];
            for (int k = 0; k < together; ++k) {
                const float up = (first + k * lanes + edge_gap) / row_scale - curve.half_height - place[1];
                const float square = radius * radius - up * up, half = sqrtf(square > 0.0f ? square : 0.0f);
                from[k] = first_column(half);
                to[k] = square < 0.0f || radius <= 0.0f ? -1 : last_column(half);
            }
            for (int word = first_word; word <= last_word; ++word) {
                const size_t here = (size_t)word * rows + first;
                for (int k = 0; k < together; ++k) {
                    if (first + k * lanes >= rows)
                        continue;
                    const int start = from[k] > 64 * word ? from[k] - 64 * word : 0;
                    const int stop = to[k] < 64 * word + 63 ? to[k] - 64 * word : 63;
                    const Word run = start <= stop ? (~(Word)0 >> (63 - (stop - start))) << start : 0;
                    const size_t at = here + k * lanes;
                    added += wp::bit_count(run & ~covered[at]);
                    mark[at] |= run;
                    covered[at] |= run;
                }
            }
        }
    };
    Word *const mark = &wp::index(marks, 0, 0), *const covered = &wp::index(covered_before, 0, 0);
    // On a CPU, where the rows of a lane stand side by side, this becomes SIMD. Of `experiment`, whose rows are single
    // words, the coverage takes a sixth longer without the first case (13 % for 64 worlds, 21 % for 256).
    if (lanes == 1 && marks.shape[0] == 1)
        mark_rows(0, 1, 0, 0, mark, covered);
    else if (lanes == 1)
        mark_rows(0, 1, first_column(radius) / 64, last_column(radius) / 64, mark, covered);
    else
        mark_rows(lane, lanes, first_column(radius) / 64, last_column(radius) / 64, mark, covered);
    return added;
"""


@wp.func_native(_VISIT)
def visit_disc(
    place: wp.vec2,
    lane: int,
    lanes: int,
    curve: CurveStruct,
    radius: float,
    columns: int,
    edge_gap: float,
    marks: wp.array2d(dtype=wp.uint64),
    covered_before: wp.array2d(dtype=wp.uint64),
) -> int:
    """Mark the cells, in the rows of a lane, whose points a disc covers at a place [m], in both arrays.

    Returns how many of the cells `covered_before` did not contain, which must not be the array `marks`.
    """
    ...


@wp.func
def mark_way(
    a: wp.vec2,
    b: wp.vec2,
    lane: int,
    lanes: int,
    curve: CurveStruct,
    radius: float,
    columns: int,
    edge_gap: float,
    marks: wp.array2d(dtype=wp.uint64),
):
    """Mark the cells, in the rows of a lane, whose points a disc covers which moves from a to b [m]."""
    rows = marks.shape[1]
    row_scale = points_per_metre(rows, edge_gap, curve.half_height)
    scale = points_per_metre(columns, edge_gap, curve.half_width)
    low = (wp.min(a[1], b[1]) - radius + curve.half_height) * row_scale
    high = (wp.max(a[1], b[1]) + radius + curve.half_height) * row_scale
    first = int(wp.clamp(low, 0.0, float(rows)))
    after = int(wp.clamp(high, -1.0, float(rows - 1))) + 1
    for row in range(first + (lane + lanes - first % lanes) % lanes, after, lanes):
        y = (float(row) + edge_gap) / row_scale - curve.half_height
        run = columns_of(swept_run(a, b, radius, y), curve.half_width, scale, edge_gap, columns)
        for word in range(run[0] / 64, run[1] / 64 + 1):
            marks[word, row] |= run_of_bits(word, run[0], run[1])
