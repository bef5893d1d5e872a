"""Periodic paths of any form: their Fourier coefficients, cars that follow them, and the search that improves them."""

import re

import numpy as np
import pytest

import baselines
import lissajous_env
from baselines.planning.families.included import best_known
from baselines.planning.free_paths import Limits, Teams, loop_of, moved, optimise, violation
from baselines.planning.plans import SETTLED, WHOLE, Plan
from baselines.policies.periodic_paths import PathParameters, PeriodicPaths, coefficients_of, derivative_of, places_of
from baselines.policies.settings import PolicySettings

EVADERS = lissajous_env.scenario("evaders")
PATHS = np.random.default_rng(1).normal(size=(2, 3, 2 + 4 * 3))


def circle(radius, x=0.0):
    return np.array([x, 0.0, radius, 0.0, 0.0, radius])


def test_coefficients_are_those_of_the_series():
    """Oracle: the series, term by term, and its coefficients again from its places."""
    places, t = places_of(PATHS, 16), np.arange(16) / 16
    x = sum(PATHS[..., 2 + 4 * k, None] * np.cos(2 * np.pi * (k + 1) * t) for k in range(3))
    x = x + sum(PATHS[..., 3 + 4 * k, None] * np.sin(2 * np.pi * (k + 1) * t) for k in range(3))
    np.testing.assert_allclose(places[..., 0], PATHS[..., :1] + x)
    np.testing.assert_allclose(coefficients_of(places, 3), PATHS, atol=1e-12)


def test_the_derivative_is_that_of_the_series():
    # Oracle: central differences at a fine period.
    fine, duration = 4000, 2.5
    places = places_of(PATHS, fine)
    wanted = (np.roll(places, -1, axis=-2) - np.roll(places, 1, axis=-2)) / (2 * duration / fine)
    np.testing.assert_allclose(places_of(derivative_of(PATHS, duration), fine), wanted, rtol=1e-4, atol=1e-3)


def test_cars_go_around_the_circles_that_were_given():
    """Oracle: the circles in closed form; an even phase of the team is free."""
    rows = [circle(0.55, x).tolist() for x in (-1.2, -0.6, 0.0, 0.6, 1.2)]
    policy = PeriodicPaths(EVADERS, parameters=PathParameters(period=20, paths=rows))
    simulation = lissajous_env.Simulation(EVADERS)
    for _ in range(200):
        simulation.step(policy.act(simulation.observation))
    places = np.sort(simulation.robots.position.numpy()[0, :, :2], axis=0)
    middle = np.array([-1.2, -0.6, 0.0, 0.6, 1.2])
    offset = places[:, 0] - middle
    np.testing.assert_allclose(np.hypot(offset, places[:, 1]), 0.55, atol=0.02)
    np.testing.assert_allclose(offset, offset[0], atol=0.03)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"period": 3}, "path.period must be a whole number from 4"),
        ({"paths": ((0.0, 1.0, 2.0),)}, "path.paths must contain a row for each robot"),
        ({"paths": ((0.0,) * 6,) * 4}, "paths must contain a row for each of the 5 robots, got 4"),
    ],
)
def test_wrong_parameters_are_refused(changed, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        PeriodicPaths(EVADERS, parameters=PathParameters(**changed))


def test_cars_that_do_not_know_the_starts_of_others_drive_to_their_paths_under_the_filter():
    """Oracle: the filter communicates, and paths on a timetable do not."""
    unknown = lissajous_env.scenario("evaders", **{"formation.start": "random"})
    assert PeriodicPaths(EVADERS).communicates == "nothing"
    assert PeriodicPaths(unknown).communicates != "nothing"


def test_violations_are_relative_and_add_up():
    """Oracle: circles in closed form: speed 2 pi r / T, curvature 1 / r, distances of their centres."""
    limits = Limits(speed=2.0, turning=0.5, apart=0.3, half=(3.0, 2.0), step=0.1)
    one = np.stack([circle(0.6, -1.0), circle(0.6, 1.0)])[None]
    fine = round(2 * np.pi * 0.6 / 1.9 / 0.1)
    assert violation(one, fine, limits)[0] == 0
    assert violation(one, fine // 2, limits)[0] == pytest.approx(
        2 * np.pi * 0.6 / (fine // 2 * 0.1) / 2.0 - 1, rel=1e-3
    )
    tight = np.stack([circle(0.4, -1.0), circle(0.4, 1.0)])[None]
    assert violation(tight, fine, limits)[0] == pytest.approx(0.25, rel=1e-3)
    near = np.stack([circle(0.6, 0.0), circle(0.6, 0.2)])[None]
    assert violation(near, fine, limits)[0] == pytest.approx(1 - 0.2 / 0.3, rel=1e-3)
    outside = np.stack([circle(0.6, -1.0), circle(0.6, 2.7)])[None]
    assert violation(outside, fine, limits)[0] == pytest.approx(0.1, rel=1e-2)


def test_teams_are_scored_apart():
    """The law of the batch: a team's score does not depend on the others; the same team twice has the same score."""
    plan = Plan("partition", EVADERS, PolicySettings("partition"))
    loop = loop_of(plan)
    other = loop + np.array([0.2, 0.1])
    both = Teams(EVADERS, loop.shape[1], 3).scores(np.stack([loop, other, loop]))
    alone = Teams(EVADERS, loop.shape[1], 1).scores(other[None])
    assert (both.worst[0], both.mean[0]) == (both.worst[2], both.mean[2])
    assert both.worst[1] == alone.worst[0]
    whole = Teams(EVADERS, loop.shape[1], 1, WHOLE).scores(loop[None])
    assert whole.worst[0] > both.worst[0] > 0, "the drive to the paths counts in whole episodes alone"


def test_moved_paths_are_moved_stretched_and_delayed():
    """Oracle: places of the paths at other times, stretched around their middle, and moved."""
    paths = PATHS[0]
    changes = np.zeros((2, 3, 5))
    changes[1] = [[0.3, -0.2, np.log(1.5), np.log(0.5), 0.25]] * 3
    places, after = places_of(paths, 16), places_of(moved(paths, changes), 16)
    np.testing.assert_allclose(after[0], places)
    around = np.roll(places, 4, axis=1) - paths[:, None, :2]
    np.testing.assert_allclose(after[1], paths[:, None, :2] + [0.3, -0.2] + around * [1.5, 0.5], atol=1e-12)


def test_free_paths_keep_the_limits_of_the_cars():
    pytest.importorskip("cma")
    start = best_known(EVADERS).plan({"stored": "evaders"})
    found = optimise({WHOLE: [start], SETTLED: [start]}, 4)
    assert len(found) >= 2
    for plan in found:
        assert plan.scenario == EVADERS
        paths = np.array(plan.settings.parameters["paths"])[None]
        assert violation(paths, plan.settings.parameters["period"], Limits.of(EVADERS))[0] < 0.011


def test_a_policy_that_plans_no_paths_is_no_start():
    assert loop_of(Plan("defaults", EVADERS, PolicySettings("kuramoto-mpcc"))) is None
    small = lissajous_env.scenario("evaders", **{"curve.half_height": 0.3, "task.contamination": (90, 15)})
    assert loop_of(Plan("defaults", small, PolicySettings("partition"))) is None


def test_without_the_library_the_command_names_the_extra(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "cma", None)
    with pytest.raises(ValueError, match=r"requires the libraries of the extra plan .*lissajous-env\[plan\]"):
        baselines.plan("evaders", optimise=True)
