"""RLlib with two modules: RLlib's own check of the environment, and PPO that trains both sides."""

import logging

import numpy as np
import pytest

ray = pytest.importorskip("ray")
pytest.importorskip("ray.rllib")

from ray.rllib.utils.pre_checks.env import check_multiagent_environments  # noqa: E402

from training.rllib import (  # noqa: E402
    LissajousMultiAgentEnv,
    policy_mapping_fn,
    two_sided_config,
)

FEW = {"targets.count": 2, "targets.arrival_rate": 1.0, "targets.entry": "unseen", "sensing.radius": 0.4}
SHORT = FEW | {"task.duration": 3.0}


def test_rllibs_check_passes_and_agents_come_and_go():
    # Oracle: RLlib's contract checker; then an episode in which a rogue appears only once it may act.
    env = LissajousMultiAgentEnv({"scenario": "experiment", "rogues": "agents", **SHORT})
    check_multiagent_environments(env)
    draw = np.random.default_rng(0)
    observations, _ = env.reset(seed=1)
    over, appeared = False, 0
    while not over:
        acted = set(env.agents)
        given = {agent: draw.uniform(-1, 1, 2).astype(np.float32) for agent in acted}
        observations, rewards, terminated, truncated, _ = env.step(given)
        assert rewards.keys() == acted == terminated.keys() - {"__all__"}
        appeared += len(observations.keys() - acted)
        over = terminated["__all__"] or truncated["__all__"]
    assert appeared > 0
    assert truncated["__all__"]


def test_each_side_has_its_module():
    assert policy_mapping_fn("robot_3") == "robots"
    assert policy_mapping_fn("rogue_12", None) == "rogues"
    with pytest.raises(ValueError, match="agent must be a robot or a rogue, got 'other_1'"):
        policy_mapping_fn("other_1")


def test_ppo_trains_both_modules():
    # Oracle: the weights of both modules change and stay finite.
    logging.getLogger("ray.rllib").setLevel(logging.ERROR)
    config = two_sided_config("experiment", **SHORT)
    config.env_runners(num_env_runners=0, rollout_fragment_length=30)
    config.training(train_batch_size_per_learner=60, minibatch_size=60, num_epochs=2)
    algorithm = config.build_algo()
    try:

        def weights():
            states = algorithm.get_weights()
            return {name: np.concatenate([np.ravel(array) for array in states[name].values()]) for name in states}

        before = weights()
        for _ in range(2):
            algorithm.train()
        after = weights()
        for name in ("robots", "rogues"):
            assert np.isfinite(after[name]).all()
            assert not np.array_equal(before[name], after[name])
    finally:
        algorithm.stop()
        ray.shutdown()
