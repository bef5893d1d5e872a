"""The task of a request, and the families of plans for it: in scale, apart at the start, inside; refusals by name."""

import math
import re

import numpy as np
import pytest
from test_plan import HALL

import baselines
import lissajous_env
from baselines.planning.families import curves_of, families_of, formations, partitions
from baselines.planning.plans import Family, Plan
from baselines.planning.request import Request
from baselines.policies.settings import PolicySettings
from lissajous_env.theory import geometry


def test_a_family_without_a_plan_says_why(capsys):
    # Story: bodies that fill the rectangle: (6) allows less than 1.8 m, by its closed form.
    task = Request(width=6.0, height=6.0, robots=5, robot_radius=1.8, sensor_radius=4.0, speed=1.0).scenario_of(5)
    assert re.search(r"bodies of 1.8 m must be below [\d.]+ m by \(6\)", formations(task).refusal)
    assert curves_of(task) == []
    alone = lissajous_env.scenario("evaders", **{"robot.count": 1, "sensing.radius": 0.2})
    assert formations(alone).refusal == "one robot leaves a gap on every curve that it can follow"


def test_points_have_formations_alone():
    families = families_of(Request(**HALL, robots=5).scenario_of(5))
    assert {family.name for family in families if family.first} == {"defaults", "Lissajous"}
    words = "the robots are of kind curve, not cars as for sweep and laps (give a turning radius)"
    assert words in [family.refusal for family in families]


def test_curves_of_a_formation_leave_room_and_no_gap():
    """Oracle: the distance and the coverage of the undisturbed formation, by measurement."""
    task = Request(**HALL, robots=7, turning_radius=1.0).scenario_of(7)
    curves = curves_of(task)
    assert any(curve.a + curve.b != 7 for curve in curves)
    for curve in curves:
        assert geometry.smallest_distance(curve, 7) > 2 * task.robot.radius
        assert geometry.measured_coverage_radius(curve) < task.sensing_radius


@pytest.mark.parametrize("robots", [2, 3, 4, 6, 9])
def test_every_start_of_a_formation_is_a_scenario_whose_robots_part(robots):
    task = Request(**HALL, robots=robots, turning_radius=1.0).scenario_of(robots)
    family = formations(task)
    for start in family.first:
        scenario = family.plan(start).scenario
        places = np.sort(np.angle(np.exp(1j * scenario.alpha * scenario.equilibrium)))
        gaps = np.diff(np.append(places, places[0] + 2 * np.pi))
        np.testing.assert_allclose(gaps, 2 * np.pi / robots, atol=1e-6)


def test_changed_settings_stay_within_their_space():
    family = Family("any", Plan, [], {"speed": (0.5, 2.0), "lanes": [2, 4], "policy": ["a", "b"]})
    random, seen = np.random.default_rng(0), {"speed": 1.0, "lanes": 2, "policy": "a"}
    assert {type(name) for _ in range(9) for name in family.changed({}, random)} == {str}
    orders = {"inset": 1.0, "cruise": 0.5}, {"cruise": 0.5, "inset": 1.0}
    keys = {Plan("any", lissajous_env.scenario("evaders"), PolicySettings("laps", order)).key for order in orders}
    assert len(keys) == 1
    for _ in range(200):
        after = family.changed(seen, random)
        assert 0.5 <= after["speed"] <= 2.0
        assert after["lanes"] in (2, 4)
        seen = after


@pytest.mark.parametrize("turning", [None, 1.0])
def test_the_task_is_in_scale_with_its_motion(turning):
    """The law of similarity: lengths times 3 and times times 2 give the same task in that scale, but for rounding."""
    one = Request(**HALL, robots=5, turning_radius=turning).scenario_of(5)
    scaled = {"width": 60.0, "height": 36.0, "robot_radius": 0.6, "sensor_radius": 15.0}
    other = Request(**scaled, speed=2.25, rogue_speed=0.3, robots=5, turning_radius=turning and 3.0).scenario_of(5)
    assert other.task.contamination == one.task.contamination
    assert other.formation.phase_rate * 2 == pytest.approx(one.formation.phase_rate)
    longest = 1 / other.robot.drag if turning else math.inf
    assert other.task.step == pytest.approx(min(2 * one.task.step, longest), rel=1e-2)


def test_a_scenario_is_the_task_as_it_is():
    evaders = lissajous_env.scenario("evaders")
    assert Request(evaders).scenario_of(5) == evaders
    assert Request(lissajous_env.scenario(evaders, **{"task.grid": None})).scenario_of(5) == evaders
    changed_ = Request(evaders, sensor_radius=0.7, rogue_speed=0.2).scenario_of(5)
    assert (changed_.sensing_radius, changed_.rogue_speed) == (0.7, 0.2)
    assert changed_.curve == evaders.curve
    seven = Request(evaders, robots=7).scenario_of(7)
    assert (seven.num_robots, seven.curve.half_width, seven.robot.wheelbase) == (7, 1.8, evaders.robot.wheelbase)
    series = lissajous_env.scenario("evaders-walls").resolve()  # with a rounded curve
    assert Request(series, robots=7).scenario_of(7).curve.harmonics == () != series.curve.harmonics
    alone = Request(lissajous_env.scenario(evaders, **{"robot.count": 1}), width=4.0, height=2.0).scenario_of(1)
    assert (alone.num_robots, alone.curve.half_width, alone.curve.a) == (1, 2.0, 3)
    watch = lissajous_env.scenario("watch", **{"task.action": "control"})
    assert Request(watch, rogue_speed=0.2).scenario_of(5).targets.speed_min == 0.2
    grid = Request("intruders", width=30.0, height=20.0).scenario_of(5).task.contamination
    assert grid[0] / grid[1] == pytest.approx(1.5, rel=0.05)  # a benchmark has 108 x 48 for 10.8 m x 4.8 m
    with pytest.warns(UserWarning, match="evaders: plans are made without its extensions top_speed; targets whose law"):
        assert Request(lissajous_env.scenario(evaders, extensions=(top_speed,))).scenario_of(5) == evaders


