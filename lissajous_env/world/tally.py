"""The clock of each world, and the sums over its episode from which the score is made."""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct, curve_parameter, wrap
from lissajous_env.device.trig import cos_sin
from lissajous_env.world.collisions import COUNT, REMOVE, take_consequence
from lissajous_env.world.distance import DistanceTable, curve_distance
from lissajous_env.world.reward import TaskStruct, give_nothing, give_reward
from lissajous_env.world.robots import FormationStruct, tracking_error
from lissajous_env.world.state import ENDED, IDLE, NEVER, NOWHERE, REMOVED, RUNNING, STUCK, Clock, Robots, Step, Tally

wp.set_module_options(OPTIONS)

RECOVERED = wp.constant(0.05)
"""Deviation from the equilibrium below which a formation has recovered [rad]."""


@wp.kernel
def reset_clock(first: int, seeds: wp.array(dtype=int), clock: Clock):
    """Start an episode with the given seed or, where it is negative, with one drawn from the seed before."""
    w = first + wp.tid()
    if clock.fresh[w] == 0:
        return
    seed = seeds[w]
    if seed < 0:
        seed = int(randomness.stream(randomness.step_key(clock.seed[w], 0), 0, randomness.EPISODE) >> wp.uint32(1))
    clock.seed[w] = seed
    clock.step[w] = 0
    clock.stage[w] = RUNNING
    clock.invalid[w] = 0
    clock.invalid_at[w] = 0


@wp.func
def formation_error(w: int, equilibrium: wp.array(dtype=wp.float64), robots: Robots) -> float:
    """max_i |wrap(phase_i - equilibrium_i - theta_0)| over robots that are there [rad], theta_0 by circular mean."""
    unit = wp.vec2(0.0, 0.0)
    n = robots.status.shape[1]
    for i in range(n):
        if robots.status[w, i] != REMOVED:
            unit += cos_sin(float(robots.phase[w, i] - equilibrium[i]))
    turn = wp.atan2(unit[1], unit[0])
    error = float(0.0)
    for i in range(n):
        if robots.status[w, i] != REMOVED:
            error = wp.max(error, wp.abs(wrap(float(robots.phase[w, i] - equilibrium[i]) - turn)))
    return error


@wp.kernel
def reset_tally(first: int, clock: Clock, robots: Robots, step_out: Step, tally: Tally):
    """Start the score of a new episode."""
    w = first + wp.tid()
    if clock.fresh[w] == 0:
        return
    for i in range(robots.status.shape[1]):
        for j in range(robots.status.shape[1]):
            tally.contact[w, i, j] = 0
        tally.returns[w, i] = wp.float64(0.0)
        step_out.terminated[w, i] = False
        step_out.truncated[w, i] = False
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
    tally.outside_steps[w] = wp.int64(0)
    tally.spacing_max[w] = 0.0
    tally.phase_error_max[w] = 0.0
    tally.off_at[w] = -1
    tally.fault_end[w] = -1


@wp.func
def leave(w: int, i: int, on_leaving: int, radius: float, curve: CurveStruct, robots: Robots, step_out: Step) -> int:
    """Return 1, and remove the robot where `on_leaving` says so, if its whole body is outside the rectangle."""
    place = robots.position[w, i]
    beyond_x = wp.max(wp.abs(place[0]) - curve.half_width, 0.0)
    beyond_y = wp.max(wp.abs(place[1]) - curve.half_height, 0.0)
    outside = int(0)
    if beyond_x * beyond_x + beyond_y * beyond_y > radius * radius and robots.status[w, i] != REMOVED:
        outside = 1
        if on_leaving == REMOVE:
            robots.status[w, i] = REMOVED
            robots.sensor[w, i] = wp.vec2(NOWHERE, NOWHERE)
            step_out.terminated[w, i] = True
    step_out.outside[w, i] = outside
    return outside


@wp.kernel
def keep_score(
    first: int,
    begin: int,
    curve: CurveStruct,
    formation: FormationStruct,
    task: TaskStruct,
    steps: int,
    cells_total: int,
    on_collision: int,
    on_leaving: int,
    radius: float,
    distances: DistanceTable,
    equilibrium: wp.array(dtype=wp.float64),
    neighbours: wp.array2d(dtype=int),
    clock: Clock,
    robots: Robots,
    step_out: Step,
    tally: Tally,
):
    """Let collisions and leaving have their consequence, score and reward the latest step, and let the clock go on."""
    w = first + wp.tid()
    if begin == 1 and clock.fresh[w] == 0:
        return
    if begin == 0 and clock.stage[w] != RUNNING:
        clock.stage[w] = IDLE
        give_nothing(w, step_out)
        return
    now = clock.step[w] + 1 - begin
    n = robots.status.shape[1]
    if on_collision != COUNT:
        for i in range(n):
            take_consequence(w, i, on_collision, robots, step_out)
    there = int(0)
    running = int(0)
    stuck = int(0)
    fault_end = int(-1)
    lateral = wp.float64(0.0)
    lateral_max = float(0.0)
    tracking = wp.float64(0.0)
    tracking_max = float(0.0)
    spacing = float(0.0)
    outside = int(0)
    for i in range(n):
        outside += leave(w, i, on_leaving, radius, curve, robots, step_out)
    for i in range(n):
        if not step_out.terminated[w, i]:
            running += 1
        status = robots.status[w, i]
        fault_end = wp.max(fault_end, robots.resumed_at[w, i])
        if status == STUCK:
            stuck += 1
        if status != REMOVED:
            there += 1
            gamma = curve_parameter(float(formation.alpha), robots.phase[w, i])
            position = robots.position[w, i]
            error = tracking_error(curve, gamma, position)
            tracking += wp.float64(error)
            tracking_max = wp.max(tracking_max, error)
            distance = curve_distance(distances, wp.vec2(position[0], position[1]))
            lateral += wp.float64(distance)
            lateral_max = wp.max(lateral_max, distance)
            for side in range(2):
                j = neighbours[i, side]
                if j > i and robots.status[w, j] != REMOVED:
                    spacing = wp.max(spacing, wp.length_sq(robots.position[w, i] - robots.position[w, j]))
    tally.outside_steps[w] += wp.int64(outside)
    tally.fault_end[w] = wp.where(stuck == 0, fault_end, -1)
    tally.lateral_max[w] = wp.max(tally.lateral_max[w], lateral_max)
    tally.tracking_max[w] = wp.max(tally.tracking_max[w], tracking_max)
    tally.spacing_max[w] = wp.max(tally.spacing_max[w], wp.sqrt(spacing))
    if begin == 0:
        tally.lateral_sum[w] += lateral / wp.float64(wp.max(there, 1))
        tally.tracking_sum[w] += tracking / wp.float64(wp.max(there, 1))
    deviation = formation_error(w, equilibrium, robots)
    tally.phase_error[w] = deviation
    tally.phase_error_max[w] = wp.max(tally.phase_error_max[w], deviation)
    if deviation >= RECOVERED:
        tally.off_at[w] = now
    if cells_total > 0:
        if tally.covered_at[w] == NEVER and tally.covered[w] == wp.int64(cells_total):
            tally.covered_at[w] = now
        if tally.covered_each_at[w] == NEVER and tally.covered_each[w] == wp.int64(n) * wp.int64(cells_total):
            tally.covered_each_at[w] = now
    clock.step[w] = now
    clock.stage[w] = wp.where(now >= steps or running == 0, ENDED, RUNNING)
    if begin == 1:
        give_nothing(w, step_out)
    else:
        give_reward(w, now >= steps, task, cells_total, step_out, tally)
