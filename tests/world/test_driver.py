"""Actions that are velocities, and the driver that turns them into steering and throttle."""

import math

import numpy as np
import pytest
from test_feedback import FIELD

import baselines
import lissajous_env

pytestmark = pytest.mark.filterwarnings("ignore::lissajous_env.parameters.assumptions.AssumptionWarning")


def made(worlds=1, seed=0, **overrides):
    fields = FIELD | {"task.action": "velocity", "targets.count": 0, "formation.start": "random"} | overrides
    return lissajous_env.Simulation(lissajous_env.scenario("intruders", **fields), worlds, seed=seed)


def central(simulation):
    """Place the robots in the middle, far apart, at rest."""
    places = np.array([(-8, 4, 0), (8, 4, 0), (0, 0, 0), (-8, -4, 0), (8, -4, 0)], dtype=np.float32)
    simulation.robots.position.assign(np.broadcast_to(places, (simulation.num_worlds, 5, 3)))
    for name in ("speed", "heading"):
        getattr(simulation.robots, name).zero_()
    simulation.step(np.zeros(simulation.action_shape, dtype=np.float32))


@pytest.mark.parametrize("step", [0.1, 1.0])
@pytest.mark.parametrize(("angle", "size"), [(1.2, 0.5), (3.1, 1.0)])
def test_a_car_reaches_the_velocity_that_it_is_given(step, angle, size):
    # Oracle: the wish itself, once the car has turned round and its motor has settled.
    simulation = made(**{"task.step": step, "task.substeps": max(round(10 * step), 1), "task.duration": 60.0})
    central(simulation)
    wish = np.array([size * math.cos(angle), size * math.sin(angle)], dtype=np.float32)
    for _ in range(round(8 / step)):
        simulation.step(np.broadcast_to(wish, simulation.action_shape))
    heading, speed = simulation.robots.heading.numpy()[0], simulation.robots.speed.numpy()[0]
    assert speed == pytest.approx(np.full(5, 1.5 * size), rel=0.01)
    off = np.angle(np.exp(1j * (heading - angle)))
    assert np.abs(off).max() < (0.02 if step < 1 else 0.1)


def test_a_wish_of_zero_stops_and_larger_ones_are_of_top_speed():
    simulation = made()
    central(simulation)
    for _ in range(11):
        simulation.step(np.ones(simulation.action_shape, dtype=np.float32))
    assert simulation.robots.speed.numpy() == pytest.approx(np.full((1, 5), 1.5), rel=0.01)
    for _ in range(20):
        simulation.step(np.zeros(simulation.action_shape, dtype=np.float32))
    assert simulation.robots.speed.numpy().max() < 0.01


def test_the_driver_is_blind_to_direction_and_side():
    # Law: a turned wish leads to a turned path, and a mirrored one to a mirrored path.
    simulation = made(3)
    central(simulation)
    angles = np.array([0.9, 0.9 + math.pi / 2, -0.9])
    simulation.robots.heading.assign(np.repeat([[0.0], [math.pi / 2], [0.0]], 5, axis=1).astype(np.float32))
    simulation.robots.measured.assign(
        np.concatenate(
            [simulation.robots.position.numpy()[..., :2], simulation.robots.heading.numpy()[..., None],
             simulation.robots.speed.numpy()[..., None]], axis=-1
        )
    )  # fmt: skip
    start = simulation.robots.position.numpy()[..., :2].copy()
    wish = np.stack([np.cos(angles), np.sin(angles)], axis=-1).astype(np.float32)[:, None]
    for _ in range(10):
        simulation.step(np.broadcast_to(wish, simulation.action_shape).copy())
    way = simulation.robots.position.numpy()[..., :2] - start
    np.testing.assert_allclose(np.stack([-way[0, :, 1], way[0, :, 0]], axis=-1), way[1], atol=1e-3)
    np.testing.assert_allclose(way[0] * [1, -1], way[2], atol=1e-3)


def test_every_interface_names_the_velocity():
    scenario = made().scenario
    assert scenario.action_names == ("x_velocity", "y_velocity")
    assert scenario.actuation == "velocity"
    env = lissajous_env.parallel_env(scenario, discrete_actions=True)
    assert env.action_space("robot_0").n == 9
    assert {"random", "still"} <= set(baselines.names(scenario))
    assert "kuramoto-mpcc" not in baselines.names(scenario)


def test_what_steers_itself_is_refused():
    with pytest.raises(ValueError, match=r"task.action must be control for robots of kind curve, got velocity"):
        lissajous_env.scenario("failure", **{"task.action": "velocity"})
