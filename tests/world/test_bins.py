"""Many robots and targets: bins give bit-identical results, equal to brute force."""

import subprocess
import sys

import numpy as np
import pytest
from test_sight import leap
from test_stages import different

import lissajous_env
from lissajous_env.device import program
from lissajous_env.world import stages
from lissajous_env.world.robots import nearby
from lissajous_env.world.robots.nearby import has_bins
from lissajous_env.world.state import REMOVED

DENSE = {"curve.a": 201, "curve.b": 200, "formation.phase_rate": 0.001, "robot.radius": 0.1}
FLEEING = {"targets.fleeing": 1.0, "targets.wandering": 0.0, "targets.leave": False}
CASES = {
    "cars": ("experiment", {}),
    "removed by the edge, all flee": ("evaders", {"targets.count": 100, "task.boundary": "remove", **FLEEING}),
    "stopped by collisions": ("rough", {"task.on_collision": "stop"}),
    "removed by collisions, and lost": ("rough-lost", {"task.on_collision": "remove"}),
    "two on each place": ("redundant", {"targets.arrival_rate": 5.0}),
    "in space": ("knot", {}),
    "large discs": ("intruders", {"targets.count": 200, "targets.leave": False, "sensing.radius": 2.0}),
    "seen from afar, anew": ("intruders", {"targets.count": 200, "targets.respawn": True, "sensing.sight": 1.5,
                                           "targets.flight": "all", "targets.entry": "hotspots"}),
    "leaping": ("swarm", {"extensions": (leap,), "targets.custom": 0.5, "targets.wandering": 0.5}),
    "large bodies": ("swarm", {"sensing.radius": 0.1, "robot.radius": 0.2, "targets.count": 500}),
    "far apart": ("swarm", {"sensing.radius": 1e-3, "robot.radius": 1e-3, "curve.a": 5, "curve.b": 4}),
    "too fast for lists": ("swarm", {"robot.count": 301, "curve.a": 501, "curve.b": 500, "targets.count": 500}),
    "crowd": ("swarm", {**DENSE, "targets.count": 1000, "targets.fleeing": 0.5, "targets.wandering": 0.5}),
    "unseen, in a crowd": ("swarm", {**DENSE, "targets.count": 0, "targets.arrival_rate": 50.0,
                                     "targets.entry": "unseen", "task.duration": 2.0}),
}  # fmt: skip


@pytest.fixture
def make_simulation(monkeypatch):
    """Make a simulation that has bins or not, whatever its size."""

    def make(scenario, with_bins):
        for module in (nearby, stages):
            monkeypatch.setattr(module, "has_bins", lambda scenario: with_bins)
        return lissajous_env.Simulation(scenario, 2, seed=3, threads=1)

    return make


def drive(simulations, steps=15, most=1.0):
    rng = np.random.default_rng(1)
    for _ in range(steps):
        action = (most * rng.uniform(-1, 1, simulations[0].action_shape)).astype(np.float32)
        for simulation in simulations:
            simulation.step(action)


@pytest.mark.parametrize("case", CASES)
def test_a_trajectory_is_the_same_with_bins(case, make_simulation):
    # Oracle: every robot asked by every target and every other robot.
    name, overrides = CASES[case]
    scenario = lissajous_env.scenario(name, **overrides)
    alone, binned = make_simulation(scenario, False), make_simulation(scenario, True)
    drive([alone, binned], 15 if scenario.resolve().num_robots < 300 else 4)
    assert different(alone, binned) == []


@pytest.mark.parametrize("case", ["stopped by collisions", "large bodies", "crowd"])
def test_a_lane_for_each_entity_gives_the_same(case, make_simulation, monkeypatch):
    # Oracle: as above. So a GPU launches the kernels; here its threads come one after the other, in their order.
    name, overrides = CASES[case]
    scenario = lissajous_env.scenario(name, **overrides)
    alone = make_simulation(scenario, False)
    monkeypatch.setattr(program.Program, "_lanes", lambda self, stage: self._sizes.get(stage.over, 1))
    many = make_simulation(scenario, True)
    drive([alone, many], 4)
    assert different(alone, many) == []


