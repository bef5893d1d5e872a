"""Sentences on the theorem of the proved filter below tables."""

import json
import warnings

import numpy as np
from command_line import called

import baselines
import lissajous_env
from baselines.benchmark.theorem import about_theorem, compatible_starts
from baselines.benchmark.types import Cell
from baselines.policies.registry import as_factory
from baselines.policies.safety.proved import ProvedParameters, unmet_conditions
from lissajous_env.parameters.assumptions import AssumptionWarning

EMPTY = {
    "targets.count": 0, "targets.arrival_rate": 0.0, "task.grid": None, "task.contamination": None,
    "faults.schedule": (), "faults.rate": 0.0, "faults.lost": 0, "task.duration": 4.0,
}  # fmt: skip
RANDOM = {"formation.start": "random"}


def resolved(name, **changes):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AssumptionWarning)
        return lissajous_env.scenario(name, **EMPTY | changes).resolve()


def test_bodies_that_overlap_are_no_start_of_a_proof():
    # Oracle: distances of the bodies at the reset.
    scenario, seeds = resolved("experiment", **RANDOM), range(70)
    compatible = compatible_starts(scenario, ProvedParameters().of(scenario), seeds)
    simulation = lissajous_env.Simulation(scenario, len(seeds))
    simulation.reset(seeds=seeds)
    place = simulation.robots.position.numpy()[..., :2]
    apart = np.linalg.norm(place[:, :, None] - place[:, None], axis=-1) + 9 * np.eye(scenario.num_robots)
    overlap = (apart < 2 * scenario.robot.radius).any(axis=(1, 2))
    assert 0 < overlap.sum() < len(seeds)
    assert not (compatible & overlap).any()
    assert compatible.any()


def sentences_of(scenario, policy, factory=None):
    rows = [{"scenario": scenario.name, "policy": policy, "seed": seed} for seed in range(8)]
    return about_theorem([Cell(scenario, policy, as_factory(factory or policy, policy))], rows).get(scenario.name, [])


def test_the_sentence_names_the_conditions_or_that_there_are_none():
    evaders, rough = lissajous_env.scenario("evaders"), lissajous_env.scenario("rough")
    (applies,) = sentences_of(evaders, "sweep-proved")
    assert "applies from the start of 8 episodes" in applies
    (words,) = sentences_of(rough, "sweep-proved")
    assert "does not apply" in words
    assert all(condition in words for condition in unmet_conditions(rough))
    assert len(unmet_conditions(rough)) == 5
    (some,) = sentences_of(resolved("experiment", **RANDOM), "sweep-proved")
    assert "applies from the start of 3 of 8 episodes only: in the others robots start too close (condition 6)" in some


def test_policies_with_the_filter_are_found_by_name_and_by_kind():
    evaders = lissajous_env.scenario("evaders")
    for name in ("sweep", "sweep-safe", "kuramoto-mpcc", "random"):
        assert sentences_of(evaders, name) == []
    assert sentences_of(evaders, "mine", lambda s, w, d: baselines.make("sweep-safe", s, w, d)) == []
    for name, factory in (("mine", lambda s, w, d: baselines.make("laps-proved", s, w, d)), ("portfolio", None)):
        (words,) = sentences_of(evaders, name, factory)
        assert "applies from the start of 8 episodes" in words


def printed(capsys, *words):
    code, text, _ = called(capsys, *words)
    assert code == 0
    return " ".join(text.split())


SHORT = ("--set", "task.duration=1")


def test_each_command_prints_one_line_below_its_table(capsys, tmp_path):
    unmet = "rough: The theorem of the proved filter does not apply: 1: noise.actuator must be 0, got 0.05;"
    for words in (("run", "rough", "sweep-proved", "--out", tmp_path / "a.npz"), ("evaluate", "rough", "sweep-proved")):
        more = () if words[0] == "run" else ("--episodes", 2)
        assert printed(capsys, *words, *more, *SHORT).count(unmet) == 1
        assert "theorem" not in printed(capsys, words[0], "rough", "sweep", *words[3:], *more, *SHORT)
    played = ("--scenarios", "rough", "evaders", "--policies", "sweep", "sweep-proved", "laps-proved", "--episodes", 2)
    fewer = ("--scenarios", "rough", "--policies", "laps-proved", "--episodes", 2)  # the table has the earlier ones
    for call in (played, fewer):
        output = printed(capsys, "benchmark", *call, "--replays", 0, "--out", tmp_path / "b", *SHORT)
        assert output.count(unmet) == 1
        assert "got 0.1 (sweep-proved, laps-proved)." in output
        assert output.count("evaders: The theorem of the proved filter applies from the start of 2 episodes") == 1
        page = (tmp_path / "b" / "report.html").read_text(encoding="utf-8")
        assert json.dumps(unmet.partition(": ")[2])[1:-1] in page
