"""Planned paths within walls: bodies stay inside, do not collide, and detect every rogue within the printed time."""

import math

import numpy as np
import pytest

import baselines
import lissajous_env
from baselines.planning.request import Request
from baselines.policies import partition
from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.line_path import ideal_worst_case
from baselines.policies.partition_plan import PartitionParameters, partition_plans

HALL = Request(width=40, height=25, robots=5, robot_radius=0.5, sensor_radius=6, speed=1.5, turning_radius=2,
               rogue_speed=1.0).scenario_of(5)  # fmt: skip
REMOVING = {"task.boundary": "remove", "curve.inset": 0.3}


def play(policy, scenario, worlds, steps=None):
    """Return the places (T, W, N, 2) of the robots in episodes of a policy, and the score rows."""
    simulation, places = lissajous_env.Simulation(scenario, worlds, seed=1), []
    for _ in range(steps or scenario.task.steps):
        places.append(simulation.robots.position.numpy()[..., :2].copy())
        simulation.step(policy.act(simulation.observation))
    return np.array(places), simulation.score()


def distance_from_walls(scenario, places):
    half = np.array([scenario.curve.half_width, scenario.curve.half_height])
    return (half - scenario.robot.radius - np.abs(places)).min()


@pytest.mark.parametrize(("scenario", "longest"), [("evaders", 4.0), (HALL, 63.4)])
def test_a_partition_stays_inside_and_detects_as_fast_as_without_walls(scenario, longest):
    """Oracle: the simulated contamination, collisions and places; the times are those without walls."""
    scenario = lissajous_env.scenario(scenario, **{"task.boundary": "wall"})
    policy = baselines.make("partition", scenario, num_worlds=2)
    places, rows = play(policy, scenario, 2)
    assert distance_from_walls(scenario, places) > 0.5 * (scenario.inset - scenario.robot.radius)
    assert all(row["collisions"] == 0 and row["guarantee_open"] == 0 for row in rows)
    assert max(row["guaranteed_detection_time"] for row in rows) <= longest
    tables = policy.tables.places(2 * policy.tables.lead_in_steps + policy.tables.loop_steps)
    reach = np.array([scenario.driven.half_width, scenario.driven.half_height])
    assert (np.abs(tables) <= reach * 1.005).all()


