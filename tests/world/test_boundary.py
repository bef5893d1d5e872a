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


def test_the_body_is_round_at_the_corner():
    # Oracle: 0.7 radii beyond both edges the body still touches the corner, at 0.75 it does not: the root of 1/2.
    for beyond, outside in ((0.7, 0.0), (0.72, 0.1)):
        simulation = one_car("open", A + beyond * RADIUS, B + beyond * RADIUS, 0.0, 0.0)
        drive(simulation, 0.0, -1.0, 1)
        assert simulation.score()[0]["outside_time"] == pytest.approx(outside)


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
