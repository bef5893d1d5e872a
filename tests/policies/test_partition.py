"""Partitions: the geometry of cells and loops, the plans, their guarantees, and what robots do about failures."""

import math
import warnings

import numpy as np
import pytest

import baselines
import lissajous_env
from baselines.policies import partition_plan as partition_module
from baselines.policies.as_cars import like_cars
from baselines.policies.ideal_motion import worst_undetected_time
from baselines.policies.loops import are_adjacent, closed_loop, divisions, evenly_spaced, length_of, tour
from baselines.policies.partition import PartitionRepair, in_ring_order, loops_lie_apart
from baselines.policies.partition_plan import PartitionParameters, least_separation, partition_plans, problem_of
from baselines.policies.timed_paths import plain_of
from baselines.policies.transit import TURNS, dubins_lengths, dubins_poses, planned_transit, radius_for_all_cars


@pytest.mark.parametrize(("count", "half"), [(1, (2.0, 1.0)), (7, (1.0, 3.0)), (15, (5.0, 5.0))])
def test_cells_tile_the_rectangle(count, half):
    """Oracle: random places, each in exactly one cell, and equal areas."""
    places = np.random.default_rng(0).uniform(-1, 1, (500, 2)) * half
    for cells in divisions(count, half):
        inside = (np.abs(places[:, None] - cells[:, :2]) < cells[:, 2:4]).all(axis=2)
        assert (inside.sum(axis=1) == 1).all()
        np.testing.assert_allclose(4 * cells[:, 2] * cells[:, 3], 4 * half[0] * half[1] / count)


@pytest.mark.parametrize("size", [(1.0, 1.0), (2.0, 0.7), (0.6, 2.0)])
@pytest.mark.parametrize("lanes", [2, 4])
def test_a_loop_can_be_driven(size, lanes):
    """Oracle: the extent, and the length of straight lines and quarter circles; curvature by finite differences."""
    corner = 0.25 if lanes == 4 else 0.5
    loop = closed_loop(size[0], size[1], corner, lanes)
    if lanes == 4 and 2 * min(size) / 3 < 2 * corner:
        assert loop is None
        return
    assert loop is not None
    np.testing.assert_allclose(np.abs([loop.min(axis=0), loop.max(axis=0)]), [size, size], rtol=1e-9)
    if lanes == 2:
        assert length_of(loop) == pytest.approx(4 * sum(size) - (8 - 2 * math.pi) * corner, rel=1e-4)
    fine = evenly_spaced(loop, 4000)
    before, after = fine - np.roll(fine, 1, axis=0), np.roll(fine, -1, axis=0) - fine
    turn = np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(axis=1))
    assert turn.sum() == pytest.approx(2 * math.pi), "counter-clockwise, once around"
    windows = np.convolve(np.r_[turn, turn[:40]], np.ones(40), "valid")[:-1]
    assert np.abs(windows).max() <= 40 * length_of(loop) / 4000 / corner * 1.1


def test_a_tour_goes_from_cell_to_cell_beside_it():
    """Oracle: a closed tour of an m x n grid exists exactly if m or n is even; else all but one step are possible."""
    for count, half, rows, gaps in ((12, (4.0, 3.0), 3, 0), (15, (5.0, 5.0), 3, 1), (5, (1.8, 0.8), 1, 1)):
        grids = [grid for grid in divisions(count, half) if len(np.unique(grid[:, 1].round(9))) == rows]
        cells = min(grids, key=lambda grid: np.ptp(grid[:, 2:4], axis=0).sum())
        order = tour(cells)
        assert sorted(order) == list(range(count))
        assert (~are_adjacent(cells)[order, np.roll(order, -1)]).sum() <= gaps + (count == 12)


