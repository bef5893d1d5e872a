"""Statistics of times of which some are right-censored: the episode ended while they were still growing.

The estimate of Kaplan and Meier (E. L. Kaplan, P. Meier, "Nonparametric Estimation from Incomplete Observations", 1958)
gives each episode a weight: a censored episode passes its own on to the episodes with longer times. The interquartile
mean of the times with these weights is that of `baselines.benchmark.statistics` where nothing is censored.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from baselines.benchmark.statistics import CUT, RESAMPLES, Statistics, draws, summarize

_TAIL = 0.025
_DIGITS = 12
"""Decimals to which products of weights are exact."""


def summarize_censored(
    times: Sequence[float] | np.ndarray,
    censored: Sequence[bool] | np.ndarray,
    unbounded: Sequence[bool] | np.ndarray,
) -> Statistics:
    """Return statistics of times; a censored or unbounded time is at least this long.

    `iqm`, `low` and `high` are those of the censored estimate. If the upper end of the middle half of the episodes is
    not known, `at_least` is true and `iqm` is the interquartile mean of the observed times, a lower bound; if this is
    so in 2.5 % of the bootstrap resamples or more, `high` is infinite. The other statistics are of the times as they
    are.

    Args:
        times: Times, by episode; NaN for none.
        censored: True if the time would have become longer in a longer episode: as long as a longer time of another
            episode.
        unbounded: True if a time counts as one that never ends.
    """
    values, observed = np.asarray(times, dtype=float), summarize(times)
    known = np.isfinite(values)
    values, endless = values[known], np.asarray(unbounded, dtype=bool)[known]
    growing = np.asarray(censored, dtype=bool)[known] | endless
    if not growing.any():
        return observed
    (middle,), (reached,) = _middle_means(np.ones((1, len(values)), dtype=int), values, growing, endless)
    low = high = math.nan
    if len(values) > 1:
        means, sure = _middle_means(draws(len(values), RESAMPLES, 0), values, growing, endless)
        low = float(np.quantile(means, _TAIL))
        ceiling = np.where(sure, means, values.max())
        high = float(np.quantile(ceiling, 1 - _TAIL)) if np.mean(~sure) < _TAIL else math.inf
    return replace(observed, iqm=float(middle), low=low, high=high, at_least=not reached)


def _middle_means(
    counts: np.ndarray, values: np.ndarray, growing: np.ndarray, endless: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return (R,) interquartile means of resamples, and whether each is an estimate rather than a lower bound.

    Args:
        counts: (R, n) how often each episode was drawn.
        values: (n,) their times.
        growing: (n,) whether a time is censored or endless.
        endless: (n,) whether a time never ends.
    """
    cut = int(CUT * len(values)) / len(values)
    order = np.lexsort((growing, np.where(endless, np.inf, values)))  # of equal times the censored ones come last
    weights, beyond = _kaplan_meier(counts[:, order], growing[order])
    reached = np.round(beyond - cut, _DIGITS) <= 0
    estimate = _trimmed_mean(weights, values[order], cut)
    by_value = np.argsort(values)
    bound = _trimmed_mean(counts[:, by_value] / len(values), values[by_value], cut)
    return np.round(np.where(reached, estimate, bound), _DIGITS), reached


def _kaplan_meier(counts: np.ndarray, growing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (R, n) weights of times in rising order, and (R,) the weight that is left beyond the last of them."""
    at_risk = np.cumsum(counts[:, ::-1], axis=1)[:, ::-1]
    ending = np.where(growing, 0, counts) / np.maximum(at_risk, 1)
    survival = np.cumprod(1 - ending, axis=1)
    return -np.diff(survival, axis=1, prepend=1.0), survival[:, -1]


def _trimmed_mean(weights: np.ndarray, ordered: np.ndarray, cut: float) -> np.ndarray:
    """Return (R,) weighted means of values in rising order without the share `cut` of the weight at either end."""
    last = np.cumsum(weights, axis=1)
    inside = np.minimum(last, 1 - cut) - np.maximum(last - weights, cut)
    return np.maximum(inside, 0) @ ordered / (1 - 2 * cut)
