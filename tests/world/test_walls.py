"""Walls in the score: parts of bodies outside, contacts, and robots that are blocked."""

import dataclasses
import math

import numpy as np
import pytest

import lissajous_env
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.world.constants import constants_of

A, B, RADIUS = 1.8, 0.8, 0.125
ONE = {"robot.count": 1, "formation.p": 0, "formation.ring": None, "faults.schedule": (), "robot.speed_max": 1.5}
WALL = {"task.boundary": "wall", "robot.speed_min": -1.0}


def one_car(x, y, heading, **overrides):
    even = {"noise.wheelbase_spread": 0.0, "noise.drive_spread": 0.0, "task.duration": 100.0}
    simulation = lissajous_env.Simulation(lissajous_env.scenario("experiment", **{**ONE, **even, **overrides}))
    simulation.robots.position.assign(np.float32([[[x, y, 0.0]]]))
    simulation.robots.heading.assign(np.float32([[heading]]))
    simulation.robots.speed.zero_()
    return simulation


def driven(simulation, steering, throttle, steps):
    """The score after as many steps of one action."""
    for _ in range(steps):
        simulation.step(np.float32([[[steering, throttle]]]))
    return simulation.score()[0]


@pytest.mark.parametrize(("x", "y"), [(A, 0.0), (-A, 0.0), (0.0, B), (0.0, -B), (A, B)])
def test_a_body_is_partly_outside_before_it_is_wholly_outside(x, y):
    # Oracle: by hand; a disc is partly outside from a radius within an edge on, wholly from a radius beyond it.
    for beyond, partly, wholly in ((-1.01, 0, 0), (-0.99, 1, 0), (0.7, 1, 0), (1.01, 1, 1)):
        place = np.array([x, y]) + beyond * RADIUS * np.sign([x, y])
        row = driven(one_car(*place, 0.0), 0.0, -1.0, 3)
        assert row["partly_outside_time"] == pytest.approx(0.3 * partly)
        assert row["outside_time"] == pytest.approx(0.3 * wholly)


def test_a_contact_counts_once_until_the_body_leaves():
    simulation = one_car(A - 0.4, 0.0, 0.0, **WALL)
    assert driven(simulation, 0.0, 0.5, 60)["wall_contacts"] == 1, "pressed against the wall"
    assert driven(simulation, 0.0, 0.0, 20)["wall_contacts"] == 1, "at rest at the wall"
    assert driven(simulation, 0.0, -1.0, 10)["wall_contacts"] == 1, "backs up"
    row = driven(simulation, 0.0, 1.0, 60)
    assert row["wall_contacts"] == 2
    assert row["partly_outside_time"] == 0, "a wall stops the whole body"
    simulation.reset()
    assert simulation.score()[0]["wall_contacts"] == 0


def test_a_car_is_blocked_while_its_policy_drives_it_into_a_wall():
    # Oracle: by hand. It is at the wall and is driven for 3 s, of which the last second is beyond `blocked_after`.
    simulation = one_car(A - RADIUS, 0.0, 0.0, **WALL)
    simulation.step(np.zeros((1, 1, 2), dtype=np.float32))
    assert driven(simulation, 0.0, 1.0, 30)["blocked_time"] == pytest.approx(1.0)
    assert driven(simulation, 0.3, 0.0, 40)["blocked_time"] == pytest.approx(1.0), "a policy that waits is not blocked"
    assert driven(simulation, 0.3, 0.01, 40)["blocked_time"] == pytest.approx(1.0), "nor one that hardly drives"
    assert driven(simulation, 0.0, 1.0, 5)["blocked_time"] == pytest.approx(1.5), "but one that goes on"
    assert driven(simulation, 0.0, -1.0, 30)["blocked_time"] == pytest.approx(2.0), "until it has moved by its radius"
    patient = one_car(A - RADIUS, 0.0, 0.0, **WALL, **{"task.blocked_after": 2.9})
    assert driven(patient, 0.0, 1.0, 31)["blocked_time"] == pytest.approx(0.1)


def test_a_car_that_slides_along_a_wall_or_circles_is_not_blocked():
    row = driven(one_car(-A + 0.3, B - RADIUS, 0.3, **WALL), 0.0, 1.0, 40)
    assert (row["wall_contacts"], row["blocked_time"]) == (1, 0)
    row = driven(one_car(0.0, -0.5, 0.0, **WALL), 1.0, 1.0, 100)
    assert (row["wall_contacts"], row["blocked_time"]) == (0, 0)


def test_a_robot_that_has_failed_or_was_removed_is_not_blocked():
    for fault in ({"faults.schedule": ((0, 0.0, math.inf),)}, {"faults.removed": ((0, 0.0),)}):
        row = driven(one_car(A - RADIUS, 0.0, 0.0, **WALL, **fault), 0.0, 1.0, 40)
        assert row["blocked_time"] == 0


@pytest.mark.parametrize(("length", "time"), [(4.0, 1.0), (1.0, 4.0), (0.5, 16.0)])
def test_contacts_and_blocked_times_scale(length, time):
    # Law: in scaled units everything is the same.
    rows = []
    scenario = lissajous_env.scenario("rough", **{**WALL, "task.duration": 30.0})
    for made in (scenario, scenario.scaled(length, time)):
        simulation, draw = lissajous_env.Simulation(made, 2, seed=3), np.random.default_rng(0)
        for action in np.repeat(draw.uniform(-1, 1, (20, *simulation.action_shape)), 15, axis=0):
            simulation.step(action)
        rows.append(simulation.score())
    assert sum(row["blocked_time"] for row in rows[0]) > 0
    for before, after in zip(*rows, strict=True):
        assert after["wall_contacts"] == before["wall_contacts"] > 0
        assert after["blocked_time"] == pytest.approx(time * before["blocked_time"])


def test_the_speed_that_an_action_requests():
    # Oracle: by hand; rest and unit of the throttle, 0 for the steering.
    forwards = constants_of(lissajous_env.scenario("experiment", **ONE).resolve(), "cpu")["driving"].numpy()
    np.testing.assert_allclose(forwards, [[0, 0], [-1, 0.75]])
    both = constants_of(lissajous_env.scenario("experiment", **ONE, **WALL).resolve(), "cpu")["driving"].numpy()
    np.testing.assert_allclose(both, [[0, 0], [0, 1.5]])


def test_a_model_whose_driving_components_do_not_exist_is_refused():
    with pytest.raises(ValueError, match=r"driving of robot model other must contain indices .* 0 to 1, got \(2,\)"):
        lissajous_env.register_robot_model(dataclasses.replace(model_of("car"), name="other", driving=(2,)))
