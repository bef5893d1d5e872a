"""The page of a benchmark, `report.html`: all scenarios together, then the failures, each scenario and all episodes."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from baselines.benchmark.plot_styles import COLOURS, styles_of
from baselines.benchmark.statistics import (
    DERIVED,
    MAIN,
    OVERALL,
    SHOWN,
    Estimate,
    added_columns,
    best_of,
    columns_of,
    in_words,
    with_numbers,
)
from baselines.benchmark.table import Bounds, Overall, Row, Rows, Table, grouped, numbers
from baselines.benchmark.types import Failure
from baselines.policies.registry import split_suffix
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.replay import contents
from lissajous_env.replay.page import as_json, html_page
from lissajous_env.wording import counted
from lissajous_env.world.columns import (
    COLLISIONS,
    COLUMNS,
    COVERAGE,
    DETECTED,
    DETECTION_TIME,
    OPEN,
    SENSED,
    SEPARATION,
    WHOLE,
    WORST_CASE,
    Column,
    task_score,
)

FORMAT = "lissajous report 3"
"""Format of the page's data, which `report.js` requires."""
MOST_EPISODES = 20_000
"""Largest number of episodes that are listed, the worst first."""
_ROBOTS = {
    "car": "cars",
    "curve": "points on the curve",
    "differential": "differential drives",
    "velocity": "cars by their velocities",
}
"""Names of the robots by `robot.kind` or, of several scenarios together, by `Scenario.actuation`."""
_DIGITS = 5
"""Significant digits of the numbers in the page."""
_EPISODES = "the episodes"
"""Placeholder of the episodes in the page of a replay, which the report shows in a frame."""

Key = tuple[str, str, int]
"""Scenario, policy and seed of an episode."""


class FailureMode(NamedTuple):
    """A way in which an episode can fail."""

    name: str
    words: str
    """Predicate of which the policy is the subject."""
    about: str
    """Rule in words."""
    applies: Callable[[Row], bool]
    """Function that tests a score row."""


FAILURE_MODES = (
    FailureMode(
        "unseen",
        "missed more than half",
        "Less than half of the targets were detected, or less than half of the cells were covered.",
        lambda row: row[DETECTED.name] < 0.5 or row[SENSED.name] < 0.5,
    ),
    FailureMode(
        "open",
        "lost the guarantee",
        "The worst-case undetected time was still growing when the episode ended and was at least half of the episode, "
        "or no robot was left.",
        lambda row: row[OPEN.name] == 1,
    ),
    FailureMode("collided", "collided", "Two robots collided.", lambda row: row[COLLISIONS.name] > 0),
)
"""The gravest first."""


def failed(row: Row) -> list[bool]:
    """Return for each of `FAILURE_MODES` whether an episode failed in that way; NaN is no failure."""
    return [mode.applies(row) for mode in FAILURE_MODES]


def badness(row: Row, scenario: Scenario) -> tuple[float, ...]:
    """Return a key by which episodes are sorted, larger being worse.

    It is the number of failure modes of the episode, then the worst-case undetected time (without contamination the
    score of the task), the collisions, and this score; times are in units of T_max. A missing number counts as 0.
    """
    parts, score = [], task_score(scenario)
    for column in (score if scenario.task.contamination is None else WORST_CASE, COLLISIONS, score):
        worse = -column.better * row[column.name] / (scenario.detection_time_bound if column.unit == "s" else 1.0)
        parts.append(0.0 if math.isnan(worse) else worse)
    return sum(failed(row)), *parts


def worst_first(rows: Rows, scenarios: Mapping[str, Scenario]) -> Rows:
    """Return score rows with the worst episode first; of equal ones the earlier first."""
    return sorted(rows, key=lambda row: badness(row, scenarios[row["scenario"]]), reverse=True)