def test_paths_of_bounded_curvature_lead_from_pose_to_pose():
    """Oracle: the end of each path, and the shortest one against the straight line and a published bound.

    Bound: distance + 4 pi radius is enough for any two poses, as two whole turns and a straight line do.
    """
    draw, radius = np.random.default_rng(0), 0.5
    start, end = (np.column_stack([draw.uniform(-2, 2, (200, 2)), draw.uniform(-4, 4, 200)]) for _ in range(2))
    pieces = dubins_lengths(start, end, radius)
    i, k = np.nonzero(np.isfinite(pieces).all(axis=-1))
    poses = dubins_poses(start[i], pieces[i, k], TURNS[k], np.full(len(i), radius), pieces[i, k].sum(axis=-1)[:, None])
    np.testing.assert_allclose(poses[:, 0, :2], end[i, :2], atol=1e-6)
    np.testing.assert_allclose(np.cos(poses[:, 0, 2] - end[i, 2]), 1, atol=1e-9)
    shortest = np.nanmin(pieces.sum(axis=-1), axis=1)
    distance = np.linalg.norm((start - end)[:, :2], axis=1)
    assert (shortest >= distance - 1e-9).all()
    assert (shortest <= distance + 4 * math.pi * radius).all()


def test_the_undetected_time_of_a_sweep_is_its_closed_form():
    """Oracle: a disc that covers a corridor's height goes to and fro; at its turn a target waits for two sweeps."""
    # Wide as 4 m, high as 0.2 m; the disc's middle goes from -1.5 m to 1.5 m and back at 1 m/s; targets at rest.
    x = np.concatenate([np.linspace(-1.5, 1.5, 31)[:-1], np.linspace(1.5, -1.5, 31)[:-1]])
    loop = np.stack([x, np.zeros_like(x)], axis=1)[None]
    # The end is sensed at the turn alone, so once in 6 s.
    assert worst_undetected_time(loop, (2.0, 0.1), 0.51, 0.0, 0.1) == pytest.approx(6.0, abs=0.25)
    assert worst_undetected_time(loop, (2.0, 0.1), 0.51, 1.5, 0.1) == pytest.approx(6.0, abs=0.25), "no way past it"
    later = np.roll(loop, -15, axis=1)  # targets of the start are detected sooner than later ones
    assert worst_undetected_time(later, (2.0, 0.1), 0.51, 0.0, 0.1) == pytest.approx(6.0, abs=0.25)
    assert worst_undetected_time(loop, (2.0, 0.6), 0.51, 0.0, 0.1) == math.inf, "above it nothing is sensed"


def played(name, overrides, worlds):
    """Return the (steps + 1, W) worst-case undetected times of episodes without collisions."""
    scenario = lissajous_env.scenario("evaders", **overrides)
    policy, simulation = baselines.make(name, scenario, worlds), lissajous_env.Simulation(scenario, worlds)
    simulation.reset(seeds=range(worlds))
    times = [np.zeros(worlds)]
    for _ in range(scenario.task.steps):
        simulation.step(policy.act(simulation.observation))
        times.append(simulation.contamination.age.numpy() * scenario.task.step)
    assert simulation.tally.collisions.numpy().sum() == 0
    return np.array(times)


def worst_of(scenario, plan):
    """Return the worst-case undetected time of the ideal motion [s]."""
    scenario = scenario.resolve()
    half = scenario.curve.half_width, scenario.curve.half_height
    return worst_undetected_time(plan.loop, half, scenario.sensing_radius, scenario.rogue_speed, scenario.task.step)


