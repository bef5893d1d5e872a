"""Takeovers: the estimate of each robot of which others have failed, and the loop that it drives because of them.

A robot that has failed still sends its place, which does not move; a robot that has been removed sends nothing, so the
age of its last message grows, or the time since the reset without any. A robot has no information about others that are
neither its ring neighbours nor in sight.
"""

import warp as wp

from baselines.policies.own_row import (
    Observation,
    hears,
    message_age,
    offset_heard,
    offset_seen,
    own_heading,
    own_position,
    own_speed,
    own_works,
    sees,
    velocity_seen,
)
from baselines.policies.path_tables import FINE
from baselines.policies.takeover_loops import SHAPES
from baselines.policies.timed_paths import Tracking
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.trig import cos_sin

wp.set_module_options(OPTIONS)

WORKING, STOPPED, SILENT = (wp.constant(k) for k in range(3))
"""Estimated states of a ring neighbour."""
STATE, HEARD_X, HEARD_Y, MESSAGE_AGE, STILL_COUNT, NEW_MESSAGES = (wp.constant(k) for k in range(6))
WATCH_SIZE = 6
"""Memory of a ring neighbour: its estimated state, a place that it sent [m], the age that its last message has in the
next step [s] (without one, less the time since the reset), the number of comparisons in a row in which it had not
moved, and the number of messages since that place."""
PLACES = wp.constant(4)
"""Number of stored places of stopped robots: of the two ring neighbours, then of two that were in sight."""
SHIFTS = wp.constant(12)
"""Number of shifts of a loop that are compared in each direction, along x and y."""


@wp.struct
class Takeover:
    """Constants of a robot's estimates of others, and the loops P of its cases C (`takeover_loops.TakeoverLoops`)."""

    still: float
    """Distance of two places that are compared below which a robot has not moved [m]."""
    compared: int
    """Number of messages from one place to the next that is compared with it."""
    patience: int
    """Number of comparisons without motion after which a ring neighbour counts as failed."""
    tracking: Tracking
    """Constants of the timed paths."""
    time_unit: float
    """Unit of an observed age [s]."""
    speed_unit: float
    """Unit of an observed speed [m/s]."""
    sight: float
    """Distance within which robots are observed [m]."""
    robots_seen: int
    """Number of robots in an observation."""
    stride: int
    """Number of samples from one that is compared to the next."""
    spacing: float
    """Distance of two shifts that are compared [m]."""
    required: float
    """Least distance of a loop from a stopped robot [m]."""
    corner_reach: float
    """Distance from a corner within which a loop covers it [m]."""
    drift: float
    """Most by which the middle of a loop moves in a control step [m]."""
    neighbours: wp.array(dtype=wp.vec2i)
    """(N,) previous and next robot on the ring, -1 for none."""
    shift_limits: wp.array2d(dtype=wp.vec4)
    """(P, N) distances by which a loop can be moved to the left, down, to the right and up in the rectangle [m]."""
    middles: wp.array2d(dtype=wp.vec2)
    """(P, N) middles of the loops [m]."""
    corners: wp.array2d(dtype=int)
    """(C, N) `TakeoverLoops.corners`."""


