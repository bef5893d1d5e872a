"""Stages of a step and of a reset: list, arguments, and equality with separate launches."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import warp as wp

import lissajous_env
from lissajous_env.device.warp_abi import fields_of, is_struct
from lissajous_env.world import stages


def actions_of(simulation, steps, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (steps, *simulation.action_shape)).astype(np.float32)


def different(one, other):
    before, after = one.save_state(), other.save_state()
    return [name for name in before if not np.array_equal(before[name], after[name], equal_nan=True)]


@pytest.mark.parametrize("begins", [False, True])
def test_every_stage_is_a_documented_kernel(begins):
    scenarios = map(lissajous_env.scenario, ("experiment", "evaders"))
    for stage in [stage for scenario in scenarios for stage in stages.stages_of(scenario, begins=begins)]:
        assert stage.about.endswith("."), stage.name
        assert stage.is_kernel


def test_the_stages_print_in_their_order():
    simulation = lissajous_env.Simulation("experiment")
    printed = str(simulation.stages).splitlines()
    assert [line.split()[0] for line in printed[::2]] == [
        "clock", "faults", "commands", "motion", "phase", "measurement", "sending", "collisions", "targets",
        "coverage", "boundary", "deviations", "score", "end", "reward", "hearing", "observation",
    ]  # fmt: skip
    assert printed[6].split()[1:4] == ["robot", "Move", "cars"]
    assert printed[6].endswith("curve, robot, task, faults, command, clock, robots")
    assert printed[9].split(maxsplit=1) == ["writes", "robots.phase"]


@pytest.mark.parametrize(
    ("overrides", "there", "gone"),
    [
        ({"task.grid": None}, {"motion"}, {"coverage"}),
        ({"task.on_collision": "stop"}, {"consequences"}, set()),
        ({"robot.kind": "curve"}, {"motion"}, {"phase"}),
        ({"targets.count": 0, "targets.arrival_rate": 0.0}, {"motion"}, {"targets"}),
    ],
)
def test_a_stage_that_has_nothing_to_do_is_left_out(overrides, there, gone):
    simulation = lissajous_env.Simulation(lissajous_env.scenario("experiment", **overrides))
    names = {stage.name for stage in simulation.stages.stages}
    assert there <= names
    assert not gone & names


def test_a_user_may_capture_steps_in_a_graph_of_their_own():
    # Oracle: as many steps. Capturing on a CPU takes one itself.
    captured, stepped = (lissajous_env.Simulation("experiment", 2, seed=1) for _ in range(2))
    for simulation in (captured, stepped):
        simulation.action.assign(actions_of(simulation, 1)[0])
    with wp.ScopedCapture("cpu") as capture:
        captured.advance()
    for _ in range(4):
        wp.capture_launch(capture.graph)
    for _ in range(captured.clock.step.numpy()[0]):
        stepped.advance()
    assert captured.clock.step.numpy()[0] >= 4
    assert different(captured, stepped) == []


def test_simulations_are_made_and_stepped_in_many_threads():
    # Oracle: the same in this thread alone.
    scenario = lissajous_env.scenario("rough", **{"task.duration": 5.0})

    def play(seed):
        simulation = lissajous_env.Simulation(scenario, 2, seed=seed)
        for action in actions_of(simulation, 30, seed):
            simulation.step(action)
        return simulation

    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(play, range(4)))
    assert [different(play(seed), together[seed]) for seed in range(4)] == [[]] * 4


RANDOM = {"formation.start": "random"}


def arrays_of(values):
    """Arrays by name, those of structs as `robots.phase`."""
    arrays = {}
    for name, value in values.items():
        inner = fields_of(value) if is_struct(value) else {"": value}
        arrays |= {f"{name}.{field}".strip("."): array for field, array in inner.items() if isinstance(array, wp.array)}
    return arrays


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("rough", {"targets.entry": "unseen", "messages.size": 2, "task.on_collision": "remove"}),
        ("evaders-failure", {"rogues": "flee", "task.on_collision": "stop", "task.boundary": "remove", **RANDOM}),
        ("evaders", {"task.conservative": True}),
    ],
)
def test_a_stage_changes_nothing_but_what_it_writes(name, overrides):
    # Oracle: every array before and after each stage of a reset and of 30 steps.
    scenario = lissajous_env.scenario(name, **overrides)
    simulation, unsaid = lissajous_env.Simulation(scenario, 2, seed=3, threads=1), set()
    arrays = arrays_of(simulation.stages._values)

    def run(stages):
        for stage, launch in zip(stages.stages, stages.work.tasks[0], strict=True):
            before = {name: array.numpy().tobytes() for name, array in arrays.items()}
            launch.launch()
            changed = {name for name, array in arrays.items() if array.numpy().tobytes() != before[name]}
            if stage.writes:
                unsaid.update((stage.name, name) for name in changed - set(stage.writes))

    for action in actions_of(simulation, 30):
        simulation.action.assign(action)
        run(simulation.stages)
    simulation.clock.fresh.fill_(1)
    run(simulation._reset)
    assert sorted(unsaid) == []
