"""A world depends on its seed and actions only: not on other worlds, earlier contents of its memory or episodes."""

import numpy as np
import pytest
import warp as wp

import lissajous_env
from lissajous_env.device.warp_abi import fields_of, is_struct
from lissajous_env.world.robots.nearby import has_bins
from lissajous_env.world.values import constants_of

CROWD = {"curve.a": 51, "curve.b": 50, "robot.radius": 0.15, "sensing.radius": 0.4, "formation.phase_rate": 0.02}
CROWD |= {"targets.count": 60, "task.duration": 3.0}
ENTERING = {"targets.arrival_rate": 20.0, "targets.entry": "unseen", "targets.fleeing": 0.5, "targets.wandering": 0.5}
SHORT = {"task.duration": 3.0}
CASES = {
    "cars": ("experiment", SHORT),
    "evading targets and contamination": ("evaders", {**SHORT, "task.contamination": (36, 16)}),
    "contamination, several ticks in a step": ("evaders", {**SHORT, "targets.speed_limit": 2.0}),
    "contamination, several steps in a tick": (
        "experiment", {**SHORT, "task.contamination": (36, 16), "targets.arrival_rate": 3.0},
    ),
    "noise, faults and late messages": (
        "rough-lost", {**SHORT, "faults.rate": 0.5, "noise.message_delay": 0.3, "messages.size": 3},
    ),
    "stopped by collisions": ("rough", {**SHORT, "task.on_collision": "stop", "robot.radius": 0.3}),
    "removed by the edge": ("intruders", {**SHORT, "task.boundary": "remove"}),
    "in space": ("knot", SHORT),
    "tracks": ("intruders", {**SHORT, "sensing.tracks_seen": 4, "sensing.teammates_seen": 2, "sensing.shared": "team",
                             "sensing.cells_seen": (6, 4)}),
    "scripted rogues": ("evaders", {**SHORT, "rogues": "follow-gap"}),
    "rogues as agents": ("evaders", {**SHORT, "rogues": "agents"}),
    "a bound": ("evaders", {**SHORT, "rogues": "follow-gap", "task.conservative": True}),
    "bins": ("swarm", CROWD),
    "bins, targets enter and flee": ("swarm", {**CROWD, **ENTERING}),
    "bins, removed by collisions": ("swarm", {**CROWD, "task.on_collision": "remove", "faults.rate": 0.3}),
}  # fmt: skip
POISONS = ((np.nan, 77_777), (1e30, -1))


@lissajous_env.reward_term(weight=0.5)
def speedy(world):
    """Robots' speed."""
    return world.robots.speed


@lissajous_env.score_column(reduce="max")
def farthest(world):
    """Largest x."""
    return world.robots.position[..., 0].max(axis=1)


@lissajous_env.observation_entry(size=2)
def ahead(world):
    """Cosine and sine of the heading."""
    return np.stack([np.cos(world.robots.heading), np.sin(world.robots.heading)], axis=-1)


def simulation_of(case, worlds=2):
    name, overrides = CASES[case]
    scenario = lissajous_env.scenario(name, extensions=[speedy, farthest, ahead], **overrides)
    assert has_bins(scenario.resolve()) == case.startswith("bins")
    return lissajous_env.Simulation(scenario, worlds, seed=5)


def arrays_in(values):
    """Warp arrays of a mapping, and of the structs in it."""
    for value in values.values():
        if isinstance(value, wp.array):
            yield value
        elif is_struct(value):
            yield from arrays_in(fields_of(value))


def state_of(simulation):
    """Every array that kernels write: all that they are given, but what is made of the scenario alone."""
    constants = {"initial", *constants_of(simulation.scenario, simulation.device)}
    for program in (simulation._reset, simulation._step):
        yield from arrays_in({name: value for name, value in program._values.items() if name not in constants})
        for stage in program.stages:
            yield from arrays_in(stage.own)


def poison(simulation, floating, whole):
    for array in state_of(simulation):
        content = array.numpy()
        if content.dtype.kind == "f":
            content[...] = floating
        elif content.dtype.kind == "b":
            content[...] = True
        else:
            content[...] = np.array(whole).astype(content.dtype)


def actions(simulation, draws):
    """Return actions of the robots, and of the rogues where these are agents, that depend on the world alone."""
    shapes = [simulation.action_shape]
    if simulation.scenario.targets.rogues == "agents":
        shapes.append(simulation.rogues.action.shape)
    return [np.float32([draw.uniform(-1, 1, shape[1:]) for draw in draws]) for shape in shapes]


def play(simulation, seeds, steps=30):
    """Everything that an episode shows: observations, rewards and ends of each step, then score and state."""
    simulation.reset(seeds=seeds)
    shown = [simulation.observation.numpy().copy()]
    draws = [np.random.default_rng(seed) for seed in seeds]
    for _ in range(steps):
        simulation.step(*actions(simulation, draws))
        shown += [array.numpy().copy() for array in (simulation.observation, simulation.reward_terms)]
        shown += [simulation.terminated.numpy().copy(), simulation.truncated.numpy().copy()]
    return shown, str(simulation.score()), simulation.save_state()


def assert_same(got, expected):
    for step, (mine, other) in enumerate(zip(got[0], expected[0], strict=True)):
        assert np.array_equal(mine, other, equal_nan=True), f"array {step}"
    assert got[1] == expected[1]
    different = [name for name, array in got[2].items() if array.tobytes() != expected[2][name].tobytes()]
    # Nobody reads rows of the episode before, actions of rogues that are not there, and ends of lists of the nearest.
    assert set(different) <= {"final_observation", "rogues.action", "_nearest"}


@pytest.mark.parametrize("case", CASES)
def test_what_memory_held_before_a_reset_changes_nothing(case):
    # Oracle: a simulation that was never used.
    expected = play(simulation_of(case), [8, 9])
    for floating, whole in POISONS:
        used = simulation_of(case)
        play(used, [1, 2], steps=17)
        poison(used, floating, whole)
        assert_same(play(used, [8, 9]), expected)


@pytest.mark.parametrize("case", CASES)
def test_a_world_in_a_batch_is_the_world_alone(case):
    # Oracle: the batch law, bit for bit, at another place of the batch.
    (shown, *_), (alone, *_) = play(simulation_of(case, 3), [8, 9, 10]), play(simulation_of(case, 1), [9])
    for step, (batch, mine) in enumerate(zip(shown, alone, strict=True)):
        assert np.array_equal(batch[1:2], mine, equal_nan=True), f"array {step}"


@pytest.mark.parametrize("case", CASES)
def test_a_loaded_state_goes_on_the_same_in_a_simulation_with_another_history(case):
    # Oracle: the simulation whose state was saved, going on. The other one is a step ahead in another episode.
    first, second = simulation_of(case), simulation_of(case)
    play(first, [8, 9], steps=11)
    play(second, [9, 8], steps=12)
    second.load_state(first.save_state())
    draws = [np.random.default_rng(k) for k in range(2)]
    for _ in range(15):
        drawn = actions(first, draws)
        for simulation in (first, second):
            simulation.step(*drawn)
        assert first.observation.numpy().tobytes() == second.observation.numpy().tobytes()
        assert first.reward_terms.numpy().tobytes() == second.reward_terms.numpy().tobytes()
    assert str(first.score()) == str(second.score())
    states = first.save_state(), second.save_state()
    assert [name for name in states[0] if states[0][name].tobytes() != states[1][name].tobytes()] == []
