"""Rehearsal before a training: the best classical policy, found by playing, is a rival; and the value of feedback."""

import io

import numpy as np
import pytest
from rich.console import Console

pytest.importorskip("stable_baselines3")

from test_train import QUIET, SMALL

import baselines
import lissajous_env
from baselines.policies import registry
from baselines.policies.base import Policy
from training import rehearsal, scenarios
from training.learned.history import summarize_scores
from training.rehearsal import best_policies
from training.sb3.trainer import train
from training.settings import TrainingSettings

SHORT = {"task.duration": 20.0}


@pytest.mark.parametrize("name", ["failure", "intruders-inside"])
def test_no_classical_policy_is_better_than_the_one_that_a_rehearsal_finds(name):
    # Oracle: `lissajous_env.evaluate` of each policy on seeds that the rehearsal does not use.
    scenario, found = lissajous_env.scenario(name, **SHORT), {}
    best = best_policies([scenario])
    for policy in (each for each in registry.names(scenario) if registry.is_classical(each)):
        if policy in best or not registry.unwrapped(policy)[1]:
            made = baselines.make(policy, scenario, 24)
            found[policy] = summarize_scores(lissajous_env.evaluate(made, scenario, range(50, 74)))
    fastest = min(found[policy]["detection_time"] for policy in best)
    fewest = min(found[policy]["collisions"] for policy in best)
    for policy, scores in found.items():
        assert scores["detection_time"] > 0.75 * fastest or scores["collisions"] > fewest, policy
    assert max(found[policy]["return"] for policy in best) >= max(of["return"] for of in found.values()) - 0.5


def test_a_policy_that_raises_is_left_out_by_name(monkeypatch):
    class Broken(Policy):
        kind = "curve"

        def decide(self, observation):
            raise RuntimeError("no action")

    class Perfect(Policy):
        """A policy that does not suit any scenario."""

        kind = "curve"

        def __init__(self, *_):
            raise ValueError("scenario must be another one")

    monkeypatch.setattr(registry, "_REGISTRY", dict(registry._REGISTRY))
    baselines.register("broken", kind="curve", factory=Broken)
    baselines.register("unsuitable", kind="curve", factory=Perfect)
    said = []
    best = best_policies([lissajous_env.scenario("failure", **SHORT)], say=said.append)
    assert best
    assert not {"broken", "unsuitable"} & {*best}
    assert [words.partition(":")[0] for words in said] == ["broken is left out of the rehearsal"]


def test_the_default_rivals_are_rehearsed_once_for_a_training(tmp_path, monkeypatch):
    played = []
    play = rehearsal._play
    monkeypatch.setattr(rehearsal, "_play", lambda name, *given: played.append(name) or play(name, *given))
    given = {"scenario": "failure", "overrides": {"task.duration": 3.0}, "base": None, "rivals": None, "steps": 1280}
    out = io.StringIO()
    history = train(TrainingSettings(**SMALL | given | {"out": tmp_path}), Console(file=out, width=200))
    count, words = len(played), out.getvalue()
    (line,) = [each for each in words.splitlines() if each.startswith("best classical policy in a rehearsal: ")]
    best = line.partition(": ")[2].split(" and ")
    assert list(history.rivals) == list(dict.fromkeys(["kuramoto", *best]))
    assert history.curve[0]["steps"] == 0
    assert words.index("on failure feedback has no value") < words.index("best classical policy")
    more = TrainingSettings(**SMALL | given | {"steps": 2560, "out": tmp_path})
    assert train(more, QUIET).rivals == history.rivals
    assert len(played) == count
    # Rivals that are named need no rehearsal.
    train(TrainingSettings(**SMALL | given | {"rivals": ("still",), "out": tmp_path / "named"}), QUIET)
    assert len(played) == count


def test_feedback_has_a_value_only_where_something_observed_is_random():
    # Oracle: for each scenario, the fields by which robots fail at random.
    for name in lissajous_env.scenarios():
        made = lissajous_env.scenario(name)
        fails = made.faults.rate > 0 or made.faults.lost > 0
        assert bool(scenarios.uses_of_feedback(made)) == fails, name
        first, *others = scenarios.about_feedback(made)
        assert ("feedback has no value" in first) != fails
        assert fails or "rough, rough-lost (robots fail or are removed at random" in others[0]
    made = lissajous_env.scenario("intruders-inside")
    assert scenarios.uses_of_feedback(lissajous_env.scenario(made, **{"faults.rate": 0.01}))
    assert scenarios.uses_of_feedback(lissajous_env.scenario(made, **{"task.reward_formation": -1.0}))


def test_an_observation_without_a_target_tells_nothing_about_those_that_are_undetected():
    # Story: undetected targets elsewhere in the same scenario change no observation of robots that move alike.
    rows = []
    for count in (3, 30):
        changes = {"targets.arrival_rate": 0.0, "targets.count": count, "task.duration": 8.0, "faults.schedule": ()}
        scenario = lissajous_env.scenario("intruders-inside", **changes)
        simulation, seen = lissajous_env.Simulation(scenario, 4, seed=3), []
        acting = baselines.make("sweep", scenario, 4)
        for _ in range(scenario.task.steps):
            seen.append(simulation.observation.numpy().copy())
            simulation.step(acting.act(simulation.observation))
        rows.append(np.array(seen))
    targets = ["target_" in name for name in simulation.layout.names]
    assert (rows[0][..., np.logical_not(targets)] == rows[1][..., np.logical_not(targets)]).all()
    assert not (rows[0][..., targets] == rows[1][..., targets]).all()
