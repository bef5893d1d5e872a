"""Designs: the paper's own is found, conditions are true, and robots can drive the phase rate, in any units."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lissajous_env
from lissajous_env.settings.parts import Curve
from lissajous_env.theory import closed_forms, geometry
from lissajous_env.theory.design import MOST_TIGHT, best_formation, design, in_words, what_fails, what_would_help


def test_finds_the_experiment_of_the_paper():
    # Oracle: published numbers of curve (16) with N = 5 and the car's turning circle.
    rows = design(1.8, 0.8, 0.125, 1.3, 5.84, num_robots=5, phase_rate=0.3, wheelbase=0.175)
    assert {(row.curve.a, row.curve.b) for row in rows} == {(1, 4), (3, 2)}
    row = next(row for row in rows if row.curve.a == 3)
    assert row.feasible
    assert (row.p, row.alpha, row.clusters) == (2, 1, 1)
    assert row.robot_radius_bound == pytest.approx(0.1503, abs=5e-5)
    assert row.coverage_radius == pytest.approx(1.273, abs=5e-4)
    assert row.detection_radius == pytest.approx(1.1578, abs=5e-5)
    assert row.detection_time_bound == pytest.approx(4.189, abs=5e-4)
    assert row.top_speed == pytest.approx(1.69, abs=5e-3)
    assert row.tight_share == pytest.approx(0.076, abs=5e-4)
    assert row.margin == pytest.approx(1.3 / 1.2728 - 1, abs=1e-4)


def test_every_curve_is_there_once():
    # Oracle: all a odd with gcd(a, N - a) = 1, counted by brute force.
    rows = design(5, 5, 0.1, 1.0, 2.0)
    pairs = [(row.curve.a, row.curve.b) for row in rows]
    largest = max(row.num_robots for row in rows)
    every = [(a, n - a) for n in range(2, largest + 1) for a in range(1, n, 2) if math.gcd(a, n - a) == 1]
    assert sorted(pairs) == sorted(every)
    # One robot more than the largest tried: no curve has room for it.
    assert (
        closed_forms.robot_radius_limit(5, 5, largest + 1) <= 0.1 or largest >= closed_forms.fewest_robots(5, 5, 1.0)[0]
    )


@settings(max_examples=20, deadline=None)
@given(st.floats(0.5, 8), st.floats(0.5, 8), st.floats(0.02, 1), st.floats(0.3, 5))
def test_sorted_by_feasibility_and_margin(half_width, half_height, body, sensor):
    rows = design(half_width, half_height, max(body, half_height / 40), max(sensor, half_width / 8), 1.0)
    feasible = [row.feasible for row in rows]
    assert feasible == sorted(feasible, reverse=True)
    works = [(row.detection_time_bound, -row.margin) for row in rows if row.feasible]
    assert works == sorted(works)
    fails = [row.margin for row in rows if not row.feasible]
    assert fails == sorted(fails, reverse=True)
    for row in rows:
        met = row.avoids_collisions, row.covers, row.detects, row.is_fast_enough, row.can_follow
        assert row.feasible == all(met)
        assert (row.margin >= 0) >= row.feasible
        # (6) and (7) are sufficient: what they promise is measured too.
        if row.feasible and row.num_robots <= 9:
            assert row.robot_radius < geometry.measured_robot_radius(row.curve, row.num_robots)
            assert row.sensor_radius > geometry.measured_coverage_radius(row.curve)
    assert what_fails(rows)
    assert what_would_help(rows)


@pytest.mark.parametrize("wheelbase", [None, 0.3])
def test_overrides_make_the_scenario(wheelbase):
    # Oracle: the scenario derives the same bounds, times and top speed on its own.
    for row in design(1.8, 0.8, 0.05, 1.0, 1.5, wheelbase=wheelbase):
        scenario = lissajous_env.scenario("experiment", **row.overrides)
        assert scenario.num_robots == row.num_robots
        assert scenario.curve == row.curve
        assert scenario.clusters == row.clusters
        assert scenario.detection_radius == row.detection_radius
        assert scenario.coverage_radius == row.coverage_radius
        assert scenario.detection_time_bound == row.detection_time_bound
        assert scenario.sensing.radius == 1.0
        assert scenario.robot.kind == ("curve" if wheelbase is None else "car")
        assert wheelbase in (None, scenario.robot.wheelbase)
        made = scenario.resolve()
        if wheelbase is None:
            fastest = made.alpha * made.robot.phase_rate_max * geometry.largest_speed(row.curve)
        else:
            fastest = made.robot.speed_max
        assert fastest == pytest.approx(1.5)


def test_bounds_that_are_not_tight():
    # Oracle: for 5, 5, 7, 8 bodies of 0.125 m exceed (6), 0.0978 m, but not the measured 0.1533 m.
    rows = design(5, 5, 0.125, 1.5, 2.0, num_robots=15)
    first = next(row for row in rows if row.curve.a == 7)
    assert not first.feasible
    assert geometry.measured_robot_radius(first.curve, 15) > 0.125
    assert what_fails(rows) == "(6), robots must not collide, fails for every one"


def test_what_would_help():
    # Oracle: with 5 robots (8) requires sin(pi / 5) hypot(1.8, 0.8) = 1.158 m.
    words = what_would_help(design(1.8, 0.8, 0.125, 0.2, 1.0))
    assert "With these bodies sensors must reach above 1.158 m (5 robots on a = 1, b = 4)" in words
    assert f"at least {closed_forms.fewest_robots(1.8, 0.8, 0.2)[0]} robots" in words
    assert "Bodies must be below 0.731 m" in what_would_help(design(1.8, 0.8, 3.0, 1.3, 1.0))
    assert "6 robots always share places" in what_would_help(design(1.8, 0.8, 0.125, 1.3, 1.0, num_robots=6))


# How fast.


@pytest.mark.parametrize("grip", [math.inf, 2.0])
def test_the_phase_rate_is_the_largest_that_robots_can_drive(grip):
    # Oracle: speed and lateral acceleration v^2 / radius along each curve, by dense sampling in float64.
    gamma = np.linspace(0, 2 * np.pi, 200_001)
    turning = geometry.turning_radius(0.175, math.pi / 9)
    for row in design(2.4, 1.5, 0.1, 1.3, 3.0, wheelbase=0.175, lateral_acceleration_max=grip):
        speed = row.phase_rate * closed_forms.curve_speed(row.curve, gamma)
        radius = np.maximum(geometry.curvature_radius(row.curve, gamma), turning)
        used = max(speed.max() / 3.0, math.sqrt(np.max(speed**2 / radius) / grip))
        assert used == pytest.approx(0.9, rel=1e-2)
        assert row.top_speed == pytest.approx(speed.max(), rel=1e-6)
        assert row.mean_speed == pytest.approx(speed[:-1].mean(), rel=1e-6)
        assert row.detection_time_bound == pytest.approx(row.lap_time * row.clusters / row.num_robots)


def test_the_hall():
    # Oracle: 13 robots of 1.5 m/s in 40 m x 25 m: T_max = 44.7 s at their very top speed on 3:10, where 0.3 rad/s, of
    # which nothing was said, needs 41.6 m/s.
    rows = design(20, 12.5, 0.5, 6, 1.5, num_robots=13, headroom=0.0)
    hall = next(row for row in rows if row.curve.a == 3)
    assert hall.detection_time_bound == pytest.approx(44.7, abs=0.05)
    assert hall.top_speed == pytest.approx(1.5)
    (asked,) = [row for row in design(20, 12.5, 0.5, 6, 1.5, 13, phase_rate=0.3) if row.curve.a == 3]
    assert not asked.feasible
    assert asked.top_speed == pytest.approx(41.6, abs=0.05)
    words = what_would_help(design(20, 12.5, 0.5, 6, 1.5, 13, phase_rate=0.3))
    assert "robots must reach 41.6 m/s" in words


def test_cars_that_cannot_follow_are_refused_by_the_number():
    # Oracle: the share of the arc below the turning radius, by dense sampling.
    gamma = np.linspace(0, 2 * np.pi, 400_001)
    for wheelbase in (0.1, 0.4):
        turning = geometry.turning_radius(wheelbase, math.pi / 9)
        for row in design(1.8, 0.8, 0.05, 1.3, 1.0, 7, wheelbase=wheelbase):
            speed = closed_forms.curve_speed(row.curve, gamma)
            share = speed[geometry.curvature_radius(row.curve, gamma) < turning].sum() / speed.sum()
            assert row.tight_share == pytest.approx(share, abs=3e-3)
            assert row.can_follow == (row.tight_share <= MOST_TIGHT)


@settings(max_examples=25, deadline=None)
@given(st.floats(1, 8), st.floats(0.5, 2), st.floats(0.1, 10), st.floats(0.1, 10), st.integers(2, 15), st.booleans())
def test_the_same_design_in_other_units(half_width, aspect, length, time, robots, cars):
    # The law of similarity: lengths times L, times times T, all else with them, is the same design.
    given = half_width, half_width / aspect, half_width / 40, half_width / 3
    speed, grip, wheelbase = half_width / 2, half_width, half_width / 30 if cars else None
    rows = design(*given, speed, robots, wheelbase=wheelbase, lateral_acceleration_max=grip)
    scaled = design(
        *(length * each for each in given),
        speed * length / time,
        robots,
        wheelbase=None if wheelbase is None else wheelbase * length,
        lateral_acceleration_max=grip * length / time**2,
    )
    by_curve = {(row.curve.a, row.curve.b): row for row in scaled}
    assert len(by_curve) == len(rows)
    for row in rows:
        other = by_curve[row.curve.a, row.curve.b]
        assert (other.p, other.alpha) == (row.p, row.alpha)
        assert other.phase_rate * time == pytest.approx(row.phase_rate)
        assert other.detection_time_bound == pytest.approx(row.detection_time_bound * time)
        assert other.detection_radius == pytest.approx(row.detection_radius * length)
        assert other.tight_share == pytest.approx(row.tight_share, abs=1e-3) or not cars


@settings(max_examples=25, deadline=None)
@given(st.floats(1, 8), st.floats(0.02, 0.2), st.floats(0.3, 5), st.floats(0.1, 10), st.floats(1, 5))
def test_faster_robots_and_larger_sensors_are_never_worse(half_width, body, sensor, speed, times):
    # The laws of monotony: of the shortest T_max by the speed, and of the fewest robots by the sensor.
    def found(sensor, speed):
        works = [row for row in design(half_width, 2.0, body, max(sensor, half_width / 8), speed) if row.feasible]
        least = min((row.detection_time_bound for row in works), default=math.inf)
        return least, min((row.num_robots for row in works), default=math.inf)

    time, robots = found(sensor, speed)
    assert found(sensor, times * speed)[0] <= time * (1 + 1e-9)
    assert found(times * sensor, speed)[1] <= robots


@given(st.integers(1, 20), st.integers(1, 40))
def test_the_formation_that_recovers_fastest(half, b):
    # Oracle: every stable, unclustered p with the alpha that puts ring neighbours on the ellipse, by brute force.
    a = 2 * half - 1
    if math.gcd(a, b) > 1:
        return
    n, curve = a + b, Curve(1, 1, a, b)
    p, alpha = best_formation(curve, n)
    rates = {
        (q, c): -math.cos(2 * math.pi * q / n) / c
        for q in closed_forms.stable_equilibria(n)
        for c in [closed_forms.default_alpha(curve, n, q)]
        if closed_forms.cluster_size(n, q, c) == 1
    }
    assert closed_forms.ring_lies_on_ellipse(curve, n, p, alpha) or not rates
    if rates:
        assert -math.cos(2 * math.pi * p / n) / alpha == pytest.approx(max(rates.values()))
    else:  # 2, 4 or 6 robots
        assert (p, alpha) == (
            closed_forms.default_p(n),
            closed_forms.default_alpha(curve, n, closed_forms.default_p(n)),
        )


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"half_width": 0}, r"half_width must be positive \[m\], got 0"),
        ({"half_height": -1.0}, r"half_height must be positive \[m\], got -1.0"),
        ({"robot_radius": math.nan}, r"robot_radius must be positive \[m\], got nan"),
        ({"sensor_radius": math.inf}, r"sensor_radius must be positive \[m\], got inf"),
        ({"sensor_radius": "far"}, r"sensor_radius must be positive \[m\], got 'far'"),
        ({"speed_max": 0}, r"speed_max must be positive \[m/s\], got 0"),
        ({"phase_rate": 0}, r"phase_rate must be positive \[rad/s\], got 0"),
        ({"num_robots": 1}, "num_robots must be a whole number from 2 to 1024, got 1"),
        ({"num_robots": 5.0}, "num_robots must be a whole number from 2 to 1024, got 5.0"),
        ({"wheelbase": -0.1}, r"wheelbase must be positive \[m\], got -0.1"),
        ({"steering_max": 2}, r"steering_max must be between 0 and pi / 2, both excluded \[rad\], got 2"),
        ({"lateral_acceleration_max": -1}, r"lateral_acceleration_max must be positive \[m/s\^2\], got -1"),
        ({"headroom": 1}, "headroom must be at least 0 and below 1, got 1"),
    ],
)
def test_bad_input(changed, message):
    good = {"half_width": 1.8, "half_height": 0.8, "robot_radius": 0.125, "sensor_radius": 1.3, "speed_max": 1.0}
    with pytest.raises(ValueError, match=f"^{message}$"):
        design(**{**good, **changed})


def test_a_design_is_named_by_its_robots_and_its_curve():
    (row,) = [row for row in design(1.8, 0.8, 0.125, 1.3, 1.0, num_robots=5) if row.curve.a == 3]
    assert in_words(row) == "5 robots on a = 3, b = 2"


def test_a_design_with_an_inset_is_that_of_the_smaller_rectangle():
    """Law: the driven curve, its speed and (6) are those of the smaller rectangle; (7) and (8) also span the corner."""
    inset, robots = (
        0.7,
        {"robot_radius": 0.2, "sensor_radius": 3.0, "speed_max": 1.0, "num_robots": 5, "wheelbase": 0.5},
    )
    inner = {(each.curve.a, each.curve.b): each for each in design(5.0, 3.0, **robots)}
    outer = design(5.0 + inset, 3.0 + inset, **robots, inset=inset)
    assert len(outer) == len(inner)
    for each in outer:
        one = inner[each.curve.a, each.curve.b]
        assert each.overrides["curve.half_width"] == 5.0 + inset
        same = ("phase_rate", "mean_speed", "tight_share", "robot_radius_bound")
        assert [getattr(each, name) for name in same] == pytest.approx([getattr(one, name) for name in same])
        for name in ("coverage_radius", "detection_radius"):
            assert getattr(each, name) == pytest.approx(getattr(one, name) + math.sqrt(2) * inset)
