"""RLlib's environment of a space of scenarios: the episodes of the PettingZoo environment."""

import numpy as np
import pytest

pytest.importorskip("ray")
pytest.importorskip("ray.rllib")

from ray.rllib.utils.pre_checks.env import check_multiagent_environments

from lissajous_env import SampledParallelEnv, ScenarioSpace, scenario
from training.rllib import LissajousMultiAgentEnv

DRAW = {
    "curve": {"choices": [{"a": 1, "b": 2}, {"a": 3, "b": 2}], "half_height": {"low": 0.8, "high": 1.0}},
    "task": {"duration": 1.0, "contamination": None},
}
SMALL = ScenarioSpace("small", scenario("evaders"), DRAW)


def test_rllibs_checker_passes():
    # Oracle: RLlib's contract checker.
    env = LissajousMultiAgentEnv({"scenario": SMALL})
    check_multiagent_environments(env)
    assert env.possible_agents == [f"robot_{i}" for i in range(5)]


def test_episodes_are_those_of_the_parallel_environment():
    env, parallel = LissajousMultiAgentEnv({"scenario": SMALL}), SampledParallelEnv(SMALL)
    teams = set()
    for seed in (3, None, None, 4, 3):
        observations, expected = env.reset(seed=seed)[0], parallel.reset(seed=seed)[0]
        assert env.scenario == parallel.scenario
        assert observations.keys() == expected.keys() == set(env.agents)
        teams.add(len(env.agents))
        over = False
        while not over:
            actions = {agent: np.full(2, 0.5, dtype=np.float32) for agent in env.agents}
            observations, rewards, _, truncated, _ = env.step(actions)
            expected, expected_rewards, *_ = parallel.step(actions)
            assert rewards == expected_rewards
            assert all((observations[agent] == expected[agent]).all() for agent in expected)
            over = truncated["__all__"]
        assert env.score()["scenario"] == env.scenario.name
    assert teams == {3, 5}
