"""Sentences on the theorem of the proved filter below tables, and warnings about starts from which cars collide."""

import json
import warnings

import numpy as np
import pytest

import baselines
import lissajous_env
from baselines.benchmark.theorem import about_theorem, compatible_starts
from baselines.benchmark.types import Cell
from baselines.policies.base import Policy
from baselines.policies.factories import as_factory, named
from baselines.policies.safety.proved import ProvedParameters, unmet_conditions
from lissajous_env.console.cli import main
from lissajous_env.parameters import named as named_scenarios
from lissajous_env.parameters.assumptions import AssumptionWarning, violations
from lissajous_env.theory import starts

EMPTY = {
    "targets.count": 0, "targets.arrival_rate": 0.0, "task.grid": None, "task.contamination": None,
    "faults.schedule": (), "faults.rate": 0.0, "faults.lost": 0, "task.duration": 4.0,
}  # fmt: skip
CROWDED = {
    "curve.half_width": 8.0, "curve.half_height": 5.0, "curve.a": 5, "curve.b": 6, "robot.speed_max": 4.0,
    "robot.wheelbase": 1.6, "formation.phase_rate": 0.12,
}  # fmt: skip
RANDOM = {"formation.start": "random"}
WORLDS = 32


def made(name, **changes):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AssumptionWarning)
        return lissajous_env.scenario(name, **EMPTY | changes).resolve()


def share_of(scenario):
    arguments = scenario.curve, scenario.formation, scenario.robot
    return starts.unavoidable(*arguments, tuple(scenario.equilibrium), tuple(scenario.top_speeds))[0]


def unavoidable_in(simulation):
    """Return for each world whether a pair of its cars cannot be separated, by the rule that the warning uses."""
    scenario, robots = simulation.scenario, simulation.robots
    place = robots.position.numpy()[..., :2]
    states = np.dstack([place, robots.heading.numpy(), robots.speed.numpy()]).astype(float)
    one, other = np.triu_indices(scenario.num_robots, 1)
    worlds, pairs = starts._are_near(states, one, other, scenario.robot)
    ends = states[worlds, one[pairs]], states[worlds, other[pairs]]
    collide = starts._collide_anyway(*ends, scenario.robot, scenario.top_speeds[np.stack([one, other])[:, pairs]])
    found = np.zeros(len(states), bool)
    found[worlds[collide]] = True
    return found


def collides(policy, scenario):
    """Return for each world whether robots of a policy collide within four seconds, by the simulation."""
    simulation = lissajous_env.Simulation(scenario, WORLDS, seed=5)
    acting, found = baselines.make(policy, scenario, WORLDS), np.zeros(WORLDS, bool)
    for _ in range(scenario.task.steps):
        simulation.step(acting.act(simulation.observation))
        found |= simulation.latest.collisions.numpy().any(axis=1)
    return found


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("hall", CROWDED),
        ("hall", RANDOM),
        ("experiment", RANDOM),
        ("team", {"formation.start_headway": 0.0}),
        ("hall", CROWDED | {"formation.start_headway": 0.6, "formation.start_noise": 0.3}),
        ("evaders", {}),
    ],
)
def test_from_a_start_that_is_called_unavoidable_every_policy_collides(name, changes):
    # Oracle: the simulation, with policies that stop, turn away, or follow their paths.
    scenario = made(name, **changes)
    marked = unavoidable_in(lissajous_env.Simulation(scenario, WORLDS, seed=5))
    everyone = np.ones(WORLDS, bool)
    for policy in ("still", "still-proved", "sweep-safe", "kuramoto-mpcc-safe"):
        everyone &= collides(policy, scenario)
    assert not (marked & ~everyone).any()
    assert marked.sum() >= 0.7 * everyone.sum()
    # The drawn starts are those of the simulation: their shares differ by chance alone.
    share, seen = share_of(scenario), marked.mean()
    spread = np.sqrt(max(seen * (1 - seen), 1 / WORLDS) * (1 / WORLDS + 1 / starts.STARTS))
    assert abs(share - seen) < 4 * spread


def test_a_scenario_with_such_starts_warns_when_it_is_made(monkeypatch):
    monkeypatch.setattr(named_scenarios, "_reported", set())
    with pytest.warns(AssumptionWarning, match=r"no policy can avoid a collision in about \d+% of the episodes"):
        lissajous_env.scenario("hall", **CROWDED)
    # Two cars on one place, from a start without any chance.
    displaced = made("evaders", **{"formation.start_noise": 0.0, "formation.displaced": ((0, 2 * np.pi / 5),)})
    (words,) = [each for each in violations(displaced) if "start so close" in each]
    assert "about 100% of the episodes, with 1 such pairs" in words
    apart = made("hall", **CROWDED | {"formation.start_headway": 0.8, "formation.start_noise": 0.3})
    assert not [each for each in violations(apart) if "start so close" in each]


