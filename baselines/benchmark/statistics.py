"""Estimates of scores: interquartile means with bootstrap intervals, largest values, comparisons seed by seed.

R. Agarwal, M. Schwarzer, P. S. Castro, A. Courville, M. G. Bellemare, "Deep Reinforcement Learning at the Edge of the
Statistical Precipice" (NeurIPS 2021) gives the reasons: the mean follows outliers, the median wastes half of the runs.

Where two policies played the same seeds, they are compared seed by seed: what a seed is worth, as easy or hard as it
is, then cancels.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from lissajous_env.world.columns import INTERQUARTILE_MEAN, LARGEST, MEAN

RESAMPLES = 2000
"""Bootstrap resamples: the ends of the interval then vary by about 2 % of its width from seed to seed."""
CUT = 0.25
"""Share of the values that an interquartile mean leaves out at either end."""


@dataclass(frozen=True)
class Estimate:
    """Estimate of a score from episodes, with its interval; a number that does not exist is NaN."""

    n: int
    """Episodes."""
    n_finite: int
    """Episodes in which there was a number; the others count in `n` alone."""
    iqm: float
    """Interquartile mean."""
    low: float
    """Lower end of the 95 % bootstrap interval of `iqm`."""
    high: float
    """Upper end of the same."""
    mean: float
    mean_low: float
    """Lower end of the 95 % bootstrap interval of `mean`."""
    mean_high: float
    """Upper end of the same."""
    std: float
    """Standard deviation between episodes, with n - 1 in the denominator."""
    min: float
    median: float
    """Median; of largest values it counts open episodes as infinite."""
    max: float
    summary: str = field(default=INTERQUARTILE_MEAN, kw_only=True)
    """Summary of the column (`Column.summary`), which selects `value`."""
    open: int = field(default=0, kw_only=True)
    """Episodes that show no bound."""
    at_least: bool = field(default=False, kw_only=True)
    """True if `max` is a lower bound of the largest value."""
    worst: int | None = field(default=None, kw_only=True)
    """Seed of the worst episode; None where it is unknown, or no value is better than another."""

    @property
    def value(self) -> float:
        """Return the number that stands for the episodes."""
        return {MEAN: self.mean, LARGEST: self.max}.get(self.summary, self.iqm)

    @property
    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval of `value`; NaN for a largest value, which has none."""
        if self.summary == LARGEST:
            return np.nan, np.nan
        return (self.mean_low, self.mean_high) if self.summary == MEAN else (self.low, self.high)


@dataclass(frozen=True)
class Paired:
    """Comparison of a policy with a reference on the same seeds; a number that does not exist is NaN."""

    n: int
    """Seeds on which both have a number."""
    better: float
    """Probability of improvement: the share of these seeds on which the policy is better, ties counted half."""
    better_low: float
    """Lower end of the 95 % bootstrap interval of `better`, over seeds."""
    better_high: float
    """Upper end of the same."""
    difference: float
    """Interquartile mean of the differences, the policy's number less the reference's, where both are finite; of a
    guarantee, the difference of the two largest numbers."""
    difference_low: float
    """Lower end of the 95 % bootstrap interval of `difference`, over seeds."""
    difference_high: float
    """Upper end of the same."""


def interquartile_mean(values: Sequence[float] | np.ndarray) -> float:
    """Return the mean of the middle half: int(n / 4) of n sorted values are cut off at each end; NaN for no values."""
    ordered = np.sort(np.asarray(values, dtype=float))
    cut = int(CUT * len(ordered))
    return float(ordered[cut : len(ordered) - cut].mean()) if len(ordered) else np.nan


def bootstrap_interval(
    *strata: Sequence[float] | np.ndarray,
    confidence: float = 0.95,
    resamples: int = RESAMPLES,
    seed: int = 0,
    cut: float = CUT,
) -> tuple[float, float]:
    """Return the percentile bootstrap interval of the interquartile mean of all values together.

    Episodes are drawn again within each stratum (a scenario), so that each keeps its share. NaN below two values.
    `cut` is the share that is left out at either end: with 0 the interval is that of the mean.
    """
    samples = [np.asarray(stratum, dtype=float) for stratum in strata if len(stratum)]
    pooled = np.concatenate(samples) if samples else np.empty(0)
    n = len(pooled)
    if n < 2:
        return np.nan, np.nan
    # A resample of sorted values is how often each one was drawn, so no resample is ever sorted: the middle half of
    # it is from draw `cut` to draw n - cut, and a value counts as often as its draws lie in there.
    drawn = np.hstack([draws(len(sample), resamples, seed + k) for k, sample in enumerate(samples)])
    outside = int(cut * n)
    if not outside:
        return middle_of(drawn @ pooled / n, confidence)
    order = np.argsort(pooled, kind="stable")
    drawn = drawn[:, order]
    last = np.cumsum(drawn, axis=1, dtype=drawn.dtype)
    counted = np.minimum(last, n - outside) - np.maximum(last - drawn, outside)
    means = np.maximum(counted, 0) @ pooled[order] / (n - 2 * outside)
    return middle_of(means, confidence)


