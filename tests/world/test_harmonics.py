"""Closed curves as Fourier series: they equal the function that they approximate, and robots follow them."""

import numpy as np
import pytest

import baselines
import lissajous_env
from baselines.mpcc import Mpcc
from lissajous_env.theory import closed_forms

LAP = np.linspace(0, 2 * np.pi, 777)
CIRCLE = lissajous_env.Curve(harmonics=((0.7, 0, 0, 0.7),))
LISSAJOUS = ((0, 0, 0, 0), (0, 0, 0, 0.8), (1.8, 0, 0, 0))
"""x = 1.8 cos 3 gamma, y = 0.8 sin 2 gamma."""
GIVEN = {"robot.count": 5, "sensing.radius": 0.6, "formation.p": 1, "formation.alpha": 1}


def bean(gamma):
    return 1.4 * np.cos(gamma), 0.55 * np.sin(gamma) + 0.15 * np.cos(2 * gamma)


def task_on(curve, name="failure", **overrides):
    return lissajous_env.scenario(name, curve=curve, **GIVEN | overrides)


def test_the_series_is_the_function():
    curve = lissajous_env.Curve.through(bean, half_width=1.8, half_height=0.8)
    np.testing.assert_allclose(closed_forms.curve_point(curve, LAP), np.stack(bean(LAP), axis=-1), atol=1e-9)
    assert len(curve.harmonics) == 2


@pytest.mark.parametrize("kind", ["curve", "car"])
def test_the_lissajous_curve_as_harmonics_is_the_lissajous_curve(kind):
    # Oracle: the closed form, stepped with the same actions.
    series = lissajous_env.Curve(half_width=1.8, half_height=0.8, harmonics=LISSAJOUS)
    plain = lissajous_env.Curve(half_width=1.8, half_height=0.8, a=3, b=2)
    rng, rows = np.random.default_rng(0), []
    scenarios = [task_on(curve, "experiment", **{"robot.kind": kind}) for curve in (series, plain)]
    both = [lissajous_env.Simulation(scenario, 3, seed=4) for scenario in scenarios]
    for _ in range(25):
        action = rng.uniform(-0.5, 0.5, both[0].action_shape).astype(np.float32)
        for simulation in both:
            simulation.step(action)
    for name in ("position", "heading", "phase", "measured"):
        one, other = (getattr(simulation.robots, name).numpy() for simulation in both)
        np.testing.assert_allclose(one, other, atol=2e-3, err_msg=name)
    rows = [simulation.score()[0] for simulation in both]
    assert rows[0]["lateral_error_max"] == pytest.approx(rows[1]["lateral_error_max"], abs=5e-3)
    assert np.isnan(rows[0]["spacing_factor"]), "known of Lissajous curves alone"


def test_contouring_control_is_the_same_on_the_same_curve():
    # Oracle: the closed form, from the same states.
    series = lissajous_env.Curve(half_width=1.8, half_height=0.8, harmonics=LISSAJOUS)
    rng, gamma = np.random.default_rng(0), np.linspace(0, 6, 16)
    place, (along, _) = closed_forms.curve_point(series, gamma), closed_forms.curve_derivatives(series, gamma)
    heading, speed = np.arctan2(along[:, 1], along[:, 0]), 0.3 * np.hypot(*along.T)
    state = np.column_stack([place + 0.05 * rng.normal(size=place.shape), heading, speed, gamma])
    one, other = (Mpcc(curve, batch=16).solve(state, np.full(16, 0.3)) for curve in (series, lissajous_env.Curve()))
    np.testing.assert_allclose(one.cost, other.cost, rtol=1e-3)


@pytest.mark.parametrize("name", ["laps", "consensus-gvf", "kuramoto-mpcc"])
def test_policies_of_cars_drive_on_any_curve(name):
    scenario = task_on(lissajous_env.Curve.through(bean), "experiment", **{"task.duration": 3.0})
    row = lissajous_env.evaluate(baselines.make(name, scenario, 2), scenario, seeds=[0, 1])[0]
    assert np.isfinite(row["return_mean"])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: task_on(CIRCLE, **{"robot.count": None}), "robot.count must be given for a curve of harmonics"),
        (lambda: task_on(CIRCLE, **{"sensing.radius": None}), "sensing.radius must be given for a curve of harmonics"),
        (lambda: lissajous_env.Curve(harmonics=((1, 0, 0),)), "curve.harmonics must contain at most 64 rows of four"),
        (lambda: lissajous_env.Curve(harmonics=((0, 0, 0, 0),)), "curve.harmonics must contain a number that is not 0"),
        (lambda: lissajous_env.Curve(harmonics=((1, 0, 0, 1),) * 65), "curve.harmonics must contain at most 64 rows"),
        (lambda: lissajous_env.Curve(harmonics=((1, 0, 0, 1),), half_depth=1.0), "curve.half_depth must be 0 with"),
        (lambda: lissajous_env.Curve.through(lambda gamma: gamma), "position must return finite x and y"),
        (lambda: lissajous_env.Curve.through(lambda x: (x, np.where(x, x, np.inf))), "1 numbers that are not finite"),
        (lambda: lissajous_env.Curve.through(lambda gamma: (gamma, gamma)), "position must be smooth and around the"),
        (lambda: lissajous_env.Curve.through(lambda gamma: (0 * gamma, 0 * gamma)), "harmonics must contain a number"),
        (lambda: lissajous_env.Curve.through(bean, harmonics=65), "harmonics must be a whole number from 1 to 64"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_by_name(make, message):
    with pytest.raises(ValueError, match=message):
        make()
