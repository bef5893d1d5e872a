"""`task.conservative`: no target is undetected for longer than reported, for any direction, step and grid."""

from itertools import pairwise

import numpy as np
import pytest
import warp as wp

import baselines
import lissajous_env
from lissajous_env.device.stage import ROBOT, stage
from lissajous_env.parameters.spreading import reaches_of
from lissajous_env.world.contamination.labels import introduced_at

SPEED, RADIUS, HALF = 0.25, 0.3, 1.0


@stage(ROBOT, writes="robots: path, position, speed")
def drift(w, i, task, command, robots):
    """Move at the commanded velocity [m/s], through anything."""
    old = robots.position[w, i]
    new = old + task.step * wp.vec3(command[w, i, 0], command[w, i, 1], 0.0)
    for s in range(robots.path.shape[2]):
        robots.path[w, i, s] = wp.lerp(old, new, float(s) / float(robots.path.shape[2] - 1))
    robots.position[w, i] = new
    robots.speed[w, i] = wp.length(new - old) / task.step


CONVOY = lissajous_env.RobotModel("convoy", ("vx", "vy"), ((0.0, 0.0),), drift, lambda *parts: 1.0)


@pytest.fixture(autouse=True)
def _convoy():
    lissajous_env.register_robot_model(CONVOY)


def around(angle, gap):
    """Discs of `RADIUS` that leave nothing open but the place around 0, as near to them as `gap` [m]."""
    side = 1.2 * RADIUS
    places = np.stack(np.meshgrid(*[np.arange(-18, 19) * side] * 2), axis=-1).reshape(-1, 2)
    places = places[np.linalg.norm(places, axis=1) > RADIUS + gap]
    turns = 2 * np.pi * np.arange(12) / 12
    ring = (RADIUS + gap) * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return np.concatenate([ring, places]) @ turn


def unseen_behind_a_convoy(angle, step, grid, gap):
    """Return the undetected time of a rogue in a gap of a convoy, from the beginning to the end [s], and the figure."""
    velocity = 0.999 * SPEED * np.array([np.cos(angle), np.sin(angle)])
    within = 0.97 * HALF / np.abs(velocity).max()
    steps = int(2 * within / step)
    start = -velocity * (steps * step / 2)
    places = start + around(angle, gap)
    reached = np.linalg.norm(places - start, axis=1) < 2 * np.sqrt(2) * HALF + 3 * RADIUS + 2 * SPEED * within
    places = places[reached]
    overrides = {
        "robot.kind": "convoy", "robot.count": len(places), "curve.half_width": HALF, "curve.half_height": HALF,
        "sensing.radius": RADIUS, "targets.count": 1, "targets.arrival_rate": 1.0, "targets.speed": 0.1,
        "targets.speed_limit": SPEED, "task.contamination": grid, "task.conservative": True,
        "task.step": step, "task.duration": steps * step, "task.grid": None, "formation.ring": None,
        "faults.schedule": (), "noise.wheelbase_spread": 0.0, "noise.drive_spread": 0.0,
    }  # fmt: skip
    simulation = lissajous_env.Simulation(lissajous_env.scenario("experiment", **overrides))
    position = np.zeros((1, len(places), 3), dtype=np.float32)
    position[0, :, :2] = places
    simulation.robots.position.assign(position)
    action = np.broadcast_to(velocity.astype(np.float32), simulation.action_shape)
    unseen = 0
    for now in range(1, steps + 1):
        simulation.step(action)
        rogue = start + now * step * velocity
        assert np.abs(rogue).max() < HALF
        # The rogue goes as the convoy does: from the end of the first step on no disc ever has it, within steps either.
        away = np.linalg.norm(simulation.robots.position.numpy()[0, :, :2] - rogue, axis=1)
        assert away.min() > RADIUS
        unseen += now > 1
    return unseen * step, simulation.score()[0]["guaranteed_detection_time"]


@pytest.mark.parametrize(
    ("degrees", "step", "grid"),
    [
        (22.5, 0.1, (40, 40)), (114.0, 0.05, (60, 45)), (22.5, 0.3, (80, 80)),
        *(pytest.param(degrees, 0.02, (80, 80), marks=pytest.mark.long) for degrees in (0.0, 13.0, 26.6, 31.0)),
    ],
)  # fmt: skip
def test_a_rogue_in_a_gap_of_a_formation_that_moves_is_not_unseen_for_longer_than_the_figure(degrees, step, grid):
    # Oracle: where the rogue and the discs are, in float64. The gap is far smaller than a cell.
    unseen, figure = unseen_behind_a_convoy(np.radians(degrees), step, grid, 0.02 * 2 * HALF / max(grid))
    assert unseen > 7.0
    assert figure >= unseen - 1e-9


