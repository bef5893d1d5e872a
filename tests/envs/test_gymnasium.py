"""The Gymnasium environments: the library's checker, the three ways of resetting, and vector = stack of singles."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import lissajous_env

SHORT = {"task.duration": 1.0}
CRASHING = {"task.on_collision": "remove", "robot.radius": 0.2, "formation.start": "random"}
KINDS = {
    "default": {},
    "removing": CRASHING,
    "discrete messages": {"scenario": "failure", "messages.size": 4, "discrete_actions": True},
    "two points": {"scenario": "failure", "robot.count": 2, "formation.p": 1, "faults.schedule": (), **CRASHING},
}
EVERY_KIND = pytest.mark.parametrize("kind", KINDS)
# Of a Gymnasium environment made without its registry.
NO_SPEC = "ignore:.*Not able to test alternative render modes due to the environment not having a spec.*"


def vector(kind="default", num_envs=4, **settings):
    return lissajous_env.vector_env(num_envs=num_envs, **{**SHORT, **KINDS[kind], **settings})


def actions_of(env, steps, seed=0):
    """Actions of each step, (steps, num_envs, ...), whose worlds draw on their own."""
    space, draw = env.single_action_space, np.random.default_rng(seed)
    shape = (steps, env.num_envs, *space.shape)
    if isinstance(space, gymnasium.spaces.MultiDiscrete):
        return draw.integers(0, space.nvec, size=shape)
    return draw.uniform(-1, 1, shape).astype(np.float32)


@EVERY_KIND
@pytest.mark.filterwarnings("error", NO_SPEC, "ignore:scenario ")
def test_the_checker_of_gymnasium(kind):
    env = lissajous_env.LissajousEnv(**{**SHORT, **KINDS[kind]})
    check_env(env, skip_render_check=True)
    # Oracle: the checker above; it leaves the environment usable.
    assert env.observation_space.contains(env.reset(seed=0)[0])


def play_singles(kind, num_envs, actions, seed):
    """The same by single environments, each reset after its end as NEXT_STEP does, with the next seed of its own."""
    singles = [lissajous_env.LissajousEnv(**{**SHORT, **KINDS[kind]}) for _ in range(num_envs)]
    observations = [np.stack([env.reset(seed=seed + k)[0] for k, env in enumerate(singles)])]
    ended, rows = [False] * num_envs, []
    for batch in actions:
        row = []
        for k, env in enumerate(singles):
            if ended[k]:
                observation, info = env.reset()
                row.append((observation, 0.0, False, False, info))
            else:
                row.append(env.step(batch[k]))
            ended[k] = row[-1][2] or row[-1][3]
        rows.append(row)
        observations.append(np.stack([step[0] for step in row]))
    return observations, rows


@EVERY_KIND
def test_a_vector_is_a_stack_of_single_environments(kind):
    # Oracle: four single environments, bit for bit, over several episodes, with the reset of NEXT_STEP.
    env = vector(kind)
    actions = actions_of(env, 45)
    expected, rows = play_singles(kind, 4, actions, seed=20)
    observation, _ = env.reset(seed=20)
    assert observation.tobytes() == expected[0].tobytes()
    ends = 0
    for k, batch in enumerate(actions):
        observation, reward, terminated, truncated, infos = env.step(batch)
        assert observation.tobytes() == expected[k + 1].tobytes()
        assert env.observation_space.contains(observation)
        assert reward.tolist() == [row[1] for row in rows[k]]
        assert terminated.tolist() == [row[2] for row in rows[k]]
        assert truncated.tolist() == [row[3] for row in rows[k]]
        np.testing.assert_array_equal(infos["robot_reward"], [row[4]["robot_reward"] for row in rows[k]])
        done = terminated | truncated
        ends += done.sum()
        assert infos["_score"].tolist() == done.tolist()
        np.testing.assert_array_equal(infos["score"], [row[4]["score"] for row in rows[k]])
        assert np.isinf(infos["score"]).all(axis=1).tolist() == (~done).tolist()
    assert ends >= 8
    if "removing" in kind or "two" in kind:
        assert any(row[2] for step in rows for row in step) == (kind == "two points")


@EVERY_KIND
def test_resetting_in_the_same_step(kind):
    # Oracle: NEXT_STEP's own episodes: the same rows, the last of each in `final_obs`, the next beginning in its place.
    same, after = vector(kind, autoreset_mode="SAME_STEP"), vector(kind)
    same.reset(seed=3)
    after.reset(seed=3)
    scores = 0
    for batch in actions_of(same, 10):
        got, reward, terminated, truncated, infos = same.step(batch)
        expected, reward_after, *flags, infos_after = after.step(batch)
        assert reward.tolist() == reward_after.tolist()
        assert [terminated.tolist(), truncated.tolist()] == [flag.tolist() for flag in flags]
        done = terminated | truncated
        assert got[~done].tobytes() == expected[~done].tobytes()
        if done.any():
            assert infos["_final_obs"].tolist() == done.tolist()
            assert np.stack(list(infos["final_obs"][done])).tobytes() == expected[done].tobytes()
            assert (infos["final_obs"][~done] == None).all()  # noqa: E711
            np.testing.assert_array_equal(infos["final_info"]["score"], infos_after["score"])
            scores += int(infos["final_info"]["_score"].sum())
            assert (same.simulation.clock.step.numpy()[done] == 0).all()
            break
        assert "final_obs" not in infos
    assert scores > 0


def test_without_resetting_a_world_waits_for_its_mask():
    # Story: all worlds end; two are reset by mask; the others do not move with their flags up.
    env = vector(autoreset_mode="DISABLED")
    env.reset(seed=0)
    for batch in actions_of(env, 10):
        _, _, _, truncated, infos = env.step(batch)
    assert truncated.all()
    assert infos["_score"].all()
    before = env.simulation.observation.numpy().copy()
    observation, reward, _, truncated, infos = env.step(actions_of(env, 1)[0])
    assert (reward == 0).all()
    assert truncated.all()
    assert not infos["_score"].any()
    np.testing.assert_array_equal(observation, before)
    mask = np.array([False, True, False, True])
    observation, _ = env.reset(options={"reset_mask": mask}, seed=[5, 6, 7, 8])
    np.testing.assert_array_equal(observation[~mask], before[~mask])
    fresh = lissajous_env.Simulation(env.scenario, 2)
    assert fresh.reset(seeds=[6, 8]).numpy().tobytes() == observation[mask].tobytes()
    _, _, _, truncated, _ = env.step(actions_of(env, 1)[0])
    assert truncated.tolist() == [True, False, True, False]
