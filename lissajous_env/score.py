"""The score: tallied on the device step by step, made into one row of named columns at the end of an episode."""

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from lissajous_env.curve import CurveStruct, wrap
from lissajous_env.robot import FormationStruct, lateral_error
from lissajous_env.state import (
    ENDED,
    IDLE,
    NEVER,
    REMOVED,
    RUNNING,
    STUCK,
    Cells,
    Clock,
    Robots,
    Step,
    Tally,
)
from lissajous_env.trig import cos_sin

if TYPE_CHECKING:
    from lissajous_env.simulation import Simulation

wp.set_module_options({"enable_backward": False, "max_unroll": 1})

COLUMNS = (
    "scenario", "policy", "episode", "seed", "targets", "detected_fraction", "detection_time_mean",
    "detection_time_p95", "detection_time_max", "detected_within_bound", "collisions", "contact_time",
    "min_separation", "coverage_time", "coverage_time_each", "idleness_mean", "idleness_max", "lateral_error_mean",
    "lateral_error_max", "spacing_factor", "phase_error", "recovery_time", "return_mean",
)  # fmt: skip

RECOVERED = wp.constant(0.05)
"""Deviation from the equilibrium below which a formation has recovered [rad]."""
STAYS = 1.0
"""Time for which the deviation must have stayed below it at the end of the episode [s]."""


@wp.func
def formation_error(w: int, equilibrium: wp.array(dtype=float), robots: Robots) -> float:
    """max_i |wrap(phase_i - equilibrium_i - theta_0)| over robots that are there [rad], theta_0 by circular mean."""
    unit = wp.vec2(0.0, 0.0)
    n = robots.status.shape[1]
    for i in range(n):
        if robots.status[w, i] != REMOVED:
            offset = robots.phase[w, i] - equilibrium[i]
            unit += cos_sin(offset)
    turn = wp.atan2(unit[1], unit[0])
    error = float(0.0)
    for i in range(n):
        if robots.status[w, i] != REMOVED:
            error = wp.max(error, wp.abs(wrap(robots.phase[w, i] - equilibrium[i] - turn)))
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
        tally.returns[w, i] = 0.0
        step_out.terminated[w, i] = False
        step_out.truncated[w, i] = False
    tally.collisions[w] = 0
    tally.contact_steps[w] = 0
    tally.min_separation[w] = 1.0e30
    tally.covered[w] = 0
    tally.covered_each[w] = 0
    tally.covered_at[w] = NEVER
    tally.covered_each_at[w] = NEVER
    tally.lateral_sum[w] = 0.0
    tally.lateral_max[w] = 0.0
    tally.spacing_max[w] = 0.0
    tally.phase_error_max[w] = 0.0
    tally.off_at[w] = -1
    tally.fault_end[w] = -1


@wp.kernel
def keep_score(
    first: int, begin: int, curve: CurveStruct, formation: FormationStruct, steps: int, cells_total: int,
    equilibrium: wp.array(dtype=float), neighbours: wp.array2d(dtype=int), clock: Clock, robots: Robots,
    step_out: Step, tally: Tally,
):
    """Add the latest step to the score, and let the clock go on."""
    w = first + wp.tid()
    if begin == 1 and clock.fresh[w] == 0:
        return
    if begin == 0 and clock.stage[w] != RUNNING:
        clock.stage[w] = IDLE
        return
    now = clock.step[w] + 1 - begin
    n = robots.status.shape[1]
    there = int(0)
    running = int(0)
    stuck = int(0)
    fault_end = int(-1)
    lateral = float(0.0)
    spacing = float(0.0)
    for i in range(n):
        if not step_out.terminated[w, i]:
            running += 1
        status = robots.status[w, i]
        fault_end = wp.max(fault_end, robots.resumed_at[w, i])
        if status == STUCK:
            stuck += 1
        if status != REMOVED:
            there += 1
            error = lateral_error(curve, float(formation.alpha) * robots.phase[w, i], robots.position[w, i])
            lateral += error
            tally.lateral_max[w] = wp.max(tally.lateral_max[w], error)
            for side in range(2):
                j = neighbours[i, side]
                if j > i and robots.status[w, j] != REMOVED:
                    spacing = wp.max(spacing, wp.length(robots.position[w, i] - robots.position[w, j]))
    tally.fault_end[w] = wp.where(stuck == 0, fault_end, -1)
    tally.spacing_max[w] = wp.max(tally.spacing_max[w], spacing)
    if begin == 0:
        tally.lateral_sum[w] += lateral / float(wp.max(there, 1))
    deviation = formation_error(w, equilibrium, robots)
    tally.phase_error[w] = deviation
    tally.phase_error_max[w] = wp.max(tally.phase_error_max[w], deviation)
    if deviation >= RECOVERED:
        tally.off_at[w] = now
    if cells_total > 0:
        if tally.covered_at[w] == NEVER and tally.covered[w] == cells_total:
            tally.covered_at[w] = now
        if tally.covered_each_at[w] == NEVER and tally.covered_each[w] == n * cells_total:
            tally.covered_each_at[w] = now
    clock.step[w] = now
    clock.stage[w] = wp.where(now >= steps or running == 0, ENDED, RUNNING)