def test_no_target_moves_farther_in_a_step_than_reaches_allow():
    # Oracle: the places of a slow rogue in a large rectangle, which rounding moves farther in each step.
    large = {"curve.half_width": 2000.0, "curve.half_height": 2000.0, "task.contamination": (40, 40)}
    slow = {"targets.speed_limit": 0.02, "task.conservative": True, "sensing.radius": 1e-3}
    simulation = lissajous_env.Simulation("experiment", rogues="agents", **large | slow)
    places = []
    for _ in range(50):
        simulation.step(np.zeros(simulation.action_shape), np.ones(simulation.rogues.action.shape))
        places.append(simulation.targets.position.numpy()[0, 0].astype(float))
    moved = np.linalg.norm(np.diff(places, axis=0), axis=1).max()
    assert 1.01 * 0.02 * 0.1 < moved <= simulation.scenario.spreading.reaches.moved


@pytest.mark.parametrize("sides", [(0.1, 0.1), (0.1, 0.14)])
@pytest.mark.parametrize("moved", [1e-4, 0.0999, 0.17])
def test_reaches_are_what_two_points_of_two_cells_allow(sides, moved):
    # Oracle: many pairs of points. No pair is missed, and every reach is that of some pair.
    rng = np.random.default_rng(3)
    reaches = reaches_of(sides, moved, 100_000)
    assert reaches.lags[0] == 1
    for lag, widths in zip(reaches.lags, reaches.widths, strict=True):
        way = lag * reaches.period * moved
        here = rng.uniform(0, 1, (20_000, 2)) * sides
        angle, share = rng.uniform(0, 2 * np.pi, 20_000), np.sqrt(rng.uniform(0, 1, 20_000))
        there = here + (way * share)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        columns, rows = np.abs(np.floor(there / sides)).astype(int).T
        assert rows.max() < len(widths)
        assert (columns <= np.array(widths)[rows]).all()
        for row, width in enumerate(widths):
            apart = np.hypot(max(width - 1, 0) * sides[0], max(row - 1, 0) * sides[1])
            assert apart <= way * (1 + 2e-6)


def played(policy, watch, duration=8.0, **overrides):
    scenario = lissajous_env.scenario("experiment", **{
        "targets.count": 1, "targets.arrival_rate": 1.0, "task.contamination": (60, 27), "task.duration": duration,
        "task.conservative": True, **overrides,
    })  # fmt: skip
    simulation = lissajous_env.Simulation(scenario, seed=4)
    policy = baselines.make(policy, scenario, 1)
    for _ in range(scenario.task.steps):
        simulation.step(policy.act(simulation.observation))
        watch.append(np.minimum(introduced_at(simulation), 10**6))
    return simulation.score()[0]


def test_a_smaller_sensor_makes_no_label_younger():
    # Law: what a smaller disc covers, a larger one does as well; the cars drive the same.
    labels, rows = [], []
    for radius in (0.5, 0.6, 0.8):
        labels.append([])
        overrides = {"sensing.radius": radius, "targets.speed_limit": 0.5, "sensing.robots_seen": 0}
        rows.append(played("open-loop-mpcc", labels[-1], **overrides))
    for small, large in pairwise(labels):
        assert all((mine <= other).all() for mine, other in zip(small, large, strict=True))
    figures = [row["guaranteed_detection_time"] for row in rows]
    assert figures == sorted(figures, reverse=True)
    assert len(set(figures)) > 1


def test_rogues_that_come_over_the_edge_walk_inward_no_slower_than_they_can():
    # Story: nobody at the start, one small disc; after some time rogues may be as deep inside as they can have come.
    for speed, step in ((0.2, 0.1), (0.2, 0.01), (1.5, 0.1)):
        watch, duration = [], 0.5 / speed
        overrides = {"targets.count": 0, "targets.entry": "boundary", "targets.speed_limit": speed, "task.step": step}
        played("still", watch, duration, **{"sensing.radius": 1e-3, "task.grid": None, **overrides})
        side = 3.6 / 60
        for now, labels in enumerate(watch, 1):
            inside = np.flatnonzero(labels[13] < 10**6)
            deep = inside[inside < 30].max() + 1  # cells that rogues may be in, from the left edge
            assert deep * side >= speed * now * step
            assert deep * side <= 1.4 * speed * now * step + 3 * side
            assert labels.min() <= now
            assert labels[0, 0] == 0


def test_the_figure_is_not_far_above_the_plain_one():
    # Against the figure of the plain field, whose error is known; both are of a finite time here.
    figures = []
    for conservative in (False, True):
        scenario = lissajous_env.scenario("evaders", **{
            "sensing.radius": 0.75, "targets.speed_limit": 0.6, "targets.flee_speed": 0.6, "task.duration": 15.0,
            "task.conservative": conservative,
        })  # fmt: skip
        (row,) = lissajous_env.evaluate(baselines.make("kuramoto-mpcc", scenario, 1), scenario, seeds=[1])
        figures.append(row["guaranteed_detection_time"])
    assert figures[0] <= figures[1] <= 1.4 * figures[0]
