"""Parts of the documentation that are made when it is built: pages of scenarios, drawings, docstrings."""

import re

import pytest

import lissajous_env
from docs.generator import scenarios
from lissajous_env import Curve, Robot, Scenario, Sensing, Targets, Task


def rows_below(heading, text):
    """Return the cells of the first table below a heading, without its titles."""
    (table,) = re.findall(rf"\n## {heading}\n.*?\n((?:\|[^\n]*\n)+)", text, re.DOTALL)[:1]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in table.splitlines()[2:]]


def test_the_page_of_a_scenario_has_its_numbers():
    # Oracle: the numbers that this scenario was made of.
    yard = Scenario(
        name="yard",
        curve=Curve(half_width=2.4),
        robot=Robot(count=3),
        sensing=Sensing(radius=0.7, robots_seen=1, targets_seen=2),
        targets=Targets(count=7, arrival_rate=0.25, speed=0.3),
        task=Task(duration=12.0, boundary="wall", on_collision="remove", reward_effort=-0.5, reward_waiting=0.0),
    )
    text = scenarios.page(yard, {}, "*the replay*")
    quantities = {row[0]: row[1] for row in rows_below("Numbers", text)}
    assert quantities["rectangle"] == "4.8 x 1.6 m"
    assert quantities["robots"].startswith("3 cars")
    assert quantities["targets"] == "7 from the start, then 0.25 per second"
    assert quantities["episode"] == "12 s, 120 steps of 0.1 s"
    assert [row[1] for row in rows_below("Observation", text)[-3:]] == [
        "`target_1_present`",
        "`target_1_x`",
        "`target_1_y`",
    ]
    assert len(rows_below("Observation", text)) == 20 + 5 + 6
    assert [row[1] for row in rows_below("Action", text)] == ["steering", "throttle"]
    assert "reward = 1 * detections - 1 * collisions - 0.5 * effort\n" in text
    assert "their agents are terminated" in text
    assert "A wall stops a car's body" in text
    assert "*the replay*" in text
    assert "benchmarks/results.py --scenarios yard --store" in text
    assert "$" not in text


def test_fields_that_differ_are_those_that_were_given():
    # Oracle: the scenario, made again of the names and values in the table alone.
    scenario = lissajous_env.scenario("rough-lost")
    rows = scenarios.differing(scenario)
    overrides = {row[0].strip("`"): row[1] for row in rows}
    numbers = {name: float(value) for name, value in overrides.items() if re.fullmatch(r"-?[\d.e-]+", value)}
    words = {"formation.ring": scenario.formation.ring, "formation.start": overrides["formation.start"]}
    assert set(numbers) | set(words) == set(overrides)
    whole = {name: int(value) if value == int(value) else value for name, value in numbers.items()}
    assert lissajous_env.scenario(Scenario(), **whole, **words).digest() == scenario.digest()
    assert all(row[3] for row in rows), "each has a meaning"


@pytest.mark.parametrize("name", lissajous_env.scenarios())
def test_every_scenario_has_a_page_with_its_results(name):
    stored = scenarios.figures.load()
    assert f"results {name}" in stored, "python benchmarks/results.py --store plays them"
    text = scenarios.page(lissajous_env.scenario(name), stored, "")
    listed = [row[0] for row in rows_below("Results of the policies", text)]
    assert {"`random`", "`still`"} <= set(listed) or set(listed) == {"`kuramoto`", "`open-loop`", "`consensus`"}
    assert len(set(listed)) == len(listed)
