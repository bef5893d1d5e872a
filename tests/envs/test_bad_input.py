"""Invalid input raises an error with name, rule and value, and leaves the environment unchanged.

Scenarios are tested in test_scenario.py; here are running environments and their constructors.
"""

import numpy as np
import pytest
import warp as wp
from gymnasium.error import ResetNeeded

import lissajous_env


def state_of(simulation):
    return {name: array.copy() for name, array in simulation.__getstate__()["arrays"].items()}


def assert_untouched(simulation, before):
    after = state_of(simulation)
    assert [name for name in before if before[name].tobytes() != after[name].tobytes()] == []


def good_actions(env):
    return {agent: np.zeros(2, dtype=np.float32) for agent in env.agents}


# Making a simulation or an environment.


@pytest.mark.parametrize(
    "worlds", [0, -3, 1.5, "4", None, True, np.True_, np.ma.masked, np.array([None], dtype=object), np.array([1, 2])]
)
def test_a_number_of_worlds(worlds):
    with pytest.raises(ValueError, match="num_worlds must be a whole number of at least 1, got"):
        lissajous_env.Simulation(lissajous_env.scenario("failure"), worlds)


@pytest.mark.parametrize("device", ["cuda:9", "tpu", "", 7, None])
def test_a_device_that_is_not_there(device):
    with pytest.raises(ValueError, match=r"device must be one of those present \(.*cpu.*\), got") as refused:
        lissajous_env.Simulation(lissajous_env.scenario("failure"), device=device)
    assert repr(device) in str(refused.value)


@pytest.mark.parametrize("threads", [0, -1, "2", 1.5, True])
def test_a_number_of_threads(threads):
    with pytest.raises(ValueError, match=f"threads must be a whole number of at least 1 or None, got {threads!r}"):
        lissajous_env.Simulation(lissajous_env.scenario("failure"), threads=threads)


@pytest.mark.parametrize("seed", [-1, 2**31, 1.5, True, "1", None, 10**30])
def test_a_seed_of_a_simulation(seed):
    with pytest.raises(ValueError, match="seed must be a whole number from 0 to 2147483647, got"):
        lissajous_env.Simulation(lissajous_env.scenario("failure"), seed=seed)


def test_a_seed_that_only_the_last_world_cannot_have():
    with pytest.raises(ValueError, match="seed must be a whole number from 0 to 2147483647"):
        lissajous_env.Simulation(lissajous_env.scenario("failure"), 3, seed=2**31 - 2)


@pytest.mark.parametrize("mode", ["ansi", "RGB_ARRAY", 1, ""])
def test_a_render_mode(mode):
    for make in (lissajous_env.parallel_env, lissajous_env.env, lissajous_env.LissajousEnv):
        with pytest.raises(ValueError, match="render_mode must be None, rgb_array or human, got") as refused:
            make("failure", render_mode=mode)
        assert repr(mode) in str(refused.value)


def test_an_autoreset_mode():
    with pytest.raises(ValueError, match="autoreset_mode must be one of NEXT_STEP, SAME_STEP, DISABLED, got 'NEVER'"):
        lissajous_env.vector_env("failure", 2, autoreset_mode="NEVER")


def test_names_come_with_the_nearest():
    with pytest.raises(ValueError, match=r"scenario must be one of .*, got 'faliure'; did you mean failure\?"):
        lissajous_env.parallel_env("faliure")
    with pytest.raises(ValueError, match=r"got robot.radios; did you mean robot.radius\?"):
        lissajous_env.vector_env("failure", **{"robot.radios": 1.0})


# The simulation.


@pytest.mark.parametrize("shape", [(5, 1), (2, 5), (2, 5, 2), (3, 5, 1), (2, 4, 1), (2, 5, 1, 1), ()])
def test_an_action_of_another_shape(shape):
    simulation = lissajous_env.Simulation(lissajous_env.scenario("failure"), 2)
    before = state_of(simulation)
    for action in (np.zeros(shape), np.zeros(shape).tolist()):
        with pytest.raises(ValueError, match=r"action must have shape \(2, 5, 1\), got"):
            simulation.step(action)
    assert_untouched(simulation, before)


