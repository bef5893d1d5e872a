"""The sums over an episode from which the score is made."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import wrap
from lissajous_env.device.trig import atan2
from lissajous_env.world.state import NEVER, REMOVED, STUCK, Clock, Robots, StepEvents, Tally

wp.set_module_options(OPTIONS)

RECOVERED = wp.constant(0.05)
"""Deviation from the equilibrium up to which a formation is in it, whatever its swing [rad]."""

SWING_MARGIN = wp.constant(1.1)
"""A formation is off where its deviation is above this many times its swing, the largest before the first fault."""


@wp.kernel
def reset_tally(first: int, clock: Clock, tally: Tally):
    """Start the score of a new episode."""
    w = first + wp.tid()
    if clock.active[w] == 0:
        return
    for i in range(tally.contact.shape[1]):
        for j in range(tally.contact.shape[1]):
            tally.contact[w, i, j] = 0
        tally.returns[w, i] = wp.float64(0.0)
    tally.collisions[w] = wp.int64(0)
    tally.contact_steps[w] = wp.int64(0)
    tally.min_separation[w] = 1.0e30
    tally.covered[w] = wp.int64(0)
    tally.covered_each[w] = wp.int64(0)
    tally.covered_at[w] = NEVER
    tally.covered_each_at[w] = NEVER
    tally.lateral_sum[w] = wp.float64(0.0)
    tally.lateral_max[w] = 0.0
    tally.tracking_sum[w] = wp.float64(0.0)
    tally.tracking_max[w] = 0.0
    tally.distance_sum[w] = wp.float64(0.0)
    tally.speed_max[w] = 0.0
    tally.change_sum[w] = wp.float64(0.0)
    tally.outside_steps[w] = wp.int64(0)
    tally.spacing_max[w] = 0.0
    tally.phase_error_max[w] = 0.0
    tally.swing[w] = 0.0
    tally.faulted[w] = 0
    tally.off_at[w] = -1
    tally.fault_end[w] = -1


@wp.func
def tally_tracking(w: int, now: int, robots: Robots, latest: StepEvents, tally: Tally):
    """Keep how far the robots are from the curve, and from the point of it at their own parameter."""
    there = int(0)
    lateral = wp.float64(0.0)
    lateral_max = float(0.0)
    tracking = wp.float64(0.0)
    tracking_max = float(0.0)
    for i in range(robots.status.shape[1]):
        if robots.status[w, i] != REMOVED:
            there += 1
            lateral += wp.float64(latest.lateral[w, i])
            lateral_max = wp.max(lateral_max, latest.lateral[w, i])
            tracking += wp.float64(latest.tracking[w, i])
            tracking_max = wp.max(tracking_max, latest.tracking[w, i])
    tally.lateral_max[w] = wp.max(tally.lateral_max[w], lateral_max)
    tally.tracking_max[w] = wp.max(tally.tracking_max[w], tracking_max)
    if now > 0:
        tally.lateral_sum[w] += lateral / wp.float64(wp.max(there, 1))
        tally.tracking_sum[w] += tracking / wp.float64(wp.max(there, 1))


@wp.func
def tally_driving(w: int, now: int, robots: Robots, latest: StepEvents, tally: Tally):
    """Keep how far the robots drove, how fast, and how unsteady their actions are."""
    there = int(0)
    way = float(0.0)
    fastest = float(0.0)
    change = float(0.0)
    for i in range(robots.status.shape[1]):
        for s in range(1, robots.track.shape[2]):
            way += wp.length(robots.track[w, i, s] - robots.track[w, i, s - 1])
        if robots.status[w, i] != REMOVED:
            there += 1
            fastest = wp.max(fastest, robots.speed[w, i])
            change += latest.change[w, i]
    tally.speed_max[w] = wp.max(tally.speed_max[w], fastest)
    if now > 0:
        tally.distance_sum[w] += wp.float64(way)
        tally.change_sum[w] += wp.float64(change / float(wp.max(there, 1)))


@wp.func
def tally_spacing(w: int, neighbours: wp.array2d(dtype=int), robots: Robots, tally: Tally):
    """Keep the largest distance of neighbours on the ring."""
    square = float(0.0)
    for i in range(robots.status.shape[1]):
        for side in range(2):
            j = neighbours[i, side]
            if j > i and robots.status[w, i] != REMOVED and robots.status[w, j] != REMOVED:
                square = wp.max(square, wp.length_sq(robots.position[w, i] - robots.position[w, j]))
    tally.spacing_max[w] = wp.max(tally.spacing_max[w], wp.sqrt(square))


@wp.func
def tally_faults(w: int, robots: Robots, tally: Tally):
    """Keep whether a robot was ever stuck, and when the latest fault was over; while one lasts, none is."""
    fault_end = int(-1)
    stuck = int(0)
    for i in range(robots.status.shape[1]):
        fault_end = wp.max(fault_end, robots.resumed_at[w, i])
        if robots.status[w, i] == STUCK:
            stuck += 1
    tally.fault_end[w] = wp.where(stuck == 0, fault_end, -1)
    if stuck > 0:
        tally.faulted[w] = 1


@wp.func
def formation_error(w: int, robots: Robots, latest: StepEvents) -> float:
    """max_i |wrap(phase_i - equilibrium_i - theta_0)| over robots that are there [rad], theta_0 by circular mean."""
    unit = wp.vec2(0.0, 0.0)
    n = robots.status.shape[1]
    for i in range(n):
        if robots.status[w, i] != REMOVED:
            unit += wp.vec2(latest.phase_offset[w, i][1], latest.phase_offset[w, i][2])
    turn = atan2(unit[1], unit[0])
    error = float(0.0)
    for i in range(n):
        if robots.status[w, i] != REMOVED:
            error = wp.max(error, wp.abs(wrap(latest.phase_offset[w, i][0] - turn)))
    return error


@wp.func
def tally_formation(w: int, now: int, robots: Robots, latest: StepEvents, tally: Tally):
    """Keep the deviation from the equilibrium, its largest, its swing, and when a fault last had it off.

    A car on a curve that it can hardly follow swings around the equilibrium all the time: off is what is more than
    that, above max(RECOVERED, SWING_MARGIN swing).
    """
    deviation = formation_error(w, robots, latest)
    tally.phase_error[w] = deviation
    tally.phase_error_max[w] = wp.max(tally.phase_error_max[w], deviation)
    if tally.faulted[w] == 0:
        tally.swing[w] = wp.max(tally.swing[w], deviation)
    elif deviation > wp.max(RECOVERED, SWING_MARGIN * tally.swing[w]):
        tally.off_at[w] = now


@wp.func
def tally_coverage(w: int, now: int, robots: int, cells_total: int, tally: Tally):
    """Keep when the last cell was sensed for the first time, and when by the last robot."""
    if tally.covered_at[w] == NEVER and tally.covered[w] == wp.int64(cells_total):
        tally.covered_at[w] = now
    if tally.covered_each_at[w] == NEVER and tally.covered_each[w] == wp.int64(robots) * wp.int64(cells_total):
        tally.covered_each_at[w] = now


@wp.kernel
def keep_score(
    first: int,
    cells_total: int,
    neighbours: wp.array2d(dtype=int),
    clock: Clock,
    robots: Robots,
    latest: StepEvents,
    tally: Tally,
):
    """Add the state after this step to the sums of the episode."""
    w = first + wp.tid()
    if clock.active[w] == 0:
        return
    now = clock.step[w]
    n = robots.status.shape[1]
    for i in range(n):
        tally.outside_steps[w] += wp.int64(latest.outside[w, i])
    tally_tracking(w, now, robots, latest, tally)
    tally_driving(w, now, robots, latest, tally)
    tally_spacing(w, neighbours, robots, tally)
    tally_faults(w, robots, tally)
    tally_formation(w, now, robots, latest, tally)
    if cells_total > 0:
        tally_coverage(w, now, n, cells_total, tally)
