"""Designs: the paper's own is found, conditions are true, and robots can drive the phase rate, in any units."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lissajous_env
from lissajous_env.settings.parts import Curve, Robot
from lissajous_env.theory import closed_forms, geometry
from lissajous_env.theory.design import best_design, best_formation, largest_phase_rate

TURNING = geometry.turning_radius(0.175, math.pi / 9)
"""Radius of the tightest circle of the paper's cars [m]."""
FORMED = "curve.a", "curve.b", "formation.p", "formation.alpha"


def test_finds_the_experiment_of_the_paper():
    # Oracle: published numbers of curve (16) with N = 5; the other curve, 1 : 4, has (6) for smaller bodies alone.
    best = best_design(1.8, 0.8, 5, Robot(radius=0.125), 1.3, 5.84, TURNING)
    assert [best.overrides[name] for name in FORMED] == [3, 2, 2, 1]
    assert best.violations(0.125, 1.3) == []
    assert best.robot_radius_bound == pytest.approx(0.1503, abs=5e-5)
    assert best.sensor_radius_bound == pytest.approx(1.273, abs=5e-4)
    assert best.tight_share == pytest.approx(0.076, abs=5e-4)


@pytest.mark.parametrize(("changed", "words"), [
    ({"robot": Robot(radius=0.25)}, "bodies of 0.25 m must be below 0.2305 m by (6)"),
    ({"sensor_radius": 0.2}, "sensors of 0.2 m must reach 1.158 m by (7) and (8)"),
    ({"turning_radius": 1.5}, "of the arc is tighter than the cars turn, 10% may be"),
    ({"num_robots": 6}, "bodies of 0.125 m must be below 0 m by (6)"),
])  # fmt: skip
def test_a_condition_that_no_curve_meets_is_named(changed, words):
    # Oracle: with 5 robots (8) requires sin(pi / 5) hypot(1.8, 0.8) = 1.158 m; 6 robots always share places.
    team = {"num_robots": 5, "robot": Robot(radius=0.125), "sensor_radius": 1.3, "speed": 1.0} | changed
    best = best_design(1.8, 0.8, **team)
    assert words in "; ".join(best.violations(team["robot"].radius, team["sensor_radius"]))


@settings(max_examples=20)
@given(st.floats(0.5, 8), st.floats(0.5, 8), st.floats(0.02, 1), st.floats(0.3, 5), st.integers(3, 9))
def test_the_best_design_meets_what_any_does(half_width, half_height, body, sensor, robots):
    """Oracle: (6), (7) and (8) on every curve; they are sufficient, so what they promise is measured too."""
    best = best_design(half_width, half_height, robots, Robot(radius=body), sensor, 1.0)
    curves = [Curve(half_width, half_height, a, robots - a) for a in range(1, robots, 2) if math.gcd(a, robots) == 1]
    feasible = [
        largest_phase_rate(curve, 1.0)
        for curve in curves
        if robots not in (4, 6)
        and body < closed_forms.robot_radius_bound(curve, robots)
        and sensor >= max(closed_forms.coverage_radius(curve), closed_forms.detection_radius(curve, robots))
    ]
    assert (best.violations(body, sensor) == []) == bool(feasible)
    if feasible:
        assert best.phase_rate == max(feasible)
        assert body < geometry.smallest_distance(best.curve, robots) / 2
        assert sensor > geometry.measured_coverage_radius(best.curve)


def test_overrides_make_the_scenario():
    # Oracle: the scenario derives the same bounds on its own.
    best = best_design(1.8, 0.8, 7, Robot(radius=0.05), 1.0, 1.5)
    scenario = lissajous_env.scenario("experiment", **best.overrides, **{"robot.count": None, "faults.schedule": ()})
    assert scenario.num_robots == 7
    assert scenario.curve == best.curve
    assert scenario.clusters == 1
    assert max(scenario.detection_radius, scenario.coverage_radius) == best.sensor_radius_bound


