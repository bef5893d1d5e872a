"""Distance from the curve: the exact one, and the table that kernels use."""

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
from lissajous_env.world.robots.distance import DistanceTable, curve_distances, table_of
from lissajous_env.world.robots.distance_table import arc_distance, rough_search
from lissajous_env.world.robots.nearest_point import nearest_arcs


@wp.kernel
def distances(table: DistanceTable, curve: CurveStruct, places: wp.array(dtype=wp.vec2), out: wp.array(dtype=float)):
    k = wp.tid()
    x = Floats()
    y = Floats()
    x[0] = places[k][0]
    y[0] = places[k][1]
    out[k] = curve_distances(table, curve, x, y, 1)[0]


def by_table(scenario, places):
    out = wp.zeros(len(places), dtype=float, device="cpu")
    inputs = [
        table_of(scenario.curve, scenario.robot.kind == "curve", "cpu"),
        curve_struct(scenario.curve, "cpu"),
        wp.array(places, dtype=wp.vec2, device="cpu"),
    ]
    wp.launch(distances, dim=len(places), inputs=inputs, outputs=[out], device="cpu")
    return out.numpy()


def places_around(curve, reach, count=3000):
    half = np.array([curve.half_width, curve.half_height])
    return np.random.default_rng(0).uniform(-reach, reach, (count, 2)) * half


DENSE = lissajous_env.scenario(
    "intruders", **{"curve.a": 7, "curve.b": 8, "curve.half_width": 5, "curve.half_height": 5}
)
BOUNDS = {"experiment": 2.5e-4, "intruders": 7e-4, "dense": 1.2e-3}


@pytest.mark.parametrize("name", BOUNDS)
def test_the_table_is_the_distance_by_brute_force(name):
    # Oracle: the nearest of 300,000 points of a lap.
    scenario = DENSE if name == "dense" else lissajous_env.scenario(name)
    points = curve_tree(scenario.curve, 300_001)
    for reach, worse in ((1.0, 1), (1.5, 2), (4.0, 4)):
        places = places_around(scenario.curve, reach)
        assert by_table(scenario, places) == pytest.approx(points.query(places)[0], abs=worse * BOUNDS[name])
    far = places_around(scenario.curve, 50.0)
    assert by_table(scenario, far) == pytest.approx(points.query(far)[0], rel=1e-3)


ROUGH = [Curve(), Curve(5, 5, 7, 8), Curve(2.3, 1.0, 5, 3), Curve(1.0, 7.5, 1, 2), Curve(20, 12.5, 51, 50)]


@pytest.mark.parametrize("curve", [*ROUGH, Curve(10, 0.5, 7, 1), Curve(60, 1, 7, 4), Curve(1, 1, 1, 1)], ids=str)
def test_the_nearest_point_is_the_nearest(curve):
    # Oracle: the nearest of many points of a lap, which is never nearer than the nearest of all.
    points = curve_tree(curve, 20_000 * (curve.a + curve.b))
    for reach in (1.0, 3.0, 100.0):
        places = places_around(curve, reach, 1001)
        phases, plausible, rough, errors = rough_search(curve, places)
        arcs, found = nearest_arcs(curve, places, phases, plausible)
        assert np.linalg.norm(arcs[:, :2] - places, axis=1) == pytest.approx(found)
        assert (found <= points.query(places)[0] + 2e-4 * curve.half_height).all()
        if curve in ROUGH:
            assert (np.abs(rough - found) <= errors).all()


def test_the_distance_from_an_arc():
    # Oracle: a circle of radius 2 around (1, 0), of which the arc is the rightmost point; and the line x = 3.
    places = np.array([[3.5, 0.0], [1.0, 0.0], [0.0, 0.0], [1.0, 5.0], [3.0, 0.0], [-7.0, 0.0]])
    assert arc_distance(np.array([3.0, 0, 1, 0, 0.5]), places) == pytest.approx([0.5, 2, 1, 3, 0, 6])
    assert arc_distance(np.array([3.0, 0, 1, 0, 0]), places) == pytest.approx([0.5, 2, 3, 2, 0, 10])


@pytest.mark.parametrize(
    "overrides", [{"curve.half_width": 1e4, "curve.half_height": 1e-3}, {"curve.a": 301, "curve.b": 300}]
)
def test_a_curve_too_dense_or_narrow_for_the_table(overrides):
    # Oracle: brute force; the table falls back to points, which are never too near. Points straight above and below the
    # places are the nearest of a curve that is a million times as long as it is high.
    scenario = lissajous_env.scenario("experiment", **overrides, **{"robot.count": 5, "formation.phase_rate": 1e-3})
    curve, places = scenario.curve, places_around(scenario.curve, 1.0, 500)
    if curve.half_width > 1e6 * curve.half_height:
        laps = np.arange(curve.a)[:, None, None] * 2 * np.pi
        phases = (np.array([[1.0], [-1.0]]) * np.arccos(places[:, 0] / curve.half_width) + laps) / curve.a
        exact = np.abs(places[:, 1] - curve.half_height * np.sin(curve.b * phases)).min(axis=(0, 1))
    else:
        exact = curve_tree(curve, 1_000_000).query(places)[0]
    found = by_table(scenario, places)
    assert np.isfinite(found).all()
    assert (found > 0.99 * exact - 0.02 * curve.half_height).all()
    assert (found < exact + 0.05 * curve.half_width).all()