def test_of_robots_in_one_place_the_first_detects_and_is_seen_first(make_simulation):
    # Oracle: as above. Lists are in no order, and every other robot stands where the one before it stands.
    overrides = {**DENSE, "targets.count": 3000, "targets.speed": 5.0, "targets.arrival_rate": 20_000.0}
    pair = [make_simulation(lissajous_env.scenario("swarm", **overrides), with_bins) for with_bins in (False, True)]
    for simulation in pair:
        simulation.robots.phase.assign(np.repeat(simulation.robots.phase.numpy()[:, ::2], 2, axis=1)[:, :401])
    drive(pair, 3, most=0.0)
    assert different(*pair) == []
    detections = pair[1].latest.detections.numpy()
    assert detections[:, ::2].sum() > 10
    assert detections[:, 1::2].sum() == 0


def brute_force(track, there):
    """Least distance [m] of each pair through a step, (N, N) above the diagonal, in float64."""
    i, j = np.triu_indices(len(track), 1)
    least = np.full(len(i), np.inf)
    for s in range(track.shape[1] - 1):
        before, after = (track[i, k] - track[j, k] for k in (s, s + 1))
        moved = after - before
        share = -(before * moved).sum(axis=1) / np.maximum((moved**2).sum(axis=1), 1e-300)
        nearest = before + np.clip(share, 0, 1)[:, None] * moved
        least = np.minimum(least, np.linalg.norm(nearest, axis=1))
    return least[there[i] & there[j]]


def test_collisions_of_a_thousand_robots_are_those_of_brute_force():
    # Oracle: every pair in float64, by NumPy.
    overrides = {"curve.a": 501, "curve.b": 500, "robot.radius": 0.02, "targets.count": 0, "task.grid": None}
    scenario = lissajous_env.scenario("swarm", **overrides, **{"faults.removed": tuple((k, 0.15) for k in range(100))})
    assert has_bins(scenario.resolve())
    simulation, nearest, in_contact = lissajous_env.Simulation(scenario, seed=2), np.inf, 0
    for _ in range(4):
        drive([simulation], 1)
        there = simulation.robots.status.numpy()[0] != int(REMOVED)
        least = brute_force(simulation.robots.path.numpy()[0].astype(float), there)
        nearest, in_contact = min(nearest, least.min()), in_contact + (least < 0.04).sum()
        (row,) = simulation.score()
        assert row["min_separation"] == pytest.approx(nearest, abs=1e-5)
        assert row["contact_time"] == pytest.approx(0.1 * in_contact, abs=0.5)
    assert in_contact > 100
    assert there.sum() == 901


@pytest.mark.parametrize(
    ("robots", "radius", "expected"),
    [(5, None, False), (49, None, False), (65, None, True), (101, 8.0, True), (101, 20.0, False)],
)
def test_bins_are_for_where_they_pay(robots, radius, expected):
    # Oracle: the crossing points that were measured, either side.
    scenario = lissajous_env.scenario("swarm", **{"curve.a": robots // 2 | 1, "curve.b": robots - (robots // 2 | 1)})
    assert has_bins(lissajous_env.scenario(scenario, **{"sensing.radius": radius}).resolve()) == expected


@pytest.mark.parametrize("fleeing", [0.0, 0.01])
def test_a_target_is_compared_with_few_of_many_robots(fleeing):
    # Oracle: all robots, with each of which every target was once compared.
    crowd = {**DENSE, "robot.radius": 0.001, "targets.wandering": 1 - fleeing, "targets.fleeing": fleeing}
    simulation = lissajous_env.Simulation(lissajous_env.scenario("swarm", **crowd))
    simulation.advance()
    bins = simulation.stages._values["bins"]
    listed = bins.used.numpy()[0] / (bins.columns * bins.rows)
    assert 0.1 < listed < simulation.num_robots / 50


def test_a_thousand_robots_and_a_million_targets_take_less_than_600_megabytes():
    # Oracle: the largest memory that the operating system saw, of a process that plays the included scenario.
    program = (
        "import pathlib, numpy, lissajous_env\n"
        "simulation = lissajous_env.Simulation('city')\n"
        "for _ in range(3):\n"
        "    simulation.step(numpy.zeros(simulation.action_shape, dtype=numpy.float32))\n"
        "assert 900_000 < simulation.latest.waiting.numpy()[0] < 1_000_000\n"
        "assert simulation.score()[0]['targets'] == 1_000_000\n"
        "told = pathlib.Path('/proc/self/status').read_text()\n"
        "print(int(told.partition('VmHWM:')[2].split()[0]) / 1024)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 600