def score_rows(simulation: "Simulation", worlds: np.ndarray) -> list[dict[str, Any]]:
    """Score of the episode that each of some worlds is in, up to now: `COLUMNS` but `policy` and `episode`.

    A time that never came is NaN. A target that was not detected counts with the time it was there.
    """
    scenario, step = simulation.scenario, simulation.scenario.task.step
    clock, tally, cells = simulation.clock, simulation.tally, simulation.cells
    host = {name: getattr(tally, name).numpy() for name in Tally.vars if name != "contact"}
    now_of, seed_of = clock.step.numpy(), clock.seed.numpy()
    appears_at, found_at = simulation.rogues.appears_at.numpy(), simulation.rogues.found_at.numpy()
    sensed_at, idle_squares = cells.sensed_at.numpy(), cells.idle_squares.numpy()
    idle_max = cells.idle_max.numpy()
    rows = []
    for w in worlds:
        now = int(now_of[w])
        times = _detection_times(appears_at[w], found_at[w], now) * step
        found = found_at[w][appears_at[w] <= now] <= now
        bound = scenario.detection_time_bound
        open_gaps = now - sensed_at[w]
        has_grid, fault_end = scenario.task.grid is not None, int(host["fault_end"][w])
        squares = idle_squares[w].sum() + np.sum(open_gaps.astype(np.int64) ** 2)
        recovered = fault_end >= 0 and (now - host["off_at"][w]) * step >= STAYS
        rows.append({
            "scenario": scenario.name,
            "seed": int(seed_of[w]),
            "targets": len(times),
            "detected_fraction": found.mean() if len(times) else np.nan,
            "detection_time_mean": times.mean() if len(times) else np.nan,
            "detection_time_p95": np.percentile(times, 95) if len(times) else np.nan,
            "detection_time_max": times.max() if len(times) else np.nan,
            "detected_within_bound": (found & (times <= bound + 1e-9)).mean() if len(times) else np.nan,
            "collisions": int(host["collisions"][w]),
            "contact_time": host["contact_steps"][w] * step,
            "min_separation": host["min_separation"][w] if host["min_separation"][w] < 1e29 else np.nan,
            "coverage_time": _time_or_nan(host["covered_at"][w], step),
            "coverage_time_each": _time_or_nan(host["covered_each_at"][w], step),
            "idleness_mean": squares * step / (2 * max(now, 1) * open_gaps.size) if has_grid else np.nan,
            "idleness_max": max(idle_max[w].max(), open_gaps.max()) * step if has_grid else np.nan,
            "lateral_error_mean": host["lateral_sum"][w] / max(now, 1),
            "lateral_error_max": host["lateral_max"][w],
            "spacing_factor": host["spacing_max"][w] / (2 * scenario.detection_radius),
            "phase_error": host["phase_error_max"][w],
            "recovery_time": max(host["off_at"][w] + 1 - fault_end, 0) * step if recovered else np.nan,
            "return_mean": host["returns"][w].mean(),
        })  # fmt: skip
    return [{name: value if isinstance(value, (str, int)) else float(value) for name, value in r.items()} for r in rows]


def _detection_times(appears_at: np.ndarray, found_at: np.ndarray, now: int) -> np.ndarray:
    appeared = appears_at <= now
    return np.minimum(found_at[appeared], now) - appears_at[appeared]


def _time_or_nan(at: int, step: float) -> float:
    return np.nan if at == int(NEVER) else at * step
