"""The score of the reference world, from what it kept: plain NumPy over lists of targets, visits and deviations."""

import math

import numpy as np
from reference_motion import extents

RECOVERED = 0.05
"""Deviation from the equilibrium up to which a formation is in it, however little it swung before [rad]."""
SWING_MARGIN = 1.1
"""The same over the largest deviation before the first fault."""


def score_of(world) -> dict[str, float]:
    """Columns of the score up to now, but names and seed."""
    dt, now = world.dt, world.now
    there = [t for t in world.targets if t.appears_at <= now]
    times = [((now if t.found_at is None else t.found_at - t.found_early) - t.appears_at) * dt for t in there]
    bound = 2 * math.pi / world.scenario.formation.phase_rate / (world.n / world.scenario.clusters)
    in_bound = [
        time <= bound + 1e-9
        for t, time in zip(there, times, strict=True)
        if t.found_at is not None or time > bound + 1e-9
    ]
    gaps = [np.diff([*visits, now]) for visits in world.visits]
    places = max(world.n / world.scenario.clusters, 2)
    corner = math.hypot(*extents(world.scenario.curve))
    nan = math.nan
    return {
        "targets": len(there),
        "detected_fraction": np.mean([t.found_at is not None for t in there]) if there else nan,
        "detection_time_mean": np.mean(times) if there else nan,
        "detection_time_p95": np.percentile(times, 95) if there else nan,
        "detection_time_max": max(times) if there else nan,
        "detected_within_bound": np.mean(in_bound) if in_bound else nan,
        "collisions": world.collisions,
        "contact_time": world.contact_steps * dt,
        "min_separation": world.least_distance if math.isfinite(world.least_distance) else nan,
        "coverage_time": nan if world.covered_at is None else world.covered_at * dt,
        "coverage_time_each": nan if world.covered_each_at is None else world.covered_each_at * dt,
        # A cell's idleness grows from 0 in each gap, so it is on average the sum of half squares over the time.
        "idleness_mean": float(np.mean([(g**2).sum() / 2 / now * dt for g in gaps])) if gaps else nan,
        "idleness_max": max(g.max() for g in gaps) * dt if gaps else nan,
        "lateral_error_mean": world.lateral_sum / now,
        "lateral_error_max": world.lateral_max,
        "tracking_error_mean": world.tracking_sum / now,
        "tracking_error_max": world.tracking_max,
        "spacing_factor": world.spacing_max / (2 * math.sin(math.pi / places) * corner),
        "phase_error": max(world.deviations),
        "recovery_time": recovery_time(world),
        "outside_time": world.outside_steps * dt,
        "partly_outside_time": world.partly_outside_steps * dt,
        "wall_contacts": world.wall_contacts,
        "blocked_time": world.blocked_steps * dt,
        "return_mean": world.returns.mean(),
    }


def recovery_time(world) -> float:
    """Time from the end of the last fault until the formation is back in its swing before the first one [s]."""
    if world.resumed_at is None or any(world.stuck(i) for i in range(world.n)):
        return math.nan
    band = max(RECOVERED, SWING_MARGIN * max(world.deviations[: world.first_fault]))
    off = [k for k, deviation in enumerate(world.deviations) if k >= world.first_fault and deviation > band]
    if not off or (world.now - off[-1]) * world.dt < world.scenario.time_unit - 1e-9:
        return math.nan
    return max(off[-1] + 1 - world.resumed_at, 0) * world.dt
