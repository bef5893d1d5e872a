"""The boundary of the rectangle: walls that stop bodies, parts of bodies outside, contacts, and blocked robots."""

import dataclasses
import math

import numpy as np
import pytest
from one_robot import RADIUS, A, B, driven, one_robot, score_after

import lissajous_env
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.world.values import constants_of

SIDES = np.float32([A - RADIUS, B - RADIUS])
WALL = {"task.boundary": "wall", "robot.speed_max": 1.5, "robot.speed_min": -1.0}


def test_a_wall_stops_a_car_that_meets_it_head_on_until_it_steers_away():
    simulation = one_robot(1.5, speed=2.0, **{"task.boundary": "wall"})
    states = driven(simulation, [[0.0, 1.0]] * 20)
    assert states[-1, [0, 2, 3]].tolist() == [SIDES[0], 0, 0], "its heading stays, its velocity goes into the wall"
    states = driven(simulation, [[1.0, 1.0]] * 100)
    assert states[:, 0].min() < SIDES[0] - 0.1
    assert (np.abs(states[:, :2]) <= SIDES).all()


def test_a_wall_takes_the_part_of_the_velocity_that_goes_into_it():
    # Oracle: by hand; in the one step of integration in which a coasting car meets the wall at 60 degrees to it.
    angle, free = math.radians(30), math.exp(-0.945 * 0.1)
    simulation = one_robot(SIDES[0] - 0.01, 0.0, angle, 1.0, **{"task.boundary": "wall", "task.substeps": 1})
    (state,) = driven(simulation, [[0.0, -1.0]])
    expected = [SIDES[0], (1 - free) / 0.945 * math.sin(angle), angle, free * math.sin(angle)]
    assert state[:4] == pytest.approx(expected, abs=1e-5)


def test_no_car_jumps_through_a_wall_or_is_caught_in_a_corner():
    simulation = one_robot(heading=0.2, speed=900.0, **{"task.substeps": 4, "task.boundary": "wall"})
    driven(simulation, [[0.0, 1.0]] * 20)
    assert (np.abs(simulation.robots.path.numpy()[0, 0, :, :2]) <= SIDES).all()
    assert driven(simulation, [[0.0, 1.0]] * 20)[-1, :2] == pytest.approx(SIDES)
    places = driven(simulation, [[-1.0, 1.0]] * 150)[:, :2]
    assert (np.linalg.norm(places - SIDES, axis=1) > 0.3).any()


@pytest.mark.parametrize(("x", "y"), [(A, 0.0), (0.0, -B), (A, B)])
def test_a_body_is_partly_outside_before_it_is_wholly_outside(x, y):
    # Oracle: by hand; a disc is partly outside from a radius within an edge on, wholly from a radius beyond it. It is
    # round: beyond both edges, it is wholly outside from the root of 1/2 of a radius on.
    last = 0.72 if x and y else 1.01
    for beyond, partly, wholly in ((-1.01, 0, 0), (-0.99, 1, 0), (0.7, 1, 0), (last, 1, 1)):
        place = np.array([x, y]) + beyond * RADIUS * np.sign([x, y])
        row = score_after(one_robot(*place), 0.0, -1.0, 3)
        assert row["partly_outside_time"] == pytest.approx(0.3 * partly)
        assert row["outside_time"] == pytest.approx(0.3 * wholly)


def test_a_contact_counts_once_until_the_body_leaves():
    simulation = one_robot(A - 0.4, **WALL)
    assert score_after(simulation, 0.0, 0.5, 60)["wall_contacts"] == 1, "pressed against the wall"
    assert score_after(simulation, 0.0, 0.0, 20)["wall_contacts"] == 1, "at rest at the wall"
    assert score_after(simulation, 0.0, -1.0, 10)["wall_contacts"] == 1, "backs up"
    row = score_after(simulation, 0.0, 1.0, 60)
    assert row["wall_contacts"] == 2
    assert row["partly_outside_time"] == 0, "a wall stops the whole body"
    simulation.reset()
    assert simulation.score()[0]["wall_contacts"] == 0


