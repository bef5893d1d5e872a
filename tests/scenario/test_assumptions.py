"""Assumptions of the paper: a violated one is reported once with its equation, and included scenarios have none."""

import dataclasses
import math
import warnings

import numpy as np
import pytest
from command_line import called

import baselines
import lissajous_env
from baselines.planning.request import Request
from baselines.policies.settings import PolicySettings
from lissajous_env.parameters import assumptions, named
from lissajous_env.parameters.assumptions import AssumptionWarning, violations
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import as_toml
from lissajous_env.settings.parts import Curve, Formation, Robot
from lissajous_env.settings.task import Sensing
from lissajous_env.theory import closed_forms


@pytest.fixture(autouse=True)
def _nothing_reported(monkeypatch):
    monkeypatch.setattr(assumptions, "_reported", set())
    monkeypatch.setattr(named, "_violated_beside_policies", set())


def warnings_of(make):
    """Texts of the warnings with which something is made."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        make()
    return [str(warning.message) for warning in caught if issubclass(warning.category, AssumptionWarning)]


POINTS = Scenario(curve=Curve(5.0, 5.0, 7, 8), robot=Robot(kind="curve", radius=0.09))


def points(base=POINTS, **parts):
    return dataclasses.replace(base, **{n: dataclasses.replace(getattr(base, n), **part) for n, part in parts.items()})


@pytest.mark.parametrize(
    ("scenario", "words"),
    [
        # Oracle: the numbers by hand; (6) 0.0978 m and (8) 1.470 m for A = B = 5, a = 7, b = 8, N = 15.
        (POINTS, []),
        (points(robot={"count": 12}), ["12 robots on a curve with a + b = 15: the paper's bounds require N = a + b"]),
        (points(robot={"count": 30}, formation={"p": 14}), ["2 of 30 robots share each place on the curve"]),
        (points(formation={"p": 3}), ["p = 3 of 15 robots is not", "3 of 15 robots share", "15 robots on 5 places on"]),
        (points(formation={"p": 0}, robot={"count": 2}), ["p = 0 of 2 robots is", "2 of 2 robots", "2 robots on 1"]),
        (points(formation={"p": 7, "alpha": 1}), ["alpha = 1 and p = 7: ring neighbours are not neighbours on the"]),
        (points(robot={"radius": 0.125}), ["bodies of 0.125 m, bound (6) allows 0.09779 m"]),
        (points(sensing={"radius": 1.2}), ["sensors reach 1.2 m, (8) requires 1.47 m: T_max does not bound"]),
        (points(sensing={"radius": 1.5}), []),
        (
            points(formation={"phase_rate": 0.3, "alpha": 4}, robot={"phase_rate_max": 0.05}),
            ["the formation moves at omega / alpha = 0.075 rad/s, the points reach 0.05 rad/s (robot.phase_rate_max)"],
        ),
    ],
)  # fmt: skip
def test_a_formation_says_what_it_violates(scenario, words):
    sentences = violations(scenario)
    assert len(sentences) == len(words)
    assert all(sentence.startswith(wanted) for sentence, wanted in zip(sentences, words, strict=True))
    assert scenario.detection_time_is_bounded == (not any(w.split()[0] in ("12", "p", "sensors") for w in words))


def test_cars_say_what_they_cannot_do():
    # Oracle: speed, radius and lateral acceleration along the curve by dense sampling.
    robot = Robot(speed_max=1.5, wheelbase=0.175, lateral_acceleration_max=2.0)
    scenario = Scenario(curve=Curve(20.0, 12.5, 3, 10), formation=Formation(phase_rate=0.3), robot=robot)
    fast, tight, grip = violations(scenario)
    gamma = np.linspace(0, 2 * np.pi, 1_000_001)
    first, second = closed_forms.curve_derivatives(scenario.curve, gamma)
    speed = np.linalg.norm(first, axis=1)
    radius = speed**3 / np.abs(np.linalg.det(np.stack([first, second], axis=1)))
    turning = 0.175 / math.tan(math.pi / 9)
    assert f"requires up to {0.3 * speed.max():.3g} m/s, the robots reach 1.5 m/s (robot.speed_max, " in fast
    assert "41.6 m/s" in fast
    assert violations(dataclasses.replace(scenario, robot=Robot(kind="differential", speed_max=1.5)))[0] == fast
    share = speed[radius < turning].sum() / speed.sum()
    assert f"bends at a radius of {radius.min():.2g} m, the cars turn at {turning:.3g} m (robot.wheelbase)" in tight
    assert f"{share:.1%} of the arc is tighter" in tight
    needed = np.max((0.3 * speed) ** 2 / np.maximum(radius, turning))
    assert f"acceleration of {needed:.3g} m/s^2, the cars grip up to 2 m/s^2 " in grip
    slow = violations(lissajous_env.scenario("experiment-printed"))[0]
    jumps = violations(named.build("experiment", **{"robot.offset": 2.9}))[0]
    assert jumps.startswith("above robot.dead_zone, the motor leads to 0.826 m/s at least (robot.offset), the curve")
    assert slow == ("the cars drive at 2.91 m/s at least (robot.throttle_min), the curve requires 0.237 to 1.69 m/s")


def test_what_ships_warns_nobody():
    assert warnings_of(lambda: [lissajous_env.scenario(name) for name in lissajous_env.scenarios()]) == []
    # The paper's cars cut 7.6 % of its arc; whoever changes something else is told nothing of it.
    assert warnings_of(lambda: lissajous_env.scenario("experiment", **{"task.duration": 5.0})) == []
    assert warnings_of(lambda: lissajous_env.parallel_env("intruders", **{"targets.speed": 0.1})) == []
    assert warnings_of(lambda: lissajous_env.Simulation(lissajous_env.scenario("redundant"))) == []
    # Where actions are velocities, no policy drives the formation.
    assert warnings_of(lambda: lissajous_env.scenario("watch", **{"robot.count": 6, "robot.radius": 1.0})) == []


def test_one_of_ones_own_warns_once(tmp_path):
    # Story: seven robots on a curve for five, from each of the doors through which a scenario is made.
    path = tmp_path / "mine.toml"
    path.write_text('base = "failure"\n[robot]\ncount = 7\n[faults]\nschedule = []\n', encoding="utf-8")
    (words,) = warnings_of(lambda: [lissajous_env.scenario(str(path)) for _ in range(3)])
    assert words.startswith("scenario mine: 7 robots on a curve with a + b = 5: the paper's bounds require N = a + b")
    changed = {"robot.radius": 0.2}
    with pytest.warns(AssumptionWarning) as caught:
        lissajous_env.parallel_env("failure", **changed)
    assert caught[0].filename == __file__, "the place is the line of the caller, not one within the package"
    assert str(caught[0].message).startswith("scenario failure: bodies of 0.2 m, bound (6) allows 0.1503 m")
    assert warnings_of(lambda: lissajous_env.vector_env("failure", 2, **changed)) == []
    scenario = Scenario(name="hand", curve=Curve(2.0, 1.0), sensing=Sensing(radius=0.4), robot=Robot(kind="curve"))
    (words,) = warnings_of(lambda: lissajous_env.parallel_env(scenario))
    assert words.startswith("scenario hand: sensors reach 0.4 m, (8) requires ")
    assert warnings_of(lambda: lissajous_env.evaluate(lambda seen: np.ones((*seen.shape[:2], 1)), scenario, [0])) == []


@pytest.fixture
def plan_of_partition(tmp_path):
    """A folder of a plan for four robots, which have no stable formation, and which does not need one."""
    sizes = {"robot_radius": 0.2, "sensor_radius": 3.0, "speed": 1.5, "turning_radius": 0.5}
    task = Request(width=12.0, height=8.0, robots=4, **sizes).scenario_of(4)
    task = named.build(task, **{"task.duration": 10 * task.task.step})
    (tmp_path / "scenario.toml").write_text(as_toml(task), encoding="utf-8")
    (tmp_path / "policy.toml").write_text(PolicySettings("partition").as_toml(), encoding="utf-8")
    return tmp_path


def test_nothing_warns_about_a_formation_that_no_policy_uses(plan_of_partition):
    """Story: a plan of a partition from Python; then the paper's method on its scenario, which does use a formation."""
    path = plan_of_partition / "scenario.toml"
    assert warnings_of(lambda: lissajous_env.evaluate(baselines.make(plan_of_partition, path), path, [0])) == []
    scenario = lissajous_env.scenario(path)
    assert violations(scenario)
    assert warnings_of(lambda: [lissajous_env.parallel_env(scenario), lissajous_env.scenario(path)]) == []
    (words,) = warnings_of(lambda: baselines.make("consensus-mpcc", scenario))
    assert words.startswith("scenario plan: p = 1 of 4 robots is not a stable equilibrium")
    assert warnings_of(lambda: baselines.make("consensus-gvf", scenario)) == []


def test_the_command_scenarios_lists_all(capsys):
    _, printed, _ = called(capsys, "scenarios", "evaders")
    assert "Violated assumptions of the paper:" in printed
    for words in violations(lissajous_env.scenario("evaders")):
        assert f"* {words}" in printed
    assert "Assumptions" not in called(capsys, "scenarios", "ideal")[1]
