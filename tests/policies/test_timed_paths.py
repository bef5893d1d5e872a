"""Timed paths: their tables against closed forms, and cars that follow them against an independent bicycle."""

import dataclasses
import math

import numpy as np
import pytest
from reference_motion import car_runge_kutta

import lissajous_env
from baselines.policies.loops import resampled
from baselines.policies.path_tables import FINE, path_tables
from baselines.policies.timed_paths import TimedPaths
from lissajous_env.world.observation import layout

EVADERS = lissajous_env.scenario("evaders")


def circles(scenario, radius=0.6, steps=22):
    """(N, steps, 2) a circle for each robot, side by side."""
    n, half = scenario.num_robots, scenario.curve.half_width
    angle = 2 * np.pi * np.arange(steps) / steps
    centre = half * ((2 * np.arange(n) + 1) / n - 1)
    x = centre[:, None] + radius * np.cos(angle)
    return np.stack([x, np.broadcast_to(radius * np.sin(angle), x.shape)], axis=-1)


def ellipse(scenario, half_width=1.2, half_height=0.8, steps=37):
    """(N, steps, 2) an ellipse at an even speed, the same for each robot."""
    t = np.linspace(0, 2 * np.pi, 20_000, endpoint=False)
    places = np.stack([half_width * np.cos(t), half_height * np.sin(t)], axis=-1)
    return np.repeat(resampled(places, steps)[None], scenario.num_robots, axis=0)


def following(tables):
    """A class of policies that follow the tables."""
    return type("Following", (TimedPaths,), {"timed": lambda self, scenario: tables})


def errors(scenario, tables, worlds=8, steps=200, seed=3):
    """(steps, W, N) distances from the reference [m]."""
    policy = following(tables)(scenario, worlds)
    simulation = lissajous_env.Simulation(scenario, worlds, seed=seed)
    wanted, offsets = tables.places(steps), []
    for k in range(steps):
        simulation.step(policy.act(simulation.observation))
        offsets.append(simulation.robots.position.numpy()[:, :, :2] - wanted[0, :, k + 1])
    return np.linalg.norm(offsets, axis=-1)


def test_the_tables_of_a_circle_are_its_closed_form():
    radius, steps = 0.6, 22
    tables = path_tables(EVADERS, circles(EVADERS, radius, steps))
    speed = 2 * np.pi * radius / (steps * EVADERS.task.step)
    assert tables.pose.shape == (1, 5, FINE * steps, 4)
    np.testing.assert_allclose(tables.pose[..., 3], speed, rtol=1e-5)
    np.testing.assert_allclose(tables.feedforward[..., 0], 1 / radius, rtol=1e-5)
    np.testing.assert_allclose(tables.feedforward[..., 1], 0, atol=1e-4)
    angle = np.pi / 2 + 2 * np.pi * np.arange(FINE * steps) / (FINE * steps)
    np.testing.assert_allclose(np.exp(1j * tables.pose[0, 2, :, 2]), np.exp(1j * angle), atol=1e-5)


def test_a_lead_in_goes_over_into_the_loop():
    """Oracle: a spiral in closed form, whose end is the circle's start, at the same speed and curvature."""
    loop = circles(EVADERS)
    rate = 2 * np.pi / loop.shape[1]
    before = np.arange(-8, 0)
    centre = loop.mean(axis=1, keepdims=True)
    radius = 0.6 + 0.0004 * before**4 / 8**3
    spiral = centre + (radius * np.stack([np.cos(rate * before), np.sin(rate * before)]))[:, None].T.swapaxes(0, 1)
    tables = path_tables(EVADERS, loop, spiral)
    assert (tables.lead_in_steps, tables.loop_steps) == (8, 22)
    np.testing.assert_allclose(tables.places(7)[0], spiral, atol=1e-12)
    np.testing.assert_allclose(tables.places(30)[0, :, 8:], loop[:, np.arange(23) % 22], atol=1e-12)
    middle = FINE * 8
    velocity = np.diff(tables.pose[0, 0, middle - 4 : middle + 4, :2], axis=0)
    assert np.ptp(np.linalg.norm(velocity, axis=1)) < 1e-4
    np.testing.assert_allclose(tables.feedforward[0, 0, middle - FINE, 0], 1 / 0.6, rtol=0.01)


@pytest.mark.parametrize(("path", "bound"), [(circles, 1e-4), (ellipse, 5e-3)])
def test_uneven_cars_follow_within_millimetres(path, bound):
    """Oracle: the place that was requested, of cars whose wheelbase and drive differ by 2 %, at about 1.7 m/s."""
    late = errors(EVADERS, path_tables(EVADERS, path(EVADERS)))[100:]
    assert late.max() < bound


@pytest.mark.parametrize("change", [{}, {"wheelbase": 1.05}, {"drive": 0.96}])
def test_an_independent_bicycle_follows(change):
    """Oracle: (12) in float64 by another integrator, of a car that is not the one that the policy assumes."""
    scenario = EVADERS.resolve()
    car = dataclasses.replace(scenario.robot, throttle_max=None, speed_max=None)
    car = dataclasses.replace(car, **{name: getattr(car, name) * factor for name, factor in change.items()})
    tables = path_tables(scenario, ellipse(scenario))
    policy, names = following(tables)(scenario), layout(scenario).names
    state = np.array([1.2, 0.05, 1.5, 1.2])
    rows = np.zeros(policy.observation_shape, dtype=np.float32)
    missed = []
    for step in range(150):
        shown = {"x": state[0] / scenario.curve.half_width, "y": state[1] / scenario.curve.half_height,
                 "cos_heading": math.cos(state[2]), "sin_heading": math.sin(state[2]),
                 "speed": state[3] / scenario.robot.top_speed, "works": 1.0}  # fmt: skip
        for name, value in shown.items():
            rows[0, 0, names.index(name)] = value
        steering, throttle = policy.act(rows)[0, 0]
        span = scenario.robot.full_throttle - scenario.robot.throttle_min
        command = steering * scenario.robot.steering_max, scenario.robot.throttle_min + (throttle + 1) / 2 * span
        for _ in range(10):
            state = car_runge_kutta(car, state, *command, scenario.task.step / 10)
        missed.append(np.linalg.norm(state[:2] - tables.places(step + 1)[0, 0, -1]))
    assert max(missed[75:]) < 5e-3


def test_a_car_from_anywhere_gets_onto_its_path():
    """Oracle: the formation's own starts, up to 3 m away and heading anywhere; 12 s are enough."""
    scenario = lissajous_env.scenario("evaders", **{"formation.start": "random"})
    assert errors(scenario, path_tables(scenario, circles(scenario)), worlds=32)[120:].max() < 0.02


def test_a_robot_that_resumes_catches_up():
    """Oracle: before and 12 s after a stop of 3.3 s the robot is where it is to be; right after, it is not."""
    scenario = lissajous_env.scenario("evaders", **{"faults.schedule": ((2, 10.0, 13.3),)})
    distances = errors(scenario, path_tables(scenario, circles(scenario)), steps=300)
    assert distances[99, :, 2].max() < 1e-3
    assert distances[134, :, 2].min() > 0.2
    assert distances[250:, :, 2].max() < 1e-3
    assert distances[100:, :, [0, 1, 3, 4]].max() < 1e-3, "the others do not react"
