"""The table of score columns is the only source of their names, titles and rules."""

import re
from pathlib import Path

import pytest

from lissajous_env.world.columns import COLUMNS, FINITE, MEANINGS, Column

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [
    path.read_text(encoding="utf-8")
    for package in ("lissajous_env", "baselines", "training")
    for path in (ROOT / package).rglob("*")
    if path.suffix in (".py", ".js", ".html") and "vendor" not in path.parts
]
ALSO_OTHERS = ("targets", "collisions", "min_separation", "phase_error", "speed_max")
"""Columns with the name of a part or field of a scenario or of the state: only entries of a row are counted."""


def test_a_column_is_named_in_three_files_at_most():
    # Story: who renames a column edits its entry, and perhaps its kernel; pages and tables follow.
    for name in COLUMNS:
        pattern = rf"""\[["']{name}["']\]""" if name in ALSO_OTHERS else rf"\b{name}\b"
        assert sum(name in text and bool(re.search(pattern, text)) for text in SOURCES) <= 3, name


def test_a_column_has_a_rule_a_meaning_and_an_order_of_its_own():
    orders = [column.order for column in COLUMNS.values() if column.order]
    assert len(set(orders)) == len(orders)
    assert all(COLUMNS[name].value is not None and meaning for name, meaning in MEANINGS.items() if name in COLUMNS)
    assert COLUMNS["recovery_time"].refusal(None) is None, "a missing number, which has a reason"
    assert COLUMNS["recovery_time"].refusal(0) is None


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        (COLUMNS["collisions"], 1.0, "a whole number of at least 0"),
        (COLUMNS["recovery_time"], -1.0, r"a number of at least 0 \[s\] or null \(never, never disturbed, or actions"),
        (COLUMNS["guarantee_open"], True, "0 or 1 or null"),
        (COLUMNS["distance_mean"], None, r"a number of at least 0 \[m\]$"),
        (Column("mine", "of a user", rule=FINITE), float("nan"), "a finite number"),
    ],
)
def test_a_value_that_breaks_the_rule_of_its_column_is_refused(column, value, words):
    assert re.search(f"must be {words}", column.refusal(value))
