"""The choice of a loop, and of a place for it, from a robot's information on failed robots."""

import warp as wp

from baselines.policies.failures import PLACES, STATE, WORKS
from baselines.policies.own_row import own_works
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct

wp.set_module_options(OPTIONS)

SIDE = wp.constant(12)
"""Shifts that are compared to each side, along x and y."""


@wp.struct
class Repair:
    """The loops P of a takeover (`repair_plan.Takeover`) and the constants of the choice among them."""

    shapes: int
    """Loops of a case."""
    first: int
    """First sample of the loops in the tables of paths."""
    every: int
    """Samples from one that is compared to the next."""
    spacing: float
    """Distance of two shifts that are compared [m]."""
    required: float
    """Least distance of a loop from a stopped robot [m]."""
    offset: float
    """Spacing of the distances of `cost` [m]."""
    sensing: float
    """Distance within which a loop passes by corners [m]."""
    drift: float
    """Most by which the middle of a loop moves in a control step [m]."""
    back: float
    """The same on the way to the robot's own loop [m], so that the car stays in phase with the others."""
    margins: wp.array2d(dtype=wp.vec4)
    """(P, N) distances by which a loop can be moved to the left, down, to the right and up in the rectangle [m]."""
    middles: wp.array2d(dtype=wp.vec2)
    """(P, N) middles of the loops [m]."""
    away: wp.array2d(dtype=wp.vec2)
    """(P, N) `Takeover.away` [m]."""
    cost: wp.array4d(dtype=float)
    """(P, N, OFFSETS, OFFSETS) `Takeover.cost`."""
    corners: wp.array2d(dtype=int)
    """(P, N) `Takeover.corners`."""


@wp.func
def distance_of(repair: Repair, path: wp.array(dtype=wp.vec4), place: wp.vec2) -> float:
    """Return the smallest distance of a loop from a place [m]."""
    least = float(wp.inf)
    for sample in range(repair.first, path.shape[0], repair.every):
        least = wp.min(least, wp.length(wp.vec2(path[sample][0], path[sample][1]) - place))
    return least


@wp.func
def clearance_of(
    repair: Repair, path: wp.array(dtype=wp.vec4), shift: wp.vec2, standing: wp.array(dtype=wp.vec3)
) -> float:
    """Return the smallest distance of a shifted loop from the stopped robots [m]."""
    least = float(wp.inf)
    for k in range(standing.shape[0]):
        if standing[k][2] > 0.0:
            least = wp.min(least, distance_of(repair, path, wp.vec2(standing[k][0], standing[k][1]) - shift))
    return least


@wp.func
def unseen_corners(
    repair: Repair, path: wp.array(dtype=wp.vec4), shift: wp.vec2, corners: int, curve: CurveStruct
) -> float:
    """Return the sum of the distances of a shifted loop from corners that it never senses [sensing radii]."""
    unseen = float(0.0)
    for k in range(4):
        if ((corners >> k) & 1) == 1:
            corner = wp.vec2(
                wp.where(k % 2 == 1, curve.half_width, -curve.half_width),
                wp.where(k / 2 == 1, curve.half_height, -curve.half_height),
            )
            least = distance_of(repair, path, corner - shift)
            if least > repair.sensing:
                unseen += least / repair.sensing
    return unseen


@wp.func
def cost_of(costs: wp.array2d(dtype=float), away: wp.vec2, offset: float) -> float:
    """Return the cost of a loop whose middle is some way from the best place, between those of a table."""
    last = float(costs.shape[0] - 1)
    x = wp.min(wp.abs(away[0]) / offset, last)
    y = wp.min(wp.abs(away[1]) / offset, last)
    column = wp.min(int(x), costs.shape[0] - 2)
    row = wp.min(int(y), costs.shape[0] - 2)
    x -= float(column)
    y -= float(row)
    lower = (1.0 - x) * costs[column, row] + x * costs[column + 1, row]
    upper = (1.0 - x) * costs[column, row + 1] + x * costs[column + 1, row + 1]
    return (1.0 - y) * lower + y * upper


@wp.kernel
def case_of_neighbours(watched: wp.array4d(dtype=float), cases: wp.array2d(dtype=int)):
    """Number the states of each robot's ring neighbours: 1 if the previous one has failed, and 2 if the next has."""
    w, i = wp.tid()
    cases[w, i] = 0
    for side in range(2):
        if watched[w, i, side, STATE] != float(WORKS):
            cases[w, i] += 1 + side


