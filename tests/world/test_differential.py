"""Differential drives: closed forms of their motion, limits and laws."""

import math

import numpy as np
import pytest
from one_robot import driven, one_robot

import lissajous_env
from lissajous_env.envs.sides import action_table
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.world.observation import layout

LIMITS = {
    "robot.speed_max": 1.2, "robot.speed_min": -0.6, "robot.yaw_rate_max": 3.0, "robot.acceleration_max": 0.8,
    "robot.yaw_acceleration_max": 4.0,
}  # fmt: skip
V, BACK, W, A, ALPHA = LIMITS.values()
DRIVE = {"robot.kind": "differential"}


def one_drive(pose=(0.0, 0.0, 0.0), speed=0.0, yaw_rate=0.0, **overrides):
    return one_robot(*pose, speed, yaw_rate, **{**DRIVE, **LIMITS, **overrides})


def trapezoid(top, rate, times):
    """Integral of a quantity that grows from 0 to a top at a rate."""
    end = top / rate
    return np.where(times < end, rate * times**2 / 2, top * (times - end / 2))


def test_a_turn_on_the_spot_by_hand():
    # Oracle: closed form of a yaw rate that grows at its limit up to its largest value.
    states = driven(one_drive(pose=(0.3, -0.2, 0.5)), [[0.0, 1.0]] * 30)
    times = 0.1 * np.arange(1, 31)
    np.testing.assert_allclose(np.unwrap(states[:, 2]), 0.5 + trapezoid(W, ALPHA, times), atol=1e-5)
    np.testing.assert_allclose(states[:, 4], np.minimum(ALPHA * times, W), rtol=1e-5)
    np.testing.assert_allclose(states[:, :2], [[0.3, -0.2]] * 30, atol=1e-7)
    assert np.abs(states[:, 3]).max() == 0


@pytest.mark.parametrize(("action", "top"), [(0.5, V / 2), (-1.0, BACK)])
def test_a_straight_way_by_hand(action, top):
    # Oracle: closed form; half of an action requests half of the speed in either direction.
    states = driven(one_drive(pose=(0.1, 0.0, 0.4)), [[action, 0.0]] * 25)
    way = math.copysign(1, top) * trapezoid(abs(top), A, 0.1 * np.arange(1, 26))
    np.testing.assert_allclose(states[:, 0], 0.1 + way * math.cos(0.4), atol=2e-6)
    np.testing.assert_allclose(states[:, 1], way * math.sin(0.4), atol=2e-6)
    assert states[-1, 3] == pytest.approx(top)


def test_a_circle_has_the_radius_of_speed_over_yaw_rate():
    # Oracle: closed form; Simpson's rule is off by (omega h)^4 / 2880 of the way.
    states = driven(one_drive(speed=-0.6, yaw_rate=2.0), [[-1.0, 2.0 / W]] * 40)
    turned = 2.0 * 0.1 * np.arange(1, 41)
    np.testing.assert_allclose(states[:, 0], -0.3 * np.sin(turned), atol=1e-5)
    np.testing.assert_allclose(states[:, 1], -0.3 * (1 - np.cos(turned)), atol=1e-5)


@pytest.mark.parametrize("boundary", ["open", "wall"])
def test_backwards_is_the_mirror_image_of_forwards(boundary):
    # Law: a drive that looks back and drives backwards goes the same way; turns have no direction of motion.
    draw, either = np.random.default_rng(3), {"robot.speed_min": -V, "task.boundary": boundary}
    actions = np.repeat(draw.uniform(-1, 1, (25, 2)), 8, axis=0)
    ahead = driven(one_drive((1.2, 0.2, 0.3), 0.8, **either), actions)
    back = driven(one_drive((1.2, 0.2, 0.3 + math.pi), -0.8, **either), actions * [-1, 1])
    assert (np.abs(ahead[:, 0]) == np.float32(1.675)).any() == (boundary == "wall")
    np.testing.assert_allclose(back[:, :2], ahead[:, :2], atol=1e-4)
    np.testing.assert_allclose(back[:, 3:], ahead[:, 3:] * [-1, 1], atol=1e-4)


def test_drives_differ_by_their_motors_and_by_the_distance_of_their_wheels():
    # Oracle: by hand. A weaker motor needs longer for the same speed; wheels farther apart turn more slowly.
    simulation = one_drive(**{"robot.drive_factors": ((0, 0.5),)})
    assert simulation.scenario.top_speeds.tolist() == [V]
    simulation.robots.wheelbase.assign(1.25 * simulation.robots.wheelbase.numpy())
    states = driven(simulation, [[1.0, 1.0]] * 40)
    np.testing.assert_allclose(states[:, 3], np.minimum(0.5 * A * 0.1 * np.arange(1, 41), V), rtol=1e-5)
    assert states[-1, 4] == pytest.approx(W / 1.25)


def test_limits_that_are_not_given_follow_from_the_others():
    # Oracle: wheels at the edge of a uniform disc that push with its whole mass times the acceleration.
    robot = lissajous_env.scenario("hall", **{"robot.kind": "differential"}).resolve().robot
    assert (robot.speed_max, robot.speed_min, robot.yaw_rate_max) == (1.5, -1.5, 3.0)
    assert robot.acceleration_max == pytest.approx(0.945 * 1.5)
    mass, force = 7.0, 7.0 * robot.acceleration_max
    assert robot.yaw_acceleration_max == pytest.approx(force * robot.radius / (mass * robot.radius**2 / 2))
    assert lissajous_env.scenario("hall").resolve().robot.speed_min == 0


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"robot.yaw_rate_max": 0.0}, r"robot.yaw_rate_max must be from 1e-06 to 1e\+10 \[rad/s\], got 0.0"),
        ({"robot.acceleration_max": -1.0}, r"robot.acceleration_max must be from 1e-06 .* \[m/s\^2\], got -1.0"),
        ({"robot.yaw_rate_max": 90.0}, r"robot.yaw_rate_max must turn a drive by at most pi in an integration step of"),
        ({"curve.half_depth": 0.5}, r"curve.half_depth must be 0 for differential drives \[m\], got 0.5"),
        ({"faults.stop": "coast"}, r"faults.stop must be dead for robots of kind differential, got 'coast'"),
        ({**LIMITS, "robot.kind": "car"}, r"robot.yaw_acceleration_max must be .* for cars, .* \[rad/s\^2\], got 4.0"),
    ],
)
def test_a_drive_that_cannot_be_simulated_is_refused_by_name(overrides, words):
    with pytest.raises(ValueError, match=words):
        lissajous_env.scenario("experiment", **{**DRIVE, **overrides})


def test_actions_observations_and_shape():
    simulation = one_drive(speed=-0.6)
    driven(simulation, [[-1.0, 0.0]])
    speed = simulation.observation.numpy()[0, 0, list(layout(simulation.scenario).names).index("speed")]
    assert speed == pytest.approx(BACK / V)
    assert simulation.scenario.action_names == ("speed", "yaw rate")
    table = np.array(action_table(simulation.scenario))
    assert ((table == 0).all(axis=1)).sum() == 1, "one action is rest"
    assert (np.abs(table[:, 1]) == 1)[table[:, 0] == 0].sum() == 2, "and two turn on the spot"
    for outline, _ in model_of("differential").shape(simulation.scenario.robot):
        assert np.hypot(*outline.T).max() <= 1.001
