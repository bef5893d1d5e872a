"""The boundary of the rectangle: open, a wall, or removal."""

import math

import numpy as np
import pytest

import lissajous_env

ALONE = {
    "robot.count": 1,
    "formation.p": 0,
    "formation.ring": None,
    "faults.schedule": (),
    "noise.wheelbase_spread": 0.0,
}
A, B = 1.8, 0.8
RADIUS = 0.125
WALL_X, WALL_Y = A - RADIUS, B - RADIUS


def one_car(boundary, x, y, heading, speed, **overrides):
    """A simulation of one car that is put somewhere."""
    scenario = lissajous_env.scenario("experiment", **ALONE, **{"task.boundary": boundary}, **overrides)
    simulation = lissajous_env.Simulation(scenario)
    simulation.robots.position.assign(np.array([[[x, y, 0.0]]], dtype=np.float32))
    simulation.robots.heading.assign(np.array([[heading]], dtype=np.float32))
    simulation.robots.speed.assign(np.array([[speed]], dtype=np.float32))
    return simulation


def drive(simulation, steering, throttle, steps):
    """Positions (steps, 2), headings and speeds (steps,) of the one car."""
    rows = []
    for _ in range(steps):
        simulation.step(np.array([[[steering, throttle]]], dtype=np.float32))
        robots = simulation.robots
        rows.append((*robots.position.numpy()[0, 0, :2], robots.heading.numpy()[0, 0], robots.speed.numpy()[0, 0]))
    rows = np.array(rows, dtype=float)
    return rows[:, :2], rows[:, 2], rows[:, 3]


def test_an_open_edge_is_crossed_and_the_time_outside_counts():
    # Oracle: by hand, the steps after which the centre is more than the radius beyond A.
    simulation = one_car("open", 1.5, 0.0, 0.0, 1.0, **{"task.reward_outside": -2.0})
    places, _, _ = drive(simulation, 0.0, 0.0, 20)
    outside = int((places[:, 0] > A + RADIUS).sum())
    assert 5 < outside < 20
    (row,) = simulation.score()
    assert row["outside_time"] == pytest.approx(0.1 * outside)
    assert simulation.reward_terms.numpy()[0, 0, 6] == pytest.approx(-0.2)
    assert not simulation.terminated.numpy().any()


def test_a_wall_stops_a_car_that_meets_it_head_on_until_it_steers_away():
    simulation = one_car("wall", 1.5, 0.0, 0.0, 2.0)
    places, headings, speeds = drive(simulation, 0.0, 1.0, 20)
    assert places[-1, 0] == np.float32(WALL_X)
    assert (places[:, 0] <= np.float32(WALL_X)).all()
    assert headings[-1] == 0, "its heading stays"
    assert speeds[-1] == 0, "all of its velocity went into the wall"
    places, _, _ = drive(simulation, 1.0, 1.0, 100)
    assert places[:, 0].min() < WALL_X - 0.1, "it can steer away"
    assert (np.abs(places) <= np.float32([WALL_X, WALL_Y])).all()
    assert simulation.score()[0]["outside_time"] == 0


@pytest.mark.parametrize(
    ("heading", "corner"),
    [
        (0.3, (WALL_X, WALL_Y)),
        (math.pi - 0.3, (-WALL_X, WALL_Y)),
        (-2.5, (-WALL_X, -WALL_Y)),
        (-0.7, (WALL_X, -WALL_Y)),
    ],
)
@pytest.mark.parametrize("steering", [-1.0, 1.0])
def test_a_car_is_not_caught_in_a_corner(heading, corner, steering):
    simulation = one_car("wall", *(0.97 * np.array(corner)), heading, 1.0)
    places, _, _ = drive(simulation, 0.0, 1.0, 20)
    assert places[-1] == pytest.approx(corner)
    places, _, _ = drive(simulation, steering, 1.0, 150)
    assert (np.linalg.norm(places - corner, axis=1) > 0.3).any()


def test_a_wall_takes_the_part_of_the_velocity_that_goes_into_it():
    # Oracle: by hand; in the one step of integration in which a coasting car meets the wall at 60 degrees to it.
    angle = math.radians(30)
    simulation = one_car("wall", WALL_X - 0.01, 0.0, angle, 1.0, **{"task.substeps": 1})
    places, headings, speeds = drive(simulation, 0.0, -1.0, 1)
    free = math.exp(-0.945 * 0.1)
    assert places[0, 0] == np.float32(WALL_X)
    assert places[0, 1] == pytest.approx((1 - free) / 0.945 * math.sin(angle), abs=1e-5)
    assert speeds[0] == pytest.approx(free * math.sin(angle), rel=1e-5)
    assert headings[0] == pytest.approx(angle)


