"""Batches of many worlds on any number of threads, resets, and what else holds of `Simulation` as a whole.

Oracle throughout: the same world simulated another way; equality is of all state, to the last bit.
"""

import numpy as np
import pytest
import warp as wp

import lissajous_env

# All that is random at once, on cars and on points.
EVERYTHING = {
    "targets.count": 6, "targets.arrival_rate": 1.0, "targets.drifting": 0.3, "targets.wandering": 0.3,
    "targets.fleeing": 0.3, "sensing.radius": 0.4, "faults.rate": 0.2, "faults.mean_duration": 0.5,
    "task.duration": 6.0, "task.reward_idleness": 0.1, "noise.message_loss": 0.2, "noise.message_delay": 0.2,
    "noise.actuator": 0.1, "noise.position": 0.01,
}  # fmt: skip
CARS = lissajous_env.scenario("rough", **EVERYTHING)
POINTS = lissajous_env.scenario("failure", **EVERYTHING, **{"formation.start": "random", "task.on_collision": "remove"})
ROGUES = lissajous_env.scenario("evaders", rogues="flee")
PAST = ("final_observation",)
"""State of the previous episode: here the one that the constructor began, with another seed."""
EACH = pytest.mark.parametrize("scenario", [CARS, POINTS, ROGUES], ids=["cars", "points", "rogues"])


def state_of(simulation):
    """All arrays of a simulation but its input, world first, copied to the host."""
    inputs = ("action", "_action_host", "_seeds", "clock.active")
    return {name: array for name, array in simulation.save_state().items() if name not in inputs}


def actions_of(scenario, worlds, steps, seed=0):
    """(steps, worlds, N, size) actions, some outside [-1, 1]; those of a world depend on its number alone."""
    shape = (steps, scenario.num_robots, scenario.action_size)
    drawn = [np.random.default_rng([seed, w]).uniform(-1.2, 1.2, shape) for w in worlds]
    return np.stack(drawn, axis=1).astype(np.float32)


def run(scenario, seeds, actions, threads=1):
    """A simulation whose worlds have these seeds, after these actions."""
    simulation = lissajous_env.Simulation(scenario, len(seeds), threads=threads)
    simulation.reset(seeds=seeds)
    for action in actions:
        simulation.step(action)
    return simulation


def assert_same(state, other, worlds=slice(None), others=slice(None), but=()):
    different = [
        name
        for name in state
        if name not in but and state[name][worlds].tobytes() != np.ascontiguousarray(other[name][others]).tobytes()
    ]
    assert different == []


@EACH
def test_a_large_batch_in_blocks_on_two_threads_is_the_batch_on_one(scenario):
    # 1,100 worlds are several blocks, so that both threads have some.
    seeds, actions = np.arange(1100) + 5, actions_of(scenario, range(1100), 12)
    one, two = (state_of(run(scenario, seeds, actions, threads)) for threads in (1, 2))
    assert_same(one, two)
    last = state_of(run(scenario, seeds[-1:], actions[:, -1:]))
    assert_same(last, two, others=slice(-1, None), but=PAST)


@EACH
@pytest.mark.parametrize("as_mask", [True, False])
def test_a_masked_reset_leaves_the_other_worlds_alone(scenario, as_mask):
    simulation = run(scenario, range(6), actions_of(scenario, range(6), 25))
    before = state_of(simulation)
    chosen = np.array([False, True, False, False, True, False])
    simulation.reset(chosen if as_mask else np.flatnonzero(chosen), seeds=[100, 200])
    after = state_of(simulation)
    assert_same(before, after, ~chosen, ~chosen)
    # The rows with which the episodes ended are kept, and the new episodes are those of their seeds.
    np.testing.assert_array_equal(after["final_observation"][chosen], before["observation"][chosen])
    fresh = run(scenario, [100, 200], [])
    assert fresh.observation.numpy().tobytes() == after["observation"][chosen].tobytes()
    assert simulation.clock.step.numpy().tolist() == [25, 0, 25, 25, 0, 25]


def test_a_reset_without_seeds_draws_the_next_seed_from_the_last():
    simulation = lissajous_env.Simulation(CARS, 4, seed=1)
    seeds = []
    for _ in range(50):
        seeds.append(simulation.clock.seed.numpy().copy())
        simulation.reset()
    assert np.min(seeds) >= 0
    assert len(np.unique(seeds)) == 200
    alone = lissajous_env.Simulation(CARS, 1, seed=3)
    chain = []
    for _ in range(50):
        chain.append(int(alone.clock.seed.numpy()[0]))
        alone.reset()
    assert chain == [int(row[2]) for row in seeds]


