"""Training on a space of scenarios: it resumes bit-identically, and evaluations play scenarios of another split."""

import json

import numpy as np
import pytest
from rich.console import Console

pytest.importorskip("stable_baselines3")

from test_mixed_vec_env import SPACE

import lissajous_env
import training
from baselines.policies.registry import make
from lissajous_env import ScenarioSpace, Simulation
from training import scenarios
from training.learned import checkpoint
from training.learned.card import CONSTANTS, Card, constants_of
from training.learned.history import RELATIVE, History, summarize_scenarios
from training.learned.network import Network
from training.learned.policy import Learned
from training.sb3 import MixedVecEnv
from training.sb3.trainer import Trainer, train
from training.settings import TrainingSettings

QUIET = Console(quiet=True)
FILE = """
base = "intruders"
require = ["clusters == 1"]
[draw.curve]
choices = [{a = 1, b = 2}, {a = 3, b = 2}]
half_height = "uniform(0.8, 1.6)"
[draw.targets]
count = 3
[draw.task]
duration = 0.5
[draw.scale]
length = "uniform(0.5, 2.0)"
time = "uniform(0.5, 2.0)"
"""
SMALL = {
    "worlds": 4, "groups": 2, "rollout": 4, "batch_size": 64, "steps": 300, "evaluate_every": 100, "layers": (4,),
    "evaluation_scenarios": 2, "evaluation_episodes": 2, "threads": 1, "base": "still", "rivals": ("sweep",),
}  # fmt: skip


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(FILE)
    return str(path)


def small(file, tmp_path, **changes):
    return TrainingSettings(**SMALL | {"scenario": file, "out": tmp_path / "run"} | changes)


def test_a_space_is_told_from_a_scenario(file, tmp_path):
    other = tmp_path / "one.toml"
    other.write_text('base = "evaders"\n[curve]\nhalf_width = 3.0\n')
    names = {"monitoring-v1": "monitoring-v1", "monitoring-v1-larger": "monitoring-v1-larger", file: "small"}
    assert {name: scenarios.space_of(name).name for name in names} == names
    assert [scenarios.space_of(name) for name in ("evaders", "monitoring-v1-3", str(other))] == [None, None, None]


@pytest.mark.parametrize("name", ["monitoring-v1", "FILE"])
def test_one_scenario_is_asked_of_what_plays_one(name, file):
    name = file if name == "FILE" else name
    with pytest.raises(ValueError, match=r"scenario must be a single scenario, got the space .*; choose one of"):
        lissajous_env.scenario(name)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"base": "none", "teacher": "sweep"}, "teacher must be none for a space of scenarios"),
        ({"short": 0.5}, "short must be 0 for a space of scenarios"),
        ({"worlds": 5}, r"worlds must be a multiple of groups \(2\) for a space of scenarios .*, got 5"),
        ({"scenario": "monitoring-v1:test"}, "scenario must be the name of a space without a split"),
        ({"overrides": {"curve": 1.0}}, "override curve must be a mapping or a Curve"),
        ({"overrides": {"curve.halfwidth": 1.0}}, "override must name a field of curve"),
    ],
)
def test_settings_for_one_scenario_are_refused_for_a_space(file, tmp_path, changes, words):
    with pytest.raises(ValueError, match=words):
        small(file, tmp_path, **changes)


def test_a_network_starts_at_the_output_that_is_given(file, tmp_path):
    # Oracle: the settings. With such a learning rate it hardly moves.
    settings = small(file, tmp_path, steps=20, learning_rate=1e-9, initial_output=(-0.25, 0.5), rivals=())
    train(settings, QUIET)
    network = checkpoint.read(settings.out)[0]
    assert network.biases[-1] == pytest.approx([-0.25, 0.5])
    with pytest.raises(ValueError, match="initial_output must be 2 numbers"):
        small(file, tmp_path, initial_output=(0.5,))


