"""Wrappers of Gymnasium, PettingZoo, SuperSuit and Minari play over the ends of episodes.

Infos are numbers under keys that do not change, and a step without agents is a step.
"""

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

import lissajous_env

ID = "lissajous_env:lissajous/experiment-v0"
REMOVING = {"task.on_collision": "remove", "task.boundary": "remove", "max_cycles": 40}
SIDES = {"rogues": "agents", "targets.count": 2, "targets.arrival_rate": 0.0, "max_cycles": 6}


def short_env(**more):
    return gymnasium.make(ID, max_cycles=5, **more)


def shapes(infos):
    return {name: shapes(part) if isinstance(part, dict) else (part.shape, part.dtype) for name, part in infos.items()}


SINGLE = {
    "team": short_env,
    "discrete": lambda: short_env(discrete_actions=True),
    "space": lambda: gymnasium.make("lissajous_env:lissajous/monitoring-v1-v0", max_cycles=5),
    "rogues": lambda: short_env(robots="still"),
    "rows": lambda: lissajous_env.vector_env("experiment", 2, max_cycles=5, agents_as_rows=True),
    "teams": lambda: lissajous_env.vector_env("experiment", 2, max_cycles=5),
    "teams in turn": lambda: gymnasium.vector.SyncVectorEnv([short_env, short_env]),
}


@pytest.mark.parametrize("name", SINGLE)
def test_infos_have_the_same_numbers_in_each_step(name):
    env = SINGLE[name]()
    _, info = env.reset(seed=1)
    first = shapes(info)
    assert all(dtype.kind in "fib" for _, dtype in first.values())
    scored = []
    for _ in range(12):
        *_, terminated, truncated, info = env.step(env.action_space.sample())
        assert shapes(info) == first
        ended = np.asarray(terminated) | np.asarray(truncated)
        has_score = np.isfinite(info["score"]).any(axis=-1)
        assert has_score.tolist() == ended.tolist()
        scored.append(ended.any())
        if ended.any() and not isinstance(env, gymnasium.vector.VectorEnv):
            row = env.unwrapped.score()
            np.testing.assert_array_equal(info["score"], [row[name] for name in env.unwrapped.score_names])
            env.reset()
    assert any(scored)


@pytest.mark.parametrize("mode", ["NEXT_STEP", "DISABLED"])
@pytest.mark.parametrize("discrete", [False, True])
def test_torch_steps_a_batch_over_the_ends_of_episodes(mode, discrete):
    torch = pytest.importorskip("torch")
    pytest.importorskip("array_api_compat")
    from gymnasium.wrappers.vector import NumpyToTorch

    settings = {"max_cycles": 3, "autoreset_mode": mode, "discrete_actions": discrete}
    env = NumpyToTorch(lissajous_env.vector_env("experiment", 2, **settings))
    env.reset(seed=1)
    for _ in range(8):
        *_, infos = env.step(torch.as_tensor(env.action_space.sample()))
        assert all(isinstance(value, torch.Tensor) for value in infos.values())


def test_minari_records_infos(tmp_path, monkeypatch):
    for needed in ("jax", "h5py"):
        pytest.importorskip(needed)
    minari = pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    env = minari.DataCollector(short_env(), record_infos=True)
    scores = []
    for seed in range(2):
        env.reset(seed=seed)
        over = False
        while not over:
            *_, over, info = env.step(env.action_space.sample())
        scores.append(info["score"])
    about = {"algorithm_name": "random", "author": "x", "author_email": "x@example.org", "code_permalink": "x"}
    episodes = list(env.create_dataset("lissajous-v0", **about).iterate_episodes())
    for episode, score in zip(episodes, scores, strict=True):
        np.testing.assert_array_equal(episode.infos["score"][-1], score)
        assert np.isinf(episode.infos["score"][:-1]).all()


PARALLEL = {
    "robots": {"max_cycles": 5},
    "removed robots": REMOVING,
    "space": {"scenario": "monitoring-v1", "max_cycles": 5},
    "both sides": SIDES,
}


