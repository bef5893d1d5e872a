"""Parts of the documentation that are made when it is built: pages of scenarios, drawings, docstrings."""

import re
from xml.etree import ElementTree

import pytest

import lissajous_env
from docs.generator import concepts, design, docstrings, files, pictures, scenarios
from lissajous_env import Curve, Robot, Scenario, Sensing, Targets, Task


def rows_below(heading, text):
    """Return the cells of the first table below a heading, without its titles."""
    (table,) = re.findall(rf"\n## {heading}\n.*?\n((?:\|[^\n]*\n)+)", text, re.DOTALL)[:1]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in table.splitlines()[2:]]


def test_the_page_of_a_scenario_has_its_numbers():
    # Oracle: the numbers that this scenario was made of.
    made = Scenario(
        name="yard",
        curve=Curve(half_width=2.4),
        robot=Robot(count=3),
        sensing=Sensing(radius=0.7, robots_seen=1, targets_seen=2),
        targets=Targets(count=7, arrival_rate=0.25, speed=0.3),
        task=Task(duration=12.0, boundary="wall", on_collision="remove", reward_effort=-0.5, reward_waiting=0.0),
    )
    text = scenarios.page(made, {}, "*the replay*")
    told = {row[0]: row[1] for row in rows_below("Numbers", text)}
    assert told["rectangle"] == "4.8 x 1.6 m"
    assert told["robots"].startswith("3 cars")
    assert told["targets"] == "7 from the start, then 0.25 per second"
    assert told["episode"] == "12 s, 120 steps of 0.1 s"
    assert [row[1] for row in rows_below("Observation", text)[-3:]] == [
        "`target_1_present`",
        "`target_1_x`",
        "`target_1_y`",
    ]
    assert len(rows_below("Observation", text)) == 20 + 5 + 6
    assert [row[1] for row in rows_below("Action", text)] == ["steering", "throttle"]
    assert "reward = 1 * detections - 1 * collisions - 0.5 * effort\n" in text
    assert "their agents are terminated" in text
    assert "A wall stops a car's centre" in text
    assert "*the replay*" in text
    assert "benchmarks/results.py --scenarios yard --store" in text
    assert "$" not in text


def test_fields_that_differ_are_those_that_were_given():
    # Oracle: the scenario, made again of the names and values in the table alone.
    given = lissajous_env.scenario("rough-lost")
    rows = scenarios.differing(given)
    overrides = {row[0].strip("`"): row[1] for row in rows}
    numbers = {name: float(value) for name, value in overrides.items() if re.fullmatch(r"-?[\d.e-]+", value)}
    words = {"formation.ring": given.formation.ring, "formation.start": overrides["formation.start"]}
    assert set(numbers) | set(words) == set(overrides)
    whole = {name: int(value) if value == int(value) else value for name, value in numbers.items()}
    assert lissajous_env.scenario(Scenario(), **whole, **words).digest() == given.digest()
    assert all(row[3] for row in rows), "each has a meaning"


@pytest.mark.parametrize("name", lissajous_env.scenarios())
def test_every_scenario_has_a_page_with_its_results(name):
    stored = scenarios.figures.load()
    assert f"results {name}" in stored, "python benchmarks/results.py --store plays them"
    text = scenarios.page(lissajous_env.scenario(name), stored, "")
    listed = [row[0] for row in rows_below("Results of the policies", text)]
    assert {"`random`", "`still`"} <= set(listed) or set(listed) == {"`kuramoto`", "`open-loop`", "`consensus`"}
    assert len(set(listed)) == len(listed)


def test_the_list_links_every_page():
    given = [lissajous_env.scenario(name) for name in lissajous_env.scenarios()]
    text = scenarios.listing(given)
    assert all(f"[`{each.name}`]({each.name}.md)" in text for each in given)
    assert re.search(r"```\{toctree\}\n:hidden:\n\n" + "\n".join(each.name for each in given) + "\n```", text)


def test_the_picture_of_a_scenario_is_a_moment_of_it():
    short = lissajous_env.scenario("failure", **{"task.duration": 1.0})
    png = pictures.picture_of(short)
    assert png[:8] == b"\x89PNG\r\n\x1a\n"
    assert len(png) > 10_000
    assert pictures.picture_of(short) == png, "the same seed, the same picture"


@pytest.mark.parametrize("name", ["curve", "ring", "stages", "folders"])
def test_a_drawing_is_the_same_each_time(name):
    draw = {**concepts.DRAWINGS, **design.DRAWINGS}[name]
    svg = draw()
    assert ElementTree.fromstring(svg).tag.endswith("svg")
    assert draw() == svg


def test_the_folders_are_those_of_the_package_and_import_one_way():
    lines = design.lines_by_folder("lissajous_env")
    assert {"world", "envs", "parameters", "theory"} <= set(lines)
    assert lines["world"] > 1000
    order, imports = design.PACKAGES, design.imports_between()
    assert imports
    assert all(order.index(source) > order.index(target) for source, target in imports)


def test_docstrings_become_restructured_text():
    given = [
        "A policy writes one method:",
        "",
        "    def decide(self):",
        "",
        "Args:",
        "    name: What it is:",
        "        so.",
    ]
    assert docstrings.with_literal_blocks(given) == ["A policy writes one method::", *given[1:]]


def test_an_absolute_value_is_no_substitution():
    assert docstrings.without_substitutions("|x - y|, as `a | b` says") == "\\|x - y\\|, as `a | b` says"


def test_a_file_is_written_only_if_it_has_changed(tmp_path):
    # Story: Sphinx reads only changed files again.
    path = tmp_path / "folder" / "page.md"
    files.write_changed(path, "one")
    path.touch()
    before = path.stat().st_mtime_ns
    files.write_changed(path, "one")
    assert path.stat().st_mtime_ns == before
    files.write_changed(path, "two")
    assert path.read_text() == "two"


def test_cells_cannot_break_a_table():
    assert files.table(["a", "b"], [["x|y", "two\nlines"]]).splitlines() == [
        "| a | b |",
        "| --- | --- |",
        "| x\\|y | two lines |",
    ]
