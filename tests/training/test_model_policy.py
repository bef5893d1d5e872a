"""Models trained with plain Stable-Baselines3, played as policies."""

import json
import pickle

import gymnasium
import numpy as np
import pytest
from command_line import called

import lissajous_env

pytest.importorskip("stable_baselines3")

from stable_baselines3 import DQN, PPO
from stable_baselines3.common.vec_env import VecNormalize

import training.sb3

SHORT = {"task.duration": 2.0}
FAST = {"n_steps": 8, "batch_size": 40, "n_epochs": 1, "device": "cpu"}


def short_scenario(name="experiment", **overrides):
    return lissajous_env.scenario(name, **SHORT | overrides)


def played_by_hand(model, env, worlds):
    """Score rows of an episode in each world of a `RobotVecEnv`, as Stable-Baselines3 itself plays a model."""
    env.seed(4)
    rows = env.reset()
    for _ in range(env.get_attr("scenario")[0].task.steps):
        rows, *_ = env.step(model.predict(rows, deterministic=True)[0])
    return list(env.get_attr("scores")[0])[-worlds:]


def by_policy(policy, scores):
    """The policy's score rows on the seeds of others."""
    return lissajous_env.evaluate(policy, policy.scenario, [score["seed"] for score in scores])


def same(rows, scores):
    """Return whether two lists of score rows agree in each episode, except in the name of the policy."""
    return [str({name: row[name] for name in score}) for row, score in zip(rows, scores, strict=True)] == [
        str(score) for score in scores
    ]


@pytest.mark.parametrize("name", ["experiment", "failure", "intruders"])
def test_a_model_of_rows_scores_as_where_it_was_trained(name):
    # Oracle: the environment that it was trained on, stepped with the model's own predict, on the same seeds. The
    # number of worlds is the same too: the last bit of a matrix product may depend on the number of its rows.
    env = training.sb3.RobotVecEnv(short_scenario(name), 3)
    model = PPO("MlpPolicy", env, seed=1, **FAST).learn(200)
    scores = played_by_hand(model, env, 3)
    policy = training.sb3.ModelPolicy(model, short_scenario(name), num_worlds=3)
    rows = by_policy(policy, scores)
    assert [row["policy"] for row in rows] == ["PPO"] * 3
    assert same(rows, scores)
    assert not same(rows[::-1], scores)


def test_normalised_rows_are_normalised_again():
    # Oracle: as above, behind the `VecNormalize` that the model was trained behind; and without it, another score.
    scenario = short_scenario()
    env = VecNormalize(training.sb3.RobotVecEnv(scenario, 3))
    model = PPO("MlpPolicy", env, seed=1, **FAST).learn(400)
    env.training = False
    scores = played_by_hand(model, env, 3)
    assert same(by_policy(training.sb3.ModelPolicy(model, scenario, 3, normalizer=env), scores), scores)
    assert not same(by_policy(training.sb3.ModelPolicy(model, scenario, 3), scores), scores)


@pytest.mark.parametrize("form", [{}, {"discrete_actions": True}])
def test_a_model_of_the_team_scores_as_where_it_was_trained(form):
    # Oracle: the Gymnasium environment of the team, stepped with the model's own predict, on the same seeds. One world
    # as there: a product of torch's matrices rounds by how many rows it has.
    env = gymnasium.make("lissajous_env:lissajous/experiment-v0", **SHORT, **form)
    model = PPO("MlpPolicy", env, seed=1, **FAST | {"batch_size": 8}).learn(16)
    policy = training.sb3.ModelPolicy(model, short_scenario())
    scores = []
    for seed in (3, 4):
        observation, over = env.reset(seed=seed)[0], False
        while not over:
            action, _ = model.predict(observation, deterministic=True)
            observation, _, terminated, truncated, _ = env.step(action)
            over = terminated or truncated
        scores.append(env.unwrapped.score())
    assert [score["seed"] for score in scores] == [3, 4]
    assert same(by_policy(policy, scores), scores)


class Recurrent:
    """Steers by how many steps it has seen of an episode, and says how many in `seen`."""

    observation_space = gymnasium.spaces.Box(-4.0, 4.0, (42,))
    action_space = gymnasium.spaces.Discrete(15)

    def predict(self, rows, state=None, episode_start=None, deterministic=False):
        before = np.zeros(len(rows), dtype=np.int64) if state is None else state[0]
        self.seen = np.where(episode_start, 0, before) + 1
        return self.seen % 15, (self.seen,)


