"""Extensions of a scenario: reward terms, score columns, observation entries, motions, models and curves."""

import pickle

import numpy as np
import pytest
import warp as wp

import baselines
import lissajous_env
from lissajous_env.device.stage import ROBOT, WORLD, stage
from lissajous_env.parameters.extensions import load_extension

SHORT = {"task.duration": 4.0}


@lissajous_env.reward_term(weight=-2.0)
def near_wall(world):
    """1 for each robot within 0.2 m of the left or the right wall."""
    return abs(world.robots.position[..., 0]) > world.scenario.curve.half_width - 0.2


@lissajous_env.reward_term(weight=-2.0)
@stage(ROBOT, writes="value_out")
def near_wall_kernel(w, i, robots, value_out: wp.array2d(dtype=float)):
    """The same."""
    value_out[w, i] = wp.where(wp.abs(robots.position[w, i][0]) > 1.6, 1.0, 0.0)


@lissajous_env.score_column(reduce="mean")
def mean_speed(world):
    """Mean speed of the team [m/s]."""
    return world.robots.speed.mean(axis=1)


@lissajous_env.score_column(reduce="last")
def last_speed(world):
    """Mean speed of the team after the last step [m/s]."""
    return world.robots.speed.mean(axis=1)


@lissajous_env.score_column(reduce="max")
@stage(WORLD, writes="value_out")
def steps_max(w, clock, value_out: wp.array(dtype=wp.float64)):
    """Largest number of steps."""
    value_out[w] = wp.float64(clock.step[w])


@lissajous_env.observation_entry(size=2, low=-0.5, high=0.5)
def place(world):
    """The place of a robot [m], clipped to half a metre."""
    return world.robots.position[..., :2]


@lissajous_env.target_motion
def march(world):
    """Half a metre a second to the right."""
    return world.targets.position + np.float32([0.5 * world.scenario.task.step, 0.0])


CUSTOM = {"targets.custom": 0.5, "targets.wandering": 0.5, "targets.leave": False, "targets.arrival_rate": 0.0}


def scenario_with(*extensions, name="experiment", **overrides):
    return lissajous_env.scenario(name, extensions=extensions, **SHORT | overrides)


def played(scenario, worlds=2, steps=30):
    simulation = lissajous_env.Simulation(scenario, worlds, seed=3)
    rng = np.random.default_rng(0)
    rewards = []
    for _ in range(steps):
        simulation.step(rng.uniform(-1, 1, simulation.action_shape).astype(np.float32))
        rewards.append(simulation.reward.numpy().copy())
    return simulation, np.array(rewards)


@pytest.mark.parametrize("term", [near_wall, near_wall_kernel], ids=["function", "kernel"])
def test_a_term_adds_to_the_reward_and_nothing_else_changes(term):
    # Oracle: the same episode without it, plus -2 wherever a robot is near a wall.
    plain, without = played(scenario_with())
    simulation, rewards = played(scenario_with(term))
    np.testing.assert_array_equal(simulation.robots.position.numpy(), plain.robots.position.numpy())
    assert simulation.reward_term_names[-1] == term.name
    near = np.abs(simulation.robots.position.numpy()[..., 0]) > 1.6
    np.testing.assert_array_equal(simulation.reward_terms.numpy()[..., -1], np.where(near, -2.0, 0.0))
    added = rewards - without
    assert set(np.round(added, 4).ravel()) == {0.0, -2.0}
    assert simulation.score()[0]["return_mean"] == pytest.approx(rewards[:, 0].sum(axis=0).mean(), abs=1e-4)


def test_a_column_is_reduced_over_the_episode_and_starts_anew_with_it():
    # Oracle: the speeds of each step.
    scenario = scenario_with(mean_speed, last_speed, steps_max)
    simulation, speeds = lissajous_env.Simulation(scenario, 2, seed=3), []
    assert np.isnan(simulation.score()[0]["mean_speed"])
    for _ in range(5):
        simulation.step(np.full(simulation.action_shape, 0.2, np.float32))
        speeds.append(simulation.robots.speed.numpy().mean(axis=1))
    rows = simulation.score()
    assert [row["mean_speed"] for row in rows] == pytest.approx(np.mean(speeds, axis=0), abs=1e-6)
    assert [row["last_speed"] for row in rows] == pytest.approx(speeds[-1], abs=1e-6)
    assert [row["steps_max"] for row in rows] == [5, 5]
    simulation.reset([1])
    assert simulation.score()[0]["steps_max"] == 5
    assert np.isnan(simulation.score()[1]["steps_max"])


