"""The results table: derived columns, open worst cases, scenarios together, and the views that show it."""

import io
import json
import math
import re

import figures
import numpy as np
import pytest
from benchmarks_in_the_small import rows
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console
from rich.text import Text

import baselines
import lissajous_env
from baselines.benchmark import best_known, shown, types
from baselines.benchmark.report_page import page as report_page
from baselines.benchmark.shown import lines_of
from baselines.benchmark.statistics import MAIN, OVER_LOWER_BOUND, SHOWN, in_words, number, with_numbers
from baselines.benchmark.table import Table, bounds_of, with_derived
from baselines.benchmark.types import Benchmark, BenchmarkOutcome, cells_of
from baselines.benchmark.written import latex, markdown, summarized, table_of
from baselines.policies.base import UnsuitableScenarioError
from lissajous_env.console.terminal import plain
from lissajous_env.episodes.lower_bounds import mean_time_lower_bound
from lissajous_env.world.columns import DETECTION_TIME, LARGEST, OPEN, task_score

SCENARIOS = {name: lissajous_env.scenario(name) for name in ("intruders", "evaders", "team", "redundant")}
INTRUDERS = {"intruders": SCENARIOS["intruders"]}
GUARANTEE = "guaranteed_detection_time"
RATIOS = "score_over_best", "worst_case_over_best"


def worst_cases(policy, times, **more):
    """Rows of episodes, of each the longest time, that at the end, and whether it is open."""
    longest, at_end, is_open = zip(*times, strict=True)
    return rows(policy, **{GUARANTEE: longest, "unseen_at_end": at_end, OPEN.name: map(float, is_open)} | more)


def without_names(text):
    """Return a text without the lines that name omitted columns, and these names."""
    begin = "Columns that do not fit the terminal: "
    named = [line.removeprefix(begin).partition(". ")[0] for line in text.splitlines() if line.startswith(begin)]
    rest = "\n".join(line for line in text.splitlines() if not line.startswith(begin))
    return rest, [name for names in named for name in names.split(", ")]


def printed(table, width=200, scenario="intruders"):
    """Return the text of a table of the scenario, and the columns that do not fit."""
    console = Console(width=width, record=True, file=io.StringIO())
    columns = with_numbers(table.estimates[scenario], SHOWN)
    shown.print_lines(console, Text("t"), columns, lines_of(table.estimates[scenario], columns))
    return without_names(console.export_text())


# Derived columns.


def test_over_the_lower_bound_is_a_mean_and_a_bound_of_nothing_has_no_ratio():
    # Oracle: by hand; the interquartile mean of these would be 2.
    limit = mean_time_lower_bound(INTRUDERS["intruders"])
    estimate = Table.of(rows("a", detection_time_mean=[2.0] * 4 + [12.0]), INTRUDERS).estimates["intruders"]["a"]
    estimate = estimate[OVER_LOWER_BOUND.name]
    assert estimate.value == pytest.approx(4 / limit)
    assert estimate.low < estimate.value < estimate.high
    experiment = lissajous_env.scenario("experiment")
    assert mean_time_lower_bound(experiment) == 0
    assert math.isnan(bounds_of(experiment).mean_time)


def derived(first, second):
    """Derived rows of two policies of a scenario with a lower bound of 0.5 s, the first being the reference."""
    derived_rows = with_derived({"a": [*first], "b": [*second]}, 0.5, DETECTION_TIME, "a")
    return [[[row[name] for name in RATIOS] for row in derived_rows[policy]] for policy in "ab"]


def test_ratios_by_hand():
    # Story: b is faster on seed 0, a on seed 1, where only a's worst case is closed; on seed 2 no policy has a bound.
    first = worst_cases("a", [(4, 1, 0), (6, 1, 0), (9, 9, 1)], detection_time_mean=[3.0, 1.0, 0.0])
    second = worst_cases("b", [(8, 1, 0), (7, 7, 1), (9, 9, 1)], detection_time_mean=[2.0, 4.0, 0.1])
    a, b = derived(first, second)
    assert a[:2] == [[1.5, 1.0], [1.0, 1.0]]
    assert b[:2] == [[1.0, 2.0], [4.0, math.inf]]
    assert np.isnan([a[2], b[2]]).all()  # nothing is a multiple of a best time of zero


