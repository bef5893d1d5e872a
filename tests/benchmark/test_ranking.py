"""The ranking of a report: mean ranks compared with hand calculation and SciPy."""

import numpy as np
import pytest
from scipy.stats import rankdata

import lissajous_env
from baselines.benchmark.ranking import rankings
from baselines.benchmark.table import Table
from lissajous_env.world.columns import COLUMNS

SCENARIOS = {name: lissajous_env.scenario(name) for name in ("evaders", "team", "redundant")}


def rows(scenario, policy, **columns):
    for seed, values in enumerate(zip(*columns.values(), strict=True)):
        numbers = dict.fromkeys(COLUMNS, 1.0) | {"unseen_at_end": 0.5, "guarantee_open": 0.0}
        yield (
            {"scenario": scenario, "policy": policy, "episode": seed, "seed": seed}
            | numbers
            | dict(zip(columns, values, strict=True))
        )


def test_ranks_by_hand():
    # Story: a is sooner on both seeds of `evaders`, b on one of `team`, where on the other they are equal.
    played = [
        *rows("evaders", "a", detection_time_mean=[1.0, 1.0], collisions=[0, 5]),
        *rows("evaders", "b", detection_time_mean=[2.0, 2.0], collisions=[0, 0]),
        *rows("team", "a", detection_time_mean=[3.0, 3.0], collisions=[1, 2]),
        *rows("team", "b", detection_time_mean=[2.0, 3.0], collisions=[1, 1]),
        *rows("team", "elsewhere not", detection_time_mean=[0.1, 0.1], collisions=[0, 0]),
        *rows("redundant", "point", detection_time_mean=[1.0], collisions=[0]),
    ]
    (cars,) = rankings(Table.of(played, SCENARIOS))
    assert (cars.group.kind, cars.group.scenarios) == ("car", ("evaders", "team"))
    assert set(cars.ranks) == {"a", "b"}  # who did not play all of them has no rank
    assert cars.ranks["a"]["detection_time_mean"][0] == (1 + 1 + 2 + 1.5) / 4
    assert cars.ranks["b"]["detection_time_mean"][0] == (2 + 2 + 1 + 1.5) / 4
    assert cars.ranks["a"]["collisions"][0] == (1.5 + 2 + 1.5 + 2) / 4
    assert list(cars.overall) == ["b", "a"]  # the best first
    assert cars.overall["a"][0] + cars.overall["b"][0] == pytest.approx(3)
    # Of what is equal everywhere, as the guarantee here, each has the middle rank.
    assert cars.ranks["a"]["guaranteed_detection_time"] == (1.5, 1.5, 1.5)


def test_guarantees_rank_by_their_largest_value():
    # Story: "often short" is shorter on three seeds of four, and longer on one; a mean or a rank by seed prefers it.
    times = {"often short": [3.0, 3.0, 3.0, 7.0], "always": [4.0, 4.0, 4.0, 4.0]}
    played = [row for name, of in times.items() for row in rows("evaders", name, guaranteed_detection_time=of)]
    (cars,) = rankings(Table.of(played, SCENARIOS))
    of = {policy: ranks["guaranteed_detection_time"] for policy, ranks in cars.ranks.items()}
    assert of == {"always": (1, 1, 1), "often short": (2, 2, 2)}


def test_an_open_guarantee_ranks_below_any_that_is_not_and_equals_another():
    times = {"closed": 9.0, "open": 4.0, "open too": 60.0}
    played = []
    for policy, time in times.items():
        is_open = policy != "closed"
        more = {"unseen_at_end": [time if is_open else 1.0] * 2, "guarantee_open": [float(is_open)] * 2}
        played += rows("evaders", policy, guaranteed_detection_time=[time] * 2, **more)
    (cars,) = rankings(Table.of(played, SCENARIOS))
    of = {policy: ranks["guaranteed_detection_time"] for policy, ranks in cars.ranks.items()}
    assert of == {"closed": (1, 1, 1), "open": (2.5, 2.5, 2.5), "open too": (2.5, 2.5, 2.5)}


def test_ranks_are_scipys_and_their_interval_that_of_seeds():
    rng = np.random.default_rng(0)
    times = rng.normal([[1.0], [1.1], [1.5]], 0.3, (3, 40))
    played = [row for k, name in enumerate("abc") for row in rows("evaders", name, detection_time_mean=times[k])]
    (cars,) = rankings(Table.of(played, SCENARIOS))
    oracle = rankdata(times, axis=0)
    for k, name in enumerate("abc"):
        mean, low, high = cars.ranks[name]["detection_time_mean"]
        assert mean == pytest.approx(oracle[k].mean())
        assert high - low == pytest.approx(2 * 1.96 * oracle[k].std() / np.sqrt(40), rel=0.1)
