"""Collisions: the closest approach, when an event begins and ends, and what it does to the robots."""

import numpy as np
import pytest
import warp as wp

import baselines
import lissajous_env
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.world import stages
from lissajous_env.world.robots import nearby

wp.set_module_options(OPTIONS)

RADIUS = 0.1
TOUCH = 2 * RADIUS


def parked(positions, seed=0, **overrides):
    """Cars at rest at these places of one world."""
    places = np.array(positions, dtype=np.float32)
    settings = {
        "robot.count": len(places),
        "robot.radius": RADIUS,
        "formation.p": 0,
        "formation.ring": None,
        "faults.schedule": (),
        "targets.count": 0,
        "targets.arrival_rate": 0.0,
        "task.grid": None,
        **overrides,
    }
    simulation = lissajous_env.Simulation(lissajous_env.scenario("experiment", **settings), seed=seed)
    place_robots(simulation, places)
    return simulation


def place_robots(simulation, places, speeds=0.0, headings=0.0):
    robots = simulation.robots
    robots.position.assign(np.pad(np.array(places, dtype=np.float32), ((0, 0), (0, 1)))[None])
    robots.speed.assign(np.full((1, len(places)), speeds, dtype=np.float32))
    robots.heading.assign(np.broadcast_to(np.array(headings, dtype=np.float32), (1, len(places))))


def rest(simulation):
    """A step in which the throttle is in the dead zone."""
    simulation.step(np.broadcast_to(np.array([0.0, -1.0], dtype=np.float32), simulation.action_shape))


def test_fast_cars_do_not_jump_through_each_other():
    # Story: two cars at 5.85 m/s, head on; between the two sub-steps they swap sides, and at no instant do they touch.
    simulation = parked([[-0.44, 0.015], [0.44, -0.015]])
    top = simulation.scenario.robot.top_speed
    place_robots(simulation, [[-0.44, 0.015], [0.44, -0.015]], speeds=top, headings=[0.0, np.pi])
    simulation.step(np.broadcast_to(np.array([0.0, 1.0], dtype=np.float32), simulation.action_shape))
    track = simulation.robots.path.numpy()[0]
    at_instants = np.linalg.norm(track[0] - track[1], axis=-1)
    assert at_instants.min() > 1.2 * TOUCH
    (row,) = simulation.score()
    assert row["collisions"] == 1
    assert row["min_separation"] == pytest.approx(0.03, abs=1e-3)
    assert simulation.latest.collisions.numpy().tolist() == [[1, 1]]


def test_a_collision_is_counted_once_until_the_pair_has_parted_by_five_percent():
    # Story: touching, apart by 2 %, touching: one event. Apart by 6 %, touching: a second one.
    distances = [1.2, 0.99, 0.9, 1.02, 1.04, 0.99, 1.06, 0.99, 1.04, 1.1]
    events, contacts = [], []
    simulation = parked([[0, 0], [1, 0]])
    for distance in distances:
        place_robots(simulation, [[0, 0], [distance * TOUCH, 0]])
        rest(simulation)
        events.append(int(simulation.latest.collisions.numpy()[0, 0]))
        contacts.append(simulation.score()[0]["contact_time"])
    assert events == [0, 1, 0, 0, 0, 0, 0, 1, 0, 0]
    assert simulation.score()[0]["collisions"] == 2
    # Time in contact counts what is closer than the radii, not what has yet to part.
    assert np.diff(contacts, prepend=0) == pytest.approx([0, 0.1, 0.1, 0, 0, 0.1, 0, 0.1, 0, 0])
    assert simulation.score()[0]["min_separation"] == pytest.approx(0.9 * TOUCH, abs=1e-6)


def test_points_of_one_place_overlap_by_design_and_are_no_collision():
    # Story of Section V: robots k and k + 15 share a place; nobody moves, so nobody runs into anybody.
    scenario = lissajous_env.scenario("redundant", **{"task.duration": 5.0})
    assert scenario.places == (*range(15), *range(15))
    rows = lissajous_env.evaluate(baselines.make("still", scenario, 2), scenario, range(2))
    assert [row["collisions"] for row in rows] == [0, 0]
    assert [row["contact_time"] for row in rows] == [0, 0]
    assert min(row["min_separation"] for row in rows) > 2 * scenario.robot.radius  # of those of different places


@pytest.mark.parametrize("many", [False, True])
def test_points_of_different_places_and_cars_of_one_place_do_collide(many, monkeypatch):
    # Oracle: by hand. Two of six points on three places stop, and those that continue run through them; six cars that
    # begin two on a place are three pairs in touch.
    for module in (nearby, stages):
        monkeypatch.setattr(module, "has_bins", lambda scenario: many)
    clustered = {"robot.count": 6, "formation.p": 2, "formation.ring": None, "targets.arrival_rate": 0.0}
    cars = lissajous_env.scenario("experiment", **clustered, **{"faults.schedule": ()})
    assert (cars.clusters, cars.places) == (2, (0, 1, 2, 3, 4, 5))
    played = lissajous_env.Simulation(cars)
    played.step(np.zeros(played.action_shape, dtype=np.float32))
    assert played.tally.collisions.numpy() == [3]
    stuck = {"faults.schedule": ((0, 0.0, 30.0), (3, 0.0, 30.0))}
    points = lissajous_env.scenario("failure", **clustered, **stuck)
    assert (points.clusters, points.places) == (2, (0, 1, 2, 0, 1, 2))
    one_lap = lissajous_env.evaluate(baselines.make("open-loop", points), points, [0])[0]
    assert one_lap["collisions"] > 0