def page(
    table: Table,
    rows: Rows,
    replays: Mapping[Key, dict[str, Any]],
    origin: Mapping[str, str],
    failures: Sequence[Failure] = (),
    notes: Mapping[str, Sequence[str]] | None = None,
) -> str:
    """Return the page as HTML that needs no other file and no network.

    Args:
        table: The table.
        rows: Its score rows, the worst first.
        replays: Playable episodes, from `lissajous_env.replay.contents.contents`.
        origin: Command, machine and versions of the numbers, in words.
        failures: Policies that raised.
        notes: Sentences about scenarios, by name.
    """
    notes = notes or {}
    policies = list(dict.fromkeys(row["policy"] for row in table.rows))
    number_of = {name: k for k, name in enumerate(policies)}
    scenario_of = {name: k for k, name in enumerate(table.estimates)}
    columns, by = _columns(table), grouped(rows)
    replayed = {f"replay-{k}": key for k, key in enumerate(replays)}
    data = {
        "format": FORMAT,
        "made": dict(origin),
        "kinds": [{"name": mode.name, "words": mode.words, "about": mode.about} for mode in FAILURE_MODES],
        "policies": [
            {
                "name": name,
                "colour": COLOURS.index(style.colour),
                "mark": style.mark,
                "hollow": bool(split_suffix(name)[1]),
            }
            for name, style in styles_of(policies).items()
        ],
        "overall": [_overall(overall, number_of) for overall in table.overall],
        "scenarios": [_scenario(table, name, number_of, by.get(name, {}), notes.get(name, ())) for name in scenario_of],
        "failures": [[failure.scenario, failure.policy, failure.error] for failure in failures],
        "columns": columns,
        "total": len(rows),
        "episodes": _episodes(rows[:MOST_EPISODES], columns, scenario_of, number_of),
        "replays": {name: [scenario_of[s], number_of[p], seed] for name, (s, p, seed) in replayed.items()},
    }
    played = f"{counted(len(rows), 'episode')} of {counted(len(policies), 'policy', 'policies')}"
    texts = {"title": "Benchmark", "counted": f"{played} on {counted(len(scenario_of), 'scenario')}"}
    player, blocks = "", {name: replays[key] for name, key in replayed.items()}
    if replays:
        empty = {"format": contents.FORMAT, "at": "@at@", "episodes": [_EPISODES]}
        player = html_page("page.html", "main.js", empty, texts={"title": "Replay"})
        blocks = {"viewer-page": player.replace(as_json(_EPISODES), "@episodes@", 1)} | blocks
    return html_page("report.html", "report.js", data, texts, ("style.css", "report.css"), blocks, framed=player)


def _columns(table: Table) -> list[dict[str, Any]]:
    """Return the columns by which episodes can be sorted, the most important first."""
    listed = [*map(task_score, table.scenarios.values()), *added_columns(table.rows), *MAIN]
    return [
        {
            "name": column.name,
            "title": column.heading,
            "listed": column in listed and not np.isnan(numbers(table.rows, column)).all(),
            "whole": column.rule is WHOLE,
            "open": OPEN.name if column is WORST_CASE else None,
        }
        for column in dict.fromkeys((*listed, *SHOWN, *COLUMNS.values()))
    ]


def _scenario(
    table: Table, name: str, number_of: Mapping[str, int], rows: Mapping[str, Rows], notes: Sequence[str]
) -> dict[str, Any]:
    scenario, policies, bounds = table.scenarios[name], table.estimates[name], table.bounds[name]
    columns = {column: best_of(policies, column) for column in columns_of(scenario, policies) if column.page}
    reference = table.references.get(name)
    return {
        "name": name,
        "description": scenario.description,
        "facts": _facts(scenario, bounds, reference),
        "notes": list(notes),
        "reference": None if reference is None else number_of[reference],
        "tradeoff": [task_score(scenario).name, COLLISIONS.name],
        "measures": [
            _described(column)
            | {"lines": [[_rounded(value), words] for value, words in _values_of_theory(column, scenario, bounds)]}
            for column in columns
        ],
        "policies": [
            {
                "policy": number_of[policy],
                "episodes": len(episodes),
                "failed": np.sum([failed(row) for row in episodes], axis=0).tolist(),
                "collisions": _rounded(float(numbers(episodes, COLLISIONS).mean())),
                "cells": {
                    column.name: _cell(policies[policy][column.name], policy in best, column, episodes)
                    for column, best in columns.items()
                },
            }
            for policy, episodes in ((policy, rows[policy]) for policy in policies)
        ],
    }


