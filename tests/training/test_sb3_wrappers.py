"""Wrappers and algorithms of Stable-Baselines3 over the batch of worlds, as their users write them."""

import numpy as np
import pytest

import lissajous_env

pytest.importorskip("stable_baselines3")

from stable_baselines3 import DQN
from stable_baselines3.common.vec_env import VecVideoRecorder

from lissajous_env.envs.sides import action_table
from training.sb3 import ModelPolicy, RobotVecEnv, RogueVecEnv

SHORT = lissajous_env.scenario("experiment", **{"task.duration": 0.8})


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