@pytest.mark.parametrize("name", PARALLEL)
def test_a_step_without_agents_is_empty(name):
    env = lissajous_env.parallel_env(**PARALLEL[name])
    with pytest.raises(ResetNeeded):
        env.step({})
    for seed in range(2):
        env.reset(seed=seed)
        while env.agents:
            last = {agent: env.action_space(agent).sample() for agent in env.agents}
            env.step(last)
        before = repr(env.score())
        assert env.step({}) == ({}, {}, {}, {}, {})
        assert repr(env.score()) == before
        with pytest.raises(ResetNeeded):
            env.step(last)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", PARALLEL)
@pytest.mark.parametrize("wrapper", ["black_death_v3", "frame_skip_v0", "round trip"])
def test_wrappers_of_parallel_environments(name, wrapper):
    supersuit = pytest.importorskip("supersuit")
    from pettingzoo.utils import aec_to_parallel, parallel_to_aec

    if wrapper == "frame_skip_v0" and name == "removed robots":
        return  # it repeats the actions of robots that are removed meanwhile, which an environment refuses by name
    wrap = {
        "black_death_v3": supersuit.black_death_v3,
        "frame_skip_v0": lambda env: supersuit.frame_skip_v0(env, 2),
        "round trip": lambda env: aec_to_parallel(parallel_to_aec(env)),
    }[wrapper]
    env = wrap(lissajous_env.parallel_env(**PARALLEL[name]))
    for seed in range(2):
        env.reset(seed=seed)
        steps = 0
        while env.agents:
            env.step({agent: env.action_space(agent).sample() for agent in env.agents})
            steps += 1
        assert 0 < steps <= 41


def test_generators_for_wrappers_are_seeded():
    for make in (lissajous_env.vector_env, lissajous_env.parallel_env, lissajous_env.LissajousEnv):
        env = make("experiment")
        drawn = []
        for seed in (5, 5, 6):
            env.reset(seed=seed)
            drawn.append(env.np_random.random())
        assert drawn[0] == drawn[1] != drawn[2]


def test_the_specification_states_the_length_of_an_episode():
    # Oracle: the number of steps until truncation.
    for settings, steps in [
        ({"max_cycles": 7}, 7),
        ({"task.duration": 0.9}, 9),
        ({"max_cycles": 7, "robots": "still"}, 7),
    ]:
        env = gymnasium.make(ID, **settings)
        assert env.spec.max_episode_steps == env.unwrapped.scenario.task.steps == steps
        again = gymnasium.make(env.spec)
        assert again.spec.max_episode_steps == steps
    assert gymnasium.make_vec(ID, 2, max_cycles=7).spec.max_episode_steps == 7
    assert gymnasium.make_vec(gymnasium.make(ID, max_cycles=7).spec, 2).spec.max_episode_steps == 7
    assert gymnasium.make("lissajous_env:lissajous/monitoring-v1-v0").spec.max_episode_steps is None
    assert gymnasium.wrappers.TimeAwareObservation(gymnasium.make(ID)).reset(seed=1)


@pytest.mark.parametrize("discrete", [False, True])
def test_tensors_are_actions(discrete):
    # Oracle: the same numbers as arrays of NumPy.
    torch = pytest.importorskip("torch")
    plain, with_tensors = (lissajous_env.parallel_env("experiment", discrete_actions=discrete) for _ in range(2))
    kinds = [lambda x: x.requires_grad_(), lambda x: x.bfloat16(), lambda x: x.half().requires_grad_(), list]
    kinds.append(lambda x: torch._neg_view(-x))  # its elements are negated only when they are read
    kinds = [lambda x: x, lambda x: x.to(torch.uint8), lambda x: x.reshape(1)] if discrete else kinds
    for kind in kinds:
        for env in (plain, with_tensors):
            env.reset(seed=1)
        number = torch.tensor(3) if discrete else torch.tensor([0.5, -0.25])
        array = 3 if discrete else np.array([0.5, -0.25])
        got = with_tensors.step({agent: kind(number.clone()) for agent in with_tensors.agents})
        expected = plain.step(dict.fromkeys(plain.agents, array))
        for agent in got[0]:
            assert got[0][agent].tobytes() == expected[0][agent].tobytes()