@wp.kernel
def watch_neighbours(
    curve: CurveStruct,
    takeover: Takeover,
    observation: Observation,
    memory: wp.array4d(dtype=float),
    stopped: wp.array3d(dtype=wp.vec3),
    case_out: wp.array2d(dtype=int),
):
    """Update robot i's memory of its ring neighbours (W, N, 2, WATCH_SIZE), and the places of stopped robots.

    `stopped` (W, N, PLACES) is x, y [m], and 1 where a place is in use. The case is the sum of 1 if the previous robot
    on the ring has failed, and 2 if the next one has.
    """
    w, i = wp.tid()
    position = own_position(w, i, curve, observation)
    case_out[w, i] = 0
    for side in range(2):
        known = memory[w, i, side]
        if not hears(w, i, side, observation):
            if known[MESSAGE_AGE] <= 0.0 and takeover.neighbours[i][side] >= 0:
                known[MESSAGE_AGE] -= takeover.tracking.step
            if known[MESSAGE_AGE] > 0.0 or known[MESSAGE_AGE] < -takeover.time_unit - 0.5 * takeover.tracking.step:
                known[STATE] = float(SILENT)
        else:
            place = position + offset_heard(w, i, side, curve, observation)
            age = message_age(w, i, side, takeover.time_unit, observation) + takeover.tracking.step
            is_first = known[MESSAGE_AGE] <= 0.0
            # A message that was heard before is older by a step and does not count.
            if is_first or age < known[MESSAGE_AGE] + 0.5 * takeover.tracking.step:
                known[NEW_MESSAGES] += 1.0
                if is_first or known[NEW_MESSAGES] >= float(takeover.compared):
                    moved = wp.length(place - wp.vec2(known[HEARD_X], known[HEARD_Y]))
                    is_still = moved < takeover.still and not is_first
                    known[STILL_COUNT] = wp.where(is_still, known[STILL_COUNT] + 1.0, 0.0)
                    known[HEARD_X] = place[0]
                    known[HEARD_Y] = place[1]
                    known[NEW_MESSAGES] = 0.0
            known[MESSAGE_AGE] = age
            if known[STILL_COUNT] == 0.0:
                known[STATE] = float(WORKING)
            if known[STILL_COUNT] >= float(takeover.patience):
                known[STATE] = float(STOPPED)
        if known[STATE] != float(WORKING):
            case_out[w, i] += 1 + side
        is_stopped = wp.where(known[STATE] == float(STOPPED), 1.0, 0.0)
        stopped[w, i, side] = wp.vec3(known[HEARD_X], known[HEARD_Y], is_stopped)
    watch_disc(w, i, position, takeover, observation, stopped)


@wp.func
def watch_disc(
    w: int,
    i: int,
    position: wp.vec2,
    takeover: Takeover,
    observation: Observation,
    stopped: wp.array3d(dtype=wp.vec3),
):
    """Update the places of stopped robots that are, or were, in sight."""
    # If a stopped robot should be in sight but is not observed, it is not there any more.
    for k in range(2, PLACES):
        known = stopped[w, i, k]
        if known[2] > 0.0 and wp.length(wp.vec2(known[0], known[1]) - position) < 0.9 * takeover.sight:
            stopped[w, i, k] = wp.vec3(0.0, 0.0, 0.0)
    own = own_speed(w, i, takeover.speed_unit, observation) * cos_sin(own_heading(w, i, observation))
    for seen in range(takeover.robots_seen):
        if sees(w, i, seen, observation):
            velocity = own + velocity_seen(w, i, seen, takeover.speed_unit, observation)
            place = position + offset_seen(w, i, seen, takeover.sight, observation)
            is_known = bool(False)
            free = int(0)
            for k in range(PLACES):
                known = stopped[w, i, k]
                if known[2] > 0.0:
                    if wp.length(wp.vec2(known[0], known[1]) - place) < 2.0 * takeover.still + 0.1 * takeover.sight:
                        is_known = True
                elif k >= 2:
                    free = k
            slow = wp.length(velocity) * takeover.tracking.step < wp.min(takeover.still, 0.5 * takeover.drift)
            if slow and not is_known and free > 0:
                stopped[w, i, free] = wp.vec3(place[0], place[1], 1.0)


@wp.func
def distance_from(takeover: Takeover, path: wp.array(dtype=wp.vec4), place: wp.vec2) -> float:
    """Return the smallest distance of a loop from a place [m]."""
    least = float(wp.inf)
    for sample in range(takeover.tracking.lead_in_steps * FINE, path.shape[0], takeover.stride):
        least = wp.min(least, wp.length(wp.vec2(path[sample][0], path[sample][1]) - place))
    return least


@wp.func
def distance_from_stopped(
    takeover: Takeover, path: wp.array(dtype=wp.vec4), shift: wp.vec2, stopped: wp.array(dtype=wp.vec3)
) -> float:
    """Return the smallest distance of a shifted loop from the stopped robots [m]."""
    least = float(wp.inf)
    for k in range(stopped.shape[0]):
        if stopped[k][2] > 0.0:
            least = wp.min(least, distance_from(takeover, path, wp.vec2(stopped[k][0], stopped[k][1]) - shift))
    return least


