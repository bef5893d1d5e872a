"""Rogues that agents move: motion, observation, reward, the batch law, similarity, and nothing without them."""

import re
from pathlib import Path

import numpy as np
import pytest

import lissajous_env
from lissajous_env import Simulation
from lissajous_env.world.rogues.acting import rogue_layout
from lissajous_env.world.state import DETECTED, PRESENT

FEW = {"targets.count": 6, "targets.arrival_rate": 0.5, "targets.entry": "unseen", "task.duration": 8.0}
SMALL = FEW | {"sensing.radius": 0.3}
AGENTS = SMALL | {"rogues": "agents"}


def actions(simulation, step, size=1.0):
    """Random actions of both sides that depend on world and step alone."""
    shapes = simulation.action_shape[1:], tuple(simulation.rogues.action.shape)[1:]
    draws = [np.random.default_rng([k, step]) for k in range(simulation.num_worlds)]
    robots = np.stack([draw.uniform(-1, 1, shapes[0]) for draw in draws]).astype(np.float32)
    return robots, size * np.stack([draw.uniform(-1, 1, shapes[1]) for draw in draws]).astype(np.float32)


def row(simulation, names, world=0, slot=0):
    """Entries of a rogue's row, by name."""
    where = [rogue_layout(simulation.scenario).names.index(name) for name in names]
    return simulation.rogues.observation.numpy()[world, slot, where]


def placed(places, robots, **settings):
    """A world of rogues and robots at these places [m], after a step in which nobody moves."""
    settings = {"targets.count": len(places), "targets.arrival_rate": 0.0, "targets.entry": "inside"} | settings
    simulation = Simulation("experiment", rogues="agents", **settings)
    position = simulation.robots.position.numpy().copy()
    position[0, :, :2] = robots
    track = np.repeat(position[:, :, None], simulation.robots.path.shape[2], axis=2)
    for array, value in ((simulation.robots.position, position), (simulation.robots.path, track)):
        array.assign(value)
    simulation.robots.speed.zero_()
    for array in (simulation.targets.position, simulation.targets.before):
        array.assign(np.array([places], dtype=np.float32))
    simulation.targets.status.assign(np.full((1, len(places)), int(PRESENT), dtype=np.int32))
    simulation.step(np.zeros(simulation.action_shape), np.zeros(simulation.rogues.action.shape))
    return simulation


FAR_ROBOTS = [[1.5, 0.7], [1.5, -0.7], [1.6, 0.7], [1.6, -0.7], [1.7, 0.7]]


def test_a_rogue_moves_at_its_speed_limit_and_walls_stop_it():
    # Story: one goes right at full speed; one requires twice as much, diagonally; one pushes into a corner.
    simulation = placed([[0.0, 0.0], [-0.5, 0.0], [-1.8, -0.8]], FAR_ROBOTS, **{"sensing.radius": 0.2})
    before = simulation.targets.position.numpy()[0].copy()
    simulation.step(np.zeros(simulation.action_shape), np.array([[[1.0, 0.0], [2.0, 2.0], [-1.0, -1.0]]]))
    moved = simulation.targets.position.numpy()[0] - before
    way = simulation.scenario.targets.speed_limit * simulation.scenario.task.step
    assert moved[0] == pytest.approx([way, 0.0], abs=1e-6)
    assert moved[1] == pytest.approx([way / 2**0.5] * 2, abs=1e-6)
    assert np.array_equal(moved[2], [0.0, 0.0])
    assert row(simulation, ["x_velocity", "y_velocity"], slot=1) == pytest.approx([0.5**0.5] * 2, abs=1e-5)
    assert row(simulation, ["x_velocity", "y_velocity"], slot=2) == pytest.approx([0.0, 0.0])


def test_an_observation_is_what_its_table_says():
    # Oracle: the entries computed by hand from places, walls and radius; slower than the targets that it replaces.
    robots = [[0.5, 0.0], [0.0, 0.6], [1.5, -0.7], [1.6, -0.7], [1.7, 0.7]]
    simulation = placed([[0.1, -0.2]], robots, **{"sensing.radius": 0.3, "targets.speed_limit": 0.1})
    curve, places = simulation.scenario.curve, simulation.robots.position.numpy()[0, :, :2]
    x, y = simulation.targets.position.numpy()[0, 0]
    assert row(simulation, ["present", "x", "y"]) == pytest.approx([1.0, x / curve.half_width, y / curve.half_height])
    walls = np.array([x + curve.half_width, curve.half_width - x, y + curve.half_height, curve.half_height - y]) / 0.3
    names = [f"wall_{side}" for side in ("left", "right", "bottom", "top")]
    assert row(simulation, names) == pytest.approx(np.minimum(walls, 4.0), abs=1e-5)
    bound = simulation.scenario.detection_time_bound
    assert row(simulation, ["age"])[0] == pytest.approx(simulation.scenario.task.step / bound, rel=1e-5)
    away = places - (x, y)
    for place, robot in enumerate(np.argsort(np.linalg.norm(away, axis=1))):
        names = [f"robot_{place}_{name}" for name in ("present", "works", "x", "y", "gap")]
        gap = min(np.linalg.norm(away[robot]) / 0.3 - 1.0, 4.0)
        due = [1.0, 1.0, away[robot, 0] / (2 * curve.half_width), away[robot, 1] / (2 * curve.half_height), gap]
        assert row(simulation, names) == pytest.approx(due, abs=1e-5)