@pytest.mark.parametrize("scenario", ["failure", "swarm"])
def test_more_worlds_than_there_is_memory(scenario):
    with pytest.raises(
        ValueError, match=r"^num_worlds must fit into the memory of cpu, \d+ MiB, at .* a world, got 1000"
    ):
        lissajous_env.Simulation(scenario, 10**9)


def test_a_grid_for_a_thousand_robots_that_no_array_holds():
    large = {"robot.count": 1024, "task.grid": (4096, 4096), "faults.schedule": ()}
    with pytest.raises(ValueError, match=r"^scenario must need less than 2048 MiB in an array of a world"):
        lissajous_env.Simulation(lissajous_env.scenario("failure", **large))


NO_NUMBERS = {
    "None": None,
    "a word": "north",
    "words": [[["a"]] * 5] * 2,
    "complex": np.zeros((2, 5, 1), dtype=complex),
    "objects": np.zeros((2, 5, 1), dtype=object),
    "booleans": np.zeros((2, 5, 1), dtype=bool),
    "ragged": [[[0.0]] * 5, [[0.0]] * 4],
}


@pytest.mark.parametrize("action", NO_NUMBERS.values(), ids=NO_NUMBERS)
def test_an_action_that_is_no_numbers(action):
    simulation = lissajous_env.Simulation(lissajous_env.scenario("failure"), 2)
    before = state_of(simulation)
    with pytest.raises(ValueError, match=r"^action must contain real numbers, got"):
        simulation.step(action)
    assert_untouched(simulation, before)


@pytest.mark.parametrize("dtype", [wp.int32, wp.float64, wp.float16, wp.uint8])
def test_a_warp_action_of_another_type(dtype):
    # Its bits used to be read as float32.
    simulation = lissajous_env.Simulation(lissajous_env.scenario("failure"), 2)
    before = state_of(simulation)
    with pytest.raises(ValueError, match=r"^action must contain float32 if it is a Warp array, got"):
        simulation.step(wp.zeros((2, 5, 1), dtype=dtype))
    assert_untouched(simulation, before)


@pytest.mark.parametrize("dtype", [np.int64, np.float16, np.float64, np.uint8])
def test_numbers_of_any_size_are_taken_as_what_they_are(dtype):
    # Oracle: the same numbers as float32.
    simulations = [lissajous_env.Simulation(lissajous_env.scenario("failure"), 2) for _ in range(2)]
    for simulation, kind in zip(simulations, (dtype, np.float32), strict=True):
        simulation.step(np.ones((2, 5, 1), dtype=kind))
    assert_untouched(simulations[0], state_of(simulations[1]))


@pytest.mark.parametrize(
    "seeds", [[-1, 0], [0, 2**31], [0.5, 1.0], ["a", "b"], [True, False], [None, 1], [2**70, 0], [[0], [1, 2]]]
)
def test_seeds_of_a_reset(seeds):
    simulation = lissajous_env.Simulation(lissajous_env.scenario("failure"), 2)
    before = state_of(simulation)
    with pytest.raises(ValueError, match="seed must be a whole number from 0 to 2147483647, got"):
        simulation.reset(seeds=seeds)
    assert_untouched(simulation, before)


def test_a_wrong_count_of_seeds():
    simulation = lissajous_env.Simulation(lissajous_env.scenario("failure"), 3)
    for worlds, seeds in [(None, [1]), ([0, 1], [1, 2, 3]), ([1], [[1]])]:
        with pytest.raises(ValueError, match="seeds must be one for each of the"):
            simulation.reset(worlds, seeds=seeds)


@pytest.mark.parametrize(
    "worlds",
    [
        [True, False],
        [[True, False, True]],
        [0, 3],
        [-1],
        7,
        [0.9],
        0.0,
        ["0"],
        [None],
        [[0], [1]],
        [1, 1],
        [[0], [1, 2]],
        [2**70],
    ],
)
def test_worlds_of_a_reset(worlds):
    simulation = lissajous_env.Simulation(lissajous_env.scenario("failure"), 3)
    before = state_of(simulation)
    rules = r"(a mask of shape \(3,\)|from 0 to 2|a mask or indices of worlds|in one row, each once)"
    with pytest.raises(ValueError, match=f"^worlds must be {rules}, got"):
        simulation.reset(worlds)
    assert_untouched(simulation, before)


