"""The clairvoyant reference: its assignment of robots to targets, and that only a benchmark gives it the state."""

import itertools

import numpy as np
import pytest
from rich.console import Console

import baselines
import lissajous_env
from baselines.benchmark import clairvoyant
from baselines.benchmark.clairvoyant import Clairvoyant, assigned, waiting_places
from baselines.benchmark.running import run
from baselines.benchmark.types import Benchmark
from lissajous_env.episodes.evaluation import episodes


def played(scenario, seeds):
    seer = Clairvoyant(scenario, len(seeds))
    return [row for rows in episodes(seer, scenario, seeds, on_start=seer.watch) for row in rows]


def test_the_nearest_pair_goes_first():
    # Oracle: all orders of robots and rogues, tried one by one; the lengths differ, so that one of them is greedy.
    rng = np.random.default_rng(0)
    way = rng.uniform(size=(20, 3, 5))
    way[:, :, 4] = np.inf
    for table, chosen in zip(way, assigned(way), strict=True):
        lengths = [sorted(table[range(3), order]) for order in itertools.permutations(range(5), 3)]
        assert sorted(table[range(3), chosen]) == min(lengths)
    nobody = assigned(np.full((2, 3, 1), np.inf))
    assert (nobody == -1).all()


@pytest.mark.parametrize("name", ["intruders", "failure"])
def test_it_finds_sooner_than_the_papers_method(name):
    scenario = lissajous_env.scenario(name, **{"sensing.radius": 0.5, "faults.schedule": (), "task.duration": 30.0})
    rival = baselines.make("kuramoto" if name == "failure" else "kuramoto-mpcc", scenario, 4)
    rivals = lissajous_env.evaluate(rival, scenario, range(4))
    times = [[row["detection_time_mean"] for row in rows] for rows in (played(scenario, range(4)), rivals)]
    assert np.mean(times[0]) < 0.5 * np.mean(times[1])


def test_it_waits_where_rogues_are_near():
    # Oracle: by symmetry, the middles of the halves of a square, and the even spacing of a boundary.
    pair = lissajous_env.scenario("intruders", **{"robot.count": 2, "curve.half_width": 2.0, "curve.half_height": 1.0})
    inside = waiting_places(lissajous_env.scenario(pair, **{"targets.entry": "inside"}))
    assert sorted(map(tuple, np.round(np.abs(inside), 1))) == [(1, 0), (1, 0)]
    around = waiting_places(lissajous_env.scenario("intruders"))
    assert np.linalg.norm(around[:, None] - around[None], axis=-1)[~np.eye(5, dtype=bool)].min() > 4


def test_a_benchmark_plays_it_when_asked_to_and_hands_the_world_to_nobody_else(tmp_path):
    class Spy:
        name, num_worlds, watched = "spy", 2, []

        def __init__(self, scenario, num_worlds, device):
            self.inner = baselines.make("kuramoto", scenario, num_worlds)

        def reset(self, worlds=None):
            self.inner.reset(worlds)

        def act(self, observation):
            return self.inner.act(observation)

        def watch(self, simulation):
            self.watched.append(simulation)

    settings = Benchmark(("failure",), ("still",), 2, clairvoyant=True, out=tmp_path, overrides={"task.duration": 2.0})
    rows = run(settings, {"spy": Spy}, console=Console(quiet=True))
    assert [row["policy"] for row in rows] == [p for p in ("still", "spy", clairvoyant.NAME) for _ in range(2)]
    assert Spy.watched == []
    assert clairvoyant.NAME not in baselines.names()
