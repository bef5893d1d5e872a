"""Arguments of every environment interface: seeds, keywords, cycles, pictures."""

import gymnasium
import numpy as np
import pytest

import lissajous_env

SHORT = {"task.duration": 1.0}


def vector(**settings):
    return lissajous_env.vector_env(**SHORT, **settings)


@pytest.mark.parametrize("mode", ["sync", "async", "vector_entry_point"])
def test_episodes_without_a_seed_are_different(mode):
    # Oracle: with a seed they are the same again; without, no two worlds are, nor those of a second batch.
    rows = []
    for _ in range(2):
        # Children of a fork begin with all that their parent knows.
        forked = {"vector_kwargs": {"context": "fork"}} if mode == "async" else {}
        env = gymnasium.make_vec("lissajous_env:lissajous/intruders-v0", 3, vectorization_mode=mode, **forked)
        rows += [row.tobytes() for row in env.reset()[0]]
        seeded = env.reset(seed=4)[0]
        np.testing.assert_array_equal(env.reset(seed=4)[0], seeded)
        env.close()
    assert len(set(rows)) == 6


def test_the_first_episode_alone_is_drawn():
    # Story: reset without a seed, a world continues from its own stream: two that began alike stay alike.
    one, other = vector(num_envs=3), vector(num_envs=3)
    assert one.reset()[0].tobytes() != other.reset()[0].tobytes()
    seeds = one.simulation.clock.seed.numpy().tolist()
    other.reset(seed=seeds)
    assert other.reset()[0].tobytes() == one.reset()[0].tobytes()
    single = lissajous_env.LissajousEnv()
    single.reset()
    single.simulation.step(np.zeros((1, 5, 2), np.float32))
    # What was drawn is told, so that the episode can be played again.
    again = lissajous_env.LissajousEnv()
    again.reset(seed=single.score()["seed"])
    again.simulation.step(np.zeros((1, 5, 2), np.float32))
    assert (single.simulation.observation.numpy() == again.simulation.observation.numpy()).all()


def test_every_world_must_be_reset_first():
    env = vector(num_envs=2)
    env.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(gymnasium.error.ResetNeeded, match="every world"):
        env.step(env.action_space.sample())
    env.reset(options={"reset_mask": np.array([False, True])})
    env.step(env.action_space.sample())


MAKERS = {
    "single": lambda **settings: gymnasium.make("lissajous_env:lissajous/failure-v0", **settings),
    "batch": lambda **settings: gymnasium.make_vec("lissajous_env:lissajous/failure-v0", 2, **settings),
    "parallel": lambda **settings: lissajous_env.parallel_env("failure", **settings),
    "aec": lambda **settings: lissajous_env.env("failure", **settings),
}
EVERY_MAKER = pytest.mark.parametrize("maker", MAKERS)


@EVERY_MAKER
def test_an_unknown_keyword_is_an_error_of_both_kinds(maker):
    # Libraries that try keywords expect a TypeError with Python's words; our commands catch ValueErrors.
    for kind in (TypeError, ValueError):
        with pytest.raises(kind, match="unexpected keyword argument 'frameskip'"):
            MAKERS[maker](frameskip=4)
        with pytest.raises(kind, match=r"curve\.foo"):
            MAKERS[maker](**{"curve.foo": 1})
    for name in ("name", "made", "overrides", "base"):
        with pytest.raises(TypeError, match="unexpected keyword argument"):
            MAKERS[maker](**{name: "evil"})


@pytest.mark.parametrize("key", ["name", "scenario", "self", "base"])
def test_overrides_do_not_collide_with_parameters(key):
    with pytest.raises(ValueError, match=f"override must name one of .*, got '{key}'"):
        lissajous_env.scenario("experiment", **{key: "evil"})


@EVERY_MAKER
def test_cycles_that_are_no_number_of_steps_are_refused(maker):
    for cycles in (1.5, True, 0, "3", 2**20 + 1):
        with pytest.raises(ValueError, match="max_cycles must be a whole number from 1 to 1048576, got"):
            MAKERS[maker](max_cycles=cycles)


def test_infos_tell_where_an_action_was_not_finite():
    for rows, number in ((False, np.nan), (False, -np.inf), (True, np.inf)):
        env = vector(num_envs=3, agents_as_rows=rows)
        env.reset(seed=1)
        per_world = 5 if rows else 1
        action = env.action_space.sample()
        assert not env.step(action)[4]["invalid"].any()
        action[per_world] = number
        invalid = env.step(action)[4]["invalid"]
        assert invalid.tolist() == [False] * per_world + [True] * per_world + [False] * per_world