# The PettingZoo environment.


def test_a_step_before_the_first_reset_and_after_the_end():
    env = lissajous_env.parallel_env("experiment", max_cycles=2)
    with pytest.raises(ResetNeeded, match="call reset first"):
        env.step({agent: np.zeros(2) for agent in env.possible_agents})
    env.reset(seed=1)
    for _ in range(2):
        env.step(good_actions(env))
    before = state_of(env.simulation)
    with pytest.raises(ResetNeeded, match="call reset first"):
        env.step({agent: np.zeros(2) for agent in env.possible_agents})
    assert env.step({}) == ({}, {}, {}, {}, {})
    assert_untouched(env.simulation, before)


def changed(env, agent, action):
    actions = good_actions(env)
    if action is None:
        del actions[agent]
    else:
        actions[agent] = action
    return actions


REFUSED = {
    "missing": ("robot_3", None, r"missing \['robot_3'\], unknown or not live \[\]"),
    "unknown": ("robot_9", np.zeros(2), r"missing \[\], unknown or not live \['robot_9'\]"),
    "one number": ("robot_1", np.zeros(1), r"action of robot_1 must be numbers of shape \(2,\), got array\(\[0"),
    "a row too many": ("robot_1", np.zeros((1, 2)), r"action of robot_1 must be numbers of shape \(2,\)"),
    "a scalar": ("robot_1", 0.5, r"action of robot_1 must be numbers of shape \(2,\), got 0.5"),
    "words": ("robot_2", ["left", "fast"], r"action of robot_2 must be numbers of shape \(2,\), got \['left'"),
    "nothing": ("robot_2", np.array([None, None]), r"action of robot_2 must be numbers of shape \(2,\)"),
    "not a number": ("robot_4", np.array([0.0, np.nan]), r"action of robot_4 must be finite, got \[0.0, nan\]"),
    "infinite": ("robot_0", np.array([-np.inf, 0.0]), r"action of robot_0 must be finite, got \[-inf, 0.0\]"),
}


@pytest.mark.parametrize(("agent", "action", "message"), REFUSED.values(), ids=REFUSED)
def test_actions_of_agents(agent, action, message):
    env = lissajous_env.parallel_env("experiment")
    env.reset(seed=1)
    env.step(good_actions(env))
    before = state_of(env.simulation)
    with pytest.raises(ValueError, match=message):
        env.step(changed(env, agent, action))
    assert_untouched(env.simulation, before)
    # A refused action leaves no trace: the next good step is that of an environment that was never asked.
    other = lissajous_env.parallel_env("experiment")
    other.reset(seed=1)
    other.step(good_actions(other))
    assert str(env.step(good_actions(env))) == str(other.step(good_actions(other)))


def test_an_unknown_agent_in_the_place_of_a_known_one():
    env = lissajous_env.parallel_env("experiment")
    env.reset(seed=1)
    actions = changed(env, "robot_3", None) | {"robot_9": np.zeros(2)}
    with pytest.raises(ValueError, match=r"missing \['robot_3'\], unknown or not live \['robot_9'\]"):
        env.step(actions)


@pytest.mark.parametrize("actions", [None, np.zeros((5, 2)), [np.zeros(2)] * 5, 3])
def test_actions_that_are_no_dict(actions):
    env = lissajous_env.parallel_env("experiment")
    env.reset(seed=1)
    before = state_of(env.simulation)
    with pytest.raises(ValueError, match="actions must be a dict of agents and their actions, got"):
        env.step(actions)
    assert_untouched(env.simulation, before)


def test_an_agent_that_was_removed():
    crashing = {"task.on_collision": "remove", "robot.radius": 0.3, "formation.start": "random"}
    env = lissajous_env.parallel_env("experiment", **crashing)
    env.reset(seed=2)
    while len(env.agents) == 5:
        env.step(good_actions(env))
    gone = next(agent for agent in env.possible_agents if agent not in env.agents)
    with pytest.raises(ValueError, match=rf"unknown or not live \['{gone}'\]"):
        env.step(good_actions(env) | {gone: np.zeros(2)})