def test_entries_stand_at_the_end_of_the_row_from_the_reset_on():
    # Oracle: the places themselves, clipped.
    simulation, _ = played(scenario_with(place), steps=7)
    assert simulation.layout.names[-2:] == ("place_0", "place_1")
    assert (simulation.layout.low[-2:], simulation.layout.high[-2:]) == (pytest.approx(-0.5), pytest.approx(0.5))
    for _ in range(2):
        where = np.clip(simulation.robots.position.numpy()[..., :2], -0.5, 0.5)
        np.testing.assert_array_equal(simulation.observation.numpy()[..., -2:], where)
        simulation.reset(seeds=[5, 6])
    assert np.abs(simulation.final_observation.numpy()[..., -2:]).max() <= 0.5


@pytest.mark.parametrize("leave", [False, True])
def test_targets_move_as_they_are_told_and_stay_in_the_rectangle(leave):
    # Oracle: 0.05 m to the right in each step, up to the edge; the others wander as before. Those that left stay there.
    simulation = lissajous_env.Simulation(scenario_with(march, **CUSTOM | {"targets.leave": leave}), 2, seed=3)
    for _ in range(60):
        before, motion = simulation.targets.position.numpy().copy(), simulation.targets.motion.numpy()
        simulation.step(np.zeros(simulation.action_shape, np.float32))
        moved = simulation.targets.position.numpy() - before
        left = simulation.targets.status.numpy() == 3
        expected = np.where(left, 0, np.minimum(before[..., 0] + 0.05, 1.8) - before[..., 0])
        np.testing.assert_allclose(moved[..., 0][motion == 4], expected[motion == 4], atol=1e-5)
        assert (moved[..., 1][motion == 4] == 0).all()
        if simulation.over.all():
            break
    assert (motion == 4).any()
    assert left[motion == 4].any() == leave
    assert simulation.scenario.without_extensions().targets.custom == 0
    assert (np.abs(moved[(motion == 2) & ~left]).sum(axis=-1) > 0).all()


def test_every_adapter_and_score_row_has_them():
    scenario = scenario_with(near_wall, mean_speed, place)
    env = lissajous_env.parallel_env(scenario)
    observations, infos = env.reset(seed=1)
    assert observations["robot_0"].shape == env.observation_space("robot_0").shape == (44,)
    assert infos["robot_0"]["reward_terms"].shape == (10,)
    assert lissajous_env.vector_env(scenario, 3).reset(seed=1)[0].shape == (3, 5, 44)
    rows = lissajous_env.evaluate(baselines.make("sweep", scenario, 2), scenario, seeds=range(3))
    assert [list(row)[-1] for row in rows] == ["mean_speed"] * 3
    assert pickle.loads(pickle.dumps(env.simulation)).scenario == env.simulation.scenario
    assert load_extension(near_wall.place) == near_wall


def returning(value):
    def wrong(world):
        return value

    return wrong


def numbered(name, size=1, door=lissajous_env.observation_entry):
    """An extension with a name: an entry of the observation of some size, or another one."""
    wrong = returning(0.0)
    wrong.__name__ = name
    return door(wrong, size=size) if door is lissajous_env.observation_entry else door(wrong)


