"""`partition-random`: a random rate of all cars, the motion of `partition` at other times."""

import dataclasses

import numpy as np
import pytest

import baselines
import lissajous_env
from baselines.policies.partition import Partition, plain_of
from baselines.policies.partition_plan import partition_plan, smallest_distance
from baselines.policies.partition_random import (
    PartitionRandom,
    RandomPartitionParameters,
    places_at,
    random_times,
    randomly_timed_partition,
)

EVADERS = lissajous_env.scenario("evaders")


def times(**parameters):
    return random_times(plain_of(EVADERS), partition_plan(plain_of(EVADERS)), RandomPartitionParameters(**parameters))


def test_rates_are_random_between_the_slowest_and_the_fastest():
    # Law: increments lie in the range, which they use; another seed gives others, the same seed the same.
    for slowest, fastest in ((0.4, 1.0), (0.6, 0.8)):
        tau = times(slowest=slowest, fastest=fastest)
        assert tau[0] == 0
        assert (np.diff(tau) > 0.98 * slowest).all()
        assert (np.diff(tau) < 1.02 * fastest).all()
        assert np.ptp(np.diff(tau)) > 0.7 * (fastest - slowest)
        assert len(tau) >= EVADERS.task.steps
    assert (times(seed=1) == times(seed=1)).all()
    assert np.abs(times(seed=1)[:200] - times(seed=2)[:200]).max() > 3


def test_at_a_rate_of_1_the_motion_is_that_of_partition():
    # Oracle: `partition`, over an episode.
    constant = RandomPartitionParameters(slowest=1.0)
    ours = randomly_timed_partition(plain_of(EVADERS), constant)[0].places(EVADERS.task.steps)
    theirs = Partition(EVADERS).tables.places(EVADERS.task.steps)
    assert np.abs(ours - theirs).max() < 1e-3


def test_cars_come_no_nearer_than_on_the_loops_of_partition():
    # Law: at each moment all cars are where those of `partition` are at one other moment, or between two of them.
    plan = partition_plan(plain_of(EVADERS))
    found = places_at(plan.loop, times())
    assert smallest_distance(found) >= 0.98 * smallest_distance(plan.loop)


def test_nobody_collides_and_worlds_are_alike():
    # Story: no collisions on cars with their dynamics; a world of a batch is the world alone, bit for bit.
    short = lissajous_env.scenario("evaders", **{"task.duration": 20.0})
    rows = lissajous_env.evaluate(baselines.make("partition-random", short, 3), short, range(3))
    (alone,) = lissajous_env.evaluate(baselines.make("partition-random", short, 1), short, [2])
    assert sum(row["collisions"] for row in rows) == 0
    told = {name for name, value in alone.items() if value == value} - {"episode"}  # NaN is left out
    assert len(told) > 20
    assert {name: rows[2][name] for name in told} == {name: alone[name] for name in told}
    assert max(row["tracking_error_mean"] for row in rows) < 1.0


def test_the_random_rate_has_a_bound_that_is_worse():
    # Story: places are visited later, so the worst-case undetected time is longer, and finite.
    from lissajous_env.episodes.guarantee import worst_undetected_times

    short = lissajous_env.scenario("evaders", **{"task.duration": 30.0})
    slow = RandomPartitionParameters(slowest=0.2)
    random = worst_undetected_times(PartitionRandom(short, 1, parameters=slow), short, [0])
    plain = worst_undetected_times(Partition(short, 1), short, [0])
    assert plain[:, 50:].max() < random[:, 50:].max() < 20.0


def test_bad_input_is_refused_by_name():
    with pytest.raises(ValueError, match=r"slowest must be at most fastest, 0.3, got 0.4"):
        RandomPartitionParameters(fastest=0.3)
    with pytest.raises(ValueError, match="seed must be"):
        dataclasses.replace(RandomPartitionParameters(), seed=-1)
