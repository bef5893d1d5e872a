"""Ratios to bounds and to the best policy: hand calculations, laws of scale, and the statistics that they resemble."""

import math

import numpy as np
import pytest

import lissajous_env
from baselines.benchmark.bounds import Bounds
from baselines.benchmark.shown import in_words
from baselines.benchmark.statistics import (
    bootstrap_interval,
    interquartile_mean,
    largest_over_scenarios,
    over_scenarios,
    performance_profile,
    profile_over_scenarios,
)
from baselines.benchmark.table import with_derived
from baselines.benchmark.written import TAUS
from lissajous_env.world.columns import AT_END, COLUMNS, DETECTION_TIME, OPEN, WORST_CASE

BOUNDS = {"small": Bounds(0.5, 2.0, math.nan), "large": Bounds(5.0, math.nan, math.nan)}


def row(scenario, policy, seed, time, worst_case, is_open=0.0, at_end=0.5):
    numbers = {DETECTION_TIME.name: time, WORST_CASE.name: worst_case, OPEN.name: is_open, AT_END.name: at_end}
    return dict.fromkeys(COLUMNS, 1.0) | {"scenario": scenario, "policy": policy, "seed": seed} | numbers


def ratios(rows, bounds=BOUNDS):
    names = "detection_over_best", "worst_case_over_bound", "worst_case_over_best"
    scenarios = dict.fromkeys(BOUNDS, lissajous_env.scenario("evaders"))
    return [[row[name] for name in names] for row in with_derived(rows, scenarios, bounds)]


def test_ratios_by_hand():
    # Story: b is faster on seed 0, a on seed 1; only a's worst case is closed on seed 1.
    rows = [
        row("small", "a", 0, 3.0, 4.0),
        row("small", "b", 0, 2.0, 8.0),
        row("small", "a", 1, 1.0, 6.0),
        row("small", "b", 1, 4.0, 7.0, is_open=1.0),
        row("large", "a", 0, 10.0, 5.0, at_end=5.0),
        row("large", "b", 0, 10.0, 5.0),
    ]
    a, b, a1, b1, grown, other = ratios(rows)
    assert a == [1.5, 2.0, 1.0]
    assert b == [1.0, 4.0, 2.0]
    assert a1 == [1.0, 3.0, 1.0]
    assert b1 == [4.0, math.inf, math.inf]
    assert grown[0] == other[0] == 1.0
    assert np.isnan([grown[1], other[1]]).all()  # no lower bound
    assert grown[2] == 1.0  # still growing at the end, but not open
    assert other[2] == 1.0


def test_where_no_policy_guarantees_anything_there_is_no_ratio_to_the_best():
    rows = [row("small", name, 0, 1.0, 9.0, is_open=1.0) for name in "ab"]
    assert all(math.isnan(of[2]) and of[1] == math.inf for of in ratios(rows))


def test_a_best_time_of_zero_is_met_by_zero_alone():
    of = ratios([row("small", "a", 0, 0.0, 1.0), row("small", "b", 0, 0.1, 1.0)])
    assert [each[0] for each in of] == [1.0, math.inf]


def test_a_scenario_in_other_units_has_the_same_ratios():
    # Law: ratios of times do not depend on the unit of time.
    rng = np.random.default_rng(0)
    times = rng.uniform(1, 5, (3, 4, 2))
    plain = [row("small", f"p{k}", s, *times[k, s]) for k in range(3) for s in range(4)]
    slow = [row("small", f"p{k}", s, *(60 * times[k, s])) for k in range(3) for s in range(4)]
    scaled = {"small": Bounds(30.0, 120.0, math.nan)}
    assert np.allclose(ratios(plain), ratios(slow, scaled))
    assert np.min(ratios(plain), axis=0)[[0, 2]].tolist() == [1.0, 1.0]


def test_a_guarantee_over_scenarios_is_its_largest_ratio():
    # Oracle: by hand; the means of these would be 2, 2 and infinite.
    of = largest_over_scenarios([1.0, 3.0], [2.0, math.nan], [1.0, math.inf])
    assert in_words(of) == ("> 3", "median 3, 1 of 3 open")
    assert in_words(largest_over_scenarios([1.0, 3.0], [2.0], [2.0])) == ("3", "median 2 of 3")
    assert in_words(largest_over_scenarios([math.inf], [math.inf])) == ("no bound", "2 of 2 open")
    assert in_words(largest_over_scenarios([math.nan], [])) == ("\N{EM DASH}", "")


def test_the_aggregate_is_the_interquartile_mean_over_scenarios():
    # Oracle: the statistics of the project on the means of the scenarios, where all are finite.
    values = np.random.default_rng(1).uniform(1, 4, (12, 5))
    of = over_scenarios(*values)
    assert (of.n, of.n_finite) == (12, 12)
    assert of.iqm == pytest.approx(interquartile_mean(values.mean(axis=1)))
    assert (of.low, of.high) == pytest.approx(bootstrap_interval(values.mean(axis=1)), abs=0.02)
    assert of.low < of.iqm < of.high


def test_more_episodes_of_the_same_scenarios_do_not_narrow_the_interval():
    # Law: the scenarios are the sample, so that repeating their episodes adds nothing.
    values = np.random.default_rng(2).uniform(1, 4, (12, 5))
    once, often = over_scenarios(*values), over_scenarios(*np.tile(values, 10))
    assert (often.iqm, often.low, often.high) == pytest.approx((once.iqm, once.low, once.high))


def test_infinite_scenarios_do_not_count_as_none():
    of = over_scenarios([1.0], [1.0], [1.0], [1.0], [1.0], [1.0], [1.0], [math.inf])
    assert (of.iqm, of.n_finite) == (1.0, 8)  # one of eight is in no middle half
    assert over_scenarios([1.0], [1.0], [math.inf], [math.inf]).iqm == math.inf
    every = over_scenarios(*[[math.inf]] * 4)
    assert (every.iqm, every.low, every.high) == (math.inf, math.inf, math.inf)
    some = over_scenarios([1.0, math.nan], [2.0], [math.nan])
    assert (some.n, some.n_finite, some.iqm) == (3, 2, 1.5)
    assert over_scenarios([math.nan], []).n_finite == 0
    assert over_scenarios([3.0]).iqm == 3.0


def test_a_profile_of_one_episode_each_is_the_performance_profile():
    # Oracle: the profile of episodes, of which each scenario has one.
    values = np.append(np.random.default_rng(3).uniform(1, 6, 30), [np.inf, np.nan])
    found = np.array(profile_over_scenarios([[value] for value in values], TAUS)).T
    share, low, high = performance_profile([values], np.array(TAUS), resamples=2000)
    np.testing.assert_allclose(found[:, 0], share)
    np.testing.assert_allclose(found[:, 1:], np.stack([low, high], axis=1), atol=0.04)
    assert (np.diff(found[:, 0]) >= 0).all()


def test_each_scenario_counts_once_in_a_profile():
    assert profile_over_scenarios([[1.0], [9.0] * 99], [2.0])[0][0] == 0.5
    assert math.isnan(profile_over_scenarios([[math.nan]], [2.0])[0][0])
