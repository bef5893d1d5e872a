"""The PettingZoo environment: its library's checkers, and properties that these do not check.

The checkers compare one step only and pass NaN and observations outside their space; so a bitwise repeat of whole
episodes, containment and finiteness are tested here.
"""

import pickle

import numpy as np
import pytest
from pettingzoo.test import api_test, parallel_api_test

import lissajous_env
from lissajous_env.world.tally import TERMS

SHORT = {"task.duration": 3.0}
CRASHING = {"task.on_collision": "remove", "robot.radius": 0.2, "formation.start": "random"}
KINDS = {
    "default": {},
    "removing": CRASHING,
    "rough": {"scenario": "rough", "task.duration": 10.0},
    "discrete messages": {"scenario": "failure", "messages.size": 4, "discrete_actions": True},
}
EVERY_KIND = pytest.mark.parametrize("kind", KINDS)


def make(kind, **settings):
    return lissajous_env.parallel_env(**{**KINDS[kind], **settings})


# Bodies are too large for (6), on purpose.
pytestmark = pytest.mark.filterwarnings("error", "ignore::lissajous_env.parameters.assumptions.AssumptionWarning")


@EVERY_KIND
def test_the_checkers_of_pettingzoo(kind):
    parallel_api_test(make(kind, **SHORT), num_cycles=100)
    api_test(lissajous_env.env(**KINDS[kind] | SHORT), num_cycles=100)


def episode(env, seed, steps=300):
    """Return the results of the reset and of each step, and the actions, which depend on the seed alone."""
    draw = np.random.default_rng(seed)
    returned = [env.reset(seed=seed)]
    for _ in range(steps):
        if not env.agents:
            break
        if env.batch.sides[0].table is not None:
            actions = {agent: int(draw.integers(env.action_space(agent).n)) for agent in env.agents}
        else:
            actions = {agent: draw.uniform(-1, 1, env.action_space(agent).shape) for agent in env.agents}
        returned.append(env.step(actions))
    return returned


@EVERY_KIND
def test_an_episode_repeats_bit_for_bit_and_stays_in_its_spaces(kind):
    # Oracle: the same again, in the same environment and in another, to the last bit; the spaces themselves.
    env, other = make(kind), make(kind)
    first, again, elsewhere = episode(env, 5), episode(env, 5), episode(other, 5)
    assert pickle.dumps(first) == pickle.dumps(again) == pickle.dumps(elsewhere)
    assert pickle.dumps(first) != pickle.dumps(episode(other, 6))
    assert len(first) > 2
    for observations, *rest in first:
        for agent, row in observations.items():
            assert env.observation_space(agent).contains(row)
            assert np.isfinite(row).all()
        if len(rest) == 4:
            rewards, terminated, truncated, infos = rest
            assert all(list(part) == list(observations) for part in (rewards, terminated, truncated, infos))
            for agent, info in infos.items():
                assert list(info) == ["reward_terms"]
                assert info["reward_terms"].shape == (len(TERMS),)
                assert rewards[agent] == pytest.approx(info["reward_terms"].sum(), abs=1e-5)
            assert all(type(value) is float for value in rewards.values())
            assert all(type(value) is bool for flags in (terminated, truncated) for value in flags.values())


def test_actions_too_large_for_float32_are_clipped():
    # Oracle: the end of the range that they lie beyond.
    env, other = make("default"), make("default")
    env.reset(seed=1)
    other.reset(seed=1)
    far = env.step({agent: np.array([1e300, -1e300]) for agent in env.agents})
    near = other.step({agent: np.array([1.0, -1.0]) for agent in other.agents})
    assert pickle.dumps(far) == pickle.dumps(near)
