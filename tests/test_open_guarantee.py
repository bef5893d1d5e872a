"""Episodes without a bound of the worst-case undetected time, and tables of censored episodes."""

import dataclasses
import math
import os
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from rich.text import Text
from scipy import stats

import baselines
import lissajous_env
from baselines.benchmark import failures, tables
from baselines.benchmark.censoring import summarize_censored
from baselines.benchmark.comparison import compare
from baselines.benchmark.shown_columns import SHOWN
from baselines.benchmark.statistics import summarize
from lissajous_env.world.columns import COLUMNS, OPEN
from lissajous_env.world.score import is_open
from lissajous_env.world.simulation import Simulation

EVADERS = {"evaders": lissajous_env.scenario("evaders")}
# Longest time unseen [s] and the same at the end, in 16 episodes of 60 s of `kuramoto-mpcc-safe` on `evaders`.
ENDED_AT_ITS_WORST = [
    (11.7, 4.4), (10.3, 2.8), (13.8, 2.2), (5.1, 3.8), (19.5, 4.6), (17.3, 13.5), (4.7, 4.7), (9.3, 3.7),
    (4.7, 3.1), (12.5, 3.0), (16.9, 3.3), (10.7, 4.4), (7.5, 3.7), (12.0, 3.3), (4.4, 3.2), (15.7, 4.9),
]  # fmt: skip
LEAPS = st.lists(st.tuples(st.integers(1, 30), st.integers(0, 60)), min_size=1, max_size=12)


def rows(times, policy="a", open_at=()):
    """Score rows of episodes of which are known: the longest time, and that at the end."""
    for seed, (longest, at_end) in enumerate(times):
        numbers = dict.fromkeys(COLUMNS, 1.0) | {"collisions": 0, OPEN.name: float(seed in open_at)}
        numbers |= {"guaranteed_detection_time": longest, "unseen_at_end": at_end}
        yield {"scenario": "evaders", "policy": policy, "episode": seed, "seed": seed} | numbers


def cells(*played):
    return compare([row for each in played for row in each], EVADERS).cells["evaders"]


def words_of(of):
    (shown,) = [each for each in SHOWN if each.name == "guaranteed_detection_time"]
    return tables.in_words(of, shown)


def ages(leaps):
    """Return the possible undetected time of a rogue, step by step: it grows by 1, and falls when the oldest is
    detected."""
    found = [0]
    for steps, fall in leaps:
        found += [found[-1] + k + 1 for k in range(steps)]
        found.append(max(found[-1] + 1 - fall, 0))
    return np.array(found)


def open_at_each_step(found):
    return [is_open(found[: k + 1].max(), found[k], k) for k in range(len(found))]


# What an episode shows.


@given(LEAPS, st.integers(0, 40))
def test_where_a_bound_holds_no_episode_of_twice_that_time_is_open(leaps, more):
    # Law: B bounds all ages of an episode that is longer than 2 B.
    found = ages(leaps)
    bound = found.max()
    padded = np.append(found, np.zeros(max(2 * bound + 1 - len(found), 0) + more, dtype=int))
    assert not any(open_at_each_step(padded)[2 * bound + 1 :])


@given(LEAPS, st.integers(1, 100), st.data())
def test_a_rogue_that_is_never_detected_makes_every_long_episode_open(leaps, more, draw):
    # Law: from t1 on it is the oldest, and of any age up to t1; then every episode of at least 2 t1 is open.
    before = ages(leaps)
    since = len(before) - 1
    young = draw.draw(st.integers(0, before[-1]))
    found = np.append(before, young + np.arange(1, since + more + 1))
    assert all(open_at_each_step(found)[max(2 * since, 1) :])


@given(LEAPS)
def test_an_open_episode_that_goes_on_stays_open_until_that_rogue_is_detected(leaps):
    # Law: and what is claimed of it never becomes less.
    found = ages(leaps)
    told = open_at_each_step(found)
    for k in range(len(found) - 1):
        assert not told[k] or told[k + 1] or found[k + 1] <= found[k]
        assert found[: k + 2].max() >= found[: k + 1].max()


def test_an_episode_that_ends_at_its_worst_moment_is_not_open():
    # Story: `random` reaches its longest time at the very end of some episodes; below half of the 20 s, that is no gap.
    scenario = lissajous_env.scenario("evaders", **{"task.duration": 20.0})
    of_all = lissajous_env.evaluate(baselines.make("random", scenario, 64), scenario, seeds=range(64))
    found = [row for row in of_all if row["guaranteed_detection_time"] == row["unseen_at_end"] < 9.0]
    assert found
    for row in found:
        assert row[OPEN.name] == 0
        assert failures.failed(row)[1] is False
        shown = words_of(cells([row, *rows([(9.3, 3.6), (12.8, 1.7), (8.4, 2.3)], "random")])["random"])
        assert not shown[0].startswith(">")


