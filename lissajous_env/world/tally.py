"""Events of a step, totals of an episode, from which its score is computed, and the reward with its terms."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import wrap
from lissajous_env.device.stage import ROBOT, WORLD, part, stage
from lissajous_env.device.trig import atan2
from lissajous_env.world.state import FAILED, NEVER, REMOVED

wp.set_module_options(OPTIONS)

FORMULAS = {
    "detection": "reward_detection * detections",
    "waiting": "reward_waiting * waiting * step",
    "collision": "reward_collision * collisions",
    "idleness": "reward_idleness * idle_ended * step / cells_total",
    "effort": "reward_effort * effort",
    "formation": "reward_formation * phase_error * step",
    "outside": "reward_outside * outside * step",
    "contamination": "reward_contamination * age_reduction * step",
    "observation": "reward_observation * in_sight * step",
}
"""Formula of each term; weights and `step` are fields of `Task`, the others of `lissajous_env.world.state`."""

TERMS = tuple(FORMULAS)
_TERMS = wp.constant(len(TERMS))
_DETECTION, _WAITING, _COLLISION, _IDLENESS, _EFFORT = (wp.constant(k) for k in range(5))
_FORMATION, _OUTSIDE, _CONTAMINATION, _OBSERVATION = (wp.constant(k) for k in range(5, 9))
"""Index of each term, in the order of `FORMULAS`."""
RECOVERED = wp.constant(0.05)
"""Deviation from the equilibrium up to which a formation always counts as recovered [rad]."""
FAULT_MARGIN = wp.constant(1.1)
"""Factor by which a quantity must exceed its largest value before the first fault to count as disturbed by it."""


@stage(ROBOT, writes="latest: reward, terms; tally: returns", idle=True)
def compute_reward(w, lane, lanes, task, cells_total, clock, contamination, latest, tally):
    """Compute the terms of each robot's reward and their sum, which includes the terms of extensions."""
    num_terms = latest.terms.shape[2]
    waiting = task.reward_waiting * float(latest.waiting[w]) * task.step
    idleness = task.reward_idleness * float(latest.idle_ended[w]) * task.step / float(wp.max(cells_total, 1))
    formation = task.reward_formation * tally.phase_error[w] * task.step
    observation = task.reward_observation * float(latest.in_sight[w]) * task.step
    age_reduction = task.reward_contamination * contamination.age_reduction[w] * task.step
    for i in range(lane, latest.reward.shape[1], lanes):
        if clock.active[w] == 0:  # the episode has ended
            for term in range(num_terms):
                latest.terms[w, i, term] = 0.0
            latest.reward[w, i] = 0.0
        else:
            # A robot that a collision or the edge removed has no share in the team's rewards of later steps.
            is_new = latest.collisions[w, i] > 0 or latest.outside[w, i] == 1
            share = wp.where(latest.terminated[w, i] and not is_new, 0.0, 1.0)
            detection = task.reward_detection * float(latest.detections[w, i])
            collision = task.reward_collision * float(latest.collisions[w, i])
            effort = task.reward_effort * latest.effort[w, i]
            outside = task.reward_outside * float(latest.outside[w, i]) * task.step
            latest.terms[w, i, _DETECTION] = detection
            latest.terms[w, i, _WAITING] = share * waiting
            latest.terms[w, i, _COLLISION] = collision
            latest.terms[w, i, _IDLENESS] = share * idleness
            latest.terms[w, i, _EFFORT] = effort
            latest.terms[w, i, _FORMATION] = share * formation
            latest.terms[w, i, _OUTSIDE] = outside
            latest.terms[w, i, _CONTAMINATION] = share * age_reduction
            latest.terms[w, i, _OBSERVATION] = share * observation
            reward = detection + share * (waiting + idleness + formation + age_reduction) + collision + effort + outside
            reward += share * observation
            for term in range(_TERMS, num_terms):
                latest.terms[w, i, term] = wp.where(share > 0.0, latest.terms[w, i, term], 0.0)
                reward += latest.terms[w, i, term]
            latest.reward[w, i] = reward
            tally.returns[w, i] += wp.float64(reward)


