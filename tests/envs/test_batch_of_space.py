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


def batch_of(space=SPACE, groups=4, size=3, seed=5, **more):
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
    batch, rng = batch_of(), np.random.default_rng(0)
    scenarios = [group.scenario for group in batch.simulations]
    alone = [Simulation(scenario, 3) for scenario in scenarios]
    for group, single in zip(batch.simulations, alone, strict=True):
        single.load_state(group.save_state())
    assert len({scenario.digest() for scenario in scenarios}) == 4
    assert {scenario.num_robots for scenario in scenarios} == {3, 5}
    for _ in range(8):
        actions = drawn_actions(batch, rng)
        rows = step(batch, actions)
        for group, single in enumerate(alone):
            worlds, n = batch.worlds_of(group), single.num_robots
            single.step(np.ascontiguousarray(actions[worlds, :n]))
            for name in ("observation", "reward", "terminated", "truncated"):
                assert (getattr(rows, name)[worlds, :n] == getattr(single, name).numpy()).all()
            assert (rows.mask[worlds] == (np.arange(5) < n)).all()
    assert rows.terminated[~rows.mask].all()
    assert not np.any([*rows.reward[~rows.mask], *rows.observation[~rows.mask].ravel()])
    scores = batch.score(np.ones(12, bool))
    assert [row["scenario"] for row in scores[::3]] == [scenario.name for scenario in scenarios]


@pytest.mark.parametrize("own", [(), (lissajous_env.reward_term()(own_reward),)])
def test_threads_change_no_bit(own):
    # Two threads take four groups side by side; eight share each group, as they do with a reward of one's own.
    space = ScenarioSpace("small", scenario("evaders", extensions=own), DRAW)
    batches, rng = [batch_of(space, threads=threads) for threads in (1, 2, 8)], np.random.default_rng(0)
    for _ in range(12):
        actions = drawn_actions(batches[0], rng)
        one, *others = [step(batch, actions) for batch in batches]
        assert all((a == b).all() for other in others for a, b in zip(one, other, strict=True))
        for batch in batches:
            batch.reset(batch.over)


def test_a_group_depends_neither_on_the_others_nor_on_when_they_are_reset():
    few, many, rng = batch_of(groups=2, size=2), batch_of(groups=5, size=2), np.random.default_rng(0)
    for turn in range(3):
        assert [group.scenario for group in few.simulations] == [group.scenario for group in many.simulations[:2]]
        for _ in range(3):
            actions = drawn_actions(many, rng)
            a, b = step(few, actions), step(many, actions)
            assert (a.observation == b.observation[:4]).all()
        many.reset(np.arange(10) >= 8 if turn == 0 else None)
        if turn:
            few.reset()


def test_worlds_that_are_reset_together_change_their_scenario_and_others_do_not():
    batch = batch_of(groups=3, size=2, seed=2)
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
        ({"scenario": "monitoring-v1:exam"}, "split must be one of train, validation, test, .*got 'exam'"),
        ({"scenario": "evaders", "num_groups": 2}, "num_groups must be 1 without a space of scenarios, got 2"),
        ({"scenario": "evaders", "roles": "rogue"}, "roles must be any, robots or rogues, got 'rogue'"),
        *(({"scenario": "evaders", **one}, "robots must be given if, and only if, roles is rogues")
          for one in ({"roles": "rogues"}, {"robots": "still"})),
        ({"roles": "rogues", "robots": "still"}, "robots must be None with a space, whose rogues are no agents"),
    ],
)  # fmt: skip
def test_invalid_arguments_are_refused_by_name(changes, words):
    with pytest.raises(ValueError, match=words):
        Batch(**{"scenario": SPACE, "num_worlds": 4} | changes)


def test_draws_that_do_not_fit_are_skipped(monkeypatch):
    # Oracle: the scenarios of another sequence from the same seed, without those that are skipped.
    def draws(fits):
        return Draws(SPACE, "train", 5, lambda candidate: candidate, fits)

    every, few = draws(lambda candidate: True), draws(lambda candidate: candidate.num_robots == 3)
    due = [drawn for drawn in (every.next(0) for _ in range(20)) if drawn[0].num_robots == 3]
    assert [few.next(0) for _ in due] == due
    monkeypatch.setattr("lissajous_env.parameters.space._MOST_DRAWS", 9)
    with pytest.raises(ValueError, match="space small must contain more scenarios of the largest size, got none"):
        draws(lambda candidate: False).next(0)
