"""Wrappers and algorithms of Stable-Baselines3 over the batch of worlds, as their users write them."""

import gymnasium
import numpy as np
import pytest

import lissajous_env

pytest.importorskip("stable_baselines3")

from stable_baselines3 import DQN, PPO
from stable_baselines3.common.vec_env import VecFrameStack, VecNormalize, VecVideoRecorder
from stable_baselines3.common.vec_env.dummy_vec_env import DummyVecEnv

from lissajous_env.envs.sides import action_table
from training.sb3 import ModelPolicy, RobotVecEnv, RogueVecEnv

SHORT = lissajous_env.scenario("experiment", **{"task.duration": 0.8})
FAST = {"n_steps": 8, "batch_size": 20, "n_epochs": 1}


def team(flat_actions, discrete_actions=False):
    def make():
        env = lissajous_env.LissajousEnv(SHORT, flat_actions=flat_actions, discrete_actions=discrete_actions)
        return gymnasium.wrappers.FlattenObservation(env) if flat_actions else env

    return DummyVecEnv([make])


def played_by_hand(model, env, worlds, steps=8):
    """Actions (steps, worlds, N, size) of the model where it was trained."""
    env.seed(3)
    rows, actions = env.reset(), []
    for _ in range(steps):
        chosen, _ = model.predict(rows, deterministic=True)
        actions.append(chosen)
        rows, *_ = env.step(chosen)
    return np.reshape(actions, (steps, worlds, 5, -1))


STACKS = {
    "as many rows as robots": lambda: VecFrameStack(RobotVecEnv(SHORT, 2), 5),
    "normalized before": lambda: VecFrameStack(VecNormalize(RobotVecEnv(SHORT, 2)), 3),
    "discrete": lambda: VecFrameStack(RobotVecEnv(SHORT, 2, discrete_actions=True), 4),
    "flat team": lambda: VecFrameStack(team(True), 3),
}


@pytest.mark.parametrize("name", STACKS)
def test_a_model_of_stacked_rows_acts_as_where_it_was_trained(name):
    # Oracle: the wrapper itself, over two episodes; the policy is reset between them.
    env = STACKS[name]()
    model = PPO("MlpPolicy", env, seed=1, **FAST).learn(80)
    normalizer = model.get_vec_normalize_env()
    if normalizer is not None:
        normalizer.training = False
    worlds = 1 if "team" in name else 2
    env = model.get_env()
    expected = played_by_hand(model, env, worlds, steps=8)
    policy = ModelPolicy(model, SHORT, worlds, normalizer=normalizer)
    simulation = lissajous_env.Simulation(SHORT, worlds)
    for _ in range(2):
        # The rows of a world share the seed of the first of them.
        rows = simulation.reset(seeds=[3] if worlds == 1 else [3, 8])
        policy.reset()
        for actions in expected:
            acted = policy.act(rows.numpy())
            table = action_table(SHORT)
            wanted = table[actions[..., 0]] if name == "discrete" else np.clip(actions, -1, 1)
            np.testing.assert_allclose(acted, wanted, atol=1e-6)
            rows = simulation.step(acted)[0]


def test_stacked_teams_are_told_from_stacked_rows():
    # Story: five rows of one robot are as long as a row of the team of five; the size of the actions decides.
    def model(rows, actions):
        box = gymnasium.spaces.Box
        spaces = {"observation_space": box(-1, 1, rows), "action_space": box(-1, 1, actions)}
        return type(
            "Model", (), spaces | {"predict": lambda self, seen, **more: (np.zeros((len(seen), *actions)), None)}
        )()

    inputs = RobotVecEnv(SHORT).observation_space.shape[0]
    seen = np.zeros((2, 5, inputs), np.float32)
    for rows, actions in [
        ((5 * inputs,), (2,)),
        ((5 * inputs,), (10,)),
        ((5, 3 * inputs), (5, 2)),
        ((15, inputs), (10,)),
    ]:
        assert ModelPolicy(model(rows, actions), SHORT, 2).act(seen).shape == (2, 5, 2)
    with pytest.raises(ValueError, match="or of several of them stacked"):
        ModelPolicy(model((inputs + 1,), (2,)), SHORT)


def test_dqn_learns_on_the_rows_of_a_batch():
    # Oracle: the same actions as numbers.
    env = RobotVecEnv(SHORT, 2, seed=0, discrete_actions=True)
    model = DQN("MlpPolicy", env, learning_starts=20, train_freq=2, seed=1).learn(100)
    env.seed(0)
    chosen, _ = model.predict(env.reset())
    env.step(chosen)
    for wrong in (chosen + 100, chosen.astype(float), chosen[:-1], chosen.astype(bool)):
        with pytest.raises(ValueError, match="action"):
            env.step(wrong)
    numbers = RobotVecEnv(SHORT, 2, seed=0)
    env.seed(0)
    numbers.seed(0)
    assert env.reset().tobytes() == numbers.reset().tobytes()
    assert env.step(chosen)[0].tobytes() == numbers.step(action_table(SHORT)[chosen])[0].tobytes()
    assert len(lissajous_env.evaluate(ModelPolicy(model, SHORT), SHORT, range(1))) == 1


@pytest.mark.parametrize("make", [RobotVecEnv, RogueVecEnv], ids=["robots", "rogues"])
def test_the_recorder_of_videos(make, tmp_path):
    pytest.importorskip("moviepy")
    env = make(SHORT, 4, seed=0, render_mode="rgb_array")
    pictures = env.get_images()
    assert len(pictures) == 4
    assert env.render().shape[0] >= pictures[0].shape[0]
    env = VecVideoRecorder(env, str(tmp_path), lambda step: step == 0, video_length=3)
    env.reset()
    for _ in range(5):
        env.step(np.zeros((env.num_envs, 2)))
    env.close()
    assert [file.stat().st_size > 1000 for file in tmp_path.iterdir()] == [True]


def test_render_modes_that_a_batch_does_not_have_are_refused():
    with pytest.raises(ValueError, match="render_mode must be None or rgb_array, got 'human'"):
        RobotVecEnv(SHORT, render_mode="human")