@part
def tally_motion(w, now, robots, latest, tally):
    """Add up distances from the curve and from the points at the phases, distances travelled and changes of actions.

    Record the largest distances from the curve and from these points, and the largest speed. Robots that a collision or
    the edge removed at the end of the step count in it, and changes of actions only for robots that worked.
    """
    present = int(0)
    working = int(0)
    lateral = wp.float64(0.0)
    tracking = wp.float64(0.0)
    distance = float(0.0)
    change = float(0.0)
    for i in range(robots.status.shape[1]):
        for s in range(1, robots.path.shape[2]):
            distance += wp.length(robots.path[w, i, s] - robots.path[w, i, s - 1])
        if robots.status[w, i] != REMOVED or latest.collisions[w, i] > 0 or latest.outside[w, i] == 1:
            present += 1
            working += latest.sensed[w, i]
            lateral += wp.float64(latest.lateral[w, i])
            tracking += wp.float64(latest.tracking[w, i])
            change += latest.change[w, i]
            tally.lateral_max[w] = wp.max(tally.lateral_max[w], latest.lateral[w, i])
            tally.tracking_max[w] = wp.max(tally.tracking_max[w], latest.tracking[w, i])
            tally.speed_max[w] = wp.max(tally.speed_max[w], wp.abs(robots.speed[w, i]))
    if now > 0:
        tally.distance_sum[w] += wp.float64(distance)
    if now > 0 and present > 0:
        tally.lateral_sum[w] += lateral / wp.float64(present)
        tally.tracking_sum[w] += tracking / wp.float64(present)
        tally.present_steps[w] += 1
    if now > 1 and working > 0:
        tally.change_sum[w] += wp.float64(change / float(working))
        tally.change_steps[w] += 1


@part
def tally_spacing(w, neighbours, robots, tally):
    """Record the largest distance of neighbours on the ring."""
    square = float(0.0)
    for i in range(robots.status.shape[1]):
        j = neighbours[i, 0]  # the one before it: of two neighbours, one is before the other
        if j >= 0 and robots.status[w, i] != REMOVED and robots.status[w, j] != REMOVED:
            square = wp.max(square, wp.length_sq(robots.position[w, i] - robots.position[w, j]))
    tally.spacing_max[w] = wp.max(tally.spacing_max[w], wp.sqrt(square))


@part
def any_failed(w, robots) -> bool:
    """Return whether some robot has failed and not resumed; removed robots do not count."""
    failed = bool(False)
    for i in range(robots.status.shape[1]):
        failed = failed or robots.status[w, i] == FAILED
    return failed


@part
def tally_faults(w, robots, tally):
    """Record whether a robot ever failed, and the step in which the last one resumed; -1 while a robot has failed."""
    fault_end = int(-1)
    for i in range(robots.status.shape[1]):
        fault_end = wp.max(fault_end, robots.resumed_at[w, i])
    failed = any_failed(w, robots)
    tally.fault_end[w] = wp.where(failed, -1, fault_end)
    tally.faulted[w] = wp.where(failed, 1, tally.faulted[w])


@part
def formation_error(w, robots, latest) -> float:
    """Return max_i |wrap(phase_i - equilibrium_i - theta_0)| [rad] of the robots that are not removed.

    theta_0 is the circular mean of phase_i - equilibrium_i.
    """
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


@part
def tally_formation(w, now, robots, latest, tally):
    """Record the deviation from the equilibrium, its largest values, and the last step in which a fault disturbed it.

    The formation counts as disturbed above max(RECOVERED, FAULT_MARGIN nominal_phase_error), because cars on a curve
    that they can hardly follow always oscillate around the equilibrium.
    """
    deviation = formation_error(w, robots, latest)
    tally.phase_error[w] = deviation
    tally.phase_error_max[w] = wp.max(tally.phase_error_max[w], deviation)
    if tally.faulted[w] == 0:
        tally.nominal_phase_error[w] = wp.max(tally.nominal_phase_error[w], deviation)
    elif deviation > wp.max(RECOVERED, FAULT_MARGIN * tally.nominal_phase_error[w]):
        tally.off_at[w] = now


@part
def tally_coverage(w, now, num_robots: int, cells_total, tally):
    """Record the steps in which every cell has been covered, by some robot and by each robot."""
    if tally.covered_at[w] == NEVER and tally.covered[w] == wp.int64(cells_total):
        tally.covered_at[w] = now
    if tally.covered_each_at[w] == NEVER and tally.covered_each[w] == wp.int64(num_robots) * wp.int64(cells_total):
        tally.covered_each_at[w] = now


@stage(
    WORLD,
    writes="tally: change_steps, change_sum, covered_at, covered_each_at, distance_sum, fault_end, faulted, "
    "lateral_max, lateral_sum, nominal_phase_error, observed, off_at, outside_steps, partly_outside_steps, "
    "phase_error, phase_error_max, present_steps, spacing_max, speed_max, tracking_max, tracking_sum",
)
def update_totals(w, cells_total, neighbours, clock, robots, latest, tally):
    """Add the state after this step to the totals of the episode."""
    now = clock.step[w]
    n = robots.status.shape[1]
    if now > 0:
        tally.observed[w] += wp.int64(latest.in_sight[w])
        for i in range(n):
            tally.outside_steps[w] += wp.int64(latest.outside[w, i])
            tally.partly_outside_steps[w] += wp.int64(latest.partly_outside[w, i])
    tally_motion(w, now, robots, latest, tally)
    tally_spacing(w, neighbours, robots, tally)
    tally_faults(w, robots, tally)
    tally_formation(w, now, robots, latest, tally)
    if cells_total > 0:
        tally_coverage(w, now, n, cells_total, tally)
