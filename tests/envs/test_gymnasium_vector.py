"""`gymnasium_vector`: one row per robot, with the same worlds as the simulation and flags per robot."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import lissajous_env

SHORT = {"task.duration": 3.0}
CRASHING = {"task.on_collision": "remove", "robot.radius": 0.2, "formation.start": "random"}
EVERY_MODE = pytest.mark.parametrize("mode", [mode.name for mode in AutoresetMode])


def pair(mode="NEXT_STEP", **settings):
    """The same worlds twice: a row for each robot, and a row for each team."""
    common = {"num_envs": 4, "autoreset_mode": mode, **SHORT, **CRASHING, **settings}
    return lissajous_env.vector_env(agents_as_rows=True, **common), lissajous_env.vector_env(**common)


def test_rows_have_the_spaces_of_one_robot():
    rows, _ = pair()
    alone = lissajous_env.parallel_env()
    assert rows.num_envs == 20
    assert rows.single_observation_space == alone.observation_space("robot_0")
    assert rows.single_action_space == alone.action_space("robot_0")
    assert rows.reset(seed=1)[0].shape == rows.observation_space.shape == (20, 42)
    discrete, _ = pair(discrete_actions=True)
    assert isinstance(discrete.single_action_space, gymnasium.spaces.Discrete)
    discrete.reset(seed=1)
    assert discrete.observation_space.contains(discrete.step(discrete.action_space.sample())[0])


@EVERY_MODE
def test_rows_are_the_robots_of_the_teams(mode):
    # Oracle: the same batch with a row for each team, and what its simulation says of each robot.
    rows, teams = pair(mode)
    rows.reset(seed=7)
    teams.reset(seed=7)
    draw, gone, over = np.random.default_rng(0), np.zeros((4, 5), bool), np.zeros(4, bool)
    removed = ends = 0
    for _ in range(100):
        action = draw.uniform(-1, 1, (4, 5, 2)).astype(np.float32)
        expected = teams.step(action)
        got, reward, terminated, truncated, infos = rows.step(action.reshape(20, 2))
        assert got.tobytes() == expected[0].tobytes()
        assert reward.tobytes() == expected[4]["robot_reward"].tobytes()
        ended = expected[2] | expected[3]
        begins = over & (mode == "NEXT_STEP")
        gone[begins] = False
        terminated, truncated = terminated.reshape(4, 5), truncated.reshape(4, 5)
        assert not (terminated & truncated).any()
        # When a world ends all of its rows do: those of robots that are there by time, the others as terminated.
        assert ((terminated | truncated).all(axis=1) == ended).all()
        assert not truncated[~ended].any()
        assert not (terminated[ended] != gone[ended])[truncated[ended]].any()
        # Before, a row is terminated once, in the step in which its robot goes; then it does not move.
        assert not (terminated & gone)[~ended].any()
        assert (reward.reshape(4, 5)[gone & ~ended[:, None] & ~over[:, None]] == 0).all()
        removed += int((terminated & ~gone)[~ended].sum())
        gone |= terminated
        if ended.any() and mode != "DISABLED":
            scored = infos["final_info"] if mode == "SAME_STEP" else infos
            assert scored["_score"].tolist() == np.repeat(ended, 5).tolist()
            np.testing.assert_array_equal(scored["score"][::5], expected[4]["score"])
        if mode == "SAME_STEP" and (terminated | truncated).any():
            assert infos["_final_obs"].tolist() == (terminated | truncated).reshape(-1).tolist()
            for row in np.flatnonzero(np.repeat(ended, 5)):
                assert infos["final_obs"][row].tobytes() == expected[4]["final_obs"][row // 5][row % 5].tobytes()
            gone[ended] = False
        ends += int((ended & ~over).sum())
        over = ended if mode != "SAME_STEP" else np.zeros(4, bool)
        if mode == "DISABLED" and over.any():
            rows.reset(options={"reset_mask": np.repeat(over, 5)})
            teams.reset(options={"reset_mask": over})
            gone[over], over = False, np.zeros(4, bool)
    assert ends >= 8
    assert removed >= 8


@EVERY_MODE
def test_a_reset_of_one_world_reports_no_score_of_the_others_again(mode):
    teams = lissajous_env.vector_env(num_envs=3, autoreset_mode=mode, **{"task.duration": 0.1})
    teams.reset(seed=1)
    assert teams.step(np.zeros((3, 5, 2), np.float32))[4]["_score"].all()
    assert not teams.reset(options={"reset_mask": np.arange(3) == 0})[1]["_score"].any()