@pytest.mark.parametrize("action", [-1, 15, 1.0, np.zeros(2), "3", None, np.array([1.0])])
def test_discrete_actions(action):
    env = lissajous_env.parallel_env("experiment", discrete_actions=True)
    env.reset(seed=1)
    before = state_of(env.simulation)
    actions = dict.fromkeys(env.agents, 3) | {"robot_2": action}
    with pytest.raises(ValueError, match="action of robot_2 must be a whole number from 0 to 14, got"):
        env.step(actions)
    assert_untouched(env.simulation, before)


@pytest.mark.parametrize("seed", [-1, 1.5, "1", [3]])
def test_a_seed_of_an_environment(seed):
    env = lissajous_env.parallel_env("experiment")
    env.reset(seed=1)
    before = state_of(env.simulation)
    with pytest.raises(ValueError, match="seed must be a whole number"):
        env.reset(seed=seed)
    assert_untouched(env.simulation, before)


@pytest.mark.parametrize("seed", [2**31, 2**63, 10**40])
def test_a_large_seed_is_folded(seed):
    # Gymnasium allows any whole number from 0. Oracle: the same again, and different from its neighbour.
    env = lissajous_env.parallel_env("experiment")
    rows = [env.reset(seed=s)[0]["robot_0"].tobytes() for s in (seed, seed, seed + 1)]
    assert rows[0] == rows[1] != rows[2]


# The Gymnasium environments.


def test_steps_outside_an_episode():
    with pytest.raises(ResetNeeded):
        lissajous_env.vector_env("failure", 2).step(np.zeros((2, 5, 1)))
    env = lissajous_env.LissajousEnv("failure", max_cycles=1)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros((5, 1)))
    env.reset(seed=1)
    env.step(np.zeros((5, 1)))
    with pytest.raises(ResetNeeded):
        env.step(np.zeros((5, 1)))


@pytest.mark.parametrize("action", [np.zeros((4, 1)), np.zeros((6, 1)), np.zeros(1), 0.0, None])
def test_a_team_of_another_size(action):
    env = lissajous_env.LissajousEnv("failure")
    env.reset(seed=1)
    before = state_of(env.simulation)
    with pytest.raises(ValueError, match=r"actions must be numbers of shape \(5, 1\), got"):
        env.step(action)
    with pytest.raises(ValueError, match="action of robot_1 in world 0 must be finite"):
        env.step(np.array([[0.0], [np.nan], [0.0], [0.0], [0.0]]))
    assert_untouched(env.simulation, before)


@pytest.mark.parametrize("seed", [-1, [1, 2], [1, 2, -3], [1.5, 2.5, 3.5], "abc", 1.5])
def test_seeds_of_a_vector(seed):
    env = lissajous_env.vector_env("failure", 3)
    env.reset(seed=1)
    before = state_of(env.simulation)
    with pytest.raises(ValueError, match="seed must be"):
        env.reset(seed=seed)
    assert_untouched(env.simulation, before)


@pytest.mark.parametrize("mask", [[True, False], [0, 1, 1], np.array([0, 2]), "all", np.ones((3, 1), dtype=bool), 1])
def test_a_mask_of_a_vector(mask):
    env = lissajous_env.vector_env("failure", 3)
    env.reset(seed=1)
    before = state_of(env.simulation)
    with pytest.raises(ValueError, match=r"reset_mask must be bool of shape \(3,\), got"):
        env.reset(options={"reset_mask": mask})
    assert_untouched(env.simulation, before)


def test_actions_of_a_vector():
    env = lissajous_env.vector_env("failure", 3)
    env.reset(seed=1)
    before = state_of(env.simulation)
    with pytest.raises(ValueError, match=r"action must have shape \(3, 5, 1\), got \(3, 5\)"):
        env.step(np.zeros((3, 5)))
    assert_untouched(env.simulation, before)


@pytest.mark.parametrize(
    "actions", [np.zeros((3, 5)), np.full((3, 5), 7), np.full((3, 5), -1), np.zeros((3, 4), int), 0]
)
def test_discrete_actions_of_a_vector(actions):
    env = lissajous_env.vector_env("failure", 3, discrete_actions=True)
    env.reset(seed=1)
    before = state_of(env.simulation)
    with pytest.raises(ValueError, match=r"whole numbers? (of shape \(3, 5\)|from 0 to 6), got"):
        env.step(actions)
    assert_untouched(env.simulation, before)
