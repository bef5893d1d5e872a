"""Radii, distances and shapes of the curve and its formation, closed and measured, against tables and brute force."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lissajous_env.parameters.scenario import Curve
from lissajous_env.theory import closed_forms, geometry

CURVE_16 = Curve(1.8, 0.8, 3, 2)


def formation(curve, num_robots, shift: float | np.ndarray = 0.0):
    """Positions (..., N, 3) of robots spread evenly along (10), by the phase of the first."""
    gamma = 2 * np.pi * np.arange(num_robots) / num_robots + np.asarray(shift)[..., None]
    return closed_forms.curve_point_3d(curve, gamma)


@st.composite
def curves(draw, largest=9):
    a = draw(st.integers(0, largest // 2)) * 2 + 1
    b = draw(st.integers(1, largest).filter(lambda b: math.gcd(a, b) == 1))
    extent = st.floats(0.1, 50.0)
    return Curve(draw(extent), draw(extent), a, b)


# (6): bodies, and (7). Oracle: table computed independently of this project, and brute force over a lap.


@pytest.mark.parametrize(
    ("curve", "body", "measured", "sensor", "covering"),
    [
        (CURVE_16, 0.1503, 0.2276, 1.273, 0.3748),
        (Curve(5, 5, 7, 3), 0.2029, 0.3170, 2.500, 1.0259),
        (Curve(5, 5, 7, 8), 0.0978, 0.1533, 1.113, 0.7293),
        (Curve(5, 3, 3, 4), 0.3388, 0.5257, 1.913, 1.1740),
    ],
)
def test_table_of_radii(curve, body, measured, sensor, covering):
    n = curve.a + curve.b
    assert closed_forms.robot_radius_bound(curve, n) == pytest.approx(body, abs=5e-5)
    assert geometry.smallest_distance(curve, n) / 2 == pytest.approx(measured, abs=5e-5)
    # Oracle of (7): a grid of 1001 x 1001 points around the farthest place. Coarser grids miss it by up to 1 %.
    assert closed_forms.coverage_radius(curve) == pytest.approx(sensor, abs=5e-4)
    assert geometry.measured_coverage_radius(curve) == pytest.approx(covering, abs=1e-3)
    assert geometry.measured_coverage_radius(curve, precision=1e-5) == pytest.approx(covering, abs=1e-4)


@settings(max_examples=40)
@given(curves())
def test_bound_6_holds(curve):
    n = curve.a + curve.b
    bound, measured = closed_forms.robot_radius_bound(curve, n), geometry.smallest_distance(curve, n) / 2
    assert bound < measured * (1 + 1e-12)
    assert measured <= math.pi / 2 * bound * (1 + 1e-12)


@pytest.mark.parametrize(("curve", "num_robots"), [(CURVE_16, 5), (CURVE_16, 7), (Curve(5, 4, 3, 2, 2, 4), 5)])
def test_smallest_distance_against_brute_force(curve, num_robots):
    positions = formation(curve, num_robots, shift=np.linspace(0, 2 * np.pi, 20_000))
    distances = np.linalg.norm(positions[:, :, None] - positions[:, None, :], axis=-1)
    brute = distances[:, ~np.eye(num_robots, dtype=bool)].min()
    # Sampling finds a minimum with an error of second order, from above.
    smallest = geometry.smallest_distance(curve, num_robots)
    assert brute * (1 - 1e-4) < smallest <= brute + 1e-12
    assert geometry.smallest_distance(curve, num_robots, least=0.9 * brute) == smallest
    assert geometry.smallest_distance(curve, num_robots, least=2 * brute) < 2 * brute


# (7) and (8): sensors.


@settings(max_examples=30)
@given(curves())
def test_coverage_bound_7_holds(curve):
    assert geometry.measured_coverage_radius(curve) <= closed_forms.coverage_radius(curve) * (1 + 1e-9)


def test_detection_radius_is_tight_for_an_odd_number_of_robots():
    # Oracle: published 1.1578; 2.162 against 2.185 for an even number.
    assert closed_forms.detection_radius(CURVE_16, 5) == pytest.approx(1.1578, abs=5e-5)
    assert geometry.largest_neighbour_distance(CURVE_16, 5, p=2) / 2 == pytest.approx(1.1578, abs=5e-5)
    even = Curve(5, 5, 7, 3)
    assert closed_forms.detection_radius(even, 10) == pytest.approx(2.185, abs=5e-4)
    assert geometry.largest_neighbour_distance(even, 10, p=3) / 2 == pytest.approx(2.162, abs=5e-4)


@settings(max_examples=60)
@given(curves())
def test_detection_bound_8_is_what_neighbours_on_the_ellipse_reach(curve):
    n = curve.a + curve.b
    p = closed_forms.default_p(n)
    if closed_forms.cluster_size(n, p) > 1:
        return
    largest = geometry.largest_neighbour_distance(curve, n, p, closed_forms.default_alpha(curve, n, p)) / 2
    bound = closed_forms.detection_radius(curve, n)
    assert largest == pytest.approx(bound, rel=1e-9) if n % 2 else largest <= bound


def test_ring_that_is_not_on_the_ellipse_breaks_8():
    # Oracle: N = 15, p = 7, a = 7 at alpha = 1: a p = 4 (mod 15), ring neighbours are fourth neighbours on the ellipse.
    curve = Curve(5, 5, 7, 8)
    reach = 2 * closed_forms.detection_radius(curve, 15)
    assert geometry.largest_neighbour_distance(curve, 15, p=7, alpha=1) > reach * 3
    assert geometry.largest_neighbour_distance(curve, 15, p=7, alpha=4) == pytest.approx(reach)


def test_detection_time_bound():
    # Oracle: the paper's 8.38 s of Fig. 3, and 4.189 s for the experiment.
    assert closed_forms.detection_time_bound(0.05, 15) == pytest.approx(8.378, abs=5e-4)
    assert closed_forms.detection_time_bound(0.3, 5) == pytest.approx(4.189, abs=5e-4)
    assert closed_forms.detection_time_bound(0.3, 6, clusters=2) == pytest.approx(2 * math.pi / 0.3 / 3)


@settings(max_examples=60)
@given(st.floats(0.5, 20), st.floats(0.5, 20), st.floats(0.2, 30))
def test_fewest_robots_is_where_7_and_8_begin_to_hold(half_width, half_height, sensor):
    n, a, b = closed_forms.fewest_robots(half_width, half_height, sensor)
    enough = sensor * (1 + 1e-6)
    assert a % 2 == 1
    assert half_height * math.sin(math.pi / (2 * a)) <= enough
    assert half_width * math.sin(math.pi / (2 * b)) <= enough
    assert math.sin(math.pi / n) * math.hypot(half_width, half_height) <= enough
    assert a == 1 or half_height * math.sin(math.pi / (2 * (a - 2))) > sensor * (1 - 1e-6)
    assert b == 1 or half_width * math.sin(math.pi / (2 * (b - 1))) > sensor * (1 - 1e-6)
    fewest = max(a + b, math.pi / math.asin(min(sensor / math.hypot(half_width, half_height), 1)))
    assert any(math.gcd(odd, n) == 1 for odd in range(a, n, 2) if n - odd >= b), "there is a curve"
    assert all(math.gcd(odd, few) > 1 for few in range(math.ceil(fewest - 1e-6), n) for odd in range(a, few - b + 1, 2))


# The curve. Oracle: numbers computed independently, finite differences.


def test_curve_16_length_curvature_and_speed():
    assert geometry.curve_length(CURVE_16) == pytest.approx(23.17, abs=5e-3)
    points = closed_forms.curve_point(CURVE_16, np.linspace(0, 2 * np.pi, 100_001))
    assert geometry.curve_length(CURVE_16) == pytest.approx(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    assert geometry.along_lap(CURVE_16)[1].min() == pytest.approx(0.038, abs=5e-4)
    limit = geometry.turning_radius(0.175, math.pi / 9)
    assert limit == pytest.approx(0.481, abs=5e-4)
    assert geometry.tight_share(CURVE_16, limit) == pytest.approx(0.076, abs=5e-4)
    speed = 0.3 * closed_forms.curve_speed(CURVE_16, np.linspace(0, 2 * np.pi, 100_001))
    assert speed.min() == pytest.approx(0.24, abs=5e-3)
    assert speed.max() == pytest.approx(1.69, abs=5e-3)
    assert 0.3 * geometry.largest_speed(CURVE_16) == pytest.approx(speed.max(), rel=1e-8)
    assert geometry.top_speed(CURVE_16, 0.3) == pytest.approx(speed.max(), rel=1e-5)
    assert speed.mean() == pytest.approx(1.11, abs=5e-3)


# (10): three dimensions.


def test_depth_only_adds_room():
    # Fig. 5: at C = 0 the largest radius is the planar one, and it never falls below.
    radii = [geometry.smallest_distance(Curve(5, 5, 7, 3, depth, 4), 10) / 2 for depth in (0, 1e-9, 1, 2, 4)]
    assert radii[0] == pytest.approx(0.3170, abs=5e-5)
    assert radii[1] == pytest.approx(radii[0])
    assert radii == sorted(radii)


# (4), (5): the ellipse.


@settings(max_examples=60)
@given(curves(), st.floats(0, 2 * np.pi))
def test_formation_lies_on_the_ellipse(curve, shift):
    n = curve.a + curve.b
    positions = formation(curve, n, shift)[..., :2]
    assert closed_forms.ellipse_residual(curve, positions, shift) == pytest.approx(0, abs=1e-9)
    # Left of (5) is a quadratic form: 1.1 times as far out it is 1.21 times as large.
    off = 0.21 * math.cos(n * shift) ** 2
    assert closed_forms.ellipse_residual(curve, positions * 1.1, shift) == pytest.approx(off, abs=1e-9)
    # Any robot of the formation names the same ellipse.
    assert closed_forms.ellipse_residual(curve, positions, shift + 2 * np.pi / n) == pytest.approx(0, abs=1e-9)
