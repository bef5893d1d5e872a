"""Environments of a space of scenarios: each reset draws a scenario, and the spaces stay."""

import itertools
import pickle

import gymnasium
import numpy as np
import pettingzoo
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, seed_test

import lissajous_env
from lissajous_env import ScenarioSpace, scenario
from lissajous_env.envs.sides import state_rows

SHORT = {"task.duration": 1.0, "task.contamination": None}
DRAW = {
    "curve": {"choices": [{"a": 1, "b": 2}, {"a": 3, "b": 2}], "half_height": "uniform(0.8, 1.0)"},
    "targets": {"count": "whole(1, 9)"},
    "task": {"duration": 1.0, "contamination": None},
}
SMALL = ScenarioSpace("small", scenario("evaders"), DRAW, shifts={"tall": {"curve": {"half_height": 3.0}}})
# Few scenarios have the largest team.
pytestmark = pytest.mark.filterwarnings("error", "ignore:No agents present but not all possible_agents")


def make(**settings):
    return lissajous_env.parallel_env(SMALL, **settings)


def test_pettingzoos_checkers_pass():
    # Oracle: PettingZoo's contract checkers, whose warnings are errors here.
    parallel_api_test(make(), num_cycles=15)
    parallel_api_test(make(discrete_actions=True), num_cycles=15)
    parallel_seed_test(make, num_cycles=10)
    api_test(lissajous_env.env(SMALL), num_cycles=25)
    seed_test(lambda: lissajous_env.env(SMALL), num_cycles=10)


def test_the_shipped_space_passes_them_by_name_and_by_id():
    parallel_api_test(lissajous_env.parallel_env("monitoring-v1:validation", **SHORT), num_cycles=10)
    env = pettingzoo.make("parallel", "lissajous/monitoring-v1-v0", **SHORT)
    env.reset(seed=1)
    assert env.unwrapped.scenario.name.startswith("monitoring-v1-")


def test_the_state_is_padded_to_the_largest_team():
    none = {"targets.count": 0, "targets.arrival_rate": 0.0}  # no arrivals: a scenario may have no target slot
    space = ScenarioSpace("few", scenario("evaders", **none), DRAW | {"targets": {"count": "choice(0, 3)"}})
    for env, seed in itertools.product((make(), lissajous_env.parallel_env(space)), range(6)):
        env.reset(seed=seed)
        state = env.state()
        assert env.state_space.contains(state)
        n, t = env.scenario.num_robots, env.scenario.target_capacity
        alone = state_rows(env.simulation)[0]
        robots, targets = alone[: 8 * n].reshape(n, 8), alone[8 * n : -1].reshape(t, 3)
        of_robots, of_targets = state[: 8 * 5].reshape(5, 8), state[8 * 5 : -1].reshape(-1, 3)
        np.testing.assert_array_equal(of_robots[:n], robots)
        np.testing.assert_array_equal(of_targets[:t], targets)
        assert not of_robots[n:].any()
        assert not of_targets[t:].any()
        assert state[-1] == alone[-1]


@pytest.mark.parametrize("kind", [lissajous_env.parallel_env, lissajous_env.LissajousEnv])
def test_pictures_are_of_the_episode_also_those_of_a_copy(kind):
    env = kind(SMALL, render_mode="rgb_array")
    shapes = set()
    for seed in range(4):
        env.reset(seed=seed)
        picture = env.render()
        assert picture.dtype == np.uint8
        assert picture.std() > 1
        shapes.add(picture.shape)
    assert len(shapes) > 1
    assert (pickle.loads(pickle.dumps(env)).render() == picture).all()
    env.close()


@pytest.mark.filterwarnings("ignore:.*Not able to test alternative render modes.*")
def test_gymnasiums_checker_passes():
    # Oracle: Gymnasium's contract checker.
    env = gymnasium.make("lissajous/monitoring-v1-v0", disable_env_checker=True, **SHORT)
    check_env(env.unwrapped, skip_render_check=True)
    assert env.observation_space.shape == (8, 42)


def test_the_team_as_one_agent_has_a_mask_and_the_mean_reward_of_the_robots():
    # Oracle: the same episode with an agent for each robot.
    env, robots = lissajous_env.LissajousEnv(SMALL), make()
    for seed in range(6):
        env.reset(seed=seed)
        robots.reset(seed=seed)
        action = env.action_space.sample()
        _, reward, _, _, info = env.step(action)
        _, rewards, *_ = robots.step({agent: action[int(agent[-1])] for agent in robots.agents})
        np.testing.assert_array_equal(info["mask"], [agent in rewards for agent in robots.possible_agents])
        assert reward == pytest.approx(np.mean(list(rewards.values())))
    assert env.score()["scenario"] == env.scenario.name


def test_scenarios_of_different_sizes_are_refused_by_name():
    uneven = ScenarioSpace("uneven", scenario("evaders"), DRAW | {"sensing": {"robots_seen": "whole(1, 3)"}})
    words = r"scenarios of a space must have rows and actions of one size, got others in uneven-\d+ and uneven"
    with pytest.raises(ValueError, match=words):
        lissajous_env.parallel_env(uneven)


def test_a_larger_team_than_any_of_the_first_scenarios_is_skipped(monkeypatch):
    # Story: one scenario is looked at; larger teams than its own never play.
    monkeypatch.setattr("lissajous_env.envs.batch.FIRST_SCENARIOS", 1)
    small = [scenario.num_robots for scenario in map(SMALL.sample, range(12))]
    first = next(SMALL.scenarios("train")).num_robots
    env = make()
    assert len(env.possible_agents) == first
    for seed in range(8):
        env.reset(seed=seed)
        assert env.scenario.num_robots <= first
    assert set(small) == {3, 5}
