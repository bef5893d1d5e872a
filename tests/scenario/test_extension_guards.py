"""Extensions cannot write to their inputs, and values that are not finite raise an error that names them."""

import numpy as np
import pytest
import warp as wp

import baselines
import lissajous_env
from lissajous_env.device.stage import ROBOT, stage

SHORT = {"task.duration": 2.0}
KINDS = {
    "reward term": (lissajous_env.reward_term(), (2, 5)),
    "score column": (lissajous_env.score_column(), (2,)),
    "observation entry": (lissajous_env.observation_entry(), (2, 5)),
    "target motion": (lissajous_env.target_motion, None),
}
MOVED = {"targets.custom": 1.0, "targets.wandering": 0.0, "targets.speed_limit": 5.0}
INTO_VIEW = "world.robots.position[..., 0] += 0.01"
WRITES = (
    INTO_VIEW,
    "np.add(world.targets.position, 1.0, out=world.targets.position)",
    "world.observation[:] = 0",
    "world.tally.returns += 1.0",
    "world.robots.position = world.robots.position + 1",
    "world.robots = None",
    "world.scenario.equilibrium[0] = 1.0",
)


def stepped(extension, worlds=2, steps=3, **overrides):
    scenario = lissajous_env.scenario("experiment", extensions=[extension], **{**SHORT, **overrides})
    simulation = lissajous_env.Simulation(scenario, worlds)
    for _ in range(steps):
        simulation.step(np.full(simulation.action_shape, 0.3, dtype=np.float32))
    return simulation


@pytest.mark.parametrize(
    ("kind", "write"), [*(("reward term", write) for write in WRITES), *((kind, INTO_VIEW) for kind in KINDS)]
)
def test_no_extension_writes_to_the_world(kind, write):
    decorate, shape = KINDS[kind]

    def meddles(world):
        exec(write, {"np": np, "world": world})
        return world.targets.position if shape is None else np.zeros(shape)

    overrides = MOVED if shape is None else {}
    with pytest.raises(ValueError, match=f"{kind} meddles failed: ValueError: .*read-only"):
        stepped(decorate(meddles), **overrides)


def test_an_array_that_does_not_exist_is_named():
    @lissajous_env.score_column()
    def mistakes(world):
        return world.robots.positions[:, 0, 0]

    with pytest.raises(ValueError, match=r"robots has no positions; did you mean position.*; see dir\(world.robots\)"):
        stepped(mistakes)


def test_what_an_extension_reads_is_of_this_step_and_may_be_copied():
    history = []

    @lissajous_env.score_column()
    def keeps(world):
        changed = world.robots.position.copy()
        changed += 1.0
        history.append(world.clock.step.copy())
        return changed[:, 0, 0]

    stepped(keeps)
    assert [steps.tolist() for steps in history] == [[1, 1], [2, 2], [3, 3]]


def test_a_policy_of_a_function_and_a_coordinator_cannot_change_what_the_world_shows():
    scenario = lissajous_env.scenario("experiment", **SHORT)
    simulation = lissajous_env.Simulation(scenario)
    before = simulation.observation.numpy().copy()

    class Meddler(baselines.NumpyCoordinator):
        def rates(self, rows):
            rows.values[:] = 0.0
            return np.full((self.num_worlds, self.scenario.num_robots), self.natural_rate)

    with pytest.raises(ValueError, match="read-only"):
        baselines.with_tracker(Meddler, "mpcc")(scenario).act(simulation.observation)
    assert (simulation.observation.numpy() == before).all()


# What is not finite.


@pytest.mark.parametrize("value", [np.nan, -1e39])
@pytest.mark.parametrize("kind", KINDS)
def test_numbers_that_are_not_finite_in_32_bits_are_refused_with_name_robot_and_world(kind, value):
    decorate, shape = KINDS[kind]

    def wild(world):
        numbers = world.targets.position.astype(float) if shape is None else np.zeros(shape)
        numbers[1, ...] = np.where(np.arange(numbers[1].size).reshape(numbers[1].shape) == 3, value, 0)
        if numbers.ndim == 1:
            numbers[1] = value
        return numbers

    where = {"score column": "world 1", "target motion": "target_1 in world 1"}.get(kind, "robot_3 in world 1")
    with pytest.raises(ValueError, match=f"{kind} wild must return finite numbers of at most .* for {where}"):
        stepped(decorate(wild), **(MOVED if shape is None else {}))


def test_a_weight_and_numbers_that_are_finite_alone_are_refused_together():
    @lissajous_env.reward_term(weight=1e20)
    def large(world):
        return np.where(np.arange(5) == 2, -1e20, 0.0) * np.ones((2, 1))

    with pytest.raises(ValueError, match=r"reward term large .* weight included, got -1e\+20 for robot_2 in world 0"):
        stepped(large)


@stage(ROBOT, writes="value_out")
def wild_kernel(w, i, clock, value_out: wp.array2d(dtype=float)):
    """0, and no number from the second step on."""
    value_out[w, i] = wp.where(clock.step[w] > 1 and i == 4, wp.nan, 0.0)


@stage(ROBOT, writes="robots: heading")
def wild_move(w, i, clock, robots):
    """Move one robot nowhere in the second step."""
    if clock.step[w] == 2 and i == 1:
        robots.heading[w, i] = wp.inf


def test_kernels_that_bring_what_is_not_finite_are_refused():
    with pytest.raises(ValueError, match=r"reward term wild_kernel must return finite .* got nan for robot_4 in world"):
        stepped(lissajous_env.reward_term()(wild_kernel))
    model = lissajous_env.RobotModel("wild", ("go",), ((0.0,),), wild_move, lambda *parts: 1.0)
    lissajous_env.register_robot_model(model)
    scenario = lissajous_env.scenario("experiment", **SHORT, **{"robot.kind": "wild"})
    simulation = lissajous_env.Simulation(scenario)
    simulation.step(np.zeros(simulation.action_shape))
    with pytest.raises(ValueError, match="robot model wild must move robots to a finite heading, got inf for robot_1"):
        simulation.step(np.zeros(simulation.action_shape))


def test_a_kernel_that_is_no_stage_is_refused_by_name():
    @wp.kernel
    def plain(value_out: wp.array2d(dtype=float)):
        value_out[0, 0] = 1.0

    with pytest.raises(ValueError, match=r"kernel of stage plain must be made by @stage, got one by @wp\.kernel"):
        stepped(lissajous_env.reward_term()(plain))


def test_a_removed_robot_gets_no_term_of_a_kernel_whatever_that_brings():
    # Story: what a GPU does, where nobody waits for a check: numbers that are not finite count as 0.
    scenario = lissajous_env.scenario(
        "experiment", extensions=[lissajous_env.reward_term()(wild_kernel)], **{"faults.removed": ((4, 0.1),)}, **SHORT
    )
    simulation = lissajous_env.Simulation(scenario)
    stages = [stage for stage in simulation.stages.stages if stage.name != "wild_kernel checked"]
    assert len(stages) == len(simulation.stages.stages) - 1
    program = type(simulation.stages)
    settings = simulation.stages._values, simulation.stages._sizes, 1, simulation.device
    simulation._step = program(stages, *settings)
    for _ in range(5):
        simulation.step(np.zeros(simulation.action_shape))
        assert np.isfinite(simulation.reward.numpy()).all()