def test_differential_drives_keep_to_their_loops_and_detect_sooner_than_cars():
    """Oracle: the planned places; a drive whose yaw rate lags behind its command weaves along straight ways."""
    drives = Request(width=40, height=25, robots=5, robot_radius=0.5, sensor_radius=6, speed=1.5, robot="differential",
                     acceleration=0.8, rogue_speed=1.0).scenario_of(5)  # fmt: skip
    policy = baselines.make("partition", drives)
    places, (row,) = play(policy, drives, 1)
    planned = policy.policy.tables.places(drives.task.steps - 1)[0].swapaxes(0, 1)
    late = np.linalg.norm(places[:, 0] - planned, axis=-1)[drives.task.steps // 2 :]
    assert late.max() < 0.3
    assert (row["collisions"], row["guarantee_open"]) == (0, 0)
    assert row["guaranteed_detection_time"] < 40


def test_drives_in_a_narrow_rectangle_turn_in_time():
    """Oracle: the planned places; a turn that begins when its curvature does leads 0.1 m beyond the loop, to a wall."""
    drives = lissajous_env.scenario("evaders-walls", **{"robot.kind": "differential", "task.duration": 12.0,
                                                      "formation.start_noise": 0.0})  # fmt: skip
    policy = baselines.make("partition", drives)
    places, (row,) = play(policy, drives, 1)
    planned = policy.policy.tables.places(drives.task.steps - 1)[0].swapaxes(0, 1)
    assert np.linalg.norm(places[:, 0] - planned, axis=-1).max() < 0.06
    assert row["wall_contacts"] == 0


@pytest.mark.parametrize(("name", "policy"), [("hall", "partition"), ("rough", "kuramoto-gvf")])
def test_drives_turn_before_walls_from_unknown_starts_and_with_noise(name, policy):
    """Oracle: the score. If turns counted as instant, there would be 18 contacts: drives gain their yaw rate slowly."""
    drives = lissajous_env.scenario(name, **{"robot.kind": "differential", "task.boundary": "wall"})
    _, rows = play(baselines.make(policy, drives, num_worlds=7), drives, 7, steps=200)
    assert sum(row["wall_contacts"] for row in rows) <= 2


def test_lines_turn_inside():
    """Oracle: the simulated contamination, collisions and places; the ideal motion's time, from the start on."""
    scenario = lissajous_env.scenario(HALL, **{"task.boundary": "wall"})
    policy = baselines.make("line-abreast", scenario, num_worlds=2)
    places, rows = play(policy, scenario, 2)
    assert distance_from_walls(scenario, places) > 0.5 * (scenario.inset - scenario.robot.radius)
    assert all(row["collisions"] == 0 and row["guarantee_open"] == 0 for row in rows)
    worst = max(row["guaranteed_detection_time"] for row in rows)
    assert worst <= 60
    assert worst == pytest.approx(ideal_worst_case(scenario.resolve(), policy.lines), rel=0.05)


def random_hall(seed):
    """Return a hall of 2 m to 100 m with walls, 1 to 8 times as wide as high, with 2 to 10 cars that fit it."""
    draw = np.random.default_rng(seed)
    width = math.exp(draw.uniform(math.log(2), math.log(100)))
    height = width / draw.uniform(1, 8)
    speed = width * draw.uniform(0.02, 0.1)
    request = Request(
        width=width, height=height, robots=int(draw.integers(2, 11)), robot_radius=height * draw.uniform(0.01, 0.05),
        sensor_radius=height * draw.uniform(0.3, 0.8), speed=speed, turning_radius=height * draw.uniform(0.02, 0.2),
        rogue_speed=speed * draw.uniform(0.1, 0.9),
    )  # fmt: skip
    return lissajous_env.scenario(request.scenario_of(int(request.robots)), **{"task.boundary": "wall"})


@pytest.mark.parametrize(("policy", "seed"), [("partition", 3), ("line-abreast", 2)])
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_planned_paths_in_halls_stay_inside_and_apart(policy, seed):
    """Law: bodies on planned paths stay inside and do not collide, and the simulated cars follow them."""
    scenario = random_hall(seed)
    policy = baselines.make(policy, scenario)
    tables, radius = policy.tables, scenario.robot.radius
    planned = tables.places(tables.lead_in_steps + tables.loop_steps)[0]
    assert distance_from_walls(scenario, planned) > 0
    one, other = np.triu_indices(scenario.num_robots, 1)
    if tables.lead_in_steps > 0:
        assert np.linalg.norm(planned[one] - planned[other], axis=-1).min() > 2 * radius
    places, rows = play(policy, scenario, 1, min(scenario.task.steps, 200))
    assert distance_from_walls(scenario, places) > 0
    assert rows[0]["collisions"] == 0


def test_cars_share_a_loop_where_walls_leave_no_room_for_one_each():
    """Physical story: circles side by side in a narrow hall leave no way past each other; cars in file need none."""
    scenario = lissajous_env.scenario("evaders", **{"task.boundary": "wall"})
    plan = partition_plans(scenario)[0]
    steps = plan.loop.shape[1]
    for robot, loop in enumerate(plan.loop):
        np.testing.assert_allclose(loop, np.roll(plan.loop[0], -robot * steps // 5, axis=0), atol=1e-9)
    own = partition_plans(scenario, PartitionParameters(in_phase=True))[0]
    assert len(np.unique(own.loop.mean(axis=1).round(6), axis=0)) == 5
    unknown = lissajous_env.scenario(scenario, **{"formation.start": "random"})  # here a shared loop has 324 collisions
    _, rows = play(baselines.make("partition", unknown, num_worlds=8), unknown, 8, 400)
    assert sum(row["collisions"] for row in rows) < 100


def test_loops_that_overlap_and_have_no_ways_are_refused(monkeypatch):
    monkeypatch.setattr(partition, "_MOST_CANDIDATES", 1)
    scenario = lissajous_env.scenario("evaders", **{"task.boundary": "wall", "robot.wheelbase": 0.2})
    words = r"partition-repair requires ways from the start .* at least 0\.375 m apart .* turn on 0\.594 m, and"
    with pytest.raises(UnsuitableScenarioError, match=words):
        baselines.make("partition-repair", scenario)


@pytest.mark.parametrize(("name", "policy", "fields", "longest"), [
    ("experiment", "partition", {"faults.schedule": ()}, None),
    ("experiment", "partition", {"faults.schedule": (), "robot.kind": "differential"}, None),
    ("experiment", "kuramoto-mpcc", {"faults.schedule": (), "robot.kind": "differential"}, None),
    ("evaders-walls", "partition-repair", {"faults.removed": ((0, 6.0),)}, 4.2),
    (HALL, "line-abreast", {"task.boundary": "remove", "task.duration": 60.0}, None),  # 4 of 5 cars left the hall
    (HALL, "partition", {"task.boundary": "remove", "task.duration": 60.0}, None),
    ("intruders", "kuramoto-mpcc-proved", REMOVING, None),  # all cars had left the rectangle after 7 s
    ("intruders", "sweep", {**REMOVING, "robot.kind": "differential"}, None),  # three of five
])  # fmt: skip
def test_cars_within_walls_or_an_edge_that_removes_them_have_no_collisions(name, policy, fields, longest):
    """Oracle: the simulated collisions, contacts, places and worst case, also after neighbours take over a cell."""
    scenario = lissajous_env.scenario(name, **{"task.boundary": "wall", "task.duration": 16.0, **fields})
    assert -lissajous_env.world.robots.inside.margin_of(scenario) < math.sqrt(0.5) * scenario.robot.radius, "at corners"
    policy = baselines.make(policy, scenario)
    if policy.name == "partition-repair":
        reach = np.array([scenario.resolve().driven.half_width, scenario.resolve().driven.half_height])
        assert (np.abs(policy.takeover_loops.loop) <= reach * 1.001).all()
    _, (row,) = play(policy, scenario, 1)
    assert (row["collisions"], row["wall_contacts"], row["outside_time"]) == (0, 0, 0)
    assert longest is None or row["guaranteed_detection_time"] <= longest
