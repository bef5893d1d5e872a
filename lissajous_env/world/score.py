"""The score: what was tallied on the device, made into one row of named columns at the end of an episode."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from lissajous_env.parameters.extensions import ScoreColumn
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.coverage import last_sensed
from lissajous_env.world.state import NEVER, REMOVED, Tally

MEANINGS = {
    "scenario": "name of the scenario",
    "policy": "name of the policy",
    "episode": "number of the episode, from 0",
    "seed": "seed of the world",
    "targets": "targets that appeared",
    "detected_fraction": "share of the targets that were detected",
    "detection_time_mean": "from a target's appearance until it is first inside a working robot's disc, between "
    "control steps too; one that is never detected counts with the time it was there [s]",
    "detection_time_p95": "95th percentile of the same [s]",
    "detection_time_max": "the longest [s]",
    "detected_within_bound": "share detected within T_max = (2 pi / omega) / (N / kappa), which is a bound only where "
    "r_s meets (8); who was there for less and was not found is left out",
    "collisions": "pairs that came closer than the sum of their radii, by the closest approach between sub-steps; "
    "a pair counts once until it parts by 5 % more; points that share a place of the formation (kappa > 1) overlap by "
    "design and are no pair",
    "contact_time": "time in contact, summed over the same pairs [s]",
    "min_separation": "smallest distance of two robots of such a pair [m]",
    "coverage_time": "until every cell was sensed by some robot [s]",
    "coverage_time_each": "until every cell was sensed by every robot [s]",
    "idleness_mean": "time since a cell was last sensed, mean over cells and time [s]",
    "idleness_max": "the longest [s]",
    "lateral_error_mean": "distance of a robot from the curve, wherever it is nearest, mean [m]",
    "lateral_error_max": "the largest [m]",
    "tracking_error_mean": "distance of a robot from the point of the curve at its own phase, mean [m]",
    "tracking_error_max": "the largest [m]",
    "spacing_factor": "largest distance of ring neighbours over 2 r_s of (8): the paper's eta_1",
    "phase_error": "largest deviation from the equilibrium (2), the common rotation removed [rad]",
    "recovery_time": "from the end of the last fault until the phase error stays, for 0.3 rad / omega at least, "
    "within 1.1 times its largest before the first one (at least 0.05 rad); empty where it never does, and where no "
    "fault had the formation off [s]",
    "outside_time": "robot-seconds that bodies were wholly outside the rectangle [s]",
    "distance_mean": "way of a robot, mean over the robots [m]",
    "speed_max": "the fastest that any robot was [m/s]",
    "smoothness": "mean square of the change of the action from step to step; 0 is steady",
    "sensed_fraction": "share of the cells that some robot has ever sensed",
    "guaranteed_detection_time": "longest time for which any rogue can have gone unseen, whatever it did [s]",
    "unseen_at_end": "the same at the end of the episode; where the two are equal the longest time was still growing "
    "there, so that it is a lower bound (right-censored) [s]",
    "guarantee_open": "1 where the episode shows no bound of that time: it was still growing at the end and is at "
    "least half of the episode, or no robot is left; otherwise 0",
    "contaminated_age_mean": "since when a rogue may be unseen in a cell, 0 where it is cleared, mean over cells "
    "and time [s]",
    "guarantee_recovery_time": "from the end of the last fault until that time stays below 1.1 times its largest "
    "before the first [s]",
    "return_mean": "sum of the rewards, mean over the robots",
}
"""What each column of a score row is, with its unit in brackets; a time that never came is NaN, in files empty."""

COLUMNS = tuple(MEANINGS)


def brought_columns(scenario: Scenario) -> tuple[str, ...]:
    """Names of the columns that a scenario's extensions bring; they stand after `COLUMNS`."""
    return tuple(each.name for each in scenario.extensions if isinstance(each, ScoreColumn))


def is_open(longest: float, at_end: float, elapsed: float, deserted: bool = False) -> bool:
    """Return whether an episode shows no bound of how long a rogue can go unseen.

    Some rogue that can be unseen at the end has then been so for longer than any before it, and for at least half of
    the episode. To show a bound, an episode must be longer than twice that bound: where no rogue can ever go unseen for
    longer than B, no episode longer than 2 B is open. Where one is never detected, and from t1 on none has been there
    for longer, every episode of 2 t1 or longer is open; while it stays undetected, an open episode stays open.

    Args:
        longest: `guaranteed_detection_time`, in any unit of time.
        at_end: `unseen_at_end`, in the same.
        elapsed: duration of the episode up to its end, in the same.
        deserted: whether no robot is left to detect anything.
    """
    return deserted or (0 < longest == at_end and 2 * at_end >= elapsed)