def test_the_splits_of_learning_and_evaluation_share_no_scenario(file, tmp_path):
    settings = small(file, tmp_path)
    env = MixedVecEnv(settings.space, 2, 1, scenarios.LEARNED, change=settings.change_drawn)
    env.reset()
    learned = set()
    for _ in range(7):
        learned |= {made.name for made in env.scenarios}
        env.step(np.zeros((env.num_envs, 2)))
    assert len(learned) == 4
    assert not learned & {made.name for made in settings.make_evaluation_scenarios()}


def test_a_restored_batch_goes_on_as_the_one_that_was_saved():
    # Oracle: the batch that was not interrupted. The first episode is over when it is saved.
    card = Card.of(SPACE.sample(0), base="sweep", constants=tuple(CONSTANTS))
    made = [MixedVecEnv(SPACE, 2, 2, central=True, card=card, staggered=True) for _ in range(2)]
    rng = np.random.default_rng(0)
    actions = [rng.uniform(-1, 1, (made[0].num_envs, 2)).astype(np.float32) for _ in range(24)]
    made[0].reset()
    for each in actions[:13]:
        made[0].step(each)
    made[1].load_state(made[0].save_state())
    assert made[1].scenarios == made[0].scenarios
    for each in actions[13:]:
        one, other = (env.step(each)[:3] for env in made)
        for mine, theirs in zip(one, other, strict=True):
            assert (mine == theirs).all()
    with pytest.raises(ValueError, match="state must be that of 1 groups, got 2"):
        MixedVecEnv(SPACE, 1, 2).load_state(made[0].save_state())


def test_constants_do_not_depend_on_the_units(file):
    made = lissajous_env.scenario("monitoring-v1-3")
    names = tuple(CONSTANTS)
    assert constants_of(made.scaled(8.0, 0.25), names) == pytest.approx(constants_of(made, names))
    assert 0 <= constants_of(made, names).min() <= constants_of(made, names).max() <= 4


def test_constants_are_inputs_that_do_not_change():
    # Oracle: the network with the constants among its inputs, in NumPy.
    rng, made = np.random.default_rng(0), lissajous_env.scenario("monitoring-v1-3")
    card = Card.of(made, constants=("team", "pace"))
    weights = [rng.normal(0, 0.1, (5, card.network_inputs)), rng.normal(0, 0.1, (2, 5))]
    network = Network(tuple(weights), (rng.normal(size=5), np.zeros(2)))
    seen = Simulation(made, 2, seed=1).observation.numpy()
    constants = np.broadcast_to(constants_of(made, card.constants), (*seen.shape[:2], 2))
    inputs = np.concatenate([seen, constants], axis=2)
    wanted = np.maximum(inputs @ weights[0].T + network.biases[0], 0) @ weights[1].T
    assert np.abs(Learned(network, card, made, 2).act(seen) - wanted.clip(-1, 1)).max() < 1e-5
    assert Card.from_dict(json.loads(json.dumps(card.to_dict())), {}, card.home).constants == card.constants
    with pytest.raises(ValueError, match="constants must be some of team"):
        Card.of(made, constants=("weather",))


def test_an_interrupted_training_on_a_space_ends_with_the_same_weights(file, tmp_path, monkeypatch):
    # Oracle: the run that was not interrupted, on one thread. Groups have changed their scenarios before and after.
    whole = small(file, tmp_path, out=tmp_path / "whole", evaluate_every=1000)
    train(whole, QUIET)
    cut, observe = small(file, tmp_path, out=tmp_path / "cut", evaluate_every=1000), Trainer.observe_update

    def stopped(trainer):
        trainer.stopping = trainer.history.steps >= 150
        observe(trainer)

    monkeypatch.setattr(Trainer, "observe_update", stopped)
    with pytest.raises(KeyboardInterrupt, match="are saved in"):
        train(cut, QUIET)
    assert 0 < checkpoint.read_text(cut.out)["counters"]["steps"] < whole.steps
    monkeypatch.undo()
    train(cut, QUIET)
    one, other = (checkpoint.read_text(settings.out) for settings in (whole, cut))
    assert one["files"] == other["files"]
    assert [point["scenarios"] for point in one["curve"]] == [point["scenarios"] for point in other["curve"]]