def test_where_a_rogue_stays_unseen_since_the_beginning_every_episode_is_open():
    # Story: cars that do not move. The same world played for longer claims more, and is open all the time.
    told = []
    for duration in (2.0, 5.0, 12.0):
        scenario = lissajous_env.scenario("evaders", **{"task.duration": duration})
        (row,) = lissajous_env.evaluate(baselines.make("still", scenario), scenario, seeds=[3])
        assert row["guaranteed_detection_time"] == pytest.approx(duration - 0.1)
        told.append(row)
    assert all(row[OPEN.name] == 1 and failures.failed(row)[1] for row in told)


def test_a_rogue_that_came_later_and_stayed_for_most_of_the_episode_is_open_too():
    # Story: all cars stop for good at 4 s of 12 s; what is then unseen is never detected.
    faults = tuple((robot, 4.0, math.inf) for robot in range(5))
    scenario = lissajous_env.scenario("evaders", **{"task.duration": 12.0, "faults.schedule": faults})
    (row,) = lissajous_env.evaluate(baselines.make("kuramoto-mpcc", scenario), scenario, seeds=[0])
    assert 7.9 < row["guaranteed_detection_time"] == row["unseen_at_end"] < 11.9
    assert row[OPEN.name] == 1


def test_playing_longer_never_claims_less():
    # Law: the same seeds for 3, 6, 12 and 24 s.
    told = []
    for duration in (3.0, 6.0, 12.0, 24.0):
        scenario = lissajous_env.scenario("evaders", **{"task.duration": duration})
        policy = baselines.make("sweep", scenario, 4)
        told.append(lissajous_env.evaluate(policy, scenario, seeds=range(4)))
    for shorter, longer in pairwise(told):
        for first, second in zip(shorter, longer, strict=True):
            assert second["guaranteed_detection_time"] >= first["guaranteed_detection_time"]


def test_without_a_robot_left_nothing_bounds_it():
    # Story: the edge removes cars that drive straight on; the episode ends at once, with nobody to detect a rogue.
    scenario = lissajous_env.scenario("evaders", **{"task.boundary": "remove", "task.duration": 60.0})
    simulation = Simulation(scenario, seed=0)
    simulation.reset(seeds=[0])
    while not simulation.over.all():
        simulation.step(np.broadcast_to(np.array([0.0, 1.0], dtype=np.float32), simulation.action_shape).copy())
    (row,) = simulation.score()
    assert simulation.terminated.numpy().all()
    assert row["guaranteed_detection_time"] < 30
    assert row[OPEN.name] == 1


def test_where_nothing_is_followed_nothing_is_open():
    scenario = lissajous_env.scenario("experiment", **{"task.duration": 1.0})
    (row,) = lissajous_env.evaluate(baselines.make("still", scenario), scenario, seeds=[0])
    assert math.isnan(row[OPEN.name])
    assert failures.failed(row)[1] is False


# What a table states.


def test_an_episode_that_ended_at_its_worst_makes_no_lower_bound_of_the_row():
    # Oracle: by hand. 4.4, 4.7 and 4.7, of which one continues, then 5.1 and 7.5: the censored episode passes its
    # weight on, 1 / 13 of it to each longer time, and the weight of a longer time is 14 / 13. Of 16 episodes the first
    # 4 go.
    times = sorted(longest for longest, at_end in ENDED_AT_ITS_WORST if longest != at_end)
    weights = np.array([1.0, 1.0] + [14 / 13] * 13)
    last = np.cumsum(weights)
    inside = np.minimum(last, 12) - np.maximum(last - weights, 4)
    expected = np.maximum(inside, 0) @ times / 8
    of = cells(rows(ENDED_AT_ITS_WORST))["a"]["guaranteed_detection_time"]
    assert of.iqm == pytest.approx(expected)
    assert of.iqm > summarize([longest for longest, _ in ENDED_AT_ITS_WORST]).iqm
    assert not of.at_least
    assert of.low < of.iqm < of.high < math.inf
    assert words_of({"guaranteed_detection_time": of})[0] == f"{expected:.3g}"


def test_a_row_is_a_lower_bound_where_more_than_a_quarter_of_its_episodes_is_open():
    # Oracle: by hand. The middle half of 16 does without the 4 longest.
    times = [(4.0, 1.0)] * 12 + [(59.9, 59.9)] * 4
    of = cells(rows(times, open_at=range(12, 16)))["a"]["guaranteed_detection_time"]
    assert (of.iqm, of.at_least) == (pytest.approx(4.0), False)
    assert of.high == math.inf  # many a resample has five of them
    assert words_of({"guaranteed_detection_time": of}) == ("4", "at least 4")
    lost = [(4.0, 1.0)] * 11 + [(59.9, 59.9)] * 5
    of = cells(rows(lost, open_at=range(11, 16)))["a"]["guaranteed_detection_time"]
    assert (of.iqm, of.at_least) == (pytest.approx((7 * 4 + 59.9) / 8), True)
    assert words_of({"guaranteed_detection_time": of})[0] == "> 11.0"
    all_open = cells(rows([(59.9, 59.9)] * 16, open_at=range(16)))["a"]["guaranteed_detection_time"]
    assert words_of({"guaranteed_detection_time": all_open}) == ("> 59.9", "")