def paired(policy: Sequence[float] | np.ndarray, reference: Sequence[float] | np.ndarray, better: int = -1) -> Paired:
    """Compare two policies on the same seeds.

    Args:
        policy: Its numbers, by seed.
        reference: Numbers of the other policy, in the same order of seeds.
        better: 1 where more is better, -1 where less is.

    An infinite number is compared, and left out of the differences; NaN is left out of both.

    Raises:
        ValueError: other numbers of seeds.
    """
    own, other = np.asarray(policy, dtype=float), np.asarray(reference, dtype=float)
    if own.shape != other.shape:
        raise ValueError(f"policies must have the same seeds to be compared, got {len(own)} and {len(other)}")
    both = ~(np.isnan(own) | np.isnan(other))
    own, other = better * own[both], better * other[both]
    if not len(own):
        return Paired(0, *[np.nan] * 6)
    won = (own > other) + (own == other) / 2
    finite = np.isfinite(own) & np.isfinite(other)
    differences = better * (own[finite] - other[finite])
    shares = bootstrap_interval(won, cut=0.0)
    middle = interquartile_mean(differences)
    return Paired(len(won), float(won.mean()), *shares, middle, *bootstrap_interval(differences))


Band = tuple[np.ndarray, np.ndarray, np.ndarray]
"""A share at each of some values, and the ends of its 95 % bootstrap interval."""


def performance_profile(
    strata: Sequence[np.ndarray], values: np.ndarray, better: int = -1, resamples: int = 500
) -> Band:
    """Share of the episodes of all strata that are at least as good as each of some values; stratified bootstrap.

    With `better` -1 that is P(score <= value), with 1 it is P(score >= value). An infinite score is the worst; NaN is
    left out.
    """
    known = [better * stratum[~np.isnan(stratum)] for stratum in strata]
    reached = np.concatenate(known)[:, None] >= better * np.asarray(values)[None]
    drawn = np.hstack([draws(len(sample), resamples, k) for k, sample in enumerate(known) if len(sample)])
    shares = drawn @ reached / len(reached)
    low, high = np.quantile(shares, [0.025, 0.975], axis=0)
    return reached.mean(axis=0), low, high


def middle_of(values: np.ndarray, confidence: float = 0.95) -> tuple[float, float]:
    """Return the ends of the middle share of some values."""
    tail = (1 - confidence) / 2
    low, high = np.quantile(values, [tail, 1 - tail])
    return float(low), float(high)


def summarize(*strata: Sequence[float] | np.ndarray, summary: str = INTERQUARTILE_MEAN) -> Estimate:
    """Return the estimate of one score from the episodes of one scenario or, stratified, of several."""
    samples = [np.asarray(stratum, dtype=float) for stratum in strata]
    finite = [sample[np.isfinite(sample)] for sample in samples]
    values = np.concatenate(finite) if finite else np.empty(0)
    n = sum(len(sample) for sample in samples)
    if not len(values):
        return Estimate(n, 0, *[np.nan] * 10, summary=summary)
    means = bootstrap_interval(*finite, cut=0.0)
    return Estimate(
        n,
        len(values),
        interquartile_mean(values),
        *bootstrap_interval(*finite),
        mean=float(values.mean()),
        mean_low=means[0],
        mean_high=means[1],
        std=float(values.std(ddof=1)) if len(values) > 1 else np.nan,
        min=float(values.min()),
        median=float(np.median(values)),
        max=float(values.max()),
        summary=summary,
    )