def test_who_goes_around_the_rectangle_is_near_the_curve_and_far_from_its_own_point():
    # Story: `laps` goes around the boundary. Its own phase cannot follow; the curve is near all the same.
    scenario = lissajous_env.scenario("intruders", **{"task.duration": 30.0})
    (row,) = lissajous_env.evaluate(baselines.make("laps", scenario, 1), scenario, seeds=[3])
    assert row["tracking_error_mean"] > 1.0
    assert 0.05 < row["lateral_error_mean"] < 0.25
    assert row["lateral_error_max"] < row["tracking_error_max"]


def test_points_of_the_curve_are_on_it():
    simulation = lissajous_env.Simulation("knot")
    for _ in range(20):
        simulation.step(np.ones(simulation.action_shape))
    (row,) = simulation.score()
    assert row["lateral_error_mean"] == row["lateral_error_max"] == 0
    assert row["tracking_error_max"] < 1e-4


def harmonics(count, decay, size, rng, flat=1.0):
    """Rows of a random closed curve that stays within `size` [m] of the middle."""
    rows = rng.normal(size=(count, 4)) / np.arange(1, count + 1)[:, None] ** decay * [1, 1, flat, flat]
    return tuple(map(tuple, (rows * size / np.abs(rows).sum(axis=0).reshape(2, 2).sum(axis=1).max()).tolist()))


RANDOM = {
    "circle": (1, 1.0, 1.0, 1.0), "flat": (1, 1.0, 1.0, 0.05), "small": (3, 2.0, 1e-3, 1.0),
    "large": (3, 2.0, 0.9, 1.0), "aside": (6, 1.0, 0.02, 1.0), "tangled": (12, 1.0, 0.1, 1.0),
    "fine": (40, 2.0, 0.5, 1.0),
}  # fmt: skip


@pytest.mark.parametrize("half", [1e-3, pytest.param(1e4, marks=pytest.mark.long)])
@pytest.mark.parametrize("case", RANDOM)
def test_the_distance_from_a_curve_of_harmonics_is_that_of_brute_force(case, half):
    # Oracle: the nearest of a hundred thousand points of a lap. A curve may be far smaller than its rectangle.
    count, decay, size, flat = RANDOM[case]
    rng = np.random.default_rng(len(case))
    curve = Curve(half, half, harmonics=harmonics(count, decay, size * half, rng, flat))
    scenario = lissajous_env.scenario("experiment", curve=curve, **{"robot.count": 5, "sensing.radius": 1.0})
    points = curve_point(curve, np.linspace(0, 2 * np.pi, 100_001))
    tree, extent = cKDTree(points), np.ptp(points, axis=0).max() / 2
    beside = points[rng.integers(len(points), size=2000)]
    beside = beside + extent * rng.normal(size=(2000, 2)) * 10 ** rng.uniform(-5, -1, (2000, 1))
    around = points.mean(axis=0) + extent * rng.uniform(-3, 3, (2000, 2))
    anywhere = half * rng.uniform(-1.2, 1.2, (1000, 2))
    for places in (beside, around, anywhere):
        places = places.astype(np.float32)
        exact = tree.query(places.astype(float))[0]
        error = np.abs(by_table(scenario, places) - exact) / np.maximum(exact, extent)
        assert np.median(error) < 2e-5
        assert np.quantile(error, 0.98) < 2e-3
        assert error.max() < 2e-2


def test_a_car_on_a_small_curve_has_no_lateral_error():
    # Story: the rectangle is a hundred times as large as the curve.
    radius = 0.02
    curve = Curve(2.0, 2.0, harmonics=((radius, 0, 0, radius),))
    scenario = lissajous_env.scenario("experiment", curve=curve, **{"robot.count": 5, "sensing.radius": 1.0})
    turn = np.linspace(0, 2 * np.pi, 50)
    for away in (0.0, 1e-4, 0.01, 1.0):
        places = (radius + away) * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        assert by_table(scenario, places) == pytest.approx(away, abs=1e-6)


@pytest.mark.parametrize("rows", [((1.9, 0, 0, 0.5),), ((0.5, 0, 0, 0.9),), ((1.0, 0, 0, 0.5), (1.0, 0, 0, 0.1))])
def test_a_curve_that_leaves_its_rectangle_is_refused_by_name(rows):
    with pytest.raises(
        ValueError, match=r"curve.harmonics must stay in the rectangle, 1.8 m x 0.8 m to each side, got"
    ):
        lissajous_env.scenario("experiment", curve=Curve(harmonics=rows), **{"robot.count": 5, "sensing.radius": 0.6})
