"""`RobotVecEnv` for Stable-Baselines3: rows are robots, and a time limit is not a terminal state."""

import warnings

import numpy as np
import pytest

import lissajous_env

pytest.importorskip("stable_baselines3")

import torch
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecCheckNan, VecEnv, VecMonitor, VecNormalize

from lissajous_env.envs.sides import action_table
from training.sb3 import ModelPolicy, RobotVecEnv


def make_env(name="intruders", worlds=3, **overrides):
    return RobotVecEnv(name, worlds, seed=0, **overrides)


def test_stable_baselines_checks_and_wrappers_pass():
    env = make_env(**{"task.duration": 1.0})
    assert isinstance(env, VecEnv)
    assert env.observation_space.shape == (42,)
    wrapped = VecNormalize(VecMonitor(VecCheckNan(env, raise_exception=True)))
    model = PPO("MlpPolicy", wrapped, n_steps=32, batch_size=96, n_epochs=1, device="cpu")
    model.learn(1000)
    assert len(model.ep_info_buffer) > 0
    assert all(info["l"] == 10 for info in model.ep_info_buffer)
    returns, lengths = evaluate_policy(model, wrapped, n_eval_episodes=30, return_episode_rewards=True, warn=False)
    assert set(lengths) == {10}
    assert np.isfinite(returns).all()
    assert env.env_is_wrapped(VecMonitor) == [False] * 15
    assert env.get_attr("num_envs", [0, 1]) == [15, 15]


def test_our_rows_are_bootstrapped_at_the_end_of_an_episode():
    # Oracle: by hand, no target ever comes, so every reward is 0, and with V = 10 and gamma 0.5 the returns
    # of the last three steps before the time limit are 5, 2.5, 1.25.
    quiet = {"targets.arrival_rate": 0.0, "targets.count": 0, "task.duration": 0.3, "task.reward_collision": 0.0}
    env = make_env(**quiet)
    model = PPO("MlpPolicy", env, n_steps=3, batch_size=45, gamma=0.5, gae_lambda=1.0, device="cpu")
    with torch.no_grad():
        model.policy.value_net.weight.zero_()
        model.policy.value_net.bias.fill_(10.0)
    _, callback = model._setup_learn(45)
    model.collect_rollouts(model.env, callback, model.rollout_buffer, 3)
    assert model.rollout_buffer.returns == pytest.approx(np.array([[1.25], [2.5], [5.0]]) * np.ones((1, 15)))


def test_episodes_are_reported_as_a_monitor_reports_them(tmp_path):
    # Oracle: the library's own VecMonitor around a batch of the same seed; cars are removed where they collide.
    changes = {"task.duration": 2.0, "task.on_collision": "remove", "robot.radius": 0.2, "formation.start": "random"}
    scenario = lissajous_env.scenario("failure", **changes)
    env, monitored = RobotVecEnv(scenario, 6, seed=1), VecMonitor(RobotVecEnv(scenario, 6, seed=1))
    draw, ended, early = np.random.default_rng(0), 0, 0
    assert (env.reset() == monitored.reset()).all()
    for _ in range(60):
        gone = env.simulation.terminated.numpy().reshape(-1).copy()
        actions = draw.uniform(-1, 1, (env.num_envs, 1))
        *_, infos = env.step(actions)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            *_, wanted = monitored.step(actions)
        for k, (info, other) in enumerate(zip(infos, wanted, strict=True)):
            # The monitor counts the steps after a robot was removed, too.
            assert ("episode" in info) == ("episode" in other and not gone[k])
            if "episode" in info:
                assert info["episode"]["l"] == other["episode"]["l"]
                assert info["episode"]["r"] == pytest.approx(other["episode"]["r"], abs=1e-5)
                assert info["episode"]["t"] > 0
                ended, early = ended + 1, early + (not info["TimeLimit.truncated"])
    assert ended > 60
    assert early > 0


def test_dqn_learns_on_the_rows_of_a_batch():
    # Oracle: the same actions as numbers.
    short = lissajous_env.scenario("experiment", **{"task.duration": 0.8})
    env = RobotVecEnv(short, 2, seed=0, discrete_actions=True)
    model = DQN("MlpPolicy", env, learning_starts=20, train_freq=2, seed=1).learn(100)
    env.seed(0)
    chosen, _ = model.predict(env.reset())
    env.step(chosen)
    for wrong in (chosen + 100, chosen.astype(float), chosen[:-1], chosen.astype(bool)):
        with pytest.raises(ValueError, match="action"):
            env.step(wrong)
    numbers = RobotVecEnv(short, 2, seed=0)
    env.seed(0)
    numbers.seed(0)
    assert env.reset().tobytes() == numbers.reset().tobytes()
    assert env.step(chosen)[0].tobytes() == numbers.step(action_table(short)[chosen])[0].tobytes()
    assert len(lissajous_env.evaluate(ModelPolicy(model, short), short, range(1))) == 1
