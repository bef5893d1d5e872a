"""Statistics of scores against SciPy, cases worked by hand, and the coverage that an interval promises."""

import numpy as np
import pytest
from scipy.stats import bootstrap, trim_mean

from baselines.benchmark.statistics import (
    bootstrap_interval,
    interquartile_mean,
    paired,
    summarize,
)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 7, 8, 16, 33, 100])
def test_interquartile_mean_is_scipys_trimmed_mean(n):
    values = np.random.default_rng(n).normal(size=n)
    assert interquartile_mean(values) == pytest.approx(trim_mean(values, 0.25), rel=1e-12)


def test_interval_of_strata_is_that_of_resampling_each_one():
    rng = np.random.default_rng(3)
    strata = [rng.normal(0, 1, 8), rng.normal(10, 1, 16)]
    drawn = [stratum[rng.integers(0, len(stratum), (20_000, len(stratum)))] for stratum in strata]
    oracle = np.quantile(trim_mean(np.hstack(drawn), 0.25, axis=1), [0.025, 0.975])
    assert bootstrap_interval(*strata, resamples=20_000) == pytest.approx(oracle, rel=0.02)


def test_summary_counts_what_has_no_number_and_leaves_it_out():
    of = summarize([1.0, np.nan, 3.0, np.nan, 2.0])
    assert (of.n, of.n_finite, of.mean, of.min, of.max, of.std) == (5, 3, 2.0, 1.0, 3.0, 1.0)
    assert of.iqm == 2.0


def test_one_value_has_no_interval():
    of = summarize([4.0])
    assert of.iqm == of.min == of.max == 4.0
    assert np.isnan([of.low, of.high, of.std]).all()


def test_interval_of_the_mean_is_scipys():
    values = np.random.default_rng(6).gamma(2, size=30)
    oracle = bootstrap((values,), np.mean, n_resamples=20_000, method="percentile", rng=np.random.default_rng(2))
    low, high = oracle.confidence_interval
    of = summarize(values)
    assert (of.mean_low, of.mean_high) == pytest.approx((low, high), abs=0.05 * (high - low))


def test_pairs_by_hand():
    of = paired([1.0, 2.0, 3.0, np.nan, 5.0], [2.0, 2.0, 1.0, 1.0, 9.0])
    assert (of.n, of.better) == (4, (1 + 0.5 + 0 + 1) / 4)
    assert of.difference == (-1 + 0) / 2  # of -4, -1, 0 and 2 the middle half
    assert paired([1.0, 2.0], [2.0, 3.0], better=1).better == 0
    assert paired([np.nan], [1.0]).n == 0
    never = paired([np.inf, 3.0, np.inf], [4.0, np.inf, np.inf])
    assert (never.n, never.better) == (3, 0.5)
    assert np.isnan(never.difference)
    with pytest.raises(ValueError, match="the same seeds to be compared, got 1 and 2"):
        paired([1.0], [1.0, 2.0])


def test_a_policy_against_itself_is_neither_better_nor_worse():
    values = np.random.default_rng(7).normal(size=16)
    of = paired(values, values)
    assert (of.better, of.better_low, of.better_high) == (0.5, 0.5, 0.5)
    assert (of.difference, of.difference_low, of.difference_high) == (0, 0, 0)


def test_seeds_in_common_cancel_in_pairs():
    # Oracle: the differences are of deviation 0.1, around -0.2; the seeds themselves are of 10, which hides it.
    rng = np.random.default_rng(8)
    seeds = rng.normal(50, 10, 64)
    ours, theirs = seeds - 0.2 + rng.normal(0, 0.1, 64), seeds
    of = paired(ours, theirs)
    assert of.difference_low < -0.2 < of.difference_high < -0.15
    assert of.better > 0.9
    alone, other = summarize(ours), summarize(theirs)
    assert alone.high > other.low  # the intervals of the two means say nothing
