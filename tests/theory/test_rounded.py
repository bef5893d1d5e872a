"""The rounded curve within walls: cars can drive along it, apart from each other, and it is that of the scenario."""

import dataclasses

import numpy as np
import pytest

import baselines
import lissajous_env
from lissajous_env.theory import closed_forms, geometry

WALLS = {"task.boundary": "wall"}


def test_cars_can_drive_along_the_rounded_curve_without_a_collision():
    """Oracle: curvature, extents and distances, computed at many phases."""
    scenario = lissajous_env.scenario("evaders", **WALLS)
    curve, gamma = scenario.driven, np.linspace(0, 2 * np.pi, 5000)
    assert geometry.along_lap(curve)[1].min() > 1.05 * 0.481
    places = closed_forms.curve_point(curve, gamma)
    np.testing.assert_allclose(np.abs(places).max(axis=0), (curve.half_width, curve.half_height), rtol=3e-3)
    others = [closed_forms.curve_point(curve, gamma + 2 * np.pi * k / 5) for k in (1, 2)]
    nearest = min(np.linalg.norm(places - other, axis=1).min() for other in others)
    assert 0.38 < geometry.smallest_distance(curve, 5) == pytest.approx(nearest, abs=1e-5)


@pytest.mark.parametrize(("name", "fields", "is_rounded"), [
    ("evaders", {}, False), ("evaders", WALLS, True), ("evaders", WALLS | {"robot.wheelbase": 0.01}, False),
    ("experiment", WALLS, True), ("failure", WALLS, False), ("hall", {}, False), ("team", WALLS, False),
    ("watch", {}, False), ("evaders", WALLS | {"curve.inset": 0.0}, True),
])  # fmt: skip
def test_only_curves_that_bend_too_tightly_within_walls_are_rounded(name, fields, is_rounded):
    scenario = lissajous_env.scenario(name, **fields)
    assert bool(scenario.driven.harmonics) == is_rounded
    assert scenario.resolve().curve.driven == scenario.resolve().driven == scenario.driven
    for bound in ("sensing_radius", "coverage_radius", "detection_radius", "robot_radius_bound"):
        assert getattr(scenario, bound) == getattr(scenario.resolve(), bound) > 0
        assert getattr(scenario.resolve().scaled(0.3), bound) == pytest.approx(0.3 * getattr(scenario, bound))
    if is_rounded:
        plain = dataclasses.replace(scenario.curve, inset=scenario.inset)
        assert scenario.driven == closed_forms.rounded(plain).driven
        assert not scenario.detection_time_is_bounded


def test_the_paper_s_method_keeps_its_guarantee_within_walls():
    """Oracle: the contamination of the simulation, and its collisions; a car that cuts a bend meets another one."""
    scenario = lissajous_env.scenario("evaders-walls", **{"task.duration": 30.0})
    rows = lissajous_env.evaluate(baselines.make("kuramoto-mpcc", scenario, 4), scenario, seeds=range(4))
    assert max(row["guaranteed_detection_time"] for row in rows) < 3.5
    assert sum(row["collisions"] + row["guarantee_open"] for row in rows) == 0
