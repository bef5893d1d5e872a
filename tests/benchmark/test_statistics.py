"""Estimates of scores against SciPy, cases worked by hand, and laws of largest values."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import bootstrap, trim_mean

from baselines.benchmark.statistics import (
    IMPROVEMENT,
    SHARE_OF_SEEDS,
    best_of,
    bootstrap_interval,
    in_words,
    interquartile_mean,
    number,
    summarize,
    summarize_largest,
)
from lissajous_env.world.columns import DETECTION_TIME, MEAN


@pytest.mark.parametrize("n", [1, 3, 4, 7, 33])
def test_interquartile_mean_is_scipys_trimmed_mean(n):
    values = np.random.default_rng(n).normal(size=n)
    assert interquartile_mean(values) == pytest.approx(trim_mean(values, 0.25), rel=1e-12)


@pytest.mark.parametrize(("cut", "statistic"), [(0.25, lambda x, axis: trim_mean(x, 0.25, axis)), (0.0, np.mean)])
def test_intervals_are_scipys(cut, statistic):
    values = np.random.default_rng(6).gamma(2, size=200)
    oracle = bootstrap((values,), statistic, n_resamples=20_000, method="percentile", rng=2).confidence_interval
    assert bootstrap_interval(values, cut) == pytest.approx(oracle, abs=0.05 * (oracle.high - oracle.low))


@pytest.mark.parametrize(("n", "share"), [(2, 0.5), (3, 0.75), (16, 0.94)])
def test_intervals_of_few_episodes_are_too_narrow(n, share):
    # Oracle: that of two or three numbers is their range, in which the middle of a symmetric distribution is.
    ends = np.array([bootstrap_interval(sample, 0.0) for sample in np.random.default_rng(n).normal(size=(1000, n))])
    assert (ends[:, 0] * ends[:, 1] < 0).mean() == pytest.approx(share, abs=0.04)


def test_an_estimate_counts_what_has_no_number_and_leaves_it_out():
    score = summarize([1.0, np.nan, 6.0, np.nan, 2.0, 3.0])
    assert (score.n, score.known, score.value, score.min, score.median, score.max) == (6, 4, 2.5, 1.0, 2.5, 6.0)
    assert summarize([1.0, 6.0, 2.0, 3.0], MEAN).value == 3.0
    one = summarize([4.0])
    assert one.value == one.min == one.max == 4.0
    assert np.isnan([one.low, one.high]).all()
    assert summarize([]).known == 0
    estimate = summarize([1, 0.5, 0, np.nan, 1, 0, 0.5], SHARE_OF_SEEDS)
    assert (estimate.n, estimate.known, estimate.value) == (7, 6, 0.5)
    assert in_words(estimate)[0] == "50 %"


def test_infinite_values_do_not_count_as_none():
    estimate = summarize([1.0] * 7 + [math.inf])
    assert (estimate.value, estimate.low, estimate.known) == (1.0, 1.0, 8)  # one of eight is in no middle half
    assert summarize([1.0, 1.0, math.inf, math.inf]).value == math.inf
    every = summarize([math.inf] * 4)
    assert (every.value, every.low, every.high) == (math.inf, math.inf, math.inf)


def test_numbers_and_the_best_in_words():
    # Oracle: by hand; (15 / 22) 22 is not 15 in float64.
    values = {99.97: "100", -99.97: "-100", 9.999: "10.0", 0.9996: "1.00", -4e-4: "0.000", -0.0: "0"}
    assert [number(value) for value in values] == [*values.values()]
    times = {"slow": [2.0] * 15, "fast": [1.0] * 15, "too": [1.0] * 15, "seldom": [1.0] * 14 + [math.nan]}
    policies = {name: {DETECTION_TIME.name: summarize([*t] + [math.nan] * 7)} for name, t in times.items()}
    assert best_of(policies, DETECTION_TIME) == {"fast", "too"}
    shares = {"a": [0.0, 0.0], "b": [1.0, 0.0], "c": [1.0, 0.5]}
    estimates = {name: {IMPROVEMENT.name: summarize(won, SHARE_OF_SEEDS)} for name, won in shares.items()}
    assert best_of(estimates, IMPROVEMENT) == {"c"}
    assert best_of({name: estimates[name] for name in "ab"}, IMPROVEMENT) == set()


def test_largest_values_in_words():
    # Oracle: by hand; an infinite value, or an open episode, shows no bound.
    assert in_words(summarize_largest([3.0, 2.0, math.inf])) == ("> 3", "median 3, 1 of 3 open")
    assert in_words(summarize_largest([3.0, 2.0, 2.0])) == ("3", "median 2, 3 episodes")
    assert in_words(summarize_largest([math.inf, math.inf])) == ("no bound", "2 of 2 open")
    assert in_words(summarize_largest([math.nan])) == ("\N{EM DASH}", "")
    times, is_open = [4.0] * 15 + [59.9], [False] * 15 + [True]
    assert in_words(summarize_largest(times, is_open)) == ("> 59.9", "median 4, 1 of 16 open")
    assert in_words(summarize_largest([4.0, 4.0, 4.0, 2.0], [False] * 3 + [True])) == ("> 4", "median 4, 1 of 4 open")
    assert in_words(summarize_largest([4.0, 5.0], growing=[False, True]))[0] == "> 5"
    assert in_words(summarize_largest([5.0, 5.0], growing=[False, True]))[0] == "5"


EPISODES = st.lists(st.tuples(st.floats(0.1, 60), st.booleans()), min_size=1, max_size=12)


@given(EPISODES, EPISODES, st.randoms())
def test_more_episodes_never_lower_a_guarantee_and_their_order_does_not_matter(episodes, more, random):
    # Law: the largest value, its lower bound and the number of open episodes grow with the episodes.
    def facts(played):
        summary = summarize_largest([time for time, _ in played], [is_open for _, is_open in played])
        return summary.value, summary.open, summary.at_least, summary.n

    mixed = [*episodes, *more]
    random.shuffle(mixed)
    assert all(less <= most for less, most in zip(facts(episodes), facts(mixed), strict=True))
    assert facts(mixed) == facts([*episodes, *more])
    assert facts(mixed)[0] == max(time for time, _ in mixed)