@pytest.mark.parametrize(
    ("door", "value", "message"),
    [
        (lissajous_env.reward_term(), np.zeros((2, 4)), r"term wrong must return numbers of shape \(2, 5\), got"),
        (lissajous_env.reward_term(), "text", "reward term wrong must return numbers"),
        (lissajous_env.reward_term(), np.full((2, 5), np.nan), "reward term wrong must return finite numbers"),
        (lissajous_env.score_column(), 1.0, r"score column wrong must return numbers of shape \(2,\), got"),
        (
            lissajous_env.observation_entry(size=3),
            np.zeros((2, 5)),
            r"of shape \(2, 5, 3\), got float64 of shape \(2, 5\)",
        ),
        (lissajous_env.target_motion, np.zeros((2, 1, 2)), "target motion wrong must return numbers of shape"),
    ],
)
def test_what_a_function_returns_is_checked(door, value, message):
    extension = door(returning(value))
    with pytest.raises(ValueError, match=message):
        played(scenario_with(extension, **(CUSTOM if door is lissajous_env.target_motion else {})))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: scenario_with("no_module:x"), "extension must be module:name that can be loaded, got 'no_module:x'"),
        (lambda: scenario_with("os:getcwd"), "extension os:getcwd must be made by reward_term, score_column"),
        (lambda: scenario_with(near_wall, near_wall), "extensions must have different names, got near_wall twice"),
        (lambda: scenario_with(5), "extensions must be objects or module:name, got 5"),
        (
            lambda: lissajous_env.score_column(reduce="median")(returning(1)),
            "wrong.reduce must be one of mean, sum",
        ),
        (lambda: lissajous_env.observation_entry(size=0)(returning(1)), "wrong.size must be a whole number"),
        (lambda: lissajous_env.observation_entry(low=1.0)(returning(1)), "wrong.high must be above low = 1"),
        (lambda: lissajous_env.reward_term()(5), "reward term must be a function or a Warp kernel, got 5"),
        (lambda: lissajous_env.reward_term(weight=np.nan)(returning(1)), "wrong.weight must be from .*, got nan"),
        (lambda: lissajous_env.observation_entry(low=-np.inf)(returning(1)), "wrong.low must be from .*, got -inf"),
        (lambda: scenario_with(gates), "targets.entry must be custom with the law of entry gates, got 'inside'"),
        (lambda: scenario_with(**AT_GATES), "targets.entry must not be custom without a target_entry, got 'custom'"),
        (lambda: scenario_with(**CUSTOM), "targets.custom must be 0 without a target_motion, got 0.5"),
        (lambda: scenario_with(march), "targets.custom must be above 0 with the target motion march, got 0"),
        (lambda: lissajous_env.target_entry(draw_gates, state={"a b": (2,)}), "state of the target entry draw_gates"),
        (lambda: lissajous_env.reward_term(state={"a": 2})(draw_gates), "must map names to tuples of whole numbers"),
        (lambda: lissajous_env.reward_term(reset=3)(draw_gates), "reset of the reward term draw_gates must be a func"),
        (
            lambda: scenario_with(numbered("a", 2), numbered("a_0", 1)),
            "entries of the observation must have different names, got a_0",
        ),
    ],
)
def test_what_is_no_extension_is_refused_by_name(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_names_of_ours_are_taken():
    assert len(scenario_with(numbered("a", 2), numbered("a_2")).extensions) == 2  # which are no entries of each other
    for extension in (numbered("detection", door=lissajous_env.reward_term),
                      numbered("collisions", door=lissajous_env.score_column), numbered("x")):  # fmt: skip
        with pytest.raises(ValueError, match=f"name of an extension must be new, got {extension.name}"):
            lissajous_env.Simulation(scenario_with(extension))


# Models of robots.


@stage(ROBOT, writes="robots: path, position")
def slide(w, i, command, clock, robots):
    """Move by a tenth of the action [m]."""
    old = robots.position[w, i]
    new = old + 0.1 * wp.vec3(command[w, i, 0], command[w, i, 1], 0.0)
    for s in range(robots.path.shape[2]):
        robots.path[w, i, s] = wp.lerp(old, new, float(s) / float(robots.path.shape[2] - 1))
    robots.position[w, i] = new


@pytest.fixture
def slider():
    rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    model = lissajous_env.RobotModel("slider", ("x", "y", "none"), rows, slide, lambda *parts: 2.0)
    return lissajous_env.register_robot_model(model)


def test_a_model_of_robots_drives_everywhere(slider):
    # Oracle: what its kernel says, and the nearest point of the curve.
    scenario = lissajous_env.scenario("experiment", **{"robot.kind": "slider"}, **SHORT)
    env = lissajous_env.parallel_env(scenario, discrete_actions=True)
    env.reset(seed=1)
    assert env.action_space("robot_0").n == 2
    simulation = env.simulation
    before, phase = simulation.robots.position.numpy().copy(), simulation.robots.phase.numpy().copy()
    env.step(dict.fromkeys(env.agents, 1))
    moved = simulation.robots.position.numpy() - before
    np.testing.assert_allclose(moved, np.broadcast_to([0, 0.1, 0], moved.shape), atol=1e-6)
    assert (simulation.robots.phase.numpy() != phase).all()
    assert simulation.speed_unit == 2.0
    assert set(baselines.names(scenario)) >= {"random", "still"}
    for name in ("random", "still"):
        row = lissajous_env.evaluate(baselines.make(name, scenario, 2), scenario, seeds=[0, 1])[0]
        assert (row["lateral_error_max"] > 0.05) == (name == "random")


def draw_gates(world):
    """Draw two gates on the left edge for each episode."""
    world.state["gate"][:] = (2.0 * world.random(2) - 1.0) * world.scenario.curve.half_height


@lissajous_env.target_entry(state={"gate": (2,), "entered": ()}, reset=draw_gates)
def gates(world):
    """Let targets enter at one of two gates, whose places the robots do not know."""
    half, count = world.scenario.curve.half_width, world.targets.position.shape[1]
    which = (world.random(count) > 0.5).astype(int)
    world.state["entered"] += 1
    return np.stack([np.full(which.shape, -half), np.take_along_axis(world.state["gate"], which, axis=1)], axis=-1)


AT_GATES = {"targets.entry": "custom", "targets.count": 3, "targets.arrival_rate": 2.0, "targets.wandering": 0.0}


def entered(simulation):
    """Targets that have appeared, and the gates (W, 2) of their worlds."""
    return simulation.targets.status.numpy() > 0, simulation._extended.remembered["gates.gate"].numpy()


def test_targets_enter_where_an_extension_says_which_remembers_its_draws():
    simulation, _ = played(scenario_with(gates, **AT_GATES), worlds=3)
    there, gate = entered(simulation)
    places = simulation.targets.position.numpy()
    assert there.sum(axis=1).min() > 3
    np.testing.assert_array_equal(places[there][:, 0], np.float32(-1.8))
    off = np.abs(places[..., 1][..., None] - gate[:, None, :]).min(axis=2)
    np.testing.assert_array_equal(off[there], 0.0)
    assert len(np.unique(gate)) == 6
    assert simulation._extended.remembered["gates.entered"].numpy().tolist() == [31, 31, 31]


def test_the_state_of_an_extension_begins_anew_with_an_episode_and_depends_on_the_seed_alone():
    scenario = scenario_with(gates, **AT_GATES)
    simulation, _ = played(scenario, worlds=3)
    before = entered(simulation)[1].copy()
    simulation.reset([1], seeds=[77])
    after = entered(simulation)[1]
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])
    alone = lissajous_env.Simulation(scenario, 1, seed=77)
    alone.reset(seeds=[77])
    np.testing.assert_array_equal(entered(alone)[1][0], after[1])
    assert simulation._extended.remembered["gates.entered"].numpy().tolist() == [31, 1, 31]


