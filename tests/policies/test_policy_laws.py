"""Properties of every registered policy: rows are independent, and it can be copied at any time."""

import copy
import pickle

import numpy as np
import pytest
import warp as wp
from choices import differing

import baselines
import lissajous_env
from baselines import names
from baselines.policies import registry
from baselines.policies.base import Policy
from baselines.policies.coordinators import TrackedReference
from lissajous_env import Simulation

STEPS = 6


def made_for(name):
    return registry.describe(name)["made_for"]


CASES = [
    (name, next(scenario for scenario in ("rough", "failure", *made_for(name), "watch") if name in names(scenario)))
    for name in differing(names())
]


def episode(policy, scenario, worlds, seed, steps=STEPS):
    """Observations and actions (steps, W, N ...) of a policy that drives the worlds itself."""
    simulation, seen, actions = Simulation(scenario, worlds, seed=seed), [], []
    for _ in range(steps):
        seen.append(simulation.observation.numpy().copy())
        actions.append(policy.act(seen[-1]))
        simulation.step(actions[-1])
    return np.array(seen), np.array(actions)


@pytest.mark.parametrize(("name", "scenario"), CASES)
def test_a_row_is_the_same_in_any_batch_at_any_place(name, scenario):
    """Oracle: the batch of 6 worlds, for batches of 1 and 5 of them, in another order, of NumPy and of Warp."""
    draw = np.random.default_rng(3)
    seen, actions = episode(baselines.make(name, scenario, 6), scenario, 6, seed=40)
    for size in (1, 5):
        policy, worlds = baselines.make(name, scenario, size), draw.permutation(6)[:size]
        for rows, action in zip(seen[:, worlds], actions[:, worlds], strict=True):
            batch = np.ascontiguousarray(rows)
            batch = batch if size == 1 else wp.array(batch, dtype=wp.float32, device="cpu")
            np.testing.assert_array_equal(policy.act(batch), action)


@pytest.mark.parametrize(("name", "scenario"), [case for case in CASES if not case[0].endswith("-proved")])
def test_a_robots_action_depends_on_its_own_row_alone(name, scenario):
    """Oracle: changing every other row, in each of six steps, leaves robot 2's action as it was, bit for bit.

    The proved filter is left out: it receives the tails of all robots.
    """
    other = baselines.make(name, scenario)
    for seen, action in zip(*episode(baselines.make(name, scenario), scenario, 1, seed=5), strict=True):
        changed = seen[:, ::-1].copy()
        changed[:, 2] = seen[:, 2]
        np.testing.assert_array_equal(action[0, 2], other.act(changed)[0, 2])


@pytest.mark.parametrize(("name", "scenario"), CASES)
def test_a_copy_goes_on_as_the_original(name, scenario):
    """Oracle: the original itself, over the steps that follow, one of its worlds forgotten on the way."""
    scenario = lissajous_env.scenario(scenario, **{"noise.message_delay": 0.8})  # so that messages are remembered
    policy, simulation = baselines.make(name, scenario, 3), Simulation(scenario, 3, seed=7)
    for _ in range(10):
        simulation.step(policy.act(simulation.observation))
    loaded = baselines.make(name, scenario, 3)
    loaded.load_state(policy.save_state())
    copies = [copy.deepcopy(policy), pickle.loads(pickle.dumps(policy)), loaded]
    assert all(type(clone) is type(policy) and clone.name == name for clone in copies)
    for step in range(STEPS):
        rows = simulation.observation.numpy().copy()
        action = policy.act(rows)
        for clone in copies:
            np.testing.assert_array_equal(clone.act(rows), action)
        simulation.step(action)
        if step == 3:
            for clone in (policy, *copies):
                clone.reset([1])


class Remembering(Policy):
    """A user's policy with memory of every kind: numbers, lists, arrays of NumPy and Warp, a part, a generator."""

    kind = "curve"
    arrays = "warp"

    def __init__(self, scenario, num_worlds=1, device="cpu", *, gain):
        super().__init__(scenario, num_worlds, device)
        self.gain, self.steps, self.seen = gain, 0, []
        self.sums = np.zeros(self.action.shape, np.float32)
        self.draw = np.random.default_rng(3)
        self.part = TrackedReference(self.scenario, num_worlds, self.device)
        self.squash = lambda x: np.clip(x, -1, 1)

    def forget(self, mask):
        self.sums[mask] = 0

    def decide(self, observation):
        self.part.coordinate(observation)
        self.steps += 1
        self.seen.append(float(observation.numpy()[0, 0, 0]))
        self.sums += observation.numpy()[:, :, :1]
        noise = self.draw.normal() + np.mean(self.seen) + self.steps
        self.action.assign(self.squash(self.gain * noise * self.sums).astype(np.float32))


def test_a_users_policy_is_copied_with_all_that_it_keeps():
    policy, simulation = Remembering("failure", 2, gain=1e-3), Simulation("failure", 2)
    for _ in range(7):
        simulation.step(policy.act(simulation.observation))
    policy.late = "set after it was made"
    for clone in (copy.deepcopy(policy), pickle.loads(pickle.dumps(policy))):
        assert (clone.late, clone.steps, clone.gain) == (policy.late, 7, 1e-3)
        expected = copy.deepcopy(policy)
        for _ in range(3):
            rows = simulation.observation.numpy().copy()
            np.testing.assert_array_equal(clone.act(rows), expected.act(rows))
    assert policy.steps == 7, "the original is left as it was"
    policy.reset([1])
    assert [memory.any() for memory in (*policy.sums, *policy.part._memory.numpy())] == [True, False, True, False]
    policy.part.late = wp.zeros(3, dtype=wp.float32, device="cpu")  # which `__init__` does not make
    with pytest.raises(ValueError, match=r"saved state must contain only the arrays of Remembering, got part.late"):
        copy.deepcopy(policy)


