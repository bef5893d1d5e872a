"""The examples of trainings in other libraries: each iteration changes the policy, which can be evaluated."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

import lissajous_env  # noqa: E402

SHORT = lissajous_env.scenario("watch", **{"task.duration": 8.0})


def with_memory(iterations):
    pytest.importorskip("sb3_contrib")
    from sb3_recurrent import train

    from training.sb3 import ModelPolicy

    return ModelPolicy(train(SHORT, iterations * 2 * 5 * 4, worlds=2, horizon=4), SHORT, 2)


def in_one_file(iterations):
    from cleanrl_ppo import train

    return train(SHORT, iterations * 2 * 5 * 4, worlds=2, horizon=4)


def from_parts(iterations):
    pytest.importorskip("torchrl")
    from torchrl_ppo import train

    from training.torchrl import ModulePolicy

    return ModulePolicy(train(SHORT, iterations, worlds=2, horizon=4), SHORT, 2)


@pytest.mark.filterwarnings("ignore:Creating .*WeightUpdater:DeprecationWarning")
@pytest.mark.parametrize("example", [with_memory, in_one_file, from_parts])
def test_each_iteration_changes_the_policy(example):
    # Oracle: the actions of both for the same rows; the third iteration begins after the ends of the episodes.
    seen = lissajous_env.Simulation(SHORT, 2).observation.numpy()
    first, later = example(1), example(3)
    actions = [policy.act(seen) for policy in (first, later)]
    assert actions[0].shape == actions[1].shape == (2, 5, 2)
    assert np.isfinite(actions).all()
    assert (actions[0] != actions[1]).any()
    rows = lissajous_env.evaluate(later.act if example is in_one_file else later, SHORT, range(2))
    assert [row["seed"] for row in rows] == [0, 1]


def test_advantages_are_those_of_stable_baselines():
    # Oracle: the library's rollout buffer.
    buffers = pytest.importorskip("stable_baselines3.common.buffers")
    from cleanrl_ppo import GAMMA, LAMBDA, advantages
    from gymnasium.spaces import Box

    rewards, values = torch.rand(2, 6, 3)
    dones, last = (torch.rand(6, 3) < 0.3).float(), torch.rand(3)
    buffer = buffers.RolloutBuffer(6, Box(-1, 1, (1,)), Box(-1, 1, (1,)), "cpu", LAMBDA, GAMMA, 3)
    buffer.rewards, buffer.values = rewards.numpy(), values.numpy()
    buffer.episode_starts[1:] = dones[:-1]  # of the row after an end
    buffer.compute_returns_and_advantage(last, dones[-1].numpy())
    np.testing.assert_allclose(advantages(rewards, values, dones, last), buffer.advantages, atol=1e-5)
