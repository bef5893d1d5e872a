"""Copies of batches in mid-episode continue like the original, bit for bit; those of adapters are among their laws.

The oracle is the original itself, which had taken steps before it was copied: what is built by the first step, such as
recorded launches, is not in what has just been made.
"""

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import baselines
import lissajous_env

pytest.importorskip("stable_baselines3")

from training.sb3.vec_env import RobotVecEnv

SHORT = {"task.duration": 1.5}
SPACE = "monitoring-v1"


def simulation(scenario, worlds, threads):
    return lissajous_env.Simulation(lissajous_env.scenario(scenario, **SHORT), worlds, "cpu", 2, threads)


MADE: dict[str, Callable[[int], Any]] = {
    "simulation": lambda threads: simulation("intruders", 6, threads),
    "crowd": lambda threads: simulation("swarm", 1, threads),
    "batch": lambda threads: lissajous_env.Batch(SPACE, 6, num_groups=3, seed=2, threads=threads),
    "batch of one group": lambda threads: lissajous_env.Batch(SPACE, 2, seed=2, threads=threads),
    "rows": lambda threads: RobotVecEnv("intruders", 3, threads=threads, **SHORT),
}  # fmt: skip


def advance(env, step):
    """Take a step with drawn actions, after which an episode that is over begins anew; return its results as text."""
    draw = np.random.default_rng(step)
    with np.printoptions(threshold=np.inf, floatmode="unique"):
        if isinstance(env, lissajous_env.Batch):
            (side,) = env.sides
            shape = env.num_worlds, side.slots, side.action_size
            env.step({side.agent: draw.uniform(-1, 1, shape).astype(np.float32)})
            result = [np.array(array) for array in env.rows(side)] + [str(env.score(np.ones(len(env.over), bool)))]
            env.reset(env.over)
            return repr(result)
        if isinstance(env, lissajous_env.Simulation):
            env.step(draw.uniform(-1, 1, env.action_shape).astype(np.float32))
            result = [np.array(array) for array in (env.over, env.reward, env.observation)] + [str(env.score())]
            if np.any(env.over):
                env.reset(np.flatnonzero(env.over))
            return repr(result)
        result = env.step(draw.uniform(-1, 1, (env.num_envs, *env.action_space.shape)).astype(np.float32))
        for info in result[3]:
            info.get("episode", {}).pop("t", None)  # the time of the day
        return repr(result)


@pytest.mark.parametrize("name", MADE)
def test_a_copy_after_steps_continues_like_the_original(name):
    env = MADE[name](2)
    if not isinstance(env, lissajous_env.Simulation):
        env.reset()
    for step in range(5):
        advance(env, step)
    twin, again = pickle.loads(pickle.dumps(env)), copy.deepcopy(env)
    expected = [advance(env, step) for step in range(5, 20)]
    assert len(set(expected)) > 7
    assert [advance(twin, step) for step in range(5, 20)] == expected
    assert advance(again, 5) == expected[0]


class Recalling(baselines.Policy):
    """Its memory begins as None and then is a view; other arrays cannot be written to."""

    def __init__(self, *given):
        super().__init__(*given)
        self.last, self.begun = None, np.broadcast_to(0.1, self.action.shape)
        self.parts = [self.scenario.equilibrium, self.action]

    def decide(self, observation):
        self.last = (0.5 * (self.begun if self.last is None else self.last) + observation[..., :2])[:, :]
        return self.last


def test_a_policy_with_views_and_constants_is_copied_in_mid_episode():
    policy, rows = Recalling("experiment", 2), simulation("experiment", 2, 1).observation
    first = policy.act(rows).numpy().tolist()
    copies = copy.deepcopy(policy), copy.copy(policy), pickle.loads(pickle.dumps(policy))
    second = policy.act(rows).numpy().tolist()
    assert [twin.act(rows).numpy().tolist() for twin in copies] == [second] * 3 != [first] * 3
