"""Invalid input raises an error with name, rule and value, and leaves the environment unchanged.

Scenarios are tested in test_scenario.py; here are running environments and their constructors.
"""

import functools

import numpy as np
import pytest
import warp as wp
from gymnasium.error import ResetNeeded

from lissajous_env import Batch, LissajousEnv, Simulation, env, parallel_env, vector_env


def assert_refused(simulation, call, words):
    """Assert that a call raises a ValueError with these words and changes no array of the simulation."""
    before = simulation.save_state()
    with pytest.raises(ValueError, match=words):
        call()
    after = simulation.save_state()
    assert [name for name in before if before[name].tobytes() != after[name].tobytes()] == []


# Making a simulation or an environment.
CONSTRUCTORS = {
    r"num_worlds must be a whole number of at least 1, got": (
        "num_worlds", [0, -3, 1.5, "4", None, True, np.True_, np.ma.masked, np.array([None])]
    ),
    r"device must be one of those present \(.*cpu.*\), got": ("device", ["cuda:9", "tpu", "", 7, None]),
    r"threads must be a whole number of at least 1 or None, got": ("threads", [0, -1, "2", 1.5, True]),
    r"seed must be a whole number from 0 to 2147483647, got": ("seed", [-1, 2**31, 1.5, True, "1", None, 10**30]),
}  # fmt: skip


@pytest.mark.parametrize("words", CONSTRUCTORS)
def test_arguments_of_a_simulation(words):
    name, values = CONSTRUCTORS[words]
    for value in values:
        with pytest.raises(ValueError, match=f"^{words}") as refused:
            Simulation("failure", **{name: value})
        assert value is np.ma.masked or str(value) in str(refused.value)


@pytest.mark.parametrize(("make", "settings", "words"), [
    (Simulation, {"num_worlds": 3, "seed": 2**31 - 2}, "seed must be a whole number from 0 to 2147483647"),
    (Simulation, {"num_worlds": 10**9}, r"^num_worlds must fit into the memory of cpu, \d+ MiB, at .* a world, got 10"),
    (Simulation, {"robot.count": 1024, "task.grid": (4096, 4096), "faults.schedule": ()},
     r"^scenario must need less than 2048 MiB in an array of a world"),
    (parallel_env, {"render_mode": "ansi"}, "render_mode must be None, rgb_array or human, got 'ansi'"),
    (env, {"render_mode": 1}, "render_mode must be None, rgb_array or human, got 1"),
    (LissajousEnv, {"render_mode": ""}, "render_mode must be None, rgb_array or human, got ''"),
    (vector_env, {"num_envs": 0}, "num_envs must be a whole number of at least 1, got 0"),
    (vector_env, {"autoreset_mode": "NEVER"}, "must be one of NEXT_STEP, SAME_STEP, DISABLED, got 'NEVER'"),
    (vector_env, {"robot.radios": 1.0}, r"got 'robot.radios'; did you mean robot.radius\?"),
])  # fmt: skip
def test_settings_of_an_environment(make, settings, words):
    with pytest.raises(ValueError, match=words):
        make("failure", **settings)


# The simulation.
SHAPE = r"^action must have shape \(2, 5, 1\), got"
NUMBERS = "^action must contain real numbers, got"
WARP = "^action must contain float32 if it is a Warp array, got"  # its bits used to be read as float32
ACTIONS = [
    *((np.zeros(shape), SHAPE) for shape in [(2, 5), (2, 4, 1), (2, 5, 1, 1), ()]),
    (np.zeros((2, 5)).tolist(), SHAPE), (None, NUMBERS), ("north", NUMBERS), ([[[0.0]] * 5, [[0.0]] * 4], NUMBERS),
    *((np.zeros((2, 5, 1), dtype), NUMBERS) for dtype in (complex, object, bool)),
    *((wp.zeros((2, 5, 1), dtype=dtype), WARP) for dtype in (wp.int32, wp.float16)),
]  # fmt: skip


def test_what_is_no_action():
    simulation = Simulation("failure", 2)
    for action, words in ACTIONS:
        assert_refused(simulation, lambda action=action: simulation.step(action), words)