@lissajous_env.score_column
def top_speed(world):
    return world.robots.speed.max(axis=1)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (HALL | {"speed": None}, "robots, speed [m/s] must be given if no scenario is named"),
        ({"scenario": "evaders", "failures": 5}, "failures must be a whole number from 0 to 4"),
        ({"scenario": "evaders", "plans": 9, "seconds": 5}, "plans must be omitted if seconds is given, got 9"),
        ({"scenario": "evaders", "robot": "tank"}, "robot must be one of curve, car, differential, got 'tank'"),
        ({"scenario": "evaders", "open": "yes"}, "open must be True or False, got 'yes'"),
        ({"scenario": "evaders", "speed": -1.0}, "speed must be from 0.01 to 10000 [m/s], got -1.0"),
        ({"scenario": "evaders", "rogue_speed": math.nan}, "rogue_speed must be from 0 to 100 [m/s], got nan"),
        ({"scenario": "evaders", "robots": "x"}, "robots must be a number or a range such as 3:8"),
        ({"scenario": "evaders", "robots": "3:2"}, "robots must be a number or a range such as 3:8, from 2 to 64"),
        ({"scenario": "evaders", "guarantee": -1.0}, "guarantee must be from 0.001 to 1000000 [s], got -1.0"),
        ({"scenario": "evaders", "acceleration": 0.8}, "acceleration must be omitted unless robots are of kind"),
        ({**HALL, "robots": 5, "robot": "differential", "turning_radius": 1.0}, "turning_radius must be omitted"),
        ({**HALL, "robots": 5, "robot": "car"}, "turning_radius must be given for robots of kind car [m], got None"),
        ({"scenario": "evaders", "clearance": -1.0}, "clearance must be from 0 to 10000 [m], got -1.0"),
        ({"scenario": "intercept"}, "task.action of intercept must be control for a plan: all patrols drive robots by"),
        ({"scenario": lissajous_env.scenario("evaders", rogues="agents")}, "targets.rogues of evaders must be"),
        ({"scenario": "evaders", "entry": "nowhere"}, "entry must be one of inside, boundary, unseen, got 'nowhere'"),
    ],
)
def test_bad_input(asked, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        baselines.plan(**asked)


def test_differential_drives_are_planned_for_with_their_acceleration():
    """Law: all families of cars fit them, and the task has their limits."""
    task = Request(**HALL, robots=5, robot="differential", acceleration=0.8).scenario_of(5)
    assert (task.robot.kind, task.robot.acceleration_max, task.robot.top_speed) == ("differential", 0.8, 1.5)
    assert task.task.boundary == "wall"
    families = families_of(task)
    assert {family.name for family in families if family.first} >= {"partition", "lines", "Lissajous", "loops"}
    loops = families[-1]
    low, high = loops.choices["cruise"]
    assert all(low <= start["cruise"] <= high for start in loops.first)
    small = {"width": 3.5, "height": 1.1, "robot_radius": 0.0566, "sensor_radius": 0.6, "speed": 3.6}
    fast = Request(**small, robots=3, robot="differential", acceleration=51.8).scenario_of(3)
    assert fast.robot.top_yaw_rate * fast.task.step / fast.task.substeps < math.pi


@pytest.mark.parametrize("robots", [4, 6])
def test_four_and_six_robots_begin_apart(robots):
    # Oracle: Lemma 1 gives them shared places in every stable equilibrium; no bodies may overlap at the start.
    task = Request(**HALL, robots=robots, turning_radius=1.0).scenario_of(robots)
    places = lissajous_env.Simulation(task).robots.position.numpy()[0, :, :2]
    first, second = np.triu_indices(robots, 1)
    assert np.linalg.norm(places[first] - places[second], axis=1).min() > 2 * task.robot.radius


def test_the_clearance_reaches_partitions():
    """Oracle: the distances between the loops of every start, which a default partition does not keep."""
    task = Request(**HALL, robots=3, turning_radius=1.0).scenario_of(3)
    plain, apart = (partitions(task, clearance) for clearance in (0.1, 2.0))
    first, second = np.triu_indices(3, 1)
    for family, least in ((plain, 0.2), (apart, 2.0)):
        places = family.plan(family.first[0]).settings.make(task).partition.loop
        gaps = np.linalg.norm(places[first] - places[second], axis=-1) - 2 * task.robot.radius
        assert gaps.min() >= least
    assert "clearance" not in plain.first[0]
    assert apart.first[0]["clearance"] > 2.0  # cars are not exactly on their loops
