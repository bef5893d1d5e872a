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


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_torchrl_wraps_the_parallel_environment():
    torchrl = pytest.importorskip("torchrl.envs")
    data = torchrl.PettingZooWrapper(lissajous_env.parallel_env("experiment", max_cycles=5)).rollout(9)
    assert data["robot", "observation"].shape[:2] == (5, 5)
    assert data["next", "done"][-1]


def test_stable_baselines_learns_on_one_world_after_another():
    sb3 = pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecNormalize

    env = VecNormalize(make_vec_env(ID, 2, seed=1, env_kwargs={"max_cycles": 8}))
    model = sb3.PPO("MlpPolicy", env, n_steps=16, batch_size=16, n_epochs=1, seed=1).learn(32)
    # Its own monitor has seen whole episodes, with none of our infos in the place of its own.
    assert [episode["l"] for episode in model.ep_info_buffer] == [8] * 4