@pytest.mark.parametrize("length", [0.5, 4.0])
def test_the_share_of_such_starts_has_no_unit(length):
    scenario = made("hall", **RANDOM)
    assert share_of(scenario.scaled(length, 2.0).resolve()) == pytest.approx(share_of(scenario), abs=1 / starts.STARTS)


def test_bodies_that_overlap_are_no_start_of_a_proof():
    # Oracle: distances of the bodies at the reset, and the rule of the warning.
    scenario, seeds = made("experiment", **RANDOM), range(70)
    compatible = compatible_starts(scenario, ProvedParameters().of(scenario), seeds)
    simulation = lissajous_env.Simulation(scenario, len(seeds))
    simulation.reset(seeds=seeds)
    place = simulation.robots.position.numpy()[..., :2]
    apart = np.linalg.norm(place[:, :, None] - place[:, None], axis=-1) + 9 * np.eye(scenario.num_robots)
    overlap = (apart < 2 * scenario.robot.radius).any(axis=(1, 2)) | unavoidable_in(simulation)
    assert 0 < overlap.sum() < len(seeds)
    assert not (compatible & overlap).any()
    assert compatible.any()


class Around(Policy):
    """A policy that passes on what another one decides."""

    kind = "car"

    def __init__(self, scenario, num_worlds=1, device="cpu", name="sweep-proved"):
        super().__init__(scenario, num_worlds, device)
        self.inner = baselines.make(name, scenario, num_worlds, device)

    def decide(self, observation):
        return self.inner.act(observation)


def said(scenario, policy, factory=None):
    cell = Cell(scenario, policy, named(policy) if factory is None else as_factory(factory, policy))
    rows = [{"scenario": scenario.name, "policy": policy, "seed": seed} for seed in range(8)]
    return about_theorem([cell], rows).get(scenario.name, [])


def test_the_sentence_names_the_conditions_or_that_there_are_none():
    evaders, rough = lissajous_env.scenario("evaders"), lissajous_env.scenario("rough")
    (applies,) = said(evaders, "sweep-proved")
    assert "applies from the start of 8 episodes" in applies
    (words,) = said(rough, "sweep-proved")
    assert "does not apply" in words
    assert all(condition in words for condition in unmet_conditions(rough))
    assert len(unmet_conditions(rough)) == 5
    (some,) = said(made("hall", **CROWDED), "sweep-proved")
    assert "applies from the start of" in some
    assert "of 8 episodes only; 6: robots start too close" in some


def test_policies_that_contain_the_filter_are_found():
    evaders = lissajous_env.scenario("evaders")
    for name in ("sweep", "sweep-safe", "kuramoto-mpcc", "random"):
        assert said(evaders, name) == []
    assert said(evaders, "mine", lambda s, w, d: Around(s, w, d, "sweep-safe")) == []
    (words,) = said(evaders, "mine", lambda s, w, d: Around(s, w, d))
    assert "does not apply: 4: the filter must decide last, got Around" in words
    (words,) = said(evaders, "mine", lambda s, w, d: baselines.make("laps-proved", s, w, d))
    assert "applies from the start of 8 episodes" in words


def printed(capsys, *words):
    with pytest.raises(SystemExit) as ended:
        main([*map(str, words)])
    assert not ended.value.code
    return " ".join(capsys.readouterr().out.split())


SHORT = ("--set", "task.duration=1")


def test_each_command_prints_one_line_below_its_table(capsys, tmp_path):
    unmet = "rough: The theorem of the proved filter does not apply: 1: noise.actuator must be 0, got 0.05;"
    for words in (("run", "rough", "sweep-proved", "--out", tmp_path / "a.npz"), ("evaluate", "rough", "sweep-proved")):
        more = () if words[0] == "run" else ("--episodes", 2)
        assert printed(capsys, *words, *more, *SHORT).count(unmet) == 1
        assert "theorem" not in printed(capsys, words[0], "rough", "sweep", *words[3:], *more, *SHORT)
    played = ("--scenarios", "rough", "evaders", "--policies", "sweep", "sweep-proved", "laps-proved", "--episodes", 2)
    told = printed(capsys, "benchmark", *played, "--replays", "none", "--out", tmp_path / "b", *SHORT)
    assert told.count(unmet) == 1
    assert "got 0.1 (sweep-proved, laps-proved)." in told
    assert told.count("evaders: The theorem of the proved filter applies from the start of 2 episodes") == 1
    page = (tmp_path / "b" / "report.html").read_text(encoding="utf-8")
    assert json.dumps(unmet.partition(": ")[2])[1:-1] in page
