"""Learned rogues: training against robots of any policy, checkpoints, and their folders in place of a script's name."""

import dataclasses
import json

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from rich.console import Console

import baselines
import lissajous_env
from tests.command_line import called
from training.learned import checkpoint
from training.learned.networks import RogueNetwork
from training.learned.policy import find
from training.learned.rogue import open_rogue, rogue_card
from training.rogue_trainer import train_rogues, undetected_times
from training.settings import RogueTraining

SMALL = {"sensing.radius": 0.35, "task.duration": 8.0, "targets.entry": "unseen"}
FAST = {"scenario": "experiment", "against": "sweep", "rounds": 3, "starts": 24, "worlds": 4,
        "episodes": 8, "overrides": SMALL, "threads": 1}  # fmt: skip


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Folder of a short training, and its history."""
    folder = tmp_path_factory.mktemp("rogues") / "run"
    return folder, train_rogues(RogueTraining(**FAST, out=folder), Console(quiet=True))


def make_network(inputs, seed=0):
    draw = np.random.default_rng(seed)
    sizes = {"0.weight": (16, inputs), "1.weight": (2, 16), "0.bias": 16, "1.bias": 2}
    return RogueNetwork({name: draw.normal(size=size).astype(np.float32) for name, size in sizes.items()})


def test_training_makes_rogues_that_stay_undetected_longer_than_those_that_wander(trained):
    # Oracle: other seeds than those of training and evaluation.
    folder, history = trained
    settings = RogueTraining(**FAST)
    seeds = range(500, 516)
    targets = settings.make_scenario().targets
    assert targets.count == settings.starts // 2, "the other rogues appear later"
    assert targets.arrival_rate > 0
    learned, wander = (
        undetected_times("sweep", settings.make_scenario(rogues), seeds) for rogues in (str(folder), "wander")
    )
    assert learned["mean"] > 1.2 * wander["mean"]
    assert history["rounds"] == 3
    assert set(history["rivals"]) == {"wander", "flee", "follow-gap"}
    # The scores are those of the stored rogue.
    assert undetected_times("sweep", settings.make_scenario(str(folder)), range(20_000, 20_008)) == history["scores"]


def test_a_finished_training_trains_no_more_and_other_settings_are_refused(trained):
    folder, history = trained
    before = (folder / checkpoint.FILE).read_bytes()
    again = train_rogues(RogueTraining(**FAST, out=folder), Console(quiet=True))
    assert again["scores"] == history["scores"]
    assert (folder / checkpoint.FILE).read_bytes() == before
    with pytest.raises(ValueError, match=r"seed = 0 there, 1 here"):
        train_rogues(RogueTraining(**FAST, out=folder, seed=1), Console(quiet=True))


def test_a_killed_imitation_resumes_after_its_last_round(trained, tmp_path, monkeypatch):
    # Oracle: the evaluation after imitation, which depends on every round, is that of a training that was not killed.
    from training.rogue_trainer import RogueTrainer

    settings, visit = RogueTraining(**FAST, out=tmp_path / "run"), RogueTrainer._visit

    class KilledError(Exception):
        pass

    def killed(trainer, k):
        if k == 2:
            raise KilledError
        return visit(trainer, k)

    monkeypatch.setattr(RogueTrainer, "_visit", killed)
    with pytest.raises(KilledError):
        train_rogues(settings, Console(quiet=True))
    visited = []
    monkeypatch.setattr(RogueTrainer, "_visit", lambda trainer, k: visited.append(k) or visit(trainer, k))
    history = train_rogues(settings, Console(quiet=True))
    assert visited == [2]
    assert history["scores"] == trained[1]["scores"]


def test_a_rogue_acts_as_its_network_says(tmp_path):
    # Oracle: the network in float64 NumPy, on the rows of the simulation, clipped and shortened as documented.
    scenario = lissajous_env.scenario("experiment", rogues="agents", **SMALL)
    card = rogue_card(scenario)
    network = make_network(len(card.inputs))
    simulation = lissajous_env.Simulation(scenario, 3)
    checkpoint.save(tmp_path, network, card)
    decide = open_rogue(tmp_path).decide
    still = np.zeros(simulation.action_shape, np.float32)
    for _ in range(5):
        simulation.step(still, np.zeros(simulation.rogues.action.shape, np.float32))
    rows = simulation.rogues.observation.numpy().astype(float)
    hidden = np.maximum(rows @ network.arrays["0.weight"].T.astype(float) + network.arrays["0.bias"], 0)
    wanted = np.clip(hidden @ network.arrays["1.weight"].T.astype(float) + network.arrays["1.bias"], -1, 1)
    assert np.abs(decide(simulation.rogues.observation.numpy()) - wanted).max() < 1e-4


def test_no_learned_rogue_outlasts_the_bound(trained, tmp_path):
    # Law: in each episode, the longest undetected time is at most the proved bound, for a trained and random networks.
    folder, _ = trained
    fields = {"task.contamination": (36, 16), "task.conservative": True, "task.grid": None, "targets.speed_limit": 0.3}
    many = {"targets.count": 20, "targets.arrival_rate": 20 / SMALL["task.duration"]}
    scenario = lissajous_env.scenario("experiment", **SMALL, **fields, **many)
    card = rogue_card(scenario)
    for k in range(3):
        checkpoint.save(tmp_path / str(k), make_network(len(card.inputs), k), card)
    for rogue in (folder, *tmp_path.iterdir()):
        for policy in ("still", "sweep"):
            played = lissajous_env.scenario(scenario, rogues=str(rogue))
            rows = lissajous_env.evaluate(baselines.make(policy, played, 6), played, range(6))
            assert all(row["detection_time_max"] <= row["guaranteed_detection_time"] + 1e-6 for row in rows)


def test_a_rogue_fits_scenarios_with_fewer_and_more_robots(tmp_path):
    # Law: entries of absent robots are zero, so a rogue acts the same without them; of more, the nearest count.
    card = rogue_card(lissajous_env.scenario("evaders"))
    network, size = make_network(len(card.inputs)), len(card.inputs)
    checkpoint.save(tmp_path, network, card)
    decide = open_rogue(tmp_path).decide
    rows = np.random.default_rng(0).normal(size=(1, 7, size + 14)).astype(np.float32)
    np.testing.assert_array_equal(decide(rows), decide(rows[..., :size]))
    rows[..., size - 14 :] = 0
    assert decide(rows[..., : size - 14]) == pytest.approx(decide(rows[..., :size]), abs=1e-5)
    checkpoint.save(tmp_path, make_network(2), dataclasses.replace(card, inputs=("present", "scent")))
    with pytest.raises(ValueError, match="must be the entries of a rogue's row in their order, got scent"):
        open_rogue(tmp_path)


def test_a_folder_is_named_like_a_script(trained, tmp_path, capsys, monkeypatch):
    # Story: the command line, Python and the trained rogue agree; a copy of the folder is the same rogue.
    folder, _ = trained
    overrides = [f"{name}={value}" for name, value in SMALL.items()]
    arguments = ("evaluate", "experiment", "sweep", "--episodes", 2, "--json", "--set", *overrides)
    code, out, error = called(capsys, *arguments, "--rogues", folder)
    assert code == 0, error
    rows = lissajous_env.evaluate(
        baselines.make("sweep", lissajous_env.scenario("experiment", **SMALL), 2), "experiment", range(2),
        rogues=str(folder), **SMALL,
    )  # fmt: skip
    times = [row["detection_time_mean"] for row in json.loads(out)["episodes"]]
    assert times == [row["detection_time_mean"] for row in rows]


def test_results_of_another_rogue_in_the_same_folder_are_refused(trained, tmp_path, capsys):
    # Story: a benchmark's folder contains episodes of a rogue; then other weights have the same path.
    folder, _ = trained
    network, card, _ = checkpoint.read(folder)
    mine = tmp_path / "mine"
    checkpoint.save(mine, network, card)
    arguments = ["benchmark", "--scenarios", "experiment", "--policies", "still", "--rogues", mine, "--out",
                 tmp_path / "out", "--replays", "0", "--set", "task.duration=4", "--episodes"]  # fmt: skip
    code, _, error = called(capsys, *arguments, 1)
    assert code == 0, error
    checkpoint.save(mine, make_network(network.inputs), card)
    code, _, error = called(capsys, *arguments, 2)
    assert code == 2
    assert "weights of the checkpoint" in error


def test_bad_input_is_refused_by_name(trained, capsys, tmp_path):
    folder, _ = trained
    with pytest.raises(ValueError, match=r"targets.rogues must be .* or a folder with checkpoint.safetensors, got"):
        lissajous_env.scenario("evaders", rogues=str(tmp_path))
    with pytest.raises(ValueError, match=r"rogues must be the folder of a rogue, got .*, which drives robots of kind"):
        lissajous_env.scenario("evaders", rogues=str(find("learned-watch")))
    with pytest.raises(ValueError, match=r"policy must drive robots, got .*, which drives rogues"):
        baselines.make(str(folder), "experiment")
    damaged = tmp_path / "damaged"
    damaged.mkdir()
    (damaged / checkpoint.FILE).write_text("{}")
    with pytest.raises(ValueError, match="must be an undamaged checkpoint"):
        lissajous_env.scenario("evaders", rogues=str(damaged))
    for arguments, words in (
        (("--side", "rogues"), "against must be the policy from which the rogues learn to hide, got none"),
        (("--against", "sweep"), "side must be rogues if options of rogues are given (against), got robots"),
        (("--side", "rogues", "--against", "sweep", "--heads", "1"), "heads must be omitted ... , set, got 1"),
        (("--side", "rogues", "--against", "swep"), "policy must be one of"),
    ):
        code, _, error = called(capsys, "train", *arguments, "--out", tmp_path / "run")
        assert code == 2
        assert all(part in error for part in words.split(" ... "))
    with pytest.raises(ValueError, match=r"targets.rogues must be omitted if rogues are trained"):
        RogueTraining(overrides={"rogues": "flee"})
