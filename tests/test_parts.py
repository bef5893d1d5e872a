"""The parts of a scenario: what was taken and vanished, or ended later without a name; and what help() says of them."""

import dataclasses
import inspect
import re

import pytest

import lissajous_env
from lissajous_env.parameters.scenario import PARTS, Faults, Scenario, Targets, Task

FIELDS = [(part, field) for part, kind in PARTS.items() for field in dataclasses.fields(kind)]
FIELD_NAMES = [f"{part}.{field.name}" for part, field in FIELDS]


@pytest.mark.parametrize(("start", "end"), [(1.0, 1.04), (0.97, 1.03), (0.0, 0.05)])
def test_a_fault_that_covers_no_step_is_refused(start, end):
    # Oracle: both ends rounded to steps of 0.1 s; it used to vanish without a word.
    with pytest.raises(ValueError, match=r"^faults.schedule must hold faults that cover a step of 0.1 s at least"):
        Scenario(faults=Faults(schedule=((0, 5.0, 6.0), (1, start, end))))
    finer = Scenario(faults=Faults(schedule=((1, start, end),)), task=Task(step=0.01))
    assert finer.faults.schedule == ((1, start, end),)


def test_a_robot_may_be_written_as_a_float():
    # Oracle: the same with whole numbers; it used to end in a TypeError when the simulation was made.
    names = {"formation.displaced": ((1.0, 0.2),), "faults.schedule": ((1.0, 0, 1),), "faults.removed": ((1.0, 2),)}
    whole = {"formation.displaced": ((1, 0.2),), "faults.schedule": ((1, 0.0, 1.0),), "faults.removed": ((1, 2.0),)}
    floats = lissajous_env.scenario("failure", **names)
    assert floats == lissajous_env.scenario("failure", **whole)
    assert floats.digest() == lissajous_env.scenario("failure", **whole).digest()
    assert type(floats.faults.schedule[0][0]) is int
    lissajous_env.Simulation(floats)


def test_two_million_targets_are_possible():
    scenario = Scenario(targets=Targets(count=2_000_000), task=Task(grid=None))
    assert scenario.target_capacity == 2_000_000


@pytest.mark.parametrize(("part", "field"), FIELDS, ids=FIELD_NAMES)
def test_help_says_what_a_field_means_its_unit_and_range(part, field):
    # Oracle: the field's own docstring in the source, and its rule.
    source = re.search(rf'    {field.name}: .*?"""(.*?)"""', inspect.getsource(PARTS[part]), re.DOTALL)
    words = re.sub(r"\s+", " ", PARTS[part].__doc__)
    assert re.sub(r"\s+", " ", source[1].strip()) in words
    assert f"{field.name}: " in words
    assert field.metadata["rule"].removeprefix("must be ") in words


def test_help_without_source_still_says_the_rules():
    # Story: a class that was made where there is no file, as in an interactive session.
    space = {"__name__": "nowhere"}
    exec(
        "from lissajous_env.parameters.checks import *\nclass Part(Checked):\n    size: float = number(1.0, 0, 2, 'm')",
        space,
    )
    assert "size: (from 0 to 2 [m]; default 1.0)" in space["Part"].__doc__


@pytest.mark.parametrize("name", ["name", "part"])
def test_an_override_called_like_a_parameter(name):
    with pytest.raises(ValueError, match=f"^override must name one of curve, .*, got '{name}'"):
        lissajous_env.scenario("experiment", **{name: "evil"})