def test_a_recurrent_model_of_rows_of_the_action_table():
    # Oracle: a count of the steps of each world's episode, and the table.
    model = Recurrent()
    policy = training.sb3.ModelPolicy(model, "experiment", 3)
    table = lissajous_env.envs.sides.action_table(policy.scenario)
    simulation = lissajous_env.Simulation("experiment", 3)
    for _ in range(4):
        policy.act(simulation.observation.numpy())
    policy.reset([1])
    acted = policy.act(simulation.observation.numpy())
    assert model.seen.tolist() == [5] * 5 + [1] * 5 + [5] * 5
    assert (acted[0] == table[5]).all()
    assert (acted[1] == table[1]).all()
    other = pickle.loads(pickle.dumps(policy))
    assert (other.act(simulation.observation.numpy())[:, 0] == table[[6, 2, 6]]).all()


def test_a_drawn_action_is_asked_for():
    env = training.sb3.RobotVecEnv("experiment", 2, seed=0)
    model = PPO("MlpPolicy", env, **FAST)
    seen = env.simulation.observation.numpy()
    drawn = training.sb3.ModelPolicy(model, "experiment", 2, deterministic=False)
    best = training.sb3.ModelPolicy(model, "experiment", 2)
    assert not (drawn.act(seen) == drawn.act(seen)).all()
    assert (best.act(seen) == best.act(seen)).all()


def box(*shape, most=1.0):
    return gymnasium.spaces.Box(-most, most, shape)


@pytest.mark.parametrize(
    ("rows", "actions", "words"),
    [
        (box(41), box(2), r"must be a Box of shape \(42,\), .* to play experiment, got \(41,\)"),
        (gymnasium.spaces.Dict({"a": box(42)}), box(2), r"observation_space of Model must be a Box .* got Dict"),
        (
            box(42),
            box(2, most=2.0),
            r"action_space of Model must be Box\(-1.0, 1.0, .* or Discrete\(15\) to play exper",
        ),
        (box(5, 42), box(2), r"or MultiDiscrete\(\[15 15 15 15 15\]\) to play experiment, got Box"),
    ],
)
def test_spaces_that_do_not_fit_are_refused_by_name(rows, actions, words):
    model = type("Model", (Recurrent,), {"observation_space": rows, "action_space": actions})()
    with pytest.raises(ValueError, match=words):
        training.sb3.ModelPolicy(model, "experiment")


@pytest.mark.parametrize("model", ["mine.zip", None, DQN])
def test_what_is_no_model_is_refused(model):
    with pytest.raises(ValueError, match=r"model must be a model of Stable-Baselines3, with .*, got"):
        training.sb3.ModelPolicy(model, "experiment")


MODULE = """
from stable_baselines3 import PPO

import training.sb3


def my_policy(scenario, num_worlds, device):
    return training.sb3.ModelPolicy(PPO.load("mine.zip"), scenario, num_worlds, device)
"""


def as_json(value):
    """A score as JSON has it: 12 digits, and null for what does not exist."""
    return value if isinstance(value, str) else None if value != value else pytest.approx(value, abs=1e-11)


def test_the_commands_play_a_model_of_ones_own(tmp_path, monkeypatch, capsys):
    # Oracle: the same model in Python; the command is called in the folder of the module and the model alone.
    model = PPO("MlpPolicy", training.sb3.RobotVecEnv("experiment", 2, seed=0), seed=1, **FAST).learn(80)
    model.save(tmp_path / "mine.zip")
    (tmp_path / "my_module.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    options = ("--episodes", 3, "--set", "task.duration=2", "--json")
    code, printed, errors = called(capsys, "evaluate", "experiment", "my_module:my_policy", *options)
    assert code == 0, errors
    policy = training.sb3.ModelPolicy(PPO.load(tmp_path / "mine.zip"), short_scenario(), num_worlds=3)
    for row, score in zip(
        lissajous_env.evaluate(policy, short_scenario(), range(3)), json.loads(printed)["episodes"], strict=True
    ):
        assert score.pop("policy") == "my_module:my_policy"
        assert len(score) > 20
        assert score == {name: as_json(row[name]) for name in score}