def test_a_trained_policy_drives_other_teams_and_is_compared_scenario_by_scenario(file, tmp_path):
    settings = small(file, tmp_path, steps=100)
    history = train(settings, QUIET)
    played = [made.name for made in settings.make_evaluation_scenarios()]
    assert list(history.curve[-1]["scenarios"]) == list(history.rivals["sweep"]["scenarios"]) == played
    assert history.rivals["sweep"][RELATIVE] == pytest.approx(1.0)
    for name in ("evaders", "monitoring-v1-larger-0"):
        policy = training.load(settings.out / "best", name)
        seen = Simulation(name).observation.numpy()
        assert np.isfinite(policy.act(seen)).all()
    assert training.load(settings.out / "best").scenario.name == played[0]
    page = (settings.out / "report.html").read_text(encoding="utf-8")
    assert all(name in page for name in played)
    assert make(str(settings.out / "best-safe"), "evaders").name.endswith("best-safe")


def test_a_changed_space_is_another_training(file, tmp_path):
    train(small(file, tmp_path, steps=100), QUIET)
    with open(file, "a") as text:
        text.write("[draw.sensing]\nradius = 0.61\n")
    with pytest.raises(ValueError, match="space of scenarios has changed"):
        train(small(file, tmp_path), QUIET)


def test_the_geometric_mean_does_not_depend_on_units_and_decides_what_is_best():
    # By hand: twice as fast in one scenario, half as fast in another.
    rival = {"a": _scores(1.0), "b": _scores(8.0), "c": _scores(None)}
    ours = {"a": _scores(0.5), "b": _scores(16.0), "c": _scores(3.0)}
    assert summarize_scenarios(ours, rival)[RELATIVE] == pytest.approx(1.0)
    slower = {"a": _scores(0.5), "b": _scores(17.0), "c": _scores(3.0)}
    history = History(rivals={"rival": summarize_scenarios(rival, rival)})
    points = [{"steps": k} | summarize_scenarios(each, rival) for k, each in enumerate((slower, ours, slower))]
    assert [history.add(point) for point in points] == [True, True, False]


def _scores(detection):
    return {"detection_time": detection, "collisions": 0.0, "return": 0.0, "detected_fraction": 1.0}


def test_waiting_counts_relative_to_the_reference():
    # Law: a scenario in other units, or with another weight of waiting, is learned with the same penalty.
    made = scenarios.leaner(SPACE.sample(0))
    changes = {"task.duration": 30.0, "task.reward_waiting": -0.3}
    one = scenarios.in_units_of("sweep", lissajous_env.scenario(made, **changes), "cpu")
    other = scenarios.in_units_of(
        "sweep", lissajous_env.scenario(made, **changes | {"task.reward_waiting": -7.0}), "cpu"
    )
    scaled = scenarios.in_units_of("sweep", lissajous_env.scenario(made, **changes).scaled(2.0, 4.0), "cpu")
    assert one.task == other.task
    assert one.task.reward_waiting < 0 == one.task.reward_detection
    assert scaled.task.reward_waiting == pytest.approx(one.task.reward_waiting / 4.0)
    unpaid = lissajous_env.scenario(made, **{"task.reward_waiting": 0.0, "task.reward_detection": 0.0})
    assert scenarios.in_units_of("sweep", unpaid, "cpu") is unpaid


def test_a_space_of_points_has_the_papers_method_as_its_base():
    space = ScenarioSpace("points", lissajous_env.scenario("failure"), {"curve": {"half_width": "uniform(1.0, 2.0)"}})
    lissajous_env.register_scenario_space(space)
    settings = TrainingSettings("points")
    assert (settings.chosen_base, settings.chosen_rivals, settings.imitated) == ("kuramoto", ("kuramoto",), None)
    cars = TrainingSettings("monitoring-v1", evaluation_scenarios=1)
    assert [TrainingSettings("monitoring-v1", worlds=k).num_groups for k in (4, 64, 100)] == [4, 32, 25]
    assert (cars.chosen_base, cars.chosen_rivals, cars.num_worlds) == ("sweep", ("kuramoto-mpcc",), 512)
