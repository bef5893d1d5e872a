"""Numbers of the documentation: each page shows the value in docs/figures.json."""

import re

import pytest

from baselines.commands.reproduce import PARTS
from benchmarks import figures

SPEEDS = {"columns": ["policy", "speed [m/s]"], "rows": [["fast", "2"], ["fastest", "3"], ["slow|er", "1"]]}
OTHERS = {"columns": ["policy", "speed [m/s]"], "rows": [["other", "5"]]}
TIMES = {"columns": ["policy", "time [s]"], "rows": [["fast", "7"]]}
TABLES = {"speeds": SPEEDS, "others": OTHERS, "times": TIMES}


@pytest.mark.parametrize("path", figures.PAGES, ids=lambda path: path.name)
def test_the_page_agrees_with_the_stored_figures(path):
    # Story: somebody types another number between two marks, or computes new ones and forgets the page.
    page = path.read_text(encoding="utf-8")
    assert page == figures.filled(page, {**figures.load(), **figures.computed_tables()})
    opened, closed = page.count("<!-- figures:"), page.count("<!-- end -->")
    assert opened == closed
    # At the beginning of a line a comment ends the paragraph, as CommonMark has it.
    assert not re.findall(r"^<!-- figures: [^>]* / .*", page, re.MULTILINE)


def test_every_part_of_the_paper_stands_on_its_page_once():
    page = (figures.ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    tables = [
        name for names in re.findall(r"^<!-- figures: (.+) -->$", page, re.MULTILINE) for name in names.split(", ")
    ]
    assert sorted(set(tables) - {"experiment"}) == sorted(PARTS), "beside them, the experiment on many seeds"
    assert len(tables) == len(set(tables))


def test_a_typed_number_is_replaced():
    page = "Up to <!-- figures: speeds / slow / speed [m/s] -->17<!-- end --> m/s.\n"
    right = page.replace("17", "1")
    assert figures.filled(page, TABLES) == right
    assert figures.filled(right, TABLES) == right


def test_a_table_is_written_and_tables_are_joined():
    alone = figures.filled("<!-- figures: others -->old<!-- end -->", TABLES)
    assert alone.splitlines()[2:5] == ["| policy | speed [m/s] |", "| --- | --- |", "| other | 5 |"]
    joined = figures.filled("<!-- figures: speeds, others --><!-- end -->", TABLES).splitlines()
    assert joined[2] == "|  | policy | speed [m/s] |"
    assert joined[6:8] == ["| speeds | slow\\|er | 1 |", "| others | other | 5 |"]


@pytest.mark.parametrize(("asked", "said"), [
    ("speed", "got 'speed'"),
    ("speeds / fas / speed [m/s]", "got 2 rows"),
    ("speeds / slow / time [s]", "a column be 'time \\[s\\]'"),
    ("speeds, times", "same columns, got speeds and times"),
])  # fmt: skip
def test_a_mark_that_asks_for_what_is_not_there_is_refused(asked, said):
    with pytest.raises(ValueError, match=said):
        figures.filled(f"<!-- figures: {asked} --><!-- end -->", TABLES)


def test_tables_are_stored_beside_the_others(tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "STORE", tmp_path / "figures.json")
    figures.store({"speeds": SPEEDS, "times": TIMES})
    figures.store({"times": OTHERS})
    assert figures.load() == {"speeds": SPEEDS, "times": OTHERS}
    merged = figures.merged("speeds", SPEEDS | {"rows": [["fastest", "6"], ["new", "4"]]})["rows"]
    assert merged == [["fast", "2"], ["fastest", "6"], ["slow|er", "1"], ["new", "4"]]
    with pytest.raises(ValueError, match="rows of table ragged"):
        figures.store({"ragged": {"columns": ["one"], "rows": [["a", "b"]]}})
    assert "ragged" not in figures.load()
