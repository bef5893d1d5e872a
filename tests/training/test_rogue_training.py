"""Rogues trained with Stable-Baselines3: one row per rogue, robots driven by any policy."""

import warnings

import numpy as np
import pytest

import baselines
import lissajous_env

pytest.importorskip("stable_baselines3")

from stable_baselines3 import DQN, PPO
from stable_baselines3.common.vec_env import VecCheckNan, VecMonitor

from lissajous_env.envs.sides import rogue_table
from training.sb3 import RobotVecEnv, RogueVecEnv

pytestmark = pytest.mark.usefixtures("one_thread")
FEW = {"targets.count": 3, "targets.arrival_rate": 0.0, "targets.entry": "unseen", "sensing.radius": 0.4}
SHORT = FEW | {"task.duration": 4.0}


def test_discrete_actions_are_rows_of_the_table():
    # Oracle: the same environments with the actions of the table. Story: DQN learns from these rows.
    chosen = RogueVecEnv("experiment", 2, "still", seed=5, discrete_actions=True, **SHORT)
    plain, draw = RogueVecEnv("experiment", 2, "still", seed=5, **SHORT), np.random.default_rng(0)
    assert chosen.action_space.n == len(rogue_table()) == 9
    assert (chosen.reset() == plain.reset()).all()
    for _ in range(50):
        indices = draw.integers(9, size=6)
        by_index, by_row = chosen.step(indices), plain.step(rogue_table()[indices])
        assert all((one == other).all() for one, other in zip(by_index[:3], by_row[:3], strict=True))
    assert len(chosen.scores) > 0
    DQN("MlpPolicy", chosen, learning_starts=60, buffer_size=600).learn(120)
    for wrong, words in (([0] * 5, r"whole numbers of shape \(6,\)"), ([0.0] * 6, "whole numbers"),
                         ([0, 9, 0, 0, 0, 0], "rogue_1 in world 0 must be a whole number .*, got 9"),
                         ([0, 0, 0, 0, -1, 0], "rogue_1 in world 1 must be a whole number .*, got -1")):  # fmt: skip
        with pytest.raises(ValueError, match=words):
            chosen.step(np.array(wrong))


def test_returns_are_detection_times():
    # Oracle: the score of the simulation, over the rogues that acted.
    env = RogueVecEnv("experiment", 1, "still", seed=1, **SHORT)
    env.reset()
    returns = []
    while not env.scores:
        *_, infos = env.step(np.zeros((3, 2)))
        returns += [info["episode"]["r"] for info in infos if "episode" in info]
    assert np.mean(returns) == pytest.approx(env.scores[0]["detection_time_mean"], abs=1e-3)


def test_ppo_trains_both_sides_in_turn_within_the_proved_bound():
    # Story: rogues learn against robots, then robots against these rogues; no rogue outlasts the proved bound.
    bounded = SHORT | {"task.contamination": (36, 16), "task.conservative": True}
    rogues = RogueVecEnv("experiment", 8, "sweep", seed=0, **bounded)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "The environment is already wrapped")
        model = PPO("MlpPolicy", VecCheckNan(VecMonitor(rogues), raise_exception=True), n_steps=40, batch_size=240)
        before = [p.detach().clone() for p in model.policy.parameters()]
        model.learn(3 * 40 * rogues.num_envs)
    assert any((p != q).any() for p, q in zip(before, model.policy.parameters(), strict=True))

    @lissajous_env.rogue("learned-here")
    def act(rows):
        return model.predict(rows.reshape(-1, rows.shape[-1]), deterministic=True)[0].reshape(*rows.shape[:2], 2)

    robots = RobotVecEnv("experiment", 4, seed=0, rogues="learned-here", **SHORT)
    PPO("MlpPolicy", robots, n_steps=20, batch_size=100).learn(2 * 20 * robots.num_envs)
    scenario = lissajous_env.scenario("experiment", rogues="learned-here", **bounded)
    scores = lissajous_env.evaluate(baselines.make("sweep", scenario, 8), scenario, seeds=range(8))
    for score in [*rogues.scores, *scores]:
        assert score["detection_time_max"] <= score["guaranteed_detection_time"] + 1e-6