def test_the_page_has_the_table_of_the_source():
    # Oracle: the names, meanings and ranges of the layout, of the first robot where there is one per robot.
    page = Path(__file__).parents[2] / "docs" / "rogues.md"
    rows = re.findall(r"^\| [\dk +]+ \| `(\w+)` \| (.*) \| \[(\S+), (\S+)\] \|$", page.read_text(), re.MULTILINE)
    layout = rogue_layout(lissajous_env.scenario(lissajous_env.Scenario(), **{"robot.count": 1}))
    table = [(name.replace("robot_k", "robot_0"), what, float(low), float(high)) for name, what, low, high in rows]
    assert table == list(zip(layout.names, layout.meanings, layout.low, layout.high, strict=True))


def test_sight_limits_which_robots_a_rogue_observes():
    # Story: two robots are within 0.7 m, three are not; the row lists two.
    robots = [[0.5, 0.0], [0.0, 0.6], [1.5, -0.7], [1.6, -0.7], [1.7, 0.7]]
    simulation = placed([[0.0, 0.0]], robots, **{"sensing.radius": 0.3, "targets.sight": 0.7})
    assert row(simulation, [f"robot_{k}_present" for k in range(5)]).tolist() == [1.0, 1.0, 0.0, 0.0, 0.0]
    assert not row(simulation, [f"robot_2_{name}" for name in ("works", "x", "y", "gap")]).any()


def test_the_reward_is_the_time_undetected():
    # Oracle: the detection times of the score, which come from the targets' own records.
    simulation = Simulation("experiment", 4, **AGENTS)
    returns = np.zeros(tuple(simulation.rogues.reward.shape))
    for step in range(simulation.scenario.task.steps):
        simulation.step(*actions(simulation, step))
        returns += simulation.rogues.reward.numpy()
    simulation.step(*actions(simulation, 0))
    assert not simulation.rogues.reward.numpy().any()  # the episodes are over
    some = 0
    for world in range(4):
        times, detected = simulation.detection_times(world)
        assert returns[world, : len(times)] == pytest.approx(times, abs=1e-4)
        assert not returns[world, len(times) :].any()
        assert np.array_equal(simulation.rogues.terminated.numpy()[world, : len(times)], detected)
        assert np.array_equal(simulation.rogues.truncated.numpy()[world, : len(times)], ~detected)
        some += detected.sum()
    assert some > 0


def test_the_row_of_a_rogue_that_is_not_there_is_zero():
    # Law: rows and flags follow the status of the slot; the last row is that of the detection, with present = 0.
    simulation = Simulation("experiment", 3, **AGENTS)
    for step in range(40):
        simulation.step(*actions(simulation, step))
        status, found_at = simulation.targets.status.numpy(), simulation.targets.found_at.numpy()
        is_new = (status == int(DETECTED)) & (found_at == step + 1)
        rows = simulation.rogues.observation.numpy()
        assert np.array_equal(rows.any(axis=-1), (status == int(PRESENT)) | is_new)
        assert np.array_equal(rows[..., 0] == 1.0, status == int(PRESENT))
        layout = rogue_layout(simulation.scenario)
        assert ((rows >= layout.low) & (rows <= layout.high)).all()


def test_an_action_that_is_not_finite_counts_as_zero_and_is_flagged():
    # Story: a NaN for a present rogue flags its world; one for an empty slot does not.
    simulation = Simulation("experiment", 2, **AGENTS)
    rogues = np.zeros(tuple(simulation.rogues.action.shape), dtype=np.float32)
    rogues[0, 0] = np.nan
    rogues[1, -1] = np.nan
    before = simulation.targets.position.numpy().copy()
    simulation.step(np.zeros(simulation.action_shape), rogues)
    assert simulation.invalid.numpy().tolist() == [1, 0]
    assert np.array_equal(simulation.targets.position.numpy()[0, 0], before[0, 0])
    assert np.isfinite(simulation.rogues.observation.numpy()).all()


def test_without_rogues_nothing_is_there_and_the_digest_is_the_old_one():
    # Story: no stage, no array, no change of the scenario's digest, which results and checkpoints hold.
    plain = Simulation("experiment", **FEW)
    assert plain.rogues is None
    assert "rogue" not in str(plain.stages)
    scenario = lissajous_env.scenario("experiment")
    assert lissajous_env.scenario("experiment", rogues="flee").digest() != scenario.digest()


def test_settings_without_sense_are_refused():
    # Story: each error names the parameter, the rule and the value.
    wrong = {
        "targets.rogues must be one of agents, wander, .* got 'wonder'; did you mean wander": {"rogues": "wonder"},
        "targets.speed_limit must be above 0 if rogues move": {"rogues": "flee", "targets.wandering": 0.0},
        r"targets.sight must be from 1e-06 to 100000 \[m\], got 0": {"targets.sight": 0},
    }
    for words, overrides in wrong.items():
        with pytest.raises(ValueError, match=words):
            lissajous_env.scenario("experiment", **{"task.contamination": None} | overrides)

    @lissajous_env.target_motion
    def still(world):
        return world.targets.position

    with pytest.raises(ValueError, match=r"targets.rogues must be None with the target motion still, got 'flee'"):
        lissajous_env.scenario("experiment", rogues="flee", extensions=still)


def test_a_step_takes_the_actions_of_both_sides_or_of_one():
    # Story: agents need actions, scripts and ordinary targets take none.
    both, one = Simulation("experiment", **AGENTS), Simulation("experiment", **SMALL, rogues="flee")
    robots, rogues = actions(both, 0)
    with pytest.raises(ValueError, match=r"rogue_action must be given if, and only if, targets.rogues is agents"):
        both.step(robots)
    with pytest.raises(ValueError, match=r"rogue_action must be given if, and only if, targets.rogues is agents"):
        one.step(robots, rogues)
    with pytest.raises(ValueError, match="rogue_action must have shape"):
        both.step(robots, rogues[:, :1])