@pytest.mark.parametrize(("name", "spread"), [("evaders", 0.05), ("team", 0.02), ("evaders-uneven", 0.02)])
def test_a_plan_obeys_the_limits_of_the_cars(name, spread):
    scenario = lissajous_env.scenario(name, **{"noise.drive_spread": spread}).resolve()
    plan = partition_plans(scenario)[0]
    robot, step = scenario.robot, scenario.task.step
    away = np.diff(plan.loop, axis=1, append=plan.loop[:, :1])
    speed = np.linalg.norm(away, axis=2).max() / step
    weakest = min([factor for _, factor in robot.drive_factors], default=1.0)
    slowest = robot.steady_speed(robot.drive * (1 - 3 * spread) * weakest)
    assert speed <= min(0.75 * robot.top_speed, 0.9 * slowest) * 1.001
    heading = np.unwrap(np.arctan2(away[..., 1], away[..., 0]), axis=1)
    turn = np.abs(np.diff(heading, axis=1))
    assert turn.max() <= 0.41
    assert (turn / (speed * step)).max() <= 1.02 / radius_for_all_cars(scenario)
    assert least_separation(plan.loop) >= 3 * robot.radius
    assert (np.abs(plan.loop) <= np.array([scenario.curve.half_width, scenario.curve.half_height]) * 1.0001).all()


def test_ways_into_the_loops_are_within_the_grip_of_the_cars():
    # Story: some cars start faster than their grip allows in the tightest turn.
    grip, scenario = 2.0, lissajous_env.scenario("evaders-uneven", **{"robot.lateral_acceleration_max": 2.0})
    ways = planned_transit(scenario, partition_plans(scenario)[0].loop).lead_in
    away = np.diff(ways, axis=1)
    speed, heading = np.linalg.norm(away, axis=2) / 0.1, np.unwrap(np.arctan2(away[..., 1], away[..., 0]), axis=1)
    assert (speed[:, 0] ** 2 > grip * radius_for_all_cars(scenario)).any()
    assert (np.abs(np.diff(heading, axis=1)) / 0.1 * speed[:, 1:]).max() < 0.8 * grip
    rows = lissajous_env.evaluate(baselines.make("partition", scenario, 2), scenario, range(2))
    assert sum(row["collisions"] for row in rows) == 0


def test_ring_neighbours_have_neighbouring_cells():
    scenario = plain_of(lissajous_env.scenario("team").resolve())
    plan = partition_plans(scenario)[0]
    cell = in_ring_order(scenario, tour(plan.cells))
    assert sorted(cell) == list(range(15))
    side_by_side = are_adjacent(plan.cells)
    adjacent = [side_by_side[cell[i], cell[j]] for i, pair in enumerate(scenario.neighbours) for j in pair]
    assert sum(adjacent) >= 28


@pytest.mark.parametrize("fields", [{}, {"robot.radius": 0.1}, {"formation.start_noise": 0.06}])
def test_the_ideal_guarantee_is_that_of_the_simulated_cars_and_nobody_collides(fields):
    """Oracle: the contamination field of the simulation, with the cars' real dynamics, from the start of an episode."""
    times = played("partition", {"task.duration": 15.0, **fields}, worlds=8)
    assert times.max() <= 4.0
    scenario = lissajous_env.scenario("evaders")
    assert times[50:].max() == pytest.approx(worst_of(scenario, partition_plans(scenario)[0]), abs=0.3)


def test_drives_plan_wider_loops_where_these_are_better():
    """Law: drives can drive the loops of cars of the same speed, so their plan is as good. Oracle: the ideal motion."""
    times, turns = [], []
    for kind in ("car", "differential"):
        hall = plain_of(like_cars(lissajous_env.scenario("hall", **{"robot.kind": kind})))
        times.append(worst_of(hall, partition_plans(hall)[0]))
        turns.append(radius_for_all_cars(hall))
    assert turns[1] < turns[0]
    assert times[1] <= times[0]
    plan = partition_plans(hall, PartitionParameters(turning=turns[0]))[0]
    moved = np.diff(plan.loop, axis=1)
    bends = np.linalg.norm(np.diff(moved, axis=1), axis=2) / np.linalg.norm(moved, axis=2)[:, 1:] ** 2
    assert bends.max() < 1.1 / turns[0]


