"""The command `lissajous design`: its recommendations are feasible, cover, and match the printed file."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

import baselines
import lissajous_env
from baselines.commands.design import design
from baselines.designing import Played, first_that_works, play, scenario_of
from lissajous_env.console.cli import main
from lissajous_env.console.terminal import Output
from lissajous_env.parameters.scenario_file import as_toml
from lissajous_env.settings.parts import Robot
from lissajous_env.theory import closed_forms
from lissajous_env.theory import design as theory

HALL = {"half_width": 20.0, "half_height": 12.5, "robot_radius": 0.5, "sensor_radius": 6.0, "speed_max": 1.5}
SMALL = {"half_width": 2.4, "half_height": 1.5, "robot_radius": 0.05, "sensor_radius": 1.3, "speed_max": 1.5}


def as_json(capsys, **asked):
    code = design(**asked, output=Output(json=True))
    return code, json.loads(capsys.readouterr().out)


def saved(printed, folder):
    """The file that the printed text tells its reader to save, saved."""
    name = re.search(r"Save the lines that follow as (\S+),", printed)[1]
    text = printed[printed.index('name = "') : printed.index("Watch it:")]
    path = Path(folder) / name
    path.write_text(text, encoding="utf-8")
    return str(path)


@pytest.mark.parametrize("turning_radius", [None, 0.48])
def test_the_hall(turning_radius, tmp_path, capsys):
    """Story: 40 m x 25 m, robots of 1.5 m/s. What is printed is saved and played: nothing is faster, all is detected.

    Oracle: played again from the printed file by the policy that it names, the score is within T_max, the distance
    within a tenth of the formation's, and no robot is faster than its top speed.
    """
    assert design(**HALL, turning_radius=turning_radius, rogue_speed=1.0) == 0
    printed = capsys.readouterr().out
    made = lissajous_env.scenario(saved(printed, tmp_path))
    assert made.num_robots == 13
    assert made.detection_time_bound > 44.7  # at the very top speed on the fastest of these curves
    policy = re.search(r"lissajous run design.toml (\S+)", printed)[1]
    assert policy == ("kuramoto" if turning_radius is None else "kuramoto-mpcc")
    (row,) = lissajous_env.evaluate(baselines.make(policy, made), made, [5])
    gamma = np.linspace(0, 2 * np.pi, 100_000, endpoint=False)
    mean = made.formation.phase_rate * closed_forms.curve_speed(made.curve, gamma).mean()
    assert row["distance_mean"] == pytest.approx(mean * made.task.duration, rel=0.1)
    assert row["speed_max"] <= 1.5 * 1.001
    assert row["collisions"] == 0
    assert row["detected_within_bound"] == 1
    assert row["guaranteed_detection_time"] < made.detection_time_bound
    assert row["sensed_fraction"] == 1


def test_the_printed_file_is_the_one_that_is_written(tmp_path, capsys):
    assert design(**SMALL) == 0
    printed = saved(capsys.readouterr().out, tmp_path)
    written = tmp_path / "mine.toml"
    assert design(**SMALL, out=written) == 0
    assert f"wrote {written}" in capsys.readouterr().out
    assert lissajous_env.scenario(printed).digest() == lissajous_env.scenario(str(written)).digest()
    with pytest.raises(SystemExit) as ended:
        main(["run", str(written), "kuramoto", "--out", str(tmp_path / "design.npz"), "--quiet"])
    assert ended.value.code == 0


def test_a_refusal_names_the_violated_condition(capsys):
    code, given = as_json(capsys, **{**HALL, "phase_rate": 0.3, "num_robots": 13})
    assert (code, given["recommendation"], given["scenario"]) == (1, None, None)
    assert "the top speed fail for every one. At this phase rate robots must reach 41.6 m/s" in given["words"][-1]
    assert (
        "too fast: the curve requires 41.6 m/s, robots reach 1.5 m/s"
        in {each["curve"]["a"]: each["reason"] for each in given["designs"]}[3]
    )
    code, given = as_json(capsys, **{**SMALL, "turning_radius": 2.5, "num_robots": 5})
    assert code == 1
    assert "the turning circle fail for every one" in given["words"][-1]
    assert "of the arc is tighter than the cars' 2.5 m" in given["words"][-1]
    assert all("cars turn at 2.5 m" in each["reason"] for each in given["designs"])


def test_a_design_that_fails_when_it_is_played_is_not_recommended():
    # Story: bodies that (6) allows, on cars that cut the corners by more than there is room for.
    robot = Robot(kind="car", radius=0.125, speed_max=1.5, wheelbase=0.25)
    (candidate,) = [each for each in theory.design(1.8, 0.8, 0.125, 1.3, 1.5, 5, wheelbase=0.25) if each.curve.a == 3]
    assert candidate.feasible
    played, refused = first_that_works([candidate], robot, None, None)
    assert played is None
    # At its own phase rate and at parts of it, each refused for what the episodes show.
    rates = [each.candidate.phase_rate for each in refused]
    assert rates == pytest.approx([candidate.phase_rate * part for part in (1, 0.5, 0.25)])
    for each in refused:
        rows = lissajous_env.evaluate(baselines.make("kuramoto-mpcc", each.scenario, 3), each.scenario, range(3))
        assert each.collisions == sum(row["collisions"] for row in rows) > 0
        assert each.failures[0].startswith(f"{each.collisions} collisions; robots left the curve by up to ")


def test_failures_are_those_of_the_worst_episode():
    # Oracle: rows written by hand.
    (candidate,) = [each for each in theory.design(1.8, 0.8, 0.1, 1.3, 1.5, 5) if each.curve.a == 3]
    scenario = scenario_of(candidate, Robot(kind="curve", radius=0.1), None, 0.2)
    whole, bound = candidate.mean_speed * scenario.task.duration, candidate.detection_time_bound
    good = {"distance_mean": whole, "collisions": 0, "detected_within_bound": 1.0, "lateral_error_max": 0.25}
    good |= {"guaranteed_detection_time": math.nan}
    for changed, words in (
        ({}, []),
        ({"distance_mean": 0.91 * whole}, []),
        ({"distance_mean": 0.4 * whole}, ["robots drove 40% of the formation's distance, 90% is required"]),
        ({"collisions": 2}, ["2 collisions; robots left the curve by up to 0.25 m"]),
        ({"detected_within_bound": 0.75}, ["25.0% of the targets were not detected within T_max"]),
        ({"detected_within_bound": math.nan}, []),
        ({"guaranteed_detection_time": bound + 1}, [f"a target can have stayed undetected for {bound + 1:.3g} s"]),
        ({"guaranteed_detection_time": bound - 1}, []),
    ):
        found = Played(candidate, scenario, "kuramoto", [good, good | changed, good]).failures
        assert len(found) == len(words)
        assert all(each.startswith(wanted) for each, wanted in zip(found, words, strict=True))


def test_similar_halls_get_similar_designs():
    """The law of similarity: with lengths times 10 and times times 5 the played episodes are the same in that scale."""

    def recommended(length, time):
        robot = Robot(kind="curve", radius=0.05 * length)
        sizes = (each * length for each in (2.4, 1.5, 0.05, 1.3))
        candidates = theory.worth_playing(theory.design(*sizes, 1.5 * length / time))
        played, _ = first_that_works(candidates, robot, None, 0.2 * length / time)
        return played

    one, other = recommended(1.0, 1.0), recommended(10.0, 5.0)
    assert (one.candidate.curve.a, one.candidate.curve.b) == (other.candidate.curve.a, other.candidate.curve.b)
    assert other.scenario.task.step == pytest.approx(5 * one.scenario.task.step, rel=1e-2)
    assert other.top_speed == pytest.approx(2 * one.top_speed, rel=1e-2)
    assert other.distance_share == pytest.approx(one.distance_share, rel=1e-2)
    assert other.undetected_time == pytest.approx(5 * one.undetected_time, rel=0.05)


def test_a_scenario_brings_what_is_not_given(tmp_path, capsys):
    # Oracle: the fields of the file, beside those that a design decides on.
    text = """
        [curve]
        half_width = 3.0
        half_height = 2.0
        [robot]
        radius = 0.05
        speed_max = 1.2
        wheelbase = 0.1
        [sensing]
        radius = 1.6
        [noise]
        position = 0.001
        [task]
        step = 0.05
    """
    path = tmp_path / "yard.toml"
    path.write_text(text, encoding="utf-8")
    code, given = as_json(capsys, scenario=str(path), out=tmp_path / "out.toml")
    assert code == 0
    made = lissajous_env.scenario(str(tmp_path / "out.toml"))
    assert made.robot.speed_max == given["recommendation"]["speed_max"] == 1.2
    assert (made.robot.wheelbase, made.robot.radius, made.sensing.radius) == (0.1, 0.05, 1.6)
    assert (made.noise.position, made.task.step) == (0.001, 0.05)
    assert (made.curve.half_width, made.curve.half_height) == (3.0, 2.0)
    assert all(row["speed_max"] <= 1.2 * 1.001 for row in given["episodes"])


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({}, "speed_max must be given, the top speed of the robots [m/s], or a scenario with cars, got None"),
        ({"scenario": "ideal"}, "speed_max must be given, the top speed of the robots [m/s], or a scenario with cars"),
        ({"speed_max": -1.0}, "robot.speed_max must be from 0.001 to 10000 [m/s], got -1.0"),
        ({"speed_max": 1.0, "turning_radius": 0.0}, "turning_radius must be positive [m], got 0.0"),
        (
            {"speed_max": 1.0, "turning_radius": 0.5, "wheelbase": 0.2},
            "turning_radius must be left out beside wheelbase [m], got 0.5",
        ),
        ({"speed_max": 1.0, "half_width": math.nan}, "half_width must be positive [m], got nan"),
        ({"speed_max": 1.0, "rogue_speed": -1.0}, "rogue_speed must be from 0 to 100 [m/s], got -1.0"),
        ({"speed_max": 1.0, "rows": 0}, "rows must be a whole number of at least 1, got 0"),
        ({"speed_max": 1.0, "out": Path("x.json")}, "out must end in .toml, got x.json"),
    ],
)
def test_bad_input(asked, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        design(**asked)


def test_robots_of_a_kind_that_no_method_drives_are_not_played():
    (candidate, *_) = theory.design(*SMALL.values())
    scenario = scenario_of(candidate, Robot(kind="curve", radius=0.05), None, None)
    other = lissajous_env.scenario(scenario)
    object.__setattr__(other.robot, "kind", "boat")
    assert play(candidate, other) is None


@pytest.mark.parametrize("name", lissajous_env.scenarios())
def test_a_scenario_can_be_written_as_a_file(name, tmp_path):
    # Oracle: read again, it is the same.
    made = lissajous_env.scenario(name)
    path = tmp_path / f"{name}.toml"
    path.write_text(as_toml(made), encoding="utf-8")
    assert lissajous_env.scenario(str(path)) == made


def test_what_no_file_can_hold_is_refused():
    with pytest.raises(ValueError, match=r"^task.grid must not be None for a scenario's file"):
        as_toml(lissajous_env.scenario("failure", **{"task.grid": None}))
