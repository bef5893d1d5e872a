"""Ratios of times to a bound and to the best policy of the run, which compare scenarios of any size and speed.

The aggregate of a policy is the interquartile mean over the scenarios, each with the mean over its seeds, and its
interval comes from scenarios that are drawn again: the scenarios of a split are a sample of the space.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from baselines.benchmark import clairvoyant
from baselines.benchmark.bounds import Bounds
from baselines.benchmark.shown_columns import DETECTION_OVER_BEST, RATIOS, WORST_CASE_OVER_BEST, WORST_CASE_OVER_BOUND
from baselines.benchmark.statistics import CUT, RESAMPLES, Statistics, draws, summarize, summarize_largest
from lissajous_env.world.columns import AT_END, DETECTION_TIME, OPEN, WORST_CASE

TAUS = (1.0, 1.05, 1.1, 1.25, 1.5, 2.0, 3.0, 5.0, 10.0)
"""Ratios at which `profiles` are evaluated."""
Profiles = dict[str, dict[str, list[tuple[float, float, float]]]]
"""By policy and column, for each ratio of `TAUS`: the share of episodes that do not exceed it, and its interval."""
Rows = Sequence[Mapping[str, Any]]


def with_ratios(rows: Rows, bounds: Mapping[str, Bounds]) -> list[dict[str, Any]]:
    """Return rows with the columns `RATIOS`.

    The worst-case undetected time of an open episode is infinite. The best policy is the best on the same scenario and
    seed, the clairvoyant excepted; where no policy has a finite time, there is no ratio.
    """
    best: dict[tuple[str, int], list[float]] = {}
    for row in rows:
        if row["policy"] != clairvoyant.NAME:
            times = best.setdefault((row["scenario"], row["seed"]), [math.inf, math.inf])
            for k, time in enumerate(_times(row)):
                times[k] = min(times[k], time) if time == time else times[k]
    told = []
    for row in rows:
        time, worst_case = _times(row)
        best_time, best_worst_case = best.get((row["scenario"], row["seed"]), (math.nan, math.nan))
        told.append(
            dict(row)
            | {
                DETECTION_OVER_BEST.name: _ratio(time, best_time),
                WORST_CASE_OVER_BOUND.name: _ratio(worst_case, bounds[row["scenario"]].worst_case),
                WORST_CASE_OVER_BEST.name: _ratio(worst_case, best_worst_case),
            }
        )
    return told


def growing(row: Mapping[str, Any]) -> bool:
    """Return whether the worst-case undetected time of an episode was still growing at its end."""
    return row[OPEN.name] == 1 or 0 < row[WORST_CASE.name] == row[AT_END.name]


def _times(row: Mapping[str, Any]) -> tuple[float, float]:
    return row[DETECTION_TIME.name], math.inf if row[OPEN.name] == 1 else row[WORST_CASE.name]


def _ratio(time: float, least: float) -> float:
    if math.isnan(time) or not math.isfinite(least):
        return math.nan
    return time / least if least > 0 else 1.0 if time == 0 else math.inf


def over_scenarios(*scenarios: Sequence[float] | np.ndarray) -> Statistics:
    """Return statistics of the means over the seeds of each scenario; `n` and `n_finite` count scenarios.

    An infinite ratio makes the mean of its scenario infinite. NaN is left out, and counts as no number. The other
    statistics than `iqm` and its interval are those of the finite means.
    """
    values = np.array([mean for mean in map(_mean, scenarios) if not math.isnan(mean)])
    found = replace(summarize(values), n=len(scenarios), n_finite=len(values))
    if len(values) < 2:
        return replace(found, iqm=float(values[0])) if len(values) else found
    again = np.repeat(np.tile(values, RESAMPLES), draws(len(values), RESAMPLES, 0).ravel()).reshape(RESAMPLES, -1)
    # Of two infinite ends there is no point in between, so an end is one of the resamples.
    low, high = np.quantile(_middle(again), [0.025, 0.975], method="inverted_cdf")
    return replace(found, iqm=float(_middle(values[None])[0]), low=float(low), high=float(high))


def largest_over_scenarios(*scenarios: Sequence[float] | np.ndarray) -> Statistics:
    """Return statistics of the largest ratio of each scenario; `n`, `n_finite` and `open` count scenarios."""
    return summarize_largest([max((ratio for ratio in of if ratio == ratio), default=math.nan) for of in scenarios])


def _mean(values: Sequence[float] | np.ndarray) -> float:
    known = np.asarray(values, dtype=float)
    known = known[~np.isnan(known)]
    return float(known.mean()) if len(known) else math.nan


def _middle(values: np.ndarray) -> np.ndarray:
    """Return the interquartile means of the rows (R, n), infinite where the middle half is."""
    cut = int(CUT * values.shape[1])
    return np.sort(values, axis=1)[:, cut : values.shape[1] - cut].mean(axis=1)


def profiles(played: Mapping[str, Mapping[str, Rows]]) -> Profiles:
    """Return the performance profiles of `RATIOS`: mean over scenarios of the share of its episodes.

    Args:
        played: Rows with the ratios, by policy and scenario.
    """
    return {
        policy: {
            column.name: profile([[row.get(column.name, math.nan) for row in rows] for rows in by.values()], TAUS)
            for column in RATIOS
        }
        for policy, by in played.items()
    }


def profile(
    scenarios: Sequence[Sequence[float] | np.ndarray], at: Sequence[float] | np.ndarray
) -> list[tuple[float, float, float]]:
    """Return, for each of some ratios, the share of episodes that do not exceed it, and its 95 % bootstrap interval.

    Each scenario counts once, and scenarios are drawn again. An infinite ratio exceeds every other; NaN is left out.
    """
    known = [np.asarray(of, dtype=float) for of in scenarios]
    known = [of[~np.isnan(of)] for of in known]
    shares = np.array([(of[:, None] <= np.asarray(at)[None]).mean(axis=0) for of in known if len(of)])
    if not len(shares):
        return [(math.nan, math.nan, math.nan) for _ in at]
    again = draws(len(shares), RESAMPLES, 0) @ shares / len(shares)
    low, high = np.quantile(again, [0.025, 0.975], axis=0)
    return list(zip(shares.mean(axis=0).tolist(), low.tolist(), high.tolist(), strict=True))
