"""Distance of robots from the curve: the kernel's, from Newton's steps, against brute force in float64."""

import numpy as np
import pytest
import warp as wp
from reference_motion import curve_tree
from scipy.spatial import cKDTree

import baselines
import lissajous_env
from lissajous_env.device.abreast import Floats
from lissajous_env.device.curve import CurveStruct, curve_struct
from lissajous_env.parameters.scenario import Curve
from lissajous_env.theory.closed_forms import curve_point
from lissajous_env.world.robots.deviations import CurvePoints, curve_distances, points_of


@wp.kernel
def distances(sampled: CurvePoints, curve: CurveStruct, places: wp.array(dtype=wp.vec2), out: wp.array(dtype=float)):
    k = wp.tid()
    x = Floats()
    y = Floats()
    x[0] = places[k][0]
    y[0] = places[k][1]
    out[k] = curve_distances(sampled, curve, x, y, 1)[0]


def by_kernel(curve, places):
    out = wp.zeros(len(places), dtype=float, device="cpu")
    inputs = [points_of(curve, "cpu"), curve_struct(curve, "cpu"), wp.array(places, dtype=wp.vec2, device="cpu")]
    wp.launch(distances, dim=len(places), inputs=inputs, outputs=[out], device="cpu")
    return out.numpy()


BOUNDS = {
    Curve(1.8, 0.8, 3, 2): 2e-3, Curve(20, 12.5, 3, 4): 0.02, Curve(10, 0.5, 7, 1): 0.015, Curve(3, 0.5, 3, 2): 2e-3,
}  # fmt: skip
"""Largest error in the rectangle [m]."""


@pytest.mark.parametrize("curve", BOUNDS, ids=str)
def test_the_distance_is_that_of_brute_force(curve):
    # Oracle: the nearest of 300,000 points of a lap.
    points, half = curve_tree(curve, 300_001), [curve.half_width, curve.half_height]
    for reach, worse in ((1.0, 1), (1.5, 10)):
        places = np.random.default_rng(0).uniform(-reach, reach, (3000, 2)) * half
        error = np.abs(by_kernel(curve, places) - points.query(places)[0])
        assert error.max() < worse * BOUNDS[curve]
        assert np.median(error) < 1e-4 * BOUNDS[curve] + 1e-6


def test_who_goes_around_the_rectangle_is_near_the_curve_and_far_from_its_own_point():
    # Story: `laps` goes around the boundary. Its own phase cannot follow; the curve is near all the same.
    scenario = lissajous_env.scenario("intruders", **{"task.duration": 30.0})
    (row,) = lissajous_env.evaluate(baselines.make("laps", scenario, 1), scenario, seeds=[3])
    assert row["tracking_error_mean"] > 1.0
    assert 0.05 < row["lateral_error_mean"] < 0.25
    assert row["lateral_error_max"] < row["tracking_error_max"]


def harmonics(count, decay, size, rng, flat=1.0):
    """Rows of a random closed curve that stays within `size` [m] of the middle."""
    rows = rng.normal(size=(count, 4)) / np.arange(1, count + 1)[:, None] ** decay * [1, 1, flat, flat]
    return tuple(map(tuple, (rows * size / np.abs(rows).sum(axis=0).reshape(2, 2).sum(axis=1).max()).tolist()))


RANDOM = {
    "flat": (1, 1.0, 1.0, 0.05), "small": (3, 2.0, 1e-3, 1.0), "tangled": (12, 1.0, 0.1, 1.0),
}  # fmt: skip


@pytest.mark.parametrize("case", RANDOM)
def test_the_distance_from_a_curve_of_harmonics_is_that_of_brute_force(case):
    # Oracle: the nearest of a hundred thousand points of a lap. A curve may be far smaller than its rectangle.
    half = 1e-3
    count, decay, size, flat = RANDOM[case]
    rng = np.random.default_rng(len(case))
    curve = Curve(half, half, harmonics=harmonics(count, decay, size * half, rng, flat))
    points = curve_point(curve, np.linspace(0, 2 * np.pi, 100_001))
    tree, extent = cKDTree(points), np.ptp(points, axis=0).max() / 2
    beside = points[rng.integers(len(points), size=2000)]
    beside = beside + extent * rng.normal(size=(2000, 2)) * 10 ** rng.uniform(-5, -1, (2000, 1))
    around = points.mean(axis=0) + extent * rng.uniform(-3, 3, (2000, 2))
    anywhere = half * rng.uniform(-1.2, 1.2, (1000, 2))
    for places in (beside, around, anywhere):
        places = places.astype(np.float32)
        exact = tree.query(places.astype(float))[0]
        error = np.abs(by_kernel(curve, places) - exact) / np.maximum(exact, extent)
        assert np.median(error) < 2e-5
        assert np.quantile(error, 0.98) < 2e-3
        assert error.max() < 2e-2


def test_a_car_on_a_small_curve_has_no_lateral_error():
    # Story: the rectangle is a hundred times as large as the curve.
    radius = 0.02
    curve = Curve(2.0, 2.0, harmonics=((radius, 0, 0, radius),))
    turn = np.linspace(0, 2 * np.pi, 50)
    for away in (0.0, 1e-4, 0.01, 1.0):
        places = (radius + away) * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        assert by_kernel(curve, places) == pytest.approx(away, abs=1e-6)


def test_a_curve_that_leaves_its_rectangle_is_refused_by_name():
    curve = Curve(harmonics=((1.0, 0, 0, 0.5), (1.0, 0, 0, 0.1)))
    with pytest.raises(
        ValueError, match=r"curve.harmonics must stay in the rectangle, 1.8 m x 0.8 m to each side, got"
    ):
        lissajous_env.scenario("experiment", curve=curve, **{"robot.count": 5, "sensing.radius": 0.6})