def test_a_task_with_another_score_is_ranked_and_compared_by_it():
    # Oracle: by hand; b detects sooner, a has more targets in sight, c none on seed 1. Detections have no lower bound.
    # Nobody has any in sight on seed 2, which has no best policy.
    times = [1.0, 1.0, 1.0]
    sighted = {"a": ([9.0, 9.0, 9.0], [0.4, 0.5, 0.0]), "b": (times, [0.2, 0.5, 0.0]), "c": (times, [0.1, 0.0, 0.0])}
    played = [
        row | {"detection_rate": math.nan, "detected_within_bound": 1.0}
        for policy, (times, shares) in sighted.items()
        for row in rows(policy, "watch", detection_time_mean=times, observed_fraction=shares)
    ]
    table = Table.of(played[3:] + played[:3], {"watch": lissajous_env.scenario("watch")}, against="b")
    estimates = table.estimates["watch"]
    assert list(estimates) == ["a", "b", "c"]
    assert [estimates[policy]["score_improvement"].value for policy in "ac"] == pytest.approx([2 / 3, 1 / 6])
    won = [row["score_improvement"] for row in table.rows]
    assert won == pytest.approx([math.nan] * 3 + [0.0, 0.0, 0.5, 1.0, 0.5, 0.5], nan_ok=True)
    ratios = [2.0, 1.0, math.nan, 4.0, math.inf, math.nan, 1.0, 1.0, math.nan]
    assert [row["score_over_best"] for row in table.rows] == pytest.approx(ratios, nan_ok=True)
    assert table_of(table)["columns"][2:4] == ["observed", "detection [s]"]
    assert "within T_max" not in table_of(table)["columns"], "where actions are velocities"
    assert estimates["a"][OVER_LOWER_BOUND.name].known == 0
    console = Console(width=60, record=True, file=io.StringIO())
    shown.print_scores(console, "a", table.scenarios["watch"], estimates["a"])
    text = console.export_text()
    assert text.index("observed_fraction") < text.index("targets")
    assert "detection_rate" not in text
    scores = [task_score(lissajous_env.scenario(name)).name for name in ("watch", "intercept", "hotspots", "evaders")]
    assert scores == ["observed_fraction", "detection_rate", *["detection_time_mean"] * 2]


def test_the_share_of_seeds_is_over_those_that_both_have():
    played = [*rows("a", detection_time_mean=[1.0, 5.0, 1.0]), *rows("b", first=1, detection_time_mean=[2.0, 2.0, 2.0])]
    table = Table.of(played, INTRUDERS)
    assert table.references == {"intruders": "a"}  # the first, as the paper's method is not played
    estimate = table.estimates["intruders"]["b"]["score_improvement"]
    assert (estimate.n, estimate.known, estimate.value) == (3, 2, 0.5)
    assert table.estimates["intruders"]["a"]["score_improvement"].known == 0
    assert Table.of(played, INTRUDERS, "b").references == {"intruders": "b"}
    assert Table.of(played[:3], INTRUDERS).references == {}
    assert shown.legend(Table.of(played[:4], INTRUDERS))[0].startswith("Interquartile mean over 1 to 3 episodes, ")
    patrolled = [row | {"policy": "lanes"} for row in played[3:]]
    assert Table.of(played[:3] + patrolled, INTRUDERS).references == {"intruders": "lanes"}


