"""A batch of worlds of many scenarios: each group is a simulation of its own scenario, whatever the others do."""

import numpy as np
import pytest

import lissajous_env
from lissajous_env import Mixture, ScenarioSpace, Simulation, scenario, scenario_space
from lissajous_env.parameters.draws import Draws

DRAW = {
    "curve": {"choices": [{"a": 1, "b": 2}, {"a": 3, "b": 2}], "half_height": {"low": 0.8, "high": 1.0}},
    "task": {"duration": 1.0, "contamination": None},
}
SPACE = ScenarioSpace("small", scenario("evaders"), DRAW)


def own_reward(world):
    """Return x of each robot [m]."""
    return world.robots.position[..., 0]


def actions(mixture, rng):
    return rng.uniform(-1, 1, mixture.action_shape).astype(np.float32)


def test_each_group_is_a_simulation_of_its_scenario():
    mixture, rng = Mixture(SPACE, num_groups=4, group_size=3, seed=5), np.random.default_rng(0)
    alone = [Simulation(each, 3) for each in mixture.scenarios]
    for group, each in zip(mixture.groups, alone, strict=True):
        each.load_state(group.save_state())
    assert len({each.digest() for each in mixture.scenarios}) == 4
    assert {each.num_robots for each in mixture.scenarios} == {3, 5}
    for _ in range(8):
        given = actions(mixture, rng)
        observation, reward, terminated, truncated = mixture.step(given)
        for group, each in enumerate(alone):
            rows, n = slice(3 * group, 3 * group + 3), each.num_robots
            each.step(np.ascontiguousarray(given[rows, :n]))
            assert (observation[rows, :n] == each.observation.numpy()).all()
            assert (reward[rows, :n] == each.reward.numpy()).all()
            assert (terminated[rows, :n] == each.terminated.numpy()).all()
            assert (truncated[rows, :n] == each.truncated.numpy()).all()
    assert [row["scenario"] for row in mixture.score()[::3]] == [each.name for each in mixture.scenarios]


@pytest.mark.parametrize("own", [(), (lissajous_env.reward_term()(own_reward),)])
def test_threads_change_no_bit(own):
    # Two threads take four groups side by side; eight share each group, as they do with a reward of one's own.
    space = ScenarioSpace("small", scenario("evaders", extensions=own), DRAW)
    mixtures, rng = [Mixture(space, 4, 3, seed=5, threads=each) for each in (1, 2, 8)], np.random.default_rng(0)
    for _ in range(12):
        given = actions(mixtures[0], rng)
        for each in mixtures:
            each.step(given)
            if each.over.all():
                each.reset()
        for name in ("observation", "reward", "terminated", "truncated"):
            one, *others = (getattr(each, name) for each in mixtures)
            assert all((one == other).all() for other in others), name


def test_places_without_a_robot_are_masked():
    mixture = Mixture(SPACE, num_groups=4, group_size=2, seed=5)
    observation, reward, terminated, truncated = mixture.step(np.ones(mixture.action_shape))
    assert (mixture.mask.sum(axis=1)[::2] == [each.num_robots for each in mixture.scenarios]).all()
    assert not observation[~mixture.mask].any()
    assert not reward[~mixture.mask].any()
    assert terminated[~mixture.mask].all()
    assert truncated[~mixture.mask].all()
    assert np.abs(observation[mixture.mask]).sum(axis=1).min() > 0


def test_a_group_depends_neither_on_the_others_nor_on_when_they_are_reset():
    few, many, rng = Mixture(SPACE, 2, 2, seed=1), Mixture(SPACE, 5, 2, seed=1), np.random.default_rng(0)
    for turn in range(3):
        assert few.scenarios == many.scenarios[:2]
        given = actions(many, rng)
        n = few.action_shape[1]
        for _ in range(3):
            many.step(given)
            few.step(given[:4, :n])
        assert (few.observation == many.observation[:4, :n]).all()
        many.reset([8, 9] if turn == 0 else None)
        if turn:
            few.reset()


def test_worlds_that_are_reset_together_change_their_scenario_and_others_do_not():
    mixture = Mixture(SPACE, num_groups=3, group_size=2, seed=2)
    before, groups = mixture.scenarios, mixture.groups[:]
    mixture.step(np.zeros(mixture.action_shape))
    untouched = mixture.observation[4:].copy()
    mixture.reset([0, 1, 2])
    assert mixture.scenarios[0] != before[0]
    assert mixture.scenarios[0].num_robots == before[0].num_robots
    assert mixture.scenarios[1:] == before[1:]
    assert mixture.groups[1:] == groups[1:]
    assert (mixture.observation[4:] == untouched).all()
    assert mixture.groups[1].clock.step.numpy().tolist() == [0, 1]


def test_scenarios_are_of_the_split_or_shift():
    shipped = scenario_space("monitoring-v1")
    mixture = Mixture(shipped, num_groups=4, group_size=1, split="test")
    seeds = [int(each.name.rpartition("-")[2]) for each in mixture.scenarios]
    assert [shipped.split_of(seed) for seed in seeds] == ["test"] * 4
    assert Mixture(shipped, 1, 1, split="larger").scenarios[0].num_robots > 8


def test_an_episode_ends_and_the_next_one_begins():
    mixture = Mixture(SPACE, num_groups=2, group_size=2)
    for _ in range(10):
        _, _, _, truncated = mixture.step(np.zeros(mixture.action_shape))
    assert mixture.over.all()
    assert truncated.all()
    mixture.reset(mixture.over)
    assert not mixture.over.any()
    assert not mixture.truncated[mixture.mask].any()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"num_groups": 0}, "num_groups must be a whole number of at least 1, got 0"),
        ({"threads": 0}, "threads must be a whole number of at least 1, got 0"),
        ({"group_size": 1.5}, "group_size must be a whole number of at least 1, got 1.5"),
        ({"seed": -1}, "seed must be a whole number from 0 to 2147483647, got -1"),
        ({"split": "exam"}, "split must be one of train, validation, test, got 'exam'"),
        ({"space": "nothing"}, "space must be one of monitoring-v1, got 'nothing'"),
    ],
)
def test_invalid_arguments_are_refused_by_name(changes, words):
    with pytest.raises(ValueError, match=words):
        Mixture(**{"space": SPACE, "num_groups": 1} | changes)


def test_rows_of_different_sizes_and_wrong_actions_are_refused():
    draw = {"sensing": {"targets_seen": {"low": 0, "high": 8}}}
    with pytest.raises(ValueError, match="scenarios of a mixture must have rows of one size"):
        Mixture(ScenarioSpace("sizes", scenario("evaders"), draw), num_groups=4)
    mixture = Mixture(SPACE, num_groups=1, group_size=2)
    with pytest.raises(ValueError, match=r"action must be numbers of shape \(2, [35], 2\), got \(3,\)"):
        mixture.step(np.zeros(3))


def test_a_drawn_scenario_is_changed_only_if_the_group_plays_it():
    # Oracle: the scenarios of another sequence from the same seed, without a change.
    changed = []
    draws, plain = Draws(SPACE, seed=5, change=lambda made: changed.append(made) or made), Draws(SPACE, seed=5)
    assert [draws.next(0) for _ in range(4)] == [plain.next(0) for _ in range(4)]
    assert draws.counts[0] > 4
    assert len(changed) == 4