def test_a_finished_world_stands_still():
    scenario = lissajous_env.scenario(CARS, **{"task.duration": 1.0})
    actions = actions_of(scenario, range(3), 15)
    simulation = lissajous_env.Simulation(scenario, 3, seed=1)
    for action in actions[:4]:
        simulation.step(action)
    simulation.reset([1], seeds=[9])
    for action in actions[4:10]:
        simulation.step(action)
    assert simulation.over.tolist() == [True, False, True]
    assert simulation.truncated.numpy().all(axis=1).tolist() == [True, False, True]
    before, score = state_of(simulation), simulation.score()
    for action in actions[10:13]:
        simulation.step(action)
        after = state_of(simulation)
        assert (after["latest.reward"][[0, 2]] == 0).all()
        assert (after["latest.terms"][[0, 2]] == 0).all()
        same = ("latest.reward", "latest.terms", "clock.status")
        assert_same(before, after, [0, 2], [0, 2], but=same)
        assert (after["robots.position"][1] != before["robots.position"][1]).any()
    now = simulation.score()
    assert str([now[0], now[2]]) == str([score[0], score[2]])
    assert not simulation.terminated.numpy().any()


@EACH
@pytest.mark.parametrize("bad", [np.nan, -np.inf])
def test_an_action_that_is_not_finite_flags_its_world_and_counts_as_zero(scenario, bad):
    actions = actions_of(scenario, range(5), 20)
    zeroed, spoiled = actions.copy(), actions.copy()
    zeroed[7, 2, 1] = 0.0
    spoiled[7, 2, 1, -1] = bad
    good, flagged = (run(scenario, range(5), batch) for batch in (zeroed, spoiled))
    assert flagged.invalid.numpy().tolist() == [0, 0, 1, 0, 0]
    assert good.invalid.numpy().tolist() == [0] * 5
    assert_same(state_of(good), state_of(flagged), but=("clock.invalid", "clock.invalid_at"))
    assert np.isfinite(flagged.observation.numpy()).all()
    flagged.reset([2])
    assert flagged.invalid.numpy().tolist() == [0] * 5


def test_the_kind_of_array_of_an_action_makes_no_difference():
    actions = actions_of(CARS, range(3), 5)
    expected = state_of(run(CARS, range(3), actions))
    assert_same(expected, state_of(run(CARS, range(3), actions.astype(np.float64))))
    assert_same(expected, state_of(run(CARS, range(3), actions.tolist())))
    assert_same(expected, state_of(run(CARS, range(3), [wp.array(a, dtype=wp.float32, device="cpu") for a in actions])))
    assert_same(expected, state_of(run(CARS, range(3), np.asfortranarray(actions))))


def test_the_arrays_stay_the_same_objects():
    # Contract of the docstring: a caller may keep them, also their view on the host.
    simulation = lissajous_env.Simulation(CARS, 2)
    names = ("observation", "final_observation", "reward", "terminated", "truncated", "invalid")
    before = [getattr(simulation, name) for name in names]
    view = simulation.observation.numpy()
    returned = simulation.step(np.zeros(simulation.action_shape))
    assert simulation.reset() is simulation.observation
    assert all(getattr(simulation, name) is array for name, array in zip(names, before, strict=True))
    assert all(a is b for a, b in zip(returned, [before[0], before[2], before[3], before[4]], strict=True))
    assert view.tobytes() == simulation.observation.numpy().tobytes()


def test_an_episode_in_which_all_robots_are_removed_ends_with_their_collision():
    # Story: two points meet, are removed, and the world stops in that very step, not in the next.
    overrides = {"robot.count": 2, "formation.p": 1, "formation.start": "random", "faults.schedule": ()}
    scenario = lissajous_env.scenario("failure", **overrides, **{"task.on_collision": "remove", "robot.radius": 0.1})
    simulation = lissajous_env.Simulation(scenario, 8)
    opposite = np.broadcast_to(np.array([[-1.0], [1.0]]), simulation.action_shape)
    removed_at = np.full(8, -1)
    for step in range(1, 40):
        simulation.step(opposite)
        gone = simulation.terminated.numpy().all(axis=1)
        removed_at[gone & (removed_at < 0)] = step
        assert (simulation.over == gone).all()
    assert (removed_at > 0).all()
    assert simulation.clock.step.numpy().tolist() == removed_at.tolist()
    assert not simulation.truncated.numpy().any()