def test_an_estimate_names_the_seed_of_its_worst_episode():
    # Story: the largest time, the smallest share, an open episode before a closed one; no order, no worst.
    times, shares = [2.0, 5.0, math.nan], [0.9, 0.2, 0.5]
    more = {"detection_time_mean": times, "sensed_fraction": shares, "contact_time": times, "speed_max": times}
    played = worst_cases("a", [(3, 1, 0), (9, 1, 0), (4, 1, 1)], first=7, **more)
    estimates = Table.of(played, INTRUDERS).estimates["intruders"]["a"]
    names = "detection_time_mean", "sensed_fraction", GUARANTEE, "contact_time", "speed_max"
    assert [estimates[name].worst for name in names] == [8, 8, 9, 8, None]


# Scenarios together.


def test_over_scenarios_each_counts_once_and_those_without_episodes_do_not():
    # Oracle: by hand. Policy b played one scenario of the three alone; points are another kind of robots.
    rng = np.random.default_rng(1)
    times = {name: rng.uniform(1, 4, count) for name, count in (("evaders", 3), ("team", 9))}
    collisions = {"evaders": [1, 2, 3], "team": [0] * 9}
    played = [
        row
        for name, of in times.items()
        for row in rows("a", name, detection_time_mean=of, collisions=collisions[name], guaranteed_detection_time=of)
    ]
    played += rows("b", "evaders", detection_time_mean=[9.0], guaranteed_detection_time=[9.0])
    played += rows("c", "redundant", detection_time_mean=[1.0])
    (cars,) = Table.of(played, SCENARIOS).overall
    assert (cars.kind, cars.scenarios, list(cars.policies)) == ("car", ("evaders", "team"), ["a"])
    assert cars.policies["a"]["collisions"].value == 1.0
    assert (cars.policies["a"]["collisions"].n, cars.policies["a"]["score_over_best"].value) == (2, 1.0)
    assert in_words(cars.policies["a"]["worst_case_over_best"]) == ("1", "median 1, 2 scenarios")
    # More episodes of the same scenarios narrow nothing; worst cases that were growing at the end are lower bounds.
    often = Table.of([row | {"unseen_at_end": row[GUARANTEE]} for row in [*played, *played]], SCENARIOS).overall[0]
    assert in_words(often.policies["a"]["worst_case_over_best"]) == ("> 1", "median 1, 2 scenarios")
    assert often.policies["a"]["collisions"] == cars.policies["a"]["collisions"]
    assert Table.of(played[:3], SCENARIOS).overall == []


# Views.


def views_of(episodes):
    """Return what each view shows of the worst case of a policy, as one line of text by the name of the view."""
    with_ends = [(time, time if is_open else 0.5, is_open) for time, is_open in episodes]
    played = [*worst_cases("ours", with_ends), *worst_cases("other", [(45.0, 0.5, False)] * len(episodes))]
    table = Table.of(played, INTRUDERS)
    estimates = table.estimates["intruders"]
    outcome = BenchmarkOutcome(Benchmark(("intruders",), ("ours", "other")), [], played, table, {"device": "cpu"})
    wide = Console(width=400, record=True, file=io.StringIO())
    shown.print_lines(wide, Text("t"), SHOWN, lines_of({"ours": estimates["ours"]}, SHOWN))
    terminal = re.sub(r"[^\x21-\x7e]+", " ", wide.export_text())
    wide = Console(width=400, record=True, file=io.StringIO())
    shown.print_scores(wide, "ours", SCENARIOS["intruders"], estimates["ours"])
    (scores,) = [line for line in wide.export_text().splitlines() if line.split()[:1] == [GUARANTEE]]
    page = report_page(table, table.rows, {}, {})
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)[1])
    cell = data["scenarios"][0]["policies"][0]["cells"][GUARANTEE]
    summary = json.loads(json.dumps(plain(summarized(outcome))))
    return {
        "terminal": terminal,
        "scores": scores,
        "markdown": markdown(table_of(table)).splitlines()[2],
        "latex": next(line for line in latex(table).splitlines() if line.startswith("ours &")),
        "page": f"{cell['words']} {cell['between']}",
        "summary": summary["statistics"]["intruders"]["ours"][GUARANTEE],
    }