@wp.func
def uncovered_corners(
    takeover: Takeover, path: wp.array(dtype=wp.vec4), shift: wp.vec2, corners: int, curve: CurveStruct
) -> float:
    """Return the sum of the distances of a shifted loop from the corners that it never covers [corner_reach]."""
    uncovered = float(0.0)
    for k in range(4):
        if ((corners >> k) & 1) == 1:
            x = wp.where(k % 2 == 1, curve.half_width, -curve.half_width)
            y = wp.where(k / 2 == 1, curve.half_height, -curve.half_height)
            least = distance_from(takeover, path, wp.vec2(x, y) - shift)
            if least > takeover.corner_reach:
                uncovered += least / takeover.corner_reach
    return uncovered


@wp.func
def clear_loop(
    takeover: Takeover,
    curve: CurveStruct,
    pose: wp.array3d(dtype=wp.vec4),
    case: int,
    i: int,
    stopped: wp.array(dtype=wp.vec3),
) -> wp.vec3:
    """Return the shift [m] and the shape of the loop of robot i's case with the least cost (`take_over`)."""
    best = wp.vec3(0.0, 0.0, 0.0)
    best_cost = float(wp.inf)
    for shape in range(SHAPES):
        loop = case * SHAPES + shape
        path = pose[loop, i]
        limits = takeover.shift_limits[loop, i]
        for row in range(-SHIFTS, SHIFTS + 1):
            for column in range(-SHIFTS, SHIFTS + 1):
                x = wp.clamp(float(column) * takeover.spacing, limits[0], limits[2])
                tried = wp.vec2(x, wp.clamp(float(row) * takeover.spacing, limits[1], limits[3]))
                # Terms that take long to compute are added only while this may be the best loop.
                cost = 0.01 * wp.length(tried) / takeover.required + 0.5 * float(shape)
                if cost < best_cost:
                    lacking = takeover.required - distance_from_stopped(takeover, path, tried, stopped)
                    cost += 1000.0 * wp.max(lacking, 0.0) / takeover.required
                if cost < best_cost:
                    cost += 20.0 * uncovered_corners(takeover, path, tried, takeover.corners[case, i], curve)
                if cost < best_cost:
                    best_cost = cost
                    best = wp.vec3(tried[0], tried[1], float(shape))
    return best


@wp.kernel
def take_over(
    takeover: Takeover,
    curve: CurveStruct,
    pose: wp.array3d(dtype=wp.vec4),
    cases: wp.array2d(dtype=int),
    observation: Observation,
    stopped: wp.array3d(dtype=wp.vec3),
    avoided: wp.array3d(dtype=wp.vec3),
    target: wp.array2d(dtype=wp.vec2),
    variant: wp.array2d(dtype=int),
    shift: wp.array2d(dtype=wp.vec2),
):
    """Choose each robot's loop and shift for its case, clear of stopped robots, and move towards that shift.

    The choice is the first loop with the smallest shift that is clear of stopped robots, and from which the robot
    covers the corners of the rectangle that it alone watches; a collision costs more than a corner, that more than
    another loop, and that more than a shift. `target` is the chosen shift, and `avoided` are the stopped robots for
    which it was chosen. The loop of a robot that has failed does not change, so that the others leave room for it when
    it resumes; a robot returns to its own loop at once, in phase with the others.
    """
    w, i = wp.tid()
    if not own_works(w, i, observation):
        return
    case = cases[w, i]
    near = 0.25 * takeover.spacing
    changed = case != variant[w, i] / SHAPES
    any_stopped = bool(False)
    for k in range(PLACES):
        if stopped[w, i, k][2] > 0.0:
            any_stopped = True
        if wp.length(stopped[w, i, k] - avoided[w, i, k]) > near:
            changed = True
    if changed:
        for k in range(PLACES):
            avoided[w, i, k] = stopped[w, i, k]
        best = wp.vec3(0.0, 0.0, 0.0)
        if any_stopped:
            best = clear_loop(takeover, curve, pose, case, i, stopped[w, i])
        chosen = case * SHAPES + int(best[2])
        shift[w, i] += takeover.middles[variant[w, i], i] - takeover.middles[chosen, i]
        variant[w, i] = chosen
        target[w, i] = wp.vec2(best[0], best[1])
    rest = target[w, i] - shift[w, i]
    if case > 0:
        rest *= wp.min(1.0, takeover.drift / wp.max(wp.length(rest), 1.0e-9))
    shift[w, i] += rest