WORLDS = r"^worlds must be (a mask of shape \(3,\)|from 0 to 2|a mask or indices of worlds|in one row, each once), got"
SEED = "seed must be a whole number from 0 to 2147483647, got"
NO_WORLDS = [True, False], [0, 3], [-1], [0.9], ["0"], "all", [[0], [1]], [1, 1], [[0], [1, 2]]
RESETS = [
    *(((worlds, None), WORLDS) for worlds in NO_WORLDS),
    *((([0, 1], seeds), SEED) for seeds in ([0, 2**31], [0.5, 1.0], ["a", "b"], [True, False], [[0], [1, 2]])),
    *((args, "seeds must be one for each of the") for args in [(None, [1]), ([0, 1], [1, 2, 3]), ([1], [[1]])]),
]  # fmt: skip


def test_worlds_and_seeds_of_a_reset():
    simulation = Simulation("failure", 3)
    for args, words in RESETS:
        assert_refused(simulation, lambda args=args: simulation.reset(*args), words)
    simulation.reset(seeds=[0, 1, 2**31 - 1])
    assert simulation.clock.seed.numpy().tolist() == [0, 1, 2**31 - 1]


# The environments.
def test_steps_outside_an_episode():
    for make, action in (
        (lambda: parallel_env("experiment", max_cycles=2), {f"robot_{i}": np.zeros(2) for i in range(5)}),
        (lambda: LissajousEnv("experiment", max_cycles=2), np.zeros((5, 2))),
    ):
        one = make()
        with pytest.raises(ResetNeeded):
            one.step(action)
        one.reset(seed=1)
        for _ in range(2):
            one.step(action)
        before = one.simulation.save_state()
        with pytest.raises(ResetNeeded):
            one.step(action)
        assert all(before[name].tobytes() == array.tobytes() for name, array in one.simulation.save_state().items())
    with pytest.raises(ResetNeeded):
        vector_env("failure", 2).step(np.zeros((2, 5, 1)))


def good_actions(agents):
    return {agent: np.zeros(2, dtype=np.float32) for agent in agents.agents}


