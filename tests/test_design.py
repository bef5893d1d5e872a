"""Designs: the paper's own is found, reasons tell the truth, and the recommendation can be run as printed."""

import dataclasses
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lissajous_env
from lissajous_env.theory import closed_forms, geometry
from lissajous_env.theory.design import design, print_design, recommendation


def test_finds_the_experiment_of_the_paper():
    # Oracle: published numbers of curve (16) with N = 5 and the car's turning circle.
    rows = design(1.8, 0.8, 0.125, 1.3, num_robots=5, wheelbase=0.175)
    assert {(row.curve.a, row.curve.b) for row in rows} == {(1, 4), (3, 2)}
    row = next(row for row in rows if row.curve.a == 3)
    assert row.feasible
    assert row.reason == ""
    assert (row.p, row.alpha, row.clusters) == (2, 1, 1)
    assert row.robot_radius_bound == pytest.approx(0.1503, abs=5e-5)
    assert row.robot_radius_measured == pytest.approx(0.2276, abs=5e-5)
    assert row.coverage_radius == pytest.approx(1.273, abs=5e-4)
    assert row.detection_radius == pytest.approx(1.1578, abs=5e-5)
    assert row.detection_time_bound == pytest.approx(4.189, abs=5e-4)
    assert row.top_speed == pytest.approx(1.69, abs=5e-3)
    assert row.tight_share == pytest.approx(0.076, abs=5e-4)
    assert row.margin == pytest.approx(1.3 / 1.2728 - 1, abs=1e-4)


def test_every_curve_is_there_once():
    # Oracle: all a odd with gcd(a, N - a) = 1, counted by brute force.
    rows = design(5, 5, 0.1, 1.0, phase_rate=0.05)
    pairs = [(row.curve.a, row.curve.b) for row in rows]
    largest = max(row.num_robots for row in rows)
    every = [(a, n - a) for n in range(2, largest + 1) for a in range(1, n, 2) if math.gcd(a, n - a) == 1]
    assert sorted(pairs) == sorted(every)
    # One robot more than the largest tried: no curve has room for it.
    assert (
        closed_forms.robot_radius_limit(5, 5, largest + 1) <= 0.1 or largest >= closed_forms.fewest_robots(5, 5, 1.0)[0]
    )


@settings(max_examples=40, deadline=None)
@given(st.floats(0.5, 8), st.floats(0.5, 8), st.floats(0.02, 1), st.floats(0.3, 5))
def test_sorted_and_reasons_name_what_fails(half_width, half_height, body, sensor):
    rows = design(half_width, half_height, max(body, half_height / 40), max(sensor, half_width / 8))
    feasible = [row.feasible for row in rows]
    assert feasible == sorted(feasible, reverse=True)
    works = [(row.detection_time_bound, -row.margin) for row in rows if row.feasible]
    assert works == sorted(works)
    fails = [row.margin for row in rows if not row.feasible]
    assert fails == sorted(fails, reverse=True)
    for row in rows:
        assert ("(6)" in row.reason or "share" in row.reason) == (not row.avoids_collisions)
        assert ("(7)" in row.reason) == (not row.covers)
        assert ("(8)" in row.reason) == (not row.detects)
        assert row.feasible == (row.reason == "")
        assert (row.margin >= 0) >= row.feasible
        assert not row.feasible or row.num_robots > 9 or row.works_measured
    assert recommendation(rows)


def test_reasons_in_words():
    # Oracle: 0.0978 m of (6) and 0.1533 m measured for 5, 5, 7, 8.
    def row(robot_radius, sensor_radius):
        return next(row for row in design(5, 5, robot_radius, sensor_radius, num_robots=15) if row.curve.a == 7)

    assert row(0.16, 2).reason == "robots of 0.16 m touch: (6) allows 0.09779 m"
    assert row(0.125, 2).reason == "robots of 0.125 m may touch: (6) allows 0.09779 m"
    assert row(0.09, 1.2).reason == "sensing discs part: (8) asks for 1.47 m, sensors reach 1.2 m"
    assert "a lap may leave gaps: (7) asks for 1.113 m, sensors reach 1 m" in row(0.09, 1).reason
    shared = design(5, 5, 0.01, 9, num_robots=6)
    assert all("2 robots share each place" in row.reason and row.robot_radius_measured == 0 for row in shared)