@wp.kernel
def case_of_line(
    reach: float,
    along: wp.vec2,
    lines: wp.array2d(dtype=int),
    centres: wp.array(dtype=wp.vec2),
    news: wp.array3d(dtype=float),
    cases: wp.array2d(dtype=int),
    home: wp.array2d(dtype=wp.vec2),
):
    """Divide each line of cells evenly among its working robots: count the others, and place each robot.

    `reach` is half of the rectangle's extent along the lines [m], `along` their direction, `lines` (N, L) the robots
    of each robot's line in order, -1 for none, `home` how far the middle of its share is from that of its cell [m].
    """
    w, i = wp.tid()
    failed = int(0)
    shares = int(0)
    rank = int(0)
    for k in range(lines.shape[1]):
        j = lines[i, k]
        if j == i:
            rank = shares
        if j >= 0:
            if j != i and news[w, i, j] < 0.0:
                failed += 1
            else:
                shares += 1
    cases[w, i] = failed
    home[w, i] = wp.vec2(0.0, 0.0)
    if failed > 0:
        middle = reach * (float(2 * rank + 1) / float(shares) - 1.0)
        home[w, i] = (middle - wp.dot(centres[i], along)) * along


@wp.kernel
def take_over(
    repair: Repair,
    curve: CurveStruct,
    pose: wp.array3d(dtype=wp.vec4),
    cases: wp.array2d(dtype=int),
    home: wp.array2d(dtype=wp.vec2),
    observation: wp.array3d(dtype=float),
    standing: wp.array3d(dtype=wp.vec3),
    avoided: wp.array3d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec4),
    plan: wp.array2d(dtype=int),
    shift: wp.array2d(dtype=wp.vec2),
):
    """Choose each robot's loop and shift for its case, clear of stopped robots, and move towards that shift.

    Of those that are clear it is the one of the least cost (`Takeover`), in which a corner of the rectangle that the
    robot alone watches counts for more than any place if the loop never senses it. Then it is the nearest to `home`,
    the shift that is best without stopped robots. `target` is the shift that was chosen, and the home that it was
    chosen for. A robot that has failed keeps its loop, for which the others leave room when it resumes.
    """
    w, i = wp.tid()
    if not own_works(w, i, observation):
        return
    now = cases[w, i]
    before = target[w, i]
    near = 0.25 * repair.spacing
    changed = now != plan[w, i] / repair.shapes or wp.length(home[w, i] - wp.vec2(before[2], before[3])) > near
    stands = float(0.0)
    for k in range(PLACES):
        stands += standing[w, i, k][2]
        if wp.length(standing[w, i, k] - avoided[w, i, k]) > near:
            changed = True
    if changed:
        for k in range(PLACES):
            avoided[w, i, k] = standing[w, i, k]
        best = wp.vec2(0.0, 0.0)
        best_shape = int(0)
        best_cost = float(wp.inf)
        for shape in range(repair.shapes):
            loop = now * repair.shapes + shape
            path = pose[loop, i]
            margin = repair.margins[loop, i]
            for row in range(-SIDE, SIDE + 1):
                for column in range(-SIDE, SIDE + 1):
                    x = wp.clamp(home[w, i][0] + float(column) * repair.spacing, margin[0], margin[2])
                    y = wp.clamp(home[w, i][1] + float(row) * repair.spacing, margin[1], margin[3])
                    tried = wp.vec2(x, y)
                    moved = tried - home[w, i]
                    # A collision costs more than a corner where targets hide, that more than any place, and that more
                    # than a shift.
                    cost = 0.01 * wp.length(moved) / repair.required
                    cost += cost_of(repair.cost[loop, i], repair.away[loop, i] + moved, repair.offset)
                    if stands > 0.0 and cost < best_cost:
                        missed = repair.required - clearance_of(repair, path, tried, standing[w, i])
                        cost += 1000.0 * wp.max(missed, 0.0) / repair.required
                    if stands > 0.0 and cost < best_cost:
                        cost += 20.0 * unseen_corners(repair, path, tried, repair.corners[loop, i], curve)
                    if cost < best_cost and (stands > 0.0 or (row == 0 and column == 0)):
                        best_cost = cost
                        best = tried
                        best_shape = shape
            if stands == 0.0:  # the first is the best
                break
        chosen = now * repair.shapes + best_shape
        shift[w, i] += repair.middles[plan[w, i], i] - repair.middles[chosen, i]
        plan[w, i] = chosen
        target[w, i] = wp.vec4(best[0], best[1], home[w, i][0], home[w, i][1])
    rest = wp.vec2(target[w, i][0], target[w, i][1]) - shift[w, i]
    most = wp.where(now == 0, repair.back, repair.drift)
    shift[w, i] += rest * wp.min(1.0, most / wp.max(wp.length(rest), 1.0e-9))


@wp.kernel
def rest_after_failure(
    rest: float, observation: wp.array3d(dtype=float), resting: wp.array2d(dtype=float), action: wp.array3d(dtype=float)
):
    """Let a robot that resumes wait for `rest` more control steps, in which the others return to their own shares."""
    w, i = wp.tid()
    if not own_works(w, i, observation):
        resting[w, i] = rest
    elif resting[w, i] > 0.0:
        resting[w, i] -= 1.0
        action[w, i, 0] = 0.0
        action[w, i, 1] = -1.0
