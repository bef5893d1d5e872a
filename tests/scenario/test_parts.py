"""Parts of a scenario: errors for unknown or misplaced fields, and help()."""

import dataclasses
import inspect
import re

import numpy as np
import pytest
from test_scenario import FIELD_NAMES, FIELDS

import lissajous_env
from lissajous_env.parameters.scenario import PARTS, Faults, Robot, Scenario, Task
from lissajous_env.settings.checks import whole


@pytest.mark.parametrize(("start", "end"), [(1.0, 1.04), (0.97, 1.03), (0.0, 0.05)])
def test_a_fault_that_covers_no_step_is_refused(start, end):
    # Oracle: both ends rounded to steps of 0.1 s; it used to vanish without a word.
    with pytest.raises(ValueError, match=r"^faults.schedule must contain faults of at least one step of 0.1 s"):
        Scenario(faults=Faults(schedule=((0, 5.0, 6.0), (1, start, end))))
    finer = Scenario(faults=Faults(schedule=((1, start, end),)), task=Task(step=0.01))
    assert finer.faults.schedule == ((1, start, end),)


def test_a_robot_may_be_written_as_a_float_and_zero_with_a_sign():
    # Oracle: the same with whole numbers and 0.0; floats used to end in a TypeError when the simulation was made.
    whole = {
        "formation.displaced": ((1, 0.2),),
        "robot.drive_factors": ((1, 2.0),),
        "faults.schedule": ((1, 0.0, 1.0),),
        "faults.removed": ((1, 2.0),),
    }
    floats = {name: ((float(robot), *(number or -0.0 for number in row)),) for name, ((robot, *row),) in whole.items()}
    floats = lissajous_env.scenario("failure", **floats)
    assert floats == lissajous_env.scenario("failure", **whole)
    assert floats.digest() == lissajous_env.scenario("failure", **whole).digest()
    assert type(floats.faults.schedule[0][0]) is int
    lissajous_env.Simulation(floats)


@pytest.mark.parametrize(("part", "field"), FIELDS, ids=FIELD_NAMES)
def test_help_says_what_a_field_means_its_unit_and_range(part, field):
    # Oracle: the field's own docstring in the source, and its rule.
    source = re.search(rf'    {field.name}: .*?"""(.*?)"""', inspect.getsource(PARTS[part]), re.DOTALL)
    words = re.sub(r"\s+", " ", PARTS[part].__doc__)
    assert re.sub(r"\s+", " ", source[1].strip()) in words
    assert f"{field.name}: " in words
    assert field.metadata["rule"].removeprefix("must be ") in words
    unit = re.search(r"\[(.*?)\]$", field.metadata["rule"])
    if unit is not None:
        assert f"[{unit[1]}]" in source[1] or (unit[1] == "1/s" and "per second" in source[1])


def test_help_includes_the_fields_of_a_base_class():
    @dataclasses.dataclass(frozen=True)
    class Tall(Robot):
        height: int = whole(3, 1, 9)

    for field in dataclasses.fields(Tall):
        assert f"{field.name}: " in Tall.__doc__
    assert Robot.__doc__.partition("Attributes:")[2] in Tall.__doc__


# The top speed of a car.


def test_a_top_speed_can_be_given():
    # Oracle: (drag speed_max + offset) / drive by hand, 0.1385 for 1.5 m/s; the steady speed of a simulated car.
    scenario = lissajous_env.scenario("experiment", **{"robot.speed_max": 1.5}).resolve()
    assert scenario.robot.throttle_max == (0.945 * 1.5 + 3.681) / 36.81 == pytest.approx(0.1385, abs=1e-4)
    still = {"noise.drive_spread": 0.0, "noise.wheelbase_spread": 0.0, "faults.schedule": ()}
    simulation = lissajous_env.Simulation(lissajous_env.scenario(scenario, **still))
    for _ in range(150):
        simulation.step(np.tile(np.float32([1.0, 1.0]), (1, 5, 1)))
    assert simulation.robots.speed.numpy() == pytest.approx(1.5, abs=1e-4)


def test_overriding_one_limit_derives_the_other():
    for base in ("intruders", lissajous_env.scenario("intruders").resolve()):  # has a throttle of its own
        scenario = lissajous_env.scenario(base, **{"robot.speed_max": 1.5})
        assert scenario.robot.top_speed == 1.5
        assert lissajous_env.scenario(scenario, **{"robot.throttle_max": 0.25}).robot.top_speed == Robot().top_speed
        assert lissajous_env.scenario(scenario, robot={"speed_max": 3.0}).robot.top_speed == 3.0
    # Another motor keeps the speed that was given, and the throttle where that was.
    robot = lissajous_env.scenario("failure", **{"robot.speed_max": 1.5, "robot.drag": 2.0}).robot
    assert (robot.top_speed, robot.full_throttle) == (1.5, (2.0 * 1.5 + 3.681) / 36.81)
    resolved = lissajous_env.scenario("failure").resolve()
    given = lissajous_env.scenario(resolved, **{"robot.drag": 2.0, "robot.throttle_max": 0.25})
    assert lissajous_env.scenario(resolved, **{"robot.drag": 2.0}) == given
    fast = lissajous_env.scenario("failure", **{"formation.phase_rate": 1e3})
    assert fast.resolve().coupling == fast.coupling, "what follows from a field is within its own limits"


def test_two_limits_must_agree():
    resolved = lissajous_env.scenario("failure").resolve().robot
    assert Robot(**dataclasses.asdict(resolved)) == resolved
    with pytest.raises(ValueError, match=r"^robot.speed_max must be 1.49967 m/s for throttle_max = 0.1385, or one of"):
        Robot(speed_max=1.5, throttle_max=0.1385)
    for fields in ({"speed_max": 0.5, "dead_zone": 0.2}, {"speed_max": 1500.0, "drag": 30.0}):
        with pytest.raises(ValueError, match=r"^robot.speed_max must need a throttle above .*, to 1000, not"):
            Robot(**fields)
