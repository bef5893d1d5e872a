"""Worlds of many scenarios as one `VecEnv`: each group as if alone, and a learner that learns from all of them."""

import warnings

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")


from lissajous_env import ScenarioSpace, scenario
from lissajous_env.parameters.assumptions import AssumptionWarning
from training.learned.card import Card
from training.sb3 import MixedVecEnv
from training.sb3.vec_env import RobotVecEnv

DRAW = {
    "curve": {"choices": [{"a": 1, "b": 2}, {"a": 3, "b": 2}], "half_height": "uniform(0.8, 1.0)"},
    "task": {"duration": 1.0, "contamination": None},
}
SPACE = ScenarioSpace("small", scenario("evaders"), DRAW)


def test_each_group_is_as_if_alone_until_it_changes_its_scenario():
    env, rng = MixedVecEnv(SPACE, num_groups=3, group_size=2, seed=5), np.random.default_rng(0)
    before = env.scenarios
    env.seed(4)
    rows = env.reset()
    starts = np.cumsum([0, *(2 * each.num_robots for each in before)])
    alone = [RobotVecEnv(each, 2) for each in before]
    for start, each in zip(starts, alone, strict=False):
        each.seed(4 + int(start))
    assert (rows == np.concatenate([each.reset() for each in alone])).all()
    for step in range(10):
        actions = rng.uniform(-1, 1, (env.num_envs, 2)).astype(np.float32)
        rows, rewards, dones, infos = env.step(actions)
        theirs = [each.step(actions[start : start + each.num_envs]) for start, each in zip(starts, alone, strict=False)]
        assert (rewards == np.concatenate([each[1] for each in theirs])).all()
        assert (dones == np.concatenate([each[2] for each in theirs])).all()
        assert (rows == np.concatenate([each[0] for each in theirs])).all() == (step < 9)
    assert dones.all()
    for mine, other in zip(infos, [info for each in theirs for info in each[3]], strict=True):
        assert (mine["terminal_observation"] == other["terminal_observation"]).all()
        assert mine["TimeLimit.truncated"]
        assert mine["episode"]["r"] == other["episode"]["r"]
    assert all(now != then for now, then in zip(env.scenarios, before, strict=True))
    assert [now.num_robots for now in env.scenarios] == [then.num_robots for then in before]
    assert {score["scenario"] for score in env.scores} == {each.name for each in before}
    assert len(env.scores) == 6


def test_rows_that_a_scenario_lacks_and_wrong_actions_are_refused():
    space = ScenarioSpace("sizes", scenario("evaders"), {"sensing": {"targets_seen": "whole(0, 8)"}})
    with pytest.raises(ValueError, match=r"observation of .* must contain 54 entries"):
        MixedVecEnv(space, num_groups=4, card=Card.of(scenario("evaders", **{"sensing.targets_seen": 8})))
    env = MixedVecEnv(SPACE, num_groups=1, group_size=1)
    env.reset()
    with pytest.raises(ValueError, match=r"actions must be numbers of shape \([35], 2\), got \(2,\)"):
        env.step(np.zeros(2))


def test_drawn_scenarios_do_not_warn():
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", AssumptionWarning)
        MixedVecEnv("monitoring-v1", num_groups=4, group_size=1, seed=77).reset()
    assert [each.message for each in told if issubclass(each.category, AssumptionWarning)] == []