REFUSED = {
    "missing": ({"robot_3": None}, r"missing \['robot_3'\], unknown or not live \[\]"),
    "unknown": ({"robot_9": np.zeros(2)}, r"missing \[\], unknown or not live \['robot_9'\]"),
    "one number": ({"robot_1": np.zeros(1)}, r"action of robot_1 must be numbers of shape \(2,\), got array\(\[0"),
    "shapes that add up": ({"robot_1": np.zeros(1, np.float32), "robot_2": np.zeros(3, np.float32)}, "of robot_1 must"),
    "a scalar": ({"robot_1": 0.5}, r"action of robot_1 must be numbers of shape \(2,\), got 0.5"),
    "words": ({"robot_2": ["left", "fast"]}, r"action of robot_2 must be numbers of shape \(2,\), got \['left'"),
    "truth": ({"robot_2": np.array([True, False])}, "action of robot_2 must be"),
    "not a number": ({"robot_4": np.array([0.0, np.nan])}, r"action of robot_4 must be finite, got \[0.0, nan\]"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_actions_of_agents(name):
    changes, words = REFUSED[name]
    agents, other = parallel_env("experiment"), parallel_env("experiment")
    for environment in (agents, other):
        environment.reset(seed=1)
        environment.step(good_actions(environment))
    actions = {agent: action for agent, action in (good_actions(agents) | changes).items() if action is not None}
    assert_refused(agents.simulation, lambda: agents.step(actions), words)
    # A refused action leaves no trace: the next good step is that of an environment that was never asked.
    assert np.isfinite(agents.simulation.action.numpy()).all()
    assert str(agents.step(good_actions(agents))) == str(other.step(good_actions(other)))


def test_an_agent_that_was_removed():
    crashing = {"task.on_collision": "remove", "robot.radius": 0.3, "formation.start": "random"}
    agents = parallel_env("experiment", **crashing)
    agents.reset(seed=2)
    while len(agents.agents) == 5:
        agents.step(good_actions(agents))
    gone = next(agent for agent in agents.possible_agents if agent not in agents.agents)
    with pytest.raises(ValueError, match=rf"unknown or not live \['{gone}'\]"):
        agents.step(good_actions(agents) | {gone: np.zeros(2)})


def test_discrete_actions():
    agents = parallel_env("experiment", discrete_actions=True)
    agents.reset(seed=1)
    words = "action of robot_2 must be a whole number from 0 to 14, got"
    for action in (-1, 15, 1.0, np.zeros(2), "3", None, True, np.array([True])):
        actions = dict.fromkeys(agents.agents, 3) | {"robot_2": action}
        assert_refused(agents.simulation, lambda actions=actions: agents.step(actions), words)


MADE = {
    "parallel": lambda: parallel_env("failure"),
    "team": lambda: LissajousEnv("failure"),
    "vector": lambda: vector_env("failure", 3),
    "discrete": lambda: vector_env("failure", 3, discrete_actions=True),
    "rows": lambda: vector_env("failure", 3, agents_as_rows=True),
    "batch": lambda: Batch("failure", 3),
}
TEAM, MASK = r"actions must be numbers of shape \(5, 1\), got", r"reset_mask must be bool of shape \(3,\), got"
DISCRETE = r"whole numbers? (of shape \(3, 5\)|from 0 to 6), got"
CALLS = [
    *(("parallel", "reset", {"seed": seed}, "seed must be a whole number") for seed in (-1, 1.5, "1", [3], True)),
    *(("parallel", "step", {"actions": actions}, "actions must be a dict of agents and their actions, got")
      for actions in (None, np.zeros((5, 1)), [np.zeros(1)] * 5)),
    *(("team", "step", {"action": action}, TEAM) for action in (np.zeros((4, 1)), np.zeros(1), 0.0, None)),
    ("team", "step", {"action": np.array([[0.0], [np.nan], [0.0], [0.0], [0.0]])},
     "action of robot_1 in world 0 must be finite"),
    *(("vector", "reset", {"seed": seed}, "seed must be")
      for seed in (-1, [1, 2], [1, 2, -3], [1.5, 2.5, 3.5], "abc", 1.5)),
    *(("vector", "reset", {"options": {"reset_mask": mask}}, MASK)
      for mask in ([True, False], [0, 1, 1], np.array([0, 2]), "all", np.ones((3, 1), dtype=bool), 1)),
    *(("rows", "reset", {"options": {"reset_mask": mask}}, "reset_mask must (be bool of shape|contain all rows)")
      for mask in (np.arange(15) == 3, np.ones(3, bool), np.ones(15))),
    ("rows", "reset", {"options": 5}, "options must be a dict, got 5"),
    ("vector", "step", {"actions": np.zeros((3, 5))}, r"actions must be numbers of shape \(3, 5, 1\), got \(3, 5\)"),
    *(("discrete", "step", {"actions": actions}, DISCRETE)
      for actions in (np.zeros((3, 5)), np.full((3, 5), 7), np.full((3, 5), -1), np.zeros((3, 4), int), 0)),
    ("discrete", "step", {"actions": np.full((3, 5), 7)}, "whole number from 0 to 6, got 7$"),
    *(("batch", "seed", {"seed": seed}, "seed must be a (number, or one for each of 3 worlds|whole number)")
      for seed in ([1], [1, 2], [1, 2, 3, 4], [[1, 2, 3]], [1, 2, -3], -1, 1.5, "1")),
    ("batch", "seed", {"seed": [1, 2, 3], "worlds": [0, 2]}, "seed must be a number, or one for each of 2 worlds"),
    *(("batch", "seed", {"seed": 1, "worlds": worlds}, WORLDS) for worlds in NO_WORLDS),
    *(("batch", "reset", {"worlds": worlds}, WORLDS) for worlds in NO_WORLDS),
]  # fmt: skip


@pytest.mark.parametrize("name", MADE)
def test_what_an_environment_does_not_take(name):
    environment = MADE[name]()
    environment.reset()
    for method, settings, words in (call for kind, *call in CALLS if kind == name):
        call = functools.partial(getattr(environment, method), **settings)
        assert_refused(getattr(environment, "batch", environment), call, words)