@pytest.mark.parametrize(("change", "words"), [
    (lambda saved: saved.pop("_memory"), "must contain _memory of shape .2, 5, 2. of float32, got none"),
    (lambda saved: saved.update(_memory=np.zeros((1, 5, 2), np.float32)), r"got shape .1, 5, 2. of float32"),
    (lambda saved: saved.update(_memory=np.zeros((2, 5, 2))), r"got shape .2, 5, 2. of float64"),
    (lambda saved: saved.update(other=np.zeros(2)), "must contain only the arrays of Sweep, got other"),
])  # fmt: skip
def test_a_state_of_something_else_is_refused_by_name(change, words):
    policy = baselines.make("sweep", "rough", 2)
    before = policy.save_state()
    saved = {name: array + 1 for name, array in before.items()}
    change(saved)
    with pytest.raises(ValueError, match=words):
        policy.load_state(saved)
    assert all((array == before[name]).all() for name, array in policy.save_state().items()), "nothing has changed"


def act(rows):
    policy = baselines.make("kuramoto", "failure")
    policy.act(rows(policy.observation_shape))


@pytest.mark.parametrize(("wrong", "words"), [
    (lambda: act(lambda shape: np.full(shape, "a")), "observation must contain real numbers, got <U1"),
    (lambda: act(lambda _: [[1, 2], [3]]), "observation must contain real numbers, got rows of different lengths"),
    (lambda: act(lambda shape: wp.zeros(shape, int, "cpu")), "observation must be float32 of shape .*, got int32"),
    (lambda: act(lambda shape: np.zeros(shape[1:])), "observation must have shape"),
    (lambda: baselines.make("sweep", "rough", 2).reset([2]), "worlds must be"),
    (lambda: baselines.make("sweep", "rough", num_worlds=0), "num_worlds must be a whole number of at least 1, got"),
    (lambda: baselines.make("sweep", "rough", device="gpu"), "device must be one of those present"),
])  # fmt: skip
def test_observations_of_another_type_and_worlds_and_devices_that_are_not_there_are_refused(wrong, words):
    with pytest.raises(ValueError, match=words):
        wrong()


@pytest.mark.parametrize(("name", "scenario"), [("kuramoto", "failure"), ("partition-repair", "rough")])
def test_agents_act_by_name_as_in_the_batch(name, scenario):
    """Oracle: the batch, in PettingZoo's own loop."""
    env = lissajous_env.parallel_env(scenario, **{"task.duration": 0.6})
    simulation = Simulation(env.scenario, seed=3)
    policy, batch = baselines.make(name, env.scenario), baselines.make(name, env.scenario)
    observations, _ = env.reset(seed=3)
    while env.agents:
        actions = policy.act(observations)
        expected = batch.act(simulation.observation).numpy()[0]
        assert list(actions) == env.agents
        np.testing.assert_array_equal(np.stack(list(actions.values())), expected)
        simulation.step(expected[None])
        observations, *_ = env.step(actions)
    assert policy.act({}) == {}


def test_removed_agents_get_no_action():
    crowded = {"task.on_collision": "remove", "robot.radius": 0.4, "task.duration": 2.0}
    env = lissajous_env.parallel_env("experiment", **crowded)
    policy, fewest = baselines.make("kuramoto-mpcc", env.scenario), 5
    observations, _ = env.reset(seed=0)
    while env.agents:
        actions = policy.act({agent: observations[agent] for agent in env.agents})
        assert list(actions) == env.agents
        fewest = min(fewest, len(actions))
        observations, *_ = env.step(actions)
    assert fewest < 5


@pytest.mark.parametrize(("worlds", "rows", "words"), [
    (1, {"robot_9": 41}, "observation must be of the agents robot_0, .*, got robot_9"),
    (1, {"robot_1": 3}, r"observation of robot_1 must have shape \(42,\), got \(3,\)"),
    (2, {"robot_1": 42}, "policy must be for one world to take observations by agent, got 2"),
])  # fmt: skip
def test_observations_by_agent_that_do_not_fit_are_refused(worlds, rows, words):
    policy = baselines.make("sweep", "rough", worlds)
    with pytest.raises(ValueError, match=words):
        policy.act({agent: np.zeros(size, np.float32) for agent, size in rows.items()})


@pytest.mark.parametrize("number", [np.nan, 1e300])
def test_numbers_that_are_none_are_refused_by_name(number):
    policy = baselines.make("sweep", "rough", 2)
    rows = np.zeros(policy.observation_shape)
    rows[1, 2, 4] = number
    with pytest.raises(ValueError, match=r"observation must be finite, got .* for speed of robot_2 in world 1"):
        policy.act(rows)


@pytest.mark.filterwarnings("error:invalid value encountered in cast")
@pytest.mark.parametrize(("name", "scenario"), CASES)
def test_absurd_observations_give_finite_actions(name, scenario):
    policy, draw = baselines.make(name, scenario, 8), np.random.default_rng(0)
    for _ in range(4):
        rows = draw.uniform(-1, 1, policy.observation_shape).astype(np.float32)
        rows[draw.random(rows.shape) < 0.3] *= np.float32(3e38 if draw.random() < 0.5 else 1e6)
        action = policy.act(rows)
        assert np.isfinite(action).all()
        assert np.abs(action).max() <= 1
