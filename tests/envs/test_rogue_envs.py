"""Environments of both sides: PettingZoo's and Gymnasium's checkers, agents that come and go, clear errors."""

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import api_test, parallel_api_test

import baselines
import lissajous_env

SHORT = {"task.duration": 3.0, "rogues": "agents", "targets.arrival_rate": 0.0, "targets.entry": "unseen"}
SHORT |= {"sensing.radius": 0.3}
ARRIVING = SHORT | {"targets.count": 2, "targets.arrival_rate": 2.0}


def sampled(env, rng):
    return {agent: rng.uniform(-1, 1, env.action_space(agent).shape).astype(np.float32) for agent in env.agents}


# An episode rarely has as many arrivals as there is room for, and the rows of the sides differ.
@pytest.mark.filterwarnings("error", "ignore:(scenario |No agents present|Observations are different|Agents have diff)")
def test_pettingzoos_checkers_pass():
    # Oracle: PettingZoo's contract checkers, whose warnings are errors here.
    parallel_api_test(lissajous_env.parallel_env("experiment", **ARRIVING), num_cycles=40)
    api_test(lissajous_env.env("experiment", **SHORT), num_cycles=100)


def test_gymnasiums_checker_passes_for_both_sides():
    # Oracle: Gymnasium's contract checker: robots against a script, then rogues against a policy.
    for settings in ({"rogues": "flee"}, {"robots": "still", "rogues": "agents"}):
        env = gymnasium.make("lissajous/experiment-v0", **{"task.duration": 3.0}, **settings)
        check_env(env.unwrapped, skip_render_check=True)
        assert env.observation_space.contains(env.reset(seed=0)[0])


def test_rogues_are_agents_from_their_appearance_to_their_detection():
    # Story: agents join in the step in which they appear, end once, and never return; flags say how each ended.
    env = lissajous_env.parallel_env("experiment", **ARRIVING)
    rng = np.random.default_rng(1)
    env.reset(seed=5)
    assert [agent for agent in env.agents if agent.startswith("rogue")] == ["rogue_0", "rogue_1"]
    ended, joined, returns = {}, set(env.agents), dict.fromkeys(env.possible_agents, 0.0)
    while env.agents:
        before = set(env.agents)
        observations, rewards, terminated, truncated, _ = env.step(sampled(env, rng))
        assert before <= observations.keys() == rewards.keys()
        joined |= set(env.agents) - before
        for agent, observation in observations.items():
            assert env.observation_space(agent).contains(observation)
            assert agent not in ended
            returns[agent] += rewards[agent]
            if terminated[agent] or truncated[agent]:
                ended[agent] = "detected" if terminated[agent] else "time"
        assert set(env.agents) == observations.keys() - ended.keys()
    rogues = {agent: how for agent, how in ended.items() if agent.startswith("rogue")}
    assert len(rogues) > 2
    assert set(rogues.values()) == {"detected", "time"}
    times, detected = env.simulation.detection_times()
    for agent, how in rogues.items():
        slot = int(agent.partition("_")[2])
        assert detected[slot] == (how == "detected")
        assert returns[agent] == pytest.approx(times[slot], abs=1e-4)  # its return is its detection time


def test_discrete_rogues_select_rest_or_a_direction():
    # Story: index 0 rests, index 1 goes right at the speed limit.
    env = lissajous_env.parallel_env("experiment", discrete_actions=True, **SHORT)
    env.reset(seed=2)
    position = env.simulation.targets.position
    before = position.numpy()[0].copy()
    env.step(dict.fromkeys(env.agents, 0) | {"rogue_0": 1})
    moved = position.numpy()[0] - before
    limit = env.scenario.targets.speed_limit * env.scenario.task.step
    assert moved[0] == pytest.approx([limit, 0.0], abs=1e-6)
    assert np.abs(moved[1:]).max() == 0.0


def test_a_rogue_team_plays_until_all_are_detected():
    # Story: two rogues rest while a sweep goes over them; the episode ends with the second detection.
    settings = {"targets.count": 2, "targets.arrival_rate": 0.0, "targets.entry": "unseen"}
    with pytest.raises(ValueError, match="robots must be driven by a policy for 1 worlds, got 2"):
        lissajous_env.LissajousEnv("experiment", robots=baselines.make("still", "experiment", 2), **settings)
    env = lissajous_env.LissajousEnv("experiment", robots="sweep", **settings)
    batch = lissajous_env.Batch("experiment", 2, roles="rogues", robots="sweep", overrides=settings)
    batch.reset()
    saved, rest = batch.save_state(), {"rogue": np.zeros((2, 2, 2), np.float32)}
    played = [(batch.step(rest), batch.state())[1] for _ in range(8)]
    batch.load_state(saved)
    assert np.array_equal(played, [(batch.step(rest), batch.state())[1] for _ in range(8)]), "the sweep is saved, too"
    env.reset(seed=1)
    total, over = 0.0, False
    while not over:
        _, reward, terminated, truncated, info = env.step(np.zeros((2, 2), np.float32))
        total, over = total + reward, terminated or truncated
    assert terminated
    assert not truncated
    scored = dict(zip(env.score_names, info["score"], strict=True))
    assert total == pytest.approx(2 * scored["detection_time_mean"], abs=1e-4)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros((2, 2), np.float32))