@settings(max_examples=12)
@given(st.lists(st.tuples(st.integers(20, 400).map(lambda time: time / 10), st.booleans()), min_size=2, max_size=6))
def test_every_view_shows_the_largest_and_the_number_of_episodes(episodes):
    # Law: of any episodes, every view shows the same three numbers.
    views, is_open = views_of(episodes), [flag for _, flag in episodes]
    largest = number(max(time for time, _ in episodes))
    ordered = sorted(math.inf if flag else time for time, flag in episodes)
    middle = (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2
    summary = views.pop("summary")
    assert (summary["summary"], summary["n"], summary["open"]) == (LARGEST, len(episodes), sum(is_open))
    assert number(summary["value"]) == largest
    assert summary["at_least"] == any(is_open)
    scores = views.pop("scores")
    assert f"{LARGEST} " in scores
    assert ("no bound" in scores) != math.isfinite(middle)
    assert f"{'> ' if any(is_open) else ''}{largest}" in scores
    for name, words in views.items():
        assert largest in words, name
        assert (f"median {number(middle)}" in words) == math.isfinite(middle), name
        assert (
            f"{sum(is_open)} of {len(episodes)} open" if any(is_open) else f", {len(episodes)} episodes"
        ) in words, name
        assert ("open" in words) == any(is_open), name
        assert ("> " in words or "$>$ " in words) == any(is_open), name


def test_a_lower_bound_is_never_best_and_what_nobody_follows_has_no_column():
    played = worst_cases("a", [(3, 2, 0), (5.7, 5.7, 1), (4, 1, 0), (5, 5, 1)])
    table = Table.of([*played, *worst_cases("b", [(9, 1, 0)] * 4)], INTRUDERS)
    text, _ = printed(table)
    assert text.split()[text.split().index(">") + 1] == "5.70"
    assert "2 of 4 open" in text
    assert "9*" in text.split()
    assert any("a lower bound" in words for words in shown.legend(table))
    nothing = worst_cases("a", [(math.nan, math.nan, math.nan)] * 2)
    assert "guaranteed" not in printed(Table.of(nothing, INTRUDERS))[0]


def test_a_narrow_terminal_keeps_the_most_important_columns():
    order = [column.name for column in SHOWN]
    assert order[:7] == ["detection_time_mean", OVER_LOWER_BOUND.name, GUARANTEE, "collisions", "sensed_fraction",
                         "distance_mean", "score_improvement"]  # fmt: skip
    played = [*rows("a", detection_time_mean=[1.0, 2.0]), *rows("b", detection_time_mean=[1.0, 2.0])]
    _, left_out = printed(Table.of(played, INTRUDERS), width=70)
    assert 0 < len(left_out) < len(order)
    assert left_out == [name for name in order if name in left_out]
    assert set(left_out) == {name for name in order if name in left_out or order.index(name) > order.index(left_out[0])}


@pytest.mark.parametrize("width", [1, 40, 80, 280])
@pytest.mark.parametrize("digits", [1.0, 1234.5])
def test_no_number_and_no_name_is_cut_at_any_width(width, digits):
    rng = np.random.default_rng(1)
    names = "arc-mpcc-safe", "runs/x[/b]"
    played = [row | {c: digits * rng.random() for c in row if type(row[c]) is float} for name in names
              for row in rows(name, detection_time_mean=[1.0] * 4)]  # fmt: skip
    estimates = Table.of(played, INTRUDERS).estimates["intruders"]

    def text_at(columns):
        console = Console(width=columns, record=True, file=io.StringIO())
        shown.print_lines(console, Text("title"), SHOWN, lines_of(estimates, SHOWN))
        shown.print_scores(console, "runs/x[/b]", SCENARIOS["intruders"], estimates["runs/x[/b]"])
        return without_names(console.export_text())

    whole, nothing = text_at(500)
    text, left_out = text_at(width)
    assert nothing == []
    assert bool(left_out) == (width < 280)
    assert {word.strip("\N{BOX DRAWINGS LIGHT HORIZONTAL}") for word in text.split()} <= {"", *whole.split()}
    assert set(names) <= set(text.split())
    if width >= 80:
        assert max(map(len, text.splitlines())) <= width


def test_the_markdown_table_says_what_the_rows_have():
    played = [*rows("kuramoto-mpcc", detection_time_mean=[4.0] * 4), *rows("laps", detection_time_mean=[2.0, 2, 2, 6])]
    table = table_of(Table.of(played, INTRUDERS))
    laps, first = (dict(zip(table["columns"], row, strict=True)) for row in table["rows"])
    assert first["scenario"] == ""
    assert list(first)[:4] == ["scenario", "policy", "detection [s]", "over lower bound"]
    assert (laps["scenario"].partition(",")[0], first["detection [s]"]) == ("`intruders`", "4")
    assert (laps["policy"], laps["detection [s]"]) == ("`laps`", "2 (2\N{EN DASH}6)")
    assert laps["better"].startswith("75 %")
    assert len({line.count("|") for line in markdown(table).splitlines()}) == 1


def test_the_latex_table_escapes_what_latex_would_read_and_marks_the_best():
    played = [*rows("[a]_5%&#{x}~^\\$", detection_time_mean=[2.0, 2.0]), *rows("slow", detection_time_mean=[3.0, 3.0])]
    text = latex(Table.of(played, INTRUDERS))
    assert r"{[}a]\_5\%\&\#\{x\}\textasciitilde{}\textasciicircum{}\textbackslash{}\$ & \textbf{2}" in text
    assert "slow & 3 " in text
    for line in text.splitlines():
        if line.endswith(r"\\"):
            assert line.replace(r"\&", "").count("&") == text.split(r"\begin{tabular}{@{}l")[1].index("@")
    assert text.count(r"\toprule") == text.count(r"\midrule") == text.count(r"\bottomrule") == 1


def policies_of(table):
    """Policies of each scenario in a table in Markdown."""
    policies = {}
    for line in table.splitlines()[2:]:
        where, policy = (cell.strip() for cell in line.split("|")[1:3])
        if where:
            names = policies.setdefault(where.split("`")[1], set())
        names.add(policy)
    return policies


def test_the_command_makes_the_table_of_the_docs():
    # Story: who runs the README's command gets the table of the docs: the same scenarios, policies and columns.
    # Oracle: the page itself; what it does not have of the default comparison, refuses the scenario.
    page = (figures.ROOT / "docs" / "comparison.md").read_text(encoding="utf-8")
    stored = re.search(r"<!-- figures: policies -->\s+(.*?)\s+<!-- end -->", page, re.DOTALL)[1]
    assert stored.splitlines()[0] == f"| scenario | policy | {' | '.join(column.heading for column in MAIN)} |"
    known = {plan.name for plan in best_known.all_known()} & set(types.SCENARIOS)
    assert {name for name, names in policies_of(stored).items() if "*best known*" in names} == known
    cells = cells_of(Benchmark(), scenarios=[types.as_played(name) for name in types.SCENARIOS])
    listed = {(name, policy.strip("`")) for name, of in policies_of(stored).items() for policy in of - {"*best known*"}}
    assert listed <= {(cell.scenario.name, cell.policy) for cell in cells}
    for cell in cells:
        assert cell.scenario.task.contamination is not None  # every one of them has a guarantee
        if (cell.scenario.name, cell.policy) not in listed:
            with pytest.raises(UnsuitableScenarioError):
                cell.factory(cell.scenario, 1, "cpu")
    readme = (figures.ROOT / "README.md").read_text(encoding="utf-8")
    gist = re.search(r"<!-- figures: gist -->\s+(.*?)\s+<!-- end -->", readme, re.DOTALL)[1].splitlines()[2:]
    assert [line.split("|")[1].strip(" `") for line in gist] == list(figures.GIST_POLICIES)
    assert set(types.POLICIES) <= set(baselines.names())
