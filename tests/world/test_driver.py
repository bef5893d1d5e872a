"""The driver of cars whose actions are velocities, between walls."""

import numpy as np
import pytest

import lissajous_env


@pytest.mark.parametrize("name", ["watch", "intercept", "hotspots"])
def test_drivers_of_any_velocities_meet_no_wall_and_move_on(name):
    simulation = lissajous_env.Simulation(name, 16, seed=3)
    scenario, robots, random = simulation.scenario, simulation.robots, np.random.default_rng(0)
    half = np.array([scenario.curve.half_width, scenario.curve.half_height]) - scenario.robot.radius
    way = np.zeros((16, scenario.num_robots))
    for step in range(min(scenario.task.steps - 1, 400)):
        if step % 25 == 0:
            velocity = random.normal(size=(16, scenario.num_robots, 2)).astype(np.float32)
        before = robots.position.numpy()[..., :2].copy()
        simulation.step(velocity)
        place = robots.position.numpy()[..., :2]
        assert (np.abs(place) < half).all()
        way += np.linalg.norm(place - before, axis=2)
    assert (way > 0.1 * scenario.robot.top_speed * 400 * scenario.task.step).all()