def score_rows(
    scenario: Scenario,
    clock: Any,
    robots: Any,
    targets: Any,
    cells: Any,
    contamination: Any,
    tally: Any,
    brought: Mapping[str, np.ndarray],
    worlds: np.ndarray,
) -> list[dict[str, Any]]:
    """Score of the episode that each of some worlds is in, up to now: its columns but `policy` and `episode`.

    A time that never came is NaN. A target that was not detected counts with the time it was there; of the share
    detected within T_max it is no part while that is below T_max. `recovery_time` is from the end of the last fault
    until the formation is off no more, as `lissajous_env.world.tally.tally_formation` says. It is NaN where the
    formation is not back for `Scenario.time_unit` at the end, and where no fault ever had it off, as there is nothing
    to recover from; `phase_error` tells the two apart. `brought` holds the values (W,) of the columns that extensions
    bring, by name; the others are the structs of the state.
    """
    step = scenario.task.step
    stays = math.ceil(scenario.time_unit / step - 1e-9)
    host = {name: getattr(tally, name).numpy() for name in Tally.vars if name != "contact"}
    now_of, seed_of = clock.step.numpy(), clock.seed.numpy()
    appears_at, found_at, found_early = (
        each.numpy() for each in (targets.appears_at, targets.found_at, targets.found_early)
    )
    sensed_at, in_discs, idle_squares, idle_max = (
        each.numpy() for each in (cells.sensed_at, cells.in_discs, cells.idle_squares, cells.idle_max)
    )
    unseen = {name: getattr(contamination, name).numpy() for name in ("age", "age_max", "mean_age_sum", "high_at")}
    lost = (robots.status.numpy() == int(REMOVED)).all(axis=1)
    follows = scenario.task.contamination is not None
    rows = []
    for w in worlds:
        now = int(now_of[w])
        times, found = detection_times(appears_at[w], found_at[w], found_early[w], now)
        times *= step
        within = times <= scenario.detection_time_bound * (1 + 1e-9)
        known = found | ~within
        open_gaps = now - last_sensed(sensed_at[w], in_discs[w], now)
        has_grid, fault_end = scenario.task.grid is not None, int(host["fault_end"][w])
        squares = idle_squares[w].sum(dtype=float) + np.sum(open_gaps.astype(float) ** 2)
        off_at, high_at = int(host["off_at"][w]), int(unseen["high_at"][w])
        recovered = fault_end >= 0 and off_at >= 0 and now - off_at >= stays
        longest, at_end = int(unseen["age_max"][w]), int(unseen["age"][w])
        deserted = bool(lost[w]) and (at_end > 0 or scenario.targets.arrival_rate > 0)
        regained = follows and fault_end >= 0 and high_at >= 0 and now - high_at >= stays
        rows.append({
            "scenario": scenario.name,
            "seed": int(seed_of[w]),
            "targets": len(times),
            "detected_fraction": found.mean() if len(times) else np.nan,
            "detection_time_mean": times.mean() if len(times) else np.nan,
            "detection_time_p95": np.percentile(times, 95) if len(times) else np.nan,
            "detection_time_max": times.max() if len(times) else np.nan,
            "detected_within_bound": (found & within)[known].mean() if known.any() else np.nan,
            "collisions": int(host["collisions"][w]),
            "contact_time": host["contact_steps"][w] * step,
            "min_separation": host["min_separation"][w] if host["min_separation"][w] < 1e29 else np.nan,
            "coverage_time": _time_or_nan(host["covered_at"][w], step),
            "coverage_time_each": _time_or_nan(host["covered_each_at"][w], step),
            "idleness_mean": squares * step / (2 * max(now, 1) * open_gaps.size) if has_grid else np.nan,
            "idleness_max": max(idle_max[w].max(), open_gaps.max()) * step if has_grid else np.nan,
            "lateral_error_mean": host["lateral_sum"][w] / max(now, 1),
            "lateral_error_max": host["lateral_max"][w],
            "tracking_error_mean": host["tracking_sum"][w] / max(now, 1),
            "tracking_error_max": host["tracking_max"][w],
            "spacing_factor": host["spacing_max"][w] / (2 * scenario.detection_radius),
            "phase_error": host["phase_error_max"][w],
            "recovery_time": max(off_at + 1 - fault_end, 0) * step if recovered else np.nan,
            "outside_time": host["outside_steps"][w] * step,
            "distance_mean": host["distance_sum"][w] / scenario.num_robots,
            "speed_max": host["speed_max"][w],
            "smoothness": host["change_sum"][w] / (now - 1) if now > 1 else np.nan,
            "sensed_fraction": host["covered"][w] / open_gaps.size if has_grid else np.nan,
            "guaranteed_detection_time": longest * step if follows else np.nan,
            "unseen_at_end": at_end * step if follows else np.nan,
            "guarantee_open": float(is_open(longest, at_end, now, deserted)) if follows else np.nan,
            "contaminated_age_mean": unseen["mean_age_sum"][w] / max(now, 1) * step if follows else np.nan,
            "guarantee_recovery_time": max(high_at + 1 - fault_end, 0) * step if regained else np.nan,
            "return_mean": host["returns"][w].mean(),
            **{name: values[w] for name, values in brought.items()},
        })  # fmt: skip
    return [{name: _plain(value) for name, value in row.items()} for row in rows]


def _plain(value: Any) -> Any:
    """Plain number, without the last digits that steps times 0.1 s leave, as in 4.6000000000000005."""
    return value if isinstance(value, (str, int)) else round(float(value), 12)


def detection_times(
    appears_at: np.ndarray, found_at: np.ndarray, found_early: np.ndarray, now: int
) -> tuple[np.ndarray, np.ndarray]:
    """Of each target that has appeared: time until it was detected, or until now [steps], and whether it was.

    One that was not is censored: all that is known is that its time is longer.
    """
    there = appears_at <= now
    detected = found_at[there] - found_early[there].astype(float)
    return np.minimum(detected, now) - appears_at[there], found_at[there] <= now


def _time_or_nan(at: int, step: float) -> float:
    return np.nan if at == int(NEVER) else at * step