def test_an_open_episode_is_not_taken_for_one_that_ends_with_the_others():
    # Oracle: by hand. Of 8 episodes 3 are open at 40 s; a single one at 58 s does not bound them.
    times = [(4.0, 1.0)] * 4 + [(40.0, 40.0)] * 3 + [(58.0, 1.0)]
    assert cells(rows(times, open_at=(4, 5, 6)))["a"]["guaranteed_detection_time"].at_least
    censored = cells(rows(times))["a"]["guaranteed_detection_time"]
    assert (censored.at_least, censored.iqm) == (False, pytest.approx((2 * 4 + 2 * 58) / 4))


def test_one_censored_episode_alone_is_a_lower_bound():
    of = cells(rows([(3.1, 3.1)]))["a"]
    assert words_of(of) == ("> 3.10", "")
    assert math.isnan(of["guaranteed_detection_time"].low)


@given(st.lists(st.floats(0, 1e3), max_size=40))
def test_where_nothing_is_censored_it_is_the_interquartile_mean(times):
    # Oracle: the same statistics without censoring; and the weights of Kaplan and Meier, all equal, by the same route.
    never = np.zeros(len(times), dtype=bool)
    plain, found = summarize(times), summarize_censored(times, never, never)
    np.testing.assert_equal(dataclasses.astuple(found), dataclasses.astuple(plain))  # NaN equals NaN
    if times:  # one more that is open and the longest: the estimate goes through the weights
        more, last = [*times, 2e3], [*never, True]
        found, known = summarize_censored(more, last, last), summarize(more)
        assert found.iqm == pytest.approx(known.iqm, rel=1e-9, abs=1e-12)
        assert found.at_least == (len(more) < 4)


def test_the_weights_are_those_of_scipy():
    # Oracle: scipy.stats.ecdf of right-censored times, ties among them; the middle half by its quantiles.
    rng = np.random.default_rng(5)
    for _ in range(50):
        times, ended = rng.integers(1, 12, 40).astype(float), rng.random(40) < 0.8
        curve = stats.ecdf(stats.CensoredData.right_censored(times, ~ended)).cdf
        levels = (np.arange(40_000) + 0.5) / 80_000 + 0.25
        if curve.probabilities[-1] < levels[-1]:
            continue
        oracle = curve.quantiles[np.searchsorted(curve.probabilities, levels)].mean()
        found = summarize_censored(times, ~ended, np.zeros(40, dtype=bool))
        assert not found.at_least
        assert found.iqm == pytest.approx(oracle, abs=2e-3)


def test_it_finds_the_truth_behind_artificial_censoring():
    # Oracle: 200 samples of 64 lognormal times, a third of them cut off; the interquartile mean of 10^6 whole ones.
    rng = np.random.default_rng(7)
    truth = summarize_of_population(rng)
    found, naive, covered = [], [], 0
    for _ in range(200):
        times, until = rng.lognormal(1.0, 0.5, 64), rng.exponential(8.0, 64)
        of = summarize_censored(np.minimum(times, until), until < times, np.zeros(64, dtype=bool))
        if not of.at_least:
            found.append(of.iqm)
            naive.append(summarize(np.minimum(times, until)).iqm)
        covered += of.low <= truth <= of.high
    assert len(found) > 180
    assert np.mean(found) == pytest.approx(truth, rel=0.02)
    assert np.mean(naive) < 0.85 * truth
    assert 0.9 < covered / 200 < 0.99


def summarize_of_population(rng):
    drawn = np.sort(rng.lognormal(1.0, 0.5, 1_000_000))
    return drawn[250_000:750_000].mean()


def test_what_is_not_decided_seed_by_seed_counts_half():
    # Oracle: by hand. Against 5 s: growing at 4 s is undecided, growing at 6 s worse, open worse, 4 s better.
    ours = rows([(4.0, 4.0), (6.0, 6.0), (40.0, 40.0), (4.0, 1.0)], open_at=(2,))
    theirs = rows([(5.0, 1.0)] * 4, "kuramoto-mpcc")
    _, policies = compare([*ours, *theirs], EVADERS).against["evaders"]
    pair = policies["a"]["guaranteed_detection_time"]
    assert pair.better == (0.5 + 0 + 0 + 1) / 4
    assert pair.difference == -1.0  # of the seed on which both are known


def test_the_table_and_its_legend_show_where_no_upper_end_is_known():
    played = [*rows([(4.0, 1.0)] * 12 + [(59.9, 59.9)] * 4, open_at=range(12, 16))]
    played += rows([(59.9, 59.9)] * 16, "lost", range(16))
    known = cells(played)
    console = Console(width=200, record=True, file=open(os.devnull, "w"))  # noqa: SIM115
    tables.print_policies(console, Text("t"), known, SHOWN)
    said = console.export_text()
    assert "4*" in said
    assert "at least 4" in said
    assert "> 59.9" in said
    assert "59.9*" not in said
    assert any("a lower bound" in words for words in tables._legend({"evaders": known}, {}, 16))
