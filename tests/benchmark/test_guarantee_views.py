"""Guarantees in every table, page and file: the largest of the episodes, their number and their median."""

import io
import json
import math
import re

from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

import lissajous_env
from baselines.benchmark import tables
from baselines.benchmark.report_page import Report
from baselines.benchmark.shown import SHOWN, lines_of, number
from baselines.benchmark.table import Table
from baselines.benchmark.types import Benchmark, Outcome
from baselines.benchmark.written import latex, markdown, summarized, table_of
from lissajous_env.console.terminal import plain
from lissajous_env.world.columns import COLUMNS, LARGEST, WORST_CASE

EVADERS = {"evaders": lissajous_env.scenario("evaders")}
GUARANTEE = WORST_CASE.name


def rows(policy, episodes):
    """Return score rows of episodes, each a worst case [s] and whether it is open."""
    numbers = dict.fromkeys(COLUMNS, 1.0) | {"collisions": 0, "targets": 1}
    return [
        {"scenario": "evaders", "policy": policy, "episode": seed, "seed": seed}
        | numbers
        | {GUARANTEE: time, "unseen_at_end": time if is_open else 0.5, "guarantee_open": float(is_open)}
        for seed, (time, is_open) in enumerate(episodes)
    ]


def views_of(episodes):
    """Return what each view shows of the worst case of a policy, as one line of text by the name of the view."""
    played = [*rows("ours", episodes), *rows("other", [(45.0, False)] * len(episodes))]
    table = Table.of(played, EVADERS)
    of = table.estimates["evaders"]
    settings_ = Benchmark(("evaders",), ("ours", "other"), episodes=len(episodes))
    outcome = Outcome(settings_, [], played, table, {"device": "cpu"})
    wide = Console(width=400, record=True, file=io.StringIO())
    tables.print_lines(wide, tables.Text("t"), SHOWN, lines_of({"ours": of["ours"]}, SHOWN))
    terminal = re.sub(r"[^\x21-\x7e]+", " ", wide.export_text())
    wide = Console(width=400, record=True, file=io.StringIO())
    tables.print_scores(wide, "ours", "evaders", of["ours"])
    (scores,) = [line for line in wide.export_text().splitlines() if line.split()[:1] == [GUARANTEE]]
    page = Report(table, {}).html(played, {})
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)[1])
    cell = data["scenarios"][0]["policies"][0]["cells"][GUARANTEE]
    summary = json.loads(json.dumps(plain(summarized(outcome, table))))
    return {
        "terminal": terminal,
        "scores": scores,
        "markdown": markdown(table_of(table)).splitlines()[2],
        "latex": next(line for line in latex(table).splitlines() if line.startswith("ours &")),
        "page": f"{cell['words']} {cell['between']}",
        "summary": summary["statistics"]["evaders"]["ours"][GUARANTEE],
    }


@settings(max_examples=20, deadline=None)
@given(
    st.lists(st.tuples(st.floats(2.0, 40.0).map(lambda time: round(time, 1)), st.booleans()), min_size=2, max_size=6)
)
def test_every_view_shows_the_largest_and_the_number_of_episodes(episodes):
    # Law: of any episodes, every view shows the same three numbers.
    views, is_open = views_of(episodes), [flag for _, flag in episodes]
    largest = number(max(time for time, _ in episodes))
    ordered = sorted(math.inf if flag else time for time, flag in episodes)
    middle = (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2
    summary = views.pop("summary")
    assert (summary["summary"], summary["n"], summary["open"]) == (LARGEST, len(episodes), sum(is_open))
    assert number(summary["max"]) == largest
    assert summary["at_least"] == any(is_open)
    scores = views.pop("scores")
    assert f"{LARGEST} " in scores
    assert f"{'> ' if any(is_open) else ''}{largest}" in scores
    for name, words in views.items():
        assert largest in words, name
        assert (f"median {number(middle)}" in words) == math.isfinite(middle), name
        assert (f"{sum(is_open)} of {len(episodes)} open" if any(is_open) else f" of {len(episodes)}") in words, name
        assert ("open" in words) == any(is_open), name
        assert ("> " in words or "$>$ " in words) == any(is_open), name