def test_the_state_of_an_extension_is_saved_copied_and_pickled():
    simulation, _ = played(scenario_with(gates, **AT_GATES), worlds=2, steps=5)
    copies = [pickle.loads(pickle.dumps(simulation)), lissajous_env.Simulation(simulation.scenario, 2)]
    copies[1].load_state(simulation.save_state())
    for clone in (simulation, *copies):
        for _ in range(20):
            clone.step(np.zeros(clone.action_shape, np.float32))
    for clone in copies:
        np.testing.assert_array_equal(clone.targets.position.numpy(), simulation.targets.position.numpy())
        np.testing.assert_array_equal(entered(clone)[1], entered(simulation)[1])


def test_random_numbers_of_an_extension_are_uniform_and_independent():
    # Oracle: the moments of the uniform distribution; the correlation between worlds, steps and calls.
    drawn = []

    @lissajous_env.score_column()
    def draws(world):
        drawn.append((world.random(50), world.random(50)))
        assert world.random(0, 2).shape == (8, 0, 2)  # of no targets
        return world.random()

    scenario = scenario_with(draws)
    assert pickle.loads(pickle.dumps(scenario)).digest() == scenario.digest(), "although no module has the function"
    played(scenario, worlds=8, steps=20)
    numbers = np.array(drawn)
    assert numbers.shape == (20, 2, 8, 50)
    assert (numbers.min() >= 0, numbers.max() < 1) == (True, True)
    assert numbers.mean() == pytest.approx(0.5, abs=0.01)
    assert numbers.var() == pytest.approx(1 / 12, abs=0.002)
    for axis in range(3):
        one, other = (np.delete(numbers, end, axis) for end in (0, -1))
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.04