def test_the_speed_is_a_parameter():
    """Oracle: a slower partition detects later, by about as much."""
    scenario = lissajous_env.scenario("evaders")
    fast, slow = partition_plans(scenario)[0], partition_plans(scenario, PartitionParameters(speed=1.2))[0]
    assert slow.speed <= 1.2
    assert worst_of(scenario, slow) / worst_of(scenario, fast) == pytest.approx(fast.speed / slow.speed, rel=0.35)


@pytest.mark.parametrize(("make", "words"), [
    (lambda: partition_plans(lissajous_env.scenario("evaders", **{"robot.wheelbase": 0.4}))[0],
     r"partition requires a rectangle that contains a car's turning circle, of radius 1.19 m, got one of 0.8 m"),
    (lambda: partition_plans(lissajous_env.scenario("evaders", **{"robot.count": 12}), PartitionParameters(rows=1))[0],
     r"partition requires room for 12 loops of radius 0.52 m, .* 0.375 m from one another, got 3.6 m x 1.6 m"),
    (lambda: partition_plans(lissajous_env.scenario("evaders"), PartitionParameters(rows=3)),  # which has columns
     r"partition requires room for 5 loops of radius 0.52 m, .* 0.375 m from one another, got 3.6 m x 1.6 m"),
    (lambda: partition_plans(lissajous_env.scenario("evaders"), PartitionParameters(rows=6))[0],
     "rows must be at most the 5 robots, got 6"),
    (lambda: partition_plans(lissajous_env.scenario("evaders", **{"task.boundary": "wall", "curve.inset": 0.35})),
     r"got one of 0\.45 m to a side within an inset of 0\.35 m"),
    (lambda: PartitionRepair("evaders", parameters=PartitionParameters()),
     r"parameters of PartitionRepair must be RepairParameters, got PartitionParameters\("),
])  # fmt: skip
def test_what_cannot_work_is_refused_by_name(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_robots_drive_around_those_that_have_failed_and_keep_the_guarantee():
    """Oracle: the partition without reaction, whose robots drive into those that stand; the grid has the corners."""
    faults = lissajous_env.scenario("evaders-failure", **{"task.duration": 40.0})
    rows, others = (
        lissajous_env.evaluate(baselines.make(name, faults, 2), faults, range(2))
        for name in ("partition-repair", "partition")
    )
    assert min(row["collisions"] for row in others) > 0
    assert sum(row["collisions"] for row in rows) == 0
    assert max(row["guaranteed_detection_time"] for row in rows) <= 7


@pytest.mark.parametrize("robot", [0, 1])
def test_the_cell_of_any_robot_that_fails_is_taken_over(robot):
    """Oracle: 4 s in the first 5 s and then less than half of the 10 s for which the robot stands."""
    times = played("partition-repair", {"faults.schedule": ((robot, 12.0, 22.0),), "task.duration": 25.0}, worlds=2)
    assert times[50:].max() <= 5


@pytest.mark.parametrize("half", [(4.5, 1.0), (1.0, 4.5)])
def test_robots_between_two_that_have_failed_drive_across_the_row(half):
    """Law: a row and a column, in which the ways to the two cells cancel, have like loops."""
    fields = {"curve.half_width": half[0], "curve.half_height": half[1], "task.contamination": None}
    policy = PartitionRepair(lissajous_env.scenario("evaders", **fields))
    sizes = np.ptp(policy.takeover_loops.loop[12], axis=1)  # of the first loops where both neighbours have failed
    assert (np.diff(sizes) * np.subtract(*half) > 0.5).all()


@pytest.mark.parametrize(("kind", "fault", "step"), [
    ("schedule", (1, 8.0, 20.0), 80), ("removed", (1, 8.0), 80), ("removed", (1, 0.0), 0),
])  # fmt: skip
def test_a_robot_knows_of_failures_by_messages_or_silence_alone(kind, fault, step):
    """Oracle: the ring (0, 1, 4, 2, 3), so who is not beside a robot continues; a message is at most 1 s old."""
    scenario = lissajous_env.scenario("evaders", **{f"faults.{kind}": (fault,)})
    policy, simulation = PartitionRepair(scenario), lissajous_env.Simulation(scenario)
    noticed = []
    for _ in range(100):
        simulation.step(policy.act(simulation.observation))
        noticed.append(np.flatnonzero(policy.variant.numpy()[0] > 0).tolist())
    assert noticed[max(step - 1, 0)] == []
    assert [robot for robot in noticed[step + 15] if robot != 1] == [0, 4]


@pytest.mark.parametrize("noise", [{"noise.message_loss": 0.3}, {"noise.position": 0.05}], ids=str)
def test_messages_that_are_lost_late_or_noisy_show_no_failure(noise):
    """Oracle: no robot fails; a message that stays the last one for some steps has the same place in all of them."""
    scenario = lissajous_env.scenario("evaders", **noise)
    policy, simulation = PartitionRepair(scenario, 4), lissajous_env.Simulation(scenario, 4)
    for _ in range(60):
        simulation.step(policy.act(simulation.observation))
        assert not policy.variant.numpy().any()


def test_a_plan_has_the_least_worst_case_and_not_the_most_frequent_visits(monkeypatch):
    """Oracle: the plan by share and time between visits alone, which rogues can evade for longer with 0.5 m sensors."""
    scenario = lissajous_env.scenario("evaders", **{"sensing.radius": 0.5})
    worst = worst_of(scenario, partition_plans(scenario)[0])
    partition_module._ranked.cache_clear()
    monkeypatch.setattr(partition_module, "_RATING", lambda entry: entry[0][1:])
    assert worst < worst_of(scenario, partition_plans(scenario)[0])
    partition_module._ranked.cache_clear()


def test_long_periods_are_compared_at_fewer_times():
    """Law: places of the loops at even times, at least 256, between which robots move a quarter of a sensing radius."""
    problem = problem_of(plain_of(lissajous_env.scenario("evaders").resolve()), PartitionParameters(speed=0.02))
    placed = np.random.default_rng(0).uniform(size=(5, 3000, 2))
    thin, step = partition_module._thinned(placed, problem)
    assert 256 <= thin.shape[1] < 400
    assert step * problem.speed <= 0.25 * problem.sensing
    np.testing.assert_array_equal(thin, placed[:, (np.arange(thin.shape[1]) * step + 1e-9).astype(int)])
    np.testing.assert_array_equal(partition_module._thinned(placed[:, :400], problem)[0], placed[:, :400])


def test_loops_that_cross_do_not_lie_apart():
    """Oracle: circles of radius 1 in phase, whose centres are 3 and 1 apart; all pairs of places would need 40 GB."""
    angle = np.linspace(0, 2 * np.pi, 50_000)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    for distance, apart in (((3.0, 0.0), True), ((1.0, 0.0), False)):
        assert loops_lie_apart(np.stack([circle, circle + distance]), 0.5) == apart


@pytest.mark.parametrize(("name", "changes", "warns"), [
    ("team", {"faults.schedule": (), "faults.lost": 1}, True), ("team", {"faults.schedule": ()}, False),
    ("evaders-failure", {}, False),  # the loops of evaders cross
])  # fmt: skip
def test_a_team_whose_cells_may_stay_uncovered_is_warned(name, changes, warns):
    scenario = lissajous_env.scenario(name, **changes)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        baselines.make("partition-repair", scenario)
    assert any("only ring neighbours learn of a failure" in str(warning.message) for warning in caught) == warns


def test_no_robots_of_a_team_collide_under_the_proved_filter():
    """Oracle: half a minute in which two robots stop. Without a headway, cars of seeds 33 and 35 collide at once."""
    scenario = lissajous_env.scenario("team", **{"task.contamination": None, "task.duration": 26.0})
    rows = lissajous_env.evaluate(baselines.make("partition-repair-proved", scenario, 2), scenario, (33, 35))
    assert sum(row["collisions"] for row in rows) == 0
