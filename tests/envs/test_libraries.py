"""Third-party libraries, used as in their documentation: they train, record or roll out."""

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import vector as vector_wrappers

import lissajous_env

ID = "lissajous_env:lissajous/experiment-v0"


def returns_of(envs, steps=32):
    """Return the returns of the episodes that end within some steps, as the scripts of CleanRL collect them."""
    envs.reset(seed=1)
    returned = []
    for _ in range(steps):
        *_, infos = envs.step(envs.action_space.sample())
        for info in infos.get("final_info") or ():
            if info and "episode" in info:
                returned.append(info["episode"]["r"])
        if "episode" in infos:
            returned += infos["episode"]["r"][infos["_episode"]].tolist()
    assert np.isfinite(returned).all()
    return returned


@pytest.mark.parametrize("mode", ["NEXT_STEP", "SAME_STEP"])
def test_statistics_of_cleanrl_with_a_row_for_each_robot(mode):
    if mode == "SAME_STEP" and gymnasium.__version__ < "1.3":
        pytest.skip("this Gymnasium's statistics take every environment to reset in the next step")
    envs = gymnasium.make_vec(
        ID, 3, vectorization_mode="vector_entry_point", max_cycles=6, agents_as_rows=True, autoreset_mode=mode
    )
    envs = vector_wrappers.RecordEpisodeStatistics(envs)
    # 32 steps hold four episodes of 6 steps and the steps that reset (or five without them), of 15 robots each.
    assert len(returns_of(envs)) == (4 if mode == "NEXT_STEP" else 5) * 15


@pytest.mark.parametrize("rows", [False, True])
def test_wrappers_of_gymnasium_for_a_batch(rows):
    env = gymnasium.make_vec(ID, 3, vectorization_mode="vector_entry_point", max_cycles=4, agents_as_rows=rows)
    env = vector_wrappers.NormalizeReward(vector_wrappers.NormalizeObservation(vector_wrappers.FlattenObservation(env)))
    env = vector_wrappers.DictInfoToList(vector_wrappers.RecordEpisodeStatistics(env))
    env.reset(seed=1)
    for _ in range(4):
        _, _, _, truncated, infos = env.step(env.action_space.sample())
    assert truncated.all()
    assert len(infos) == env.num_envs == (15 if rows else 3)
    expected = env.unwrapped.simulation.score_numbers(None).repeat(env.num_envs // 3, axis=0)
    np.testing.assert_array_equal([info["score"] for info in infos], expected)
    assert all(info["episode"]["l"] == 4 for info in infos)


def test_the_wrapper_that_records_videos_of_a_batch(tmp_path, monkeypatch):
    moviepy = pytest.importorskip("moviepy.video.io.ImageSequenceClip")
    kept, original = [], moviepy.ImageSequenceClip
    monkeypatch.setattr(moviepy, "ImageSequenceClip", lambda frames, fps: kept.append(frames) or original(frames, fps))
    settings = {"max_cycles": 3, "render_mode": "rgb_array", "agents_as_rows": True}
    env = gymnasium.make_vec(ID, 4, vectorization_mode="vector_entry_point", **settings)
    env = vector_wrappers.RecordVideo(env, str(tmp_path / "films"), episode_trigger=lambda number: number == 0)
    env.reset(seed=1)
    for _ in range(5):
        env.step(env.action_space.sample())
    env.close()
    assert [file.stat().st_size > 1000 for file in (tmp_path / "films").iterdir()] == [True]
    # The reset and three steps; the four worlds are four different pictures.
    assert len(kept[0]) == 4
    assert all(np.ptp(frame) > 100 for frame in kept[0])


def test_torchrl_wraps_it_and_reads_the_infos():
    torchrl = pytest.importorskip("torchrl.envs")
    env = torchrl.GymWrapper(gymnasium.make(ID)).auto_register_info_dict()
    data = env.rollout(5)["next"]
    # The reward is the team's, a single number; the robots' stand beside it under another name.
    assert data["reward"].shape == (5, 1)
    assert data["robot_reward"].shape == (5, 5)
    np.testing.assert_allclose(data["reward"][:, 0], data["robot_reward"].mean(1), rtol=1e-6)


@pytest.mark.parametrize(("mode", "rows"), [("SAME_STEP", False), ("DISABLED", True)])
def test_torchrl_wraps_a_batch(mode, rows):
    torchrl = pytest.importorskip("torchrl.envs")
    env = lissajous_env.vector_env("experiment", 3, max_cycles=4, autoreset_mode=mode, agents_as_rows=rows)
    data = torchrl.GymWrapper(env).rollout(9, break_when_any_done=False)
    assert data["next", "reward"].shape == (15 if rows else 3, 9, 1)
    assert data["next", "done"].sum() == 2 * (15 if rows else 3)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_torchrl_wraps_the_parallel_environment():
    torchrl = pytest.importorskip("torchrl.envs")
    data = torchrl.PettingZooWrapper(lissajous_env.parallel_env("experiment", max_cycles=5)).rollout(9)
    assert data["robot", "observation"].shape[:2] == (5, 5)
    assert data["next", "done"][-1]


@pytest.mark.filterwarnings("ignore")
def test_supersuit_makes_a_vector_of_the_robots():
    supersuit = pytest.importorskip("supersuit")
    env = supersuit.pettingzoo_env_to_vec_env_v1(lissajous_env.parallel_env("experiment", max_cycles=5))
    env = supersuit.concat_vec_envs_v1(env, 2, num_cpus=0, base_class="stable_baselines3")
    rows = env.reset()
    assert rows.shape[0] == 10
    # Two copies of an environment that was given no seed do not play the same episode.
    assert (rows[:5] != rows[5:]).any()
    for _ in range(5):
        _, _, dones, _ = env.step(np.stack([env.action_space.sample() for _ in range(10)]))
    assert dones.all()


def test_stable_baselines_learns_on_one_world_after_another():
    sb3 = pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecNormalize

    env = VecNormalize(make_vec_env(ID, 2, seed=1, env_kwargs={"flat_actions": True, "max_cycles": 8}))
    model = sb3.PPO("MlpPolicy", env, n_steps=16, batch_size=16, n_epochs=1, seed=1).learn(32)
    # Its own monitor has seen whole episodes, with none of our infos in the place of its own.
    assert [episode["l"] for episode in model.ep_info_buffer] == [8] * 4