def test_a_car_is_blocked_while_its_policy_drives_it_into_a_wall():
    # Oracle: by hand. It is at the wall and is driven for 3 s, of which the last second is beyond `blocked_after`.
    simulation = one_robot(A - RADIUS, **WALL)
    score_after(simulation, 0.0, 0.0, 1)
    assert score_after(simulation, 0.0, 1.0, 30)["blocked_time"] == pytest.approx(1.0)
    assert score_after(simulation, 0.3, 0.0, 40)["blocked_time"] == pytest.approx(1.0), "a policy waits"
    assert score_after(simulation, 0.3, 0.01, 40)["blocked_time"] == pytest.approx(1.0), "it hardly drives"
    assert score_after(simulation, 0.0, 1.0, 5)["blocked_time"] == pytest.approx(1.5), "it goes on"
    assert score_after(simulation, 0.0, -1.0, 30)["blocked_time"] == pytest.approx(2.0), "until it moved by its radius"
    patient = one_robot(A - RADIUS, **WALL, **{"task.blocked_after": 2.6})  # 26 float32 steps are more
    assert score_after(patient, 0.0, 1.0, 28)["blocked_time"] == pytest.approx(0.1)


def test_a_car_that_slides_along_a_wall_or_circles_or_has_failed_is_not_blocked():
    row = score_after(one_robot(-A + 0.3, B - RADIUS, 0.3, **WALL), 0.0, 1.0, 40)
    assert (row["wall_contacts"], row["blocked_time"]) == (1, 0)
    row = score_after(one_robot(0.0, -0.5, **WALL), 1.0, 1.0, 100)
    assert (row["wall_contacts"], row["blocked_time"]) == (0, 0)
    for kind, action in (("differential", (-1.0, 0.0)), ("car", (0.0, -0.5))):  # of the car, the motor does not drive
        rests = one_robot(**WALL | {"robot.kind": kind, "robot.speed_min": 0.0, "robot.throttle_min": 0.0})
        assert score_after(rests, *action, 40)["blocked_time"] == 0
    for fault in ({"faults.schedule": ((0, 0.0, math.inf),)}, {"faults.removed": ((0, 0.0),)}):
        assert score_after(one_robot(A - RADIUS, **WALL, **fault), 0.0, 1.0, 40)["blocked_time"] == 0


def test_the_speed_that_an_action_requests():
    # Oracle: by hand; rest of the throttle and its speeds in both directions, 0 for the steering.
    for kind, back, expected in (("car", 0, [-1, 0.75, 0]), ("car", -1, [0, 1.5, 1]), ("differential", 0, [0, 1.5, 0])):
        scenario = lissajous_env.scenario("experiment", **WALL | {"robot.kind": kind, "robot.speed_min": back})
        speeds = constants_of(scenario.resolve(), "cpu")["action_speeds"].numpy()
        np.testing.assert_allclose(speeds, [[0, 0, 0], expected][:: 1 if kind == "car" else -1])
    with pytest.raises(ValueError, match=r"driving of robot model other must contain indices .* 0 to 1, got \(2,\)"):
        lissajous_env.register_robot_model(dataclasses.replace(model_of("car"), name="other", driving=(2,)))


def test_points_on_the_curve_never_leave():
    runs = []
    assert lissajous_env.scenario("failure", **{"task.boundary": "wall"}).inset > 0, "with walls, bodies stay inside"
    for boundary in ("open", "remove"):
        simulation = lissajous_env.Simulation(lissajous_env.scenario("failure", **{"task.boundary": boundary}), 3)
        draw = np.random.default_rng(1)
        for _ in range(50):
            simulation.step(draw.uniform(-1, 1, simulation.action_shape))
        runs.append(simulation.observation.numpy().tobytes())
        assert all(row["outside_time"] == 0 for row in simulation.score())
    assert runs[0] == runs[1]