@pytest.mark.parametrize("grip", [math.inf, 2.0])
def test_the_phase_rate_is_the_largest_that_robots_can_drive(grip):
    # Oracle: speed and lateral acceleration v^2 / radius along each curve, by dense sampling in float64.
    gamma = np.linspace(0, 2 * np.pi, 200_001)
    for a, b in ((1, 4), (3, 2), (5, 8)):
        curve = Curve(2.4, 1.5, a, b)
        first, second = closed_forms.curve_derivatives(curve, gamma)
        per_radian = np.linalg.norm(first, axis=1)
        bend = per_radian**3 / np.abs(np.linalg.det(np.stack([first, second], axis=1)))
        speed, radius = largest_phase_rate(curve, 3.0, TURNING, grip) * per_radian, np.maximum(bend, TURNING)
        used = max(speed.max() / 3.0, math.sqrt(np.max(speed**2 / radius) / grip))
        assert used == pytest.approx(0.9, rel=1e-2)


def robot_of(size, length=1.0, time=1.0):
    """A robot whose body and grip are in proportion to a size, in other units, and the radius of its sensor."""
    return Robot(radius=size / 40 * length, lateral_acceleration_max=size * length / time**2), size / 3 * length


@settings(max_examples=25)
@given(st.floats(1, 8), st.floats(0.5, 2), st.floats(0.1, 10), st.floats(0.1, 10), st.integers(2, 15), st.booleans())
def test_the_same_design_in_other_units(half_width, aspect, length, time, robots, cars):
    # The law of similarity: lengths times L, times times T, all else with them, is the same design.
    turning = half_width / 12 if cars else 0.0
    one = best_design(half_width, half_width / aspect, robots, *robot_of(half_width), half_width / 2, turning)
    halves, speed = (half_width * length, half_width / aspect * length), half_width / 2 * length / time
    other = best_design(*halves, robots, *robot_of(half_width, length, time), speed, turning * length)
    if (other.curve.a, other.curve.b) == (one.curve.a, one.curve.b):  # but for two that are equally good
        assert [other.overrides[name] for name in FORMED] == [one.overrides[name] for name in FORMED]
        assert other.phase_rate * time == pytest.approx(one.phase_rate)
    assert other.sensor_radius_bound == pytest.approx(one.sensor_radius_bound * length, rel=1e-6)


@given(st.integers(1, 20), st.integers(1, 40))
def test_the_formation_that_recovers_fastest(half, b):
    # Oracle: every stable, unclustered p with the alpha that puts ring neighbours on the ellipse, by brute force.
    a = 2 * half - 1
    if math.gcd(a, b) > 1:
        return
    n, curve = a + b, Curve(1, 1, a, b)
    p, alpha = best_formation(curve, n)
    pairs = [(q, closed_forms.default_alpha(curve, n, q)) for q in closed_forms.stable_equilibria(n)]
    rates = [-math.cos(2 * math.pi * q / n) / c for q, c in pairs if closed_forms.cluster_size(n, q, c) == 1]
    if rates:
        assert closed_forms.ring_lies_on_ellipse(curve, n, p, alpha)
        assert -math.cos(2 * math.pi * p / n) / alpha == pytest.approx(max(rates))
    else:  # equally spaced
        assert n in (2, 4, 6)
        assert (p, alpha) == (1, 1)
    shared = best_formation(Curve(1, 1, a, b), 3 * a)  # N shares a factor with a: stable, but not on the ellipse
    assert shared == ((closed_forms.default_p(3 * a), 1) if a > 2 else (1, 1)), a


def test_a_design_with_an_inset_is_that_of_the_smaller_rectangle():
    """Law: the driven curve, its speed and (6) are those of the smaller rectangle; (7) and (8) also span the corner."""
    inset, sizes = 0.7, (5, Robot(radius=0.2), 4.0, 1.0, 1.0)
    inner = best_design(5.0, 3.0, *sizes)
    outer = best_design(5.0 + inset, 3.0 + inset, *sizes, inset=inset)
    assert outer.overrides["curve.half_width"] == 5.0 + inset
    assert (outer.curve.a, outer.phase_rate) == (inner.curve.a, pytest.approx(inner.phase_rate))
    assert outer.robot_radius_bound == pytest.approx(inner.robot_radius_bound)
    assert outer.sensor_radius_bound == pytest.approx(inner.sensor_radius_bound + math.sqrt(2) * inset)