def summarize_largest(
    values: Sequence[float] | np.ndarray,
    without_bound: Sequence[bool] | np.ndarray | bool = False,
    growing: Sequence[bool] | np.ndarray | bool = False,
) -> Estimate:
    """Return the estimate of a worst case, for which the largest one stands.

    Args:
        values: Worst cases, by episode; NaN for none, infinite for one without a bound.
        without_bound: True for an episode that shows no bound of its worst case.
        growing: True for an episode at whose end the worst case was still growing; if all episodes with the largest
            value are of this kind, it is a lower bound as well.
    """
    worst = np.asarray(values, dtype=float)
    known = ~np.isnan(worst)
    is_open, last = (np.broadcast_to(each, worst.shape)[known] for each in (without_bound, growing))
    worst = worst[known]
    is_open = is_open | np.isinf(worst)
    of = summarize(worst, summary=LARGEST)
    return replace(
        of,
        n=len(known),
        n_finite=len(worst),
        median=float(np.median(np.where(is_open, np.inf, worst))) if len(worst) else np.nan,
        open=int(is_open.sum()),
        at_least=bool(len(worst)) and bool(is_open.any() or last[worst == of.max].all()),
    )


def over_scenarios(*scenarios: Sequence[float] | np.ndarray) -> Estimate:
    """Return the estimate from the means over the seeds of each scenario; `n` and `n_finite` count scenarios.

    The scenarios are the sample, which is drawn again: those of a split are a sample of the space. An infinite ratio
    makes the mean of its scenario infinite. NaN is left out, and counts as no number. The other numbers than `iqm` and
    its interval are those of the finite means.
    """
    known = [values[~np.isnan(values)] for values in (np.asarray(each, dtype=float) for each in scenarios)]
    means = np.array([values.mean() for values in known if len(values)])
    of = replace(summarize(means), n=len(scenarios), n_finite=len(means))
    if len(means) < 2:
        return replace(of, iqm=float(means[0])) if len(means) else of
    again = np.repeat(np.tile(means, RESAMPLES), draws(len(means), RESAMPLES, 0).ravel()).reshape(RESAMPLES, -1)
    # Of two infinite ends there is no point in between, so an end is one of the resamples.
    low, high = np.quantile(_middle_half(again), [0.025, 0.975], method="inverted_cdf")
    return replace(of, iqm=float(_middle_half(means[None])[0]), low=float(low), high=float(high))


def _middle_half(values: np.ndarray) -> np.ndarray:
    """Return the interquartile means of the rows (R, n), infinite where the middle half is."""
    cut = int(CUT * values.shape[1])
    return np.sort(values, axis=1)[:, cut : values.shape[1] - cut].mean(axis=1)


def largest_over_scenarios(*scenarios: Sequence[float] | np.ndarray) -> Estimate:
    """Return the estimate of the largest ratio of all scenarios; `n`, `n_finite` and `open` count scenarios."""
    return summarize_largest([max((ratio for ratio in of if ratio == ratio), default=np.nan) for of in scenarios])


def profile_over_scenarios(scenarios: Sequence[Sequence[float] | np.ndarray], at: Sequence[float] | np.ndarray) -> Band:
    """Return, for each of some ratios, the share of episodes that do not exceed it, and its 95 % bootstrap interval.

    Each scenario counts once, and scenarios are drawn again. An infinite ratio exceeds every other; NaN is left out.
    """
    known = [values[~np.isnan(values)] for values in (np.asarray(each, dtype=float) for each in scenarios)]
    shares = np.array([(of[:, None] <= np.asarray(at)[None]).mean(axis=0) for of in known if len(of)])
    if not len(shares):
        nothing = np.full(len(at), np.nan)
        return nothing, nothing, nothing
    low, high = np.quantile(draws(len(shares), RESAMPLES, 0) @ shares / len(shares), [0.025, 0.975], axis=0)
    return shares.mean(axis=0), low, high


def share_detected(found: Sequence[float] | np.ndarray, unfound: Sequence[float] | np.ndarray) -> tuple[Any, Any]:
    """Return times [s] in rising order, and the estimate of the share of the targets that is detected within each.

    The time of a target that was not detected is censored: it is at least as long as the target was present. The
    estimate is that of E. L. Kaplan, P. Meier, "Nonparametric Estimation from Incomplete Observations" (1958).

    Args:
        found: times until the detection [s].
        unfound: times for which the other targets were present [s].
    """
    from scipy import stats  # its import takes longer than that of this project

    times = np.concatenate([found, unfound]).astype(float)
    if not times.size:
        return times, times
    censored = np.arange(len(times)) >= len(found)
    curve = stats.ecdf(stats.CensoredData.right_censored(times, censored)).cdf
    return curve.quantiles, curve.probabilities


@lru_cache(maxsize=16)
def draws(size: int, resamples: int, seed: int) -> np.ndarray:
    """Return (resamples, size) how often each of `size` values is drawn, with replacement."""
    generator = np.random.default_rng([seed, size])
    return generator.multinomial(size, np.full(size, 1 / size), size=resamples).astype(np.int32)