def _overall(overall: Overall, number_of: Mapping[str, int]) -> dict[str, Any]:
    """Return the estimates over the scenarios of a kind of robots."""
    columns = {column: best_of(overall.policies, column) for column in with_numbers(overall.policies, OVERALL)}
    return {
        "kind": _ROBOTS.get(overall.kind, overall.kind),
        "scenarios": list(overall.scenarios),
        "measures": [_described(column) for column in columns],
        "policies": [
            {
                "policy": number_of[policy],
                "cells": {c.name: _words(estimates[c.name], policy in best) for c, best in columns.items()},
            }
            for policy, estimates in overall.policies.items()
        ],
    }


def _described(column: Column) -> dict[str, Any]:
    """Return the description of a column for the page; only columns of the episodes have a strip of their values."""
    return {
        "column": column.name,
        "title": column.heading,
        "whole": column.rule is WHOLE,
        "about": f"{column.described}; the number is the {column.summary}",
        "strip": column.name not in DERIVED,
    }


def _facts(scenario: Scenario, bounds: Bounds, reference: str | None) -> list[tuple[str, str]]:
    """Return the main numbers of a scenario, each as its name and its value in words."""
    facts = (
        ("robots", f"{scenario.num_robots} {_ROBOTS.get(scenario.robot.kind, scenario.robot.kind)}"),
        ("episode", f"{scenario.task.duration:g} s"),
        (scenario.detection_time_label, f"{scenario.detection_time_bound:.3g} s"),
        *((("policies are compared with", reference),) if reference is not None else ()),
    )
    words = bounds.in_words().removeprefix(", ")
    return [*facts, *((("bounds", words),) if words else ())]


def _values_of_theory(column: Column, scenario: Scenario, bounds: Bounds) -> list[tuple[float, str]]:
    """Return the values that theory names for a column of a scenario, each with its label."""
    bound = scenario.detection_time_bound, scenario.detection_time_label
    lines = {
        WORST_CASE: [(bounds.in_formation, "in formation"), (bounds.best_known, "best known")],
        DETECTION_TIME: [(bounds.mean_time, "least"), bound],
        COVERAGE: [bound],
        SEPARATION: [(2 * scenario.robot.radius, "collision")],
    }.get(column, [])
    return [(value, words) for value, words in lines if math.isfinite(value)]


def _words(estimate: Estimate, best: bool) -> dict[str, Any]:
    """Return an estimate in words, and the number that sorts it; None comes last."""
    words, beside = in_words(estimate)
    return {"words": words, "between": beside, "value": _rounded(estimate.value), "known": estimate.known, "best": best}


def _cell(estimate: Estimate, best: bool, column: Column, rows: Rows) -> dict[str, Any]:
    """Return a column of one policy for the page: an estimate, and the quartiles of the episodes."""
    values = numbers(rows, column)
    known = values[np.isfinite(values)]
    return _words(estimate, best) | {
        "interval": _rounded([estimate.low, estimate.high]),
        "quartiles": _rounded(np.quantile(known, (0, 0.25, 0.5, 0.75, 1)).tolist()) if len(known) else None,
    }


def _episodes(
    rows: Sequence[Row],
    columns: Sequence[Mapping[str, Any]],
    scenario_of: Mapping[str, int],
    number_of: Mapping[str, int],
) -> dict[str, list[Any]]:
    """Return the columns of the episodes; `failed` has a bit for each of `FAILURE_MODES`."""
    return {
        "scenario": [scenario_of[row["scenario"]] for row in rows],
        "policy": [number_of[row["policy"]] for row in rows],
        "seed": [row["seed"] for row in rows],
        "failed": [sum(fails << k for k, fails in enumerate(failed(row))) for row in rows],
        **{column["name"]: [_rounded(row.get(column["name"], math.nan)) for row in rows] for column in columns},
    }


def _rounded(value: Any) -> Any:
    """Round to a few digits; NaN and infinity become null."""
    if isinstance(value, list):
        return [_rounded(entry) for entry in value]
    if not math.isfinite(value):
        return None
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value
