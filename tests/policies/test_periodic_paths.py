"""Periodic paths of any form: their Fourier coefficients, and cars that follow them."""

import re

import numpy as np
import pytest

import baselines
import lissajous_env
from baselines.policies.periodic_paths import PathParameters, PeriodicPaths

EVADERS = lissajous_env.scenario("evaders")


def test_places_are_those_of_the_series():
    """Oracle: the series, term by term."""
    paths, t = np.random.default_rng(1).normal(size=(5, 2 + 4 * 3)), np.arange(16) / 16
    y = sum(paths[..., 4 + 4 * k, None] * np.cos(2 * np.pi * (k + 1) * t) for k in range(3))
    y = y + sum(paths[..., 5 + 4 * k, None] * np.sin(2 * np.pi * (k + 1) * t) for k in range(3))
    policy = PeriodicPaths(EVADERS, parameters=PathParameters(period=16, paths=paths.tolist()))
    np.testing.assert_allclose(policy.tables.places(15)[0, ..., 1], paths[:, 1:2] + y, atol=1e-12)


def test_cars_go_around_the_circles_that_were_given():
    """Oracle: the circles in closed form; an even phase of the team is free."""
    middle = np.array([-1.2, -0.6, 0.0, 0.6, 1.2])
    rows = [[x, 0.0, 0.55, 0.0, 0.0, 0.55] for x in middle]
    policy = PeriodicPaths(EVADERS, parameters=PathParameters(period=20, paths=rows))
    simulation = lissajous_env.Simulation(EVADERS)
    for _ in range(200):
        simulation.step(policy.act(simulation.observation))
    places = np.sort(simulation.robots.position.numpy()[0, :, :2], axis=0)
    offset = places[:, 0] - middle
    np.testing.assert_allclose(np.hypot(offset, places[:, 1]), 0.55, atol=0.02)
    np.testing.assert_allclose(offset, offset[0], atol=0.03)


@pytest.mark.parametrize(("changed", "message"), [
    ({"paths": ((0.0, 1.0, 2.0),)}, "path.paths must contain a row for each robot"),
    ({"paths": ((0.0,) * 6,) * 4}, "paths must contain a row for each of the 5 robots, got 4"),
])  # fmt: skip
def test_wrong_parameters_are_refused(changed, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        PeriodicPaths(EVADERS, parameters=PathParameters(**changed))


def test_cars_that_do_not_know_the_starts_of_others_drive_to_their_paths_under_the_filter():
    """Oracle: the filter sends positions, paths on a timetable nothing, and the paper's controller phases."""
    unknown = lissajous_env.scenario("evaders", **{"formation.start": "random"})
    policies = PeriodicPaths(EVADERS), PeriodicPaths(unknown), baselines.make("kuramoto-mpcc-safe", EVADERS)
    positions = "positions of ring neighbours"
    assert [of.communicates for of in policies] == ["nothing", positions, f"phases of ring neighbours and {positions}"]
