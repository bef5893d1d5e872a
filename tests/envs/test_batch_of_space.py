"""A batch of many scenarios: each group is a simulation of its own scenario, whatever the others do."""

import numpy as np
import pytest

import lissajous_env
from lissajous_env import Batch, ScenarioSpace, Simulation, scenario
from lissajous_env.parameters.space import Draws

DRAW = {
    "curve": {"choices": [{"a": 1, "b": 2}, {"a": 3, "b": 2}], "half_height": "uniform(0.8, 1.0)"},
    "task": {"duration": 1.0, "contamination": None},
}
SPACE = ScenarioSpace("small", scenario("evaders"), DRAW)


def own_reward(world):
    """Return x of each robot [m]."""
    return world.robots.position[..., 0]


def made(space=SPACE, groups=4, size=3, seed=5, **more):
    batch = Batch(space, groups * size, num_groups=groups, seed=seed, **more)
    batch.reset()
    return batch


def step(batch, actions):
    (side,) = batch.sides
    batch.step({side.agent: actions[: batch.num_worlds]})
    return batch.rows(side)


def drawn_actions(batch, rng):
    (side,) = batch.sides
    return rng.uniform(-1, 1, (batch.num_worlds, side.slots, side.action_size)).astype(np.float32)


def test_each_group_is_a_simulation_of_its_scenario_and_the_rest_is_masked():
    batch, rng = made(), np.random.default_rng(0)
    scenarios = [each.scenario for each in batch.simulations]
    alone = [Simulation(each, 3) for each in scenarios]
    for group, each in zip(batch.simulations, alone, strict=True):
        each.load_state(group.save_state())
    assert len({each.digest() for each in scenarios}) == 4
    assert {each.num_robots for each in scenarios} == {3, 5}
    for _ in range(8):
        given = drawn_actions(batch, rng)
        rows = step(batch, given)
        for group, each in enumerate(alone):
            of, n = batch.worlds_of(group), each.num_robots
            each.step(np.ascontiguousarray(given[of, :n]))
            for name in ("observation", "reward", "terminated", "truncated"):
                assert (getattr(rows, name)[of, :n] == getattr(each, name).numpy()).all()
            assert rows.mask[of, :n].all()
            assert not rows.mask[of, n:].any()
    assert rows.terminated[~rows.mask].all()
    assert not np.any([*rows.reward[~rows.mask], *rows.observation[~rows.mask].ravel()])
    scores = batch.score(np.ones(12, bool))
    assert [row["scenario"] for row in scores[::3]] == [each.name for each in scenarios]


@pytest.mark.parametrize("own", [(), (lissajous_env.reward_term()(own_reward),)])
def test_threads_change_no_bit(own):
    # Two threads take four groups side by side; eight share each group, as they do with a reward of one's own.
    space = ScenarioSpace("small", scenario("evaders", extensions=own), DRAW)
    batches, rng = [made(space, threads=each) for each in (1, 2, 8)], np.random.default_rng(0)
    for _ in range(12):
        given = drawn_actions(batches[0], rng)
        one, *others = [step(each, given) for each in batches]
        for other in others:
            assert all((a == b).all() for a, b in zip(one, other, strict=True))
        for each in batches:
            each.reset(each.over)


def test_a_group_depends_neither_on_the_others_nor_on_when_they_are_reset():
    few, many, rng = made(groups=2, size=2), made(groups=5, size=2), np.random.default_rng(0)
    for turn in range(3):
        assert [each.scenario for each in few.simulations] == [each.scenario for each in many.simulations[:2]]
        for _ in range(3):
            given = drawn_actions(many, rng)
            a, b = step(few, given), step(many, given)
            assert (a.observation == b.observation[:4]).all()
        many.reset(np.arange(10) >= 8 if turn == 0 else None)
        if turn:
            few.reset()


def test_worlds_that_are_reset_together_change_their_scenario_and_others_do_not():
    batch = made(groups=3, size=2, seed=2)
    before, rng = batch.simulations[:], np.random.default_rng(0)
    rows = step(batch, drawn_actions(batch, rng))
    batch.reset(np.array([True, True, True, False, False, False]))
    assert batch.simulations[0].scenario != before[0].scenario
    assert batch.simulations[1:] == before[1:]
    assert (batch.rows(batch.sides[0]).observation[4:] == rows.observation[4:]).all()
    assert batch.simulations[1].clock.step.numpy().tolist() == [0, 1]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"num_groups": 0}, "num_groups must be a whole number of at least 1, got 0"),
        ({"num_groups": 3}, r"num_worlds must be a multiple of num_groups \(3\), got 4"),
        ({"threads": 0}, "threads must be a whole number of at least 1, got 0"),
        ({"seed": -1}, "seed must be a whole number .*, got -1"),
        ({"scenario": "monitoring-v1:exam"}, "split must be one of train, validation, test, .*got 'exam'"),
        ({"scenario": "evaders", "num_groups": 2}, "num_groups must be 1 without a space of scenarios, got 2"),
    ],
)
def test_invalid_arguments_are_refused_by_name(changes, words):
    with pytest.raises(ValueError, match=words):
        Batch(**{"scenario": SPACE, "num_worlds": 4} | changes)


def test_draws_that_do_not_fit_are_skipped(monkeypatch):
    # Oracle: the scenarios of another sequence from the same seed, without those that are skipped.
    def draws(fits):
        return Draws(SPACE, "train", 5, lambda made: made, fits)

    every, few = draws(lambda made: True), draws(lambda made: made.num_robots == 3)
    due = [drawn for drawn in (every.next(0) for _ in range(20)) if drawn[0].num_robots == 3]
    assert [few.next(0) for _ in due] == due
    monkeypatch.setattr("lissajous_env.parameters.space._MOST_DRAWS", 9)
    with pytest.raises(ValueError, match="space small must contain more scenarios of the largest size, got none"):
        draws(lambda made: False).next(0)