@pytest.mark.parametrize("wheelbase", [None, 0.3])
def test_overrides_make_the_scenario(wheelbase):
    # Oracle: the scenario derives the same bounds and times on its own.
    for row in design(1.8, 0.8, 0.05, 1.0, wheelbase=wheelbase):
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
        default = dataclasses.replace(scenario.formation, p=None, alpha=None)
        assert dataclasses.replace(scenario, formation=default).resolve() == scenario.resolve()


def test_print_recommends_a_call_that_runs(capsys):
    print_design(sensor_radius=1.3, rows=2)
    printed = capsys.readouterr().out
    assert "Take 5 robots on a = 1, b = 4" in printed
    assert "[m]" in printed  # rich would take an unescaped unit for a style
    call = printed[printed.index("lissajous_env.scenario(") :].strip()
    assert eval(call, {"lissajous_env": lissajous_env}).num_robots == 5


def test_print_says_what_fails_and_what_would_help(capsys):
    # Oracle: with 5 robots (8) asks for sin(pi / 5) hypot(1.8, 0.8) = 1.158 m.
    print_design(sensor_radius=0.2)
    printed = capsys.readouterr().out
    assert "No design works" in printed
    assert "sensors must reach above 1.158 m (5 robots on a = 1, b = 4)" in printed
    robots = closed_forms.fewest_robots(1.8, 0.8, 0.2)[0]
    assert f"at least {robots} robots" in printed
    print_design(robot_radius=3.0)
    assert "(6), robots must not touch, fails for every one. Bodies must be below 0.731 m" in capsys.readouterr().out
    print_design(num_robots=6)
    assert "6 robots always share places" in capsys.readouterr().out


def test_bounds_that_are_not_tight():
    # Oracle: for 5, 5, 7, 8 bodies of 0.125 m exceed (6), 0.0978 m, but not the measured 0.1533 m.
    rows = [row for row in design(5, 5, 0.125, 1.5, num_robots=15) if row.curve.a == 7]
    assert not rows[0].feasible
    assert rows[0].works_measured
    assert rows[0].coverage_radius_measured == geometry.measured_coverage_radius(rows[0].curve)
    words = recommendation(rows)
    assert "No design meets all bounds ((6), robots must not touch, fails for every one)" in words
    assert "bodies below 0.153 m and sensors above 1.470 m" in words
    assert "lissajous_env.scenario(" in words


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"half_width": 0}, r"half_width must be positive \[m\], got 0"),
        ({"half_height": -1.0}, r"half_height must be positive \[m\], got -1.0"),
        ({"robot_radius": math.nan}, r"robot_radius must be positive \[m\], got nan"),
        ({"sensor_radius": math.inf}, r"sensor_radius must be positive \[m\], got inf"),
        ({"sensor_radius": "far"}, r"sensor_radius must be positive \[m\], got 'far'"),
        ({"phase_rate": 0}, r"phase_rate must be positive \[rad/s\], got 0"),
        ({"num_robots": 1}, "num_robots must be a whole number from 2 to 1024, got 1"),
        ({"num_robots": 5.0}, "num_robots must be a whole number from 2 to 1024, got 5.0"),
        ({"wheelbase": -0.1}, r"wheelbase must be positive \[m\], got -0.1"),
        ({"steering_max": 2}, r"steering_max must be between 0 and pi / 2, both excluded \[rad\], got 2"),
    ],
)
def test_bad_input(changed, message):
    good = {"half_width": 1.8, "half_height": 0.8, "robot_radius": 0.125, "sensor_radius": 1.3}
    with pytest.raises(ValueError, match=f"^{message}$"):
        design(**{**good, **changed})
    with pytest.raises(ValueError, match=f"^{message}$"):
        print_design(**{**good, **changed})


def test_rows_must_be_positive():
    with pytest.raises(ValueError, match="rows must be a whole number of at least 1, got 0"):
        print_design(rows=0)