def test_no_car_jumps_through_the_wall_and_its_track_ends_there():
    simulation = one_car("wall", 0.0, 0.0, 0.2, 900.0, **{"task.substeps": 4})
    drive(simulation, 0.0, 1.0, 3)
    track = simulation.robots.track.numpy()[0, 0]
    assert (np.abs(track[:, :2]) <= np.float32([WALL_X, WALL_Y])).all()
    assert (track[-1] == simulation.robots.position.numpy()[0, 0]).all()


def test_a_car_is_removed_once_its_whole_body_is_outside():
    # Oracle: by hand, the first step after which the centre is more than the radius beyond B.
    free = one_car("open", 0.0, 0.6, math.pi / 2, 1.0)
    places, _, _ = drive(free, 0.0, 0.0, 12)
    at = int(np.flatnonzero(places[:, 1] > B + RADIUS)[0])
    simulation = one_car("remove", 0.0, 0.6, math.pi / 2, 1.0, **{"task.reward_outside": -3.0, "targets.count": 0})
    for k in range(at + 1):
        assert not simulation.terminated.numpy().any()
        drive(simulation, 0.0, 0.0, 1)
        assert simulation.reward_terms.numpy()[0, 0, 6] == pytest.approx(-0.3 if k == at else 0)
    assert simulation.terminated.numpy().all()
    assert simulation.robots.status.numpy()[0, 0] == 2
    assert not simulation.truncated.numpy().any()
    assert simulation.over.all(), "nobody is left"
    assert (simulation.observation.numpy()[0, 0, 7:] == 0).all()
    assert simulation.score()[0]["outside_time"] == pytest.approx(0.1), "counted once, in the step in which it went"


def test_the_body_is_round_at_the_corner():
    # Oracle: 0.7 radii beyond both edges the body still touches the corner, at 0.75 it does not: the root of 1/2.
    for beyond, outside in ((0.7, 0.0), (0.72, 0.1)):
        simulation = one_car("open", A + beyond * RADIUS, B + beyond * RADIUS, 0.0, 0.0)
        drive(simulation, 0.0, -1.0, 1)
        assert simulation.score()[0]["outside_time"] == pytest.approx(outside)


def test_the_others_go_on_when_one_is_removed():
    many = {"faults.schedule": ((1, 0.5, math.inf),), "faults.removed": ((2, 0.3),), "task.reward_waiting": -1.0}
    scenario = lissajous_env.scenario("experiment", **{"task.boundary": "remove", "targets.arrival_rate": 20.0}, **many)
    simulation = lissajous_env.Simulation(scenario)
    position = simulation.robots.position.numpy().copy()
    position[0, :2] = [[A + 0.2, 0.0, 0.0], [0.0, B + 0.11, 0.0]]
    simulation.robots.position.assign(position)
    simulation.robots.speed.zero_()
    for _ in range(10):
        simulation.step(np.tile(np.float32([0.0, -1.0]), (1, 5, 1)))
    assert simulation.terminated.numpy()[0].tolist() == [True, False, False, False, False]
    assert simulation.robots.status.numpy()[0].tolist()[:3] == [2, 1, 2], "removed, stuck at the edge, lost"
    assert not simulation.over.any()
    waiting = simulation.reward_terms.numpy()[0, :, 1]
    assert waiting[0] == 0 > waiting[3], "who is gone has no part in what the others earn"
    # A collision with one that is gone does not happen.
    before = simulation.score()[0]["collisions"]
    position = simulation.robots.position.numpy().copy()
    position[0, 3] = position[0, 0]
    simulation.robots.position.assign(position)
    simulation.step(np.tile(np.float32([0.0, -1.0]), (1, 5, 1)))
    assert simulation.score()[0]["collisions"] == before


def test_points_on_the_curve_never_leave():
    runs = []
    walled = lissajous_env.scenario("failure", **{"task.boundary": "wall"})
    assert walled.inset == walled.robot.radius, "with walls, whole bodies stay inside"
    for boundary in ("open", "remove"):
        simulation = lissajous_env.Simulation(lissajous_env.scenario("failure", **{"task.boundary": boundary}), 3)
        draw = np.random.default_rng(1)
        for _ in range(50):
            simulation.step(draw.uniform(-1, 1, simulation.action_shape))
        runs.append((simulation.observation.numpy().tobytes(), simulation.robots.position.numpy().tobytes()))
        assert all(row["outside_time"] == 0 for row in simulation.score())
    assert runs[0] == runs[1]


def test_an_agent_that_leaves_is_terminated_in_every_environment():
    leaving = {"task.boundary": "remove", "robot.radius": 0.01, "task.duration": 20.0}
    env = lissajous_env.parallel_env("experiment", **leaving)
    env.reset(seed=1)
    ended = set()
    while env.agents:
        ahead = {agent: np.array([0.0, 1.0], dtype=np.float32) for agent in env.agents}
        _, _, terminations, truncations, _ = env.step(ahead)
        ended |= {agent for agent, gone in terminations.items() if gone}
    assert ended == set(env.possible_agents)
    assert not any(truncations.values())
