"""The page of a benchmark, `report.html`: the ranking first, then the failures, each scenario and all episodes."""

import math
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from baselines.benchmark.bounds import Bounds
from baselines.benchmark.plot_styles import COLOURS, styles_of
from baselines.benchmark.ranking import KINDS, Ranking, badness, failed, headline, rankings, worst_first
from baselines.benchmark.shown import (
    COMPARED,
    MAIN,
    OVER_LOWER_BOUND,
    OVERALL,
    SHOWN,
    brought_in,
    in_words,
    pair_in_words,
    shown_columns,
    values_of_theory,
    with_numbers,
)
from baselines.benchmark.statistics import Estimate, Paired
from baselines.benchmark.table import Row, Rows, Table, grouped, numbers
from baselines.benchmark.types import Failure, Key
from baselines.policies.registry import unwrapped
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.report import report
from lissajous_env.world.columns import COLLISIONS, COLUMNS, DETECTION_TIME, LARGEST, OPEN, WHOLE, WORST_CASE, Column

FORMAT = "lissajous report 2"
MOST_EPISODES = 20_000
"""Largest number of episodes that are listed; of more, the worst of each policy on each scenario."""
_KINDS = {"car": "cars", "curve": "points on the curve"}
_CURVE = 240
"""Number of times of a curve."""
_DIGITS = 5


@dataclass(frozen=True)
class Played:
    """An episode that was played again."""

    contents: dict[str, Any] = field(repr=False)
    """Content that the page needs to play it."""
    same: bool
    """True if it had the same scores as in the benchmark; a policy may draw its own numbers, or round differently."""
    rogue: float | None = None
    """Time at which the rogue that the policy misses appears [s]; None if the replay shows none."""


@dataclass(frozen=True)
class Report:
    """The content of the page."""

    table: Table
    provenance: Mapping[str, str]
    """Command, machine and versions of the numbers, in words."""
    commands: Mapping[str, str] = field(default_factory=dict)
    """Name of each scenario in a command, with its overrides; scenarios without such a name are left out."""
    nameless: frozenset[str] = frozenset()
    """Policies that cannot be named in a command."""
    failures: Sequence[Failure] = ()
    notes: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Sentences about a scenario, by its name."""

    def ranked(self) -> list[dict[str, Any]]:
        """Return all score rows, the worst first."""
        return [self.table.rows[k] for k in worst_first(self.table.rows, self.table.scenarios)]

    def html(self, ranked: Rows, replays: Mapping[Key, Played]) -> str:
        """Make the page.

        Args:
            ranked: result of `ranked`.
            replays: episodes that can be played in it.
        """
        rows = self.table.rows
        policies = list(dict.fromkeys(row["policy"] for row in rows))
        number_of = {name: k for k, name in enumerate(policies)}
        scenario_of = {name: k for k, name in enumerate(self.table.estimates)}
        listed, columns, by = _listed(ranked), _columns(rows), grouped(ranked)
        replayed = {f"replay-{k}": (key, played) for k, (key, played) in enumerate(replays.items())}
        data = {
            "format": FORMAT,
            "made": dict(self.provenance),
            "kinds": [{"name": kind.name, "words": kind.words, "about": kind.about} for kind in KINDS],
            "policies": self._policies(policies),
            "rankings": [self._ranking(of, scenario_of, number_of) for of in rankings(self.table)],
            "scenarios": [self._scenario(name, number_of, by.get(name, {})) for name in scenario_of],
            "failures": [[failure.scenario, failure.policy, failure.error] for failure in self.failures],
            "columns": columns,
            "tradeoff": [DETECTION_TIME.name, COLLISIONS.name],
            "total": len(ranked),
            "episodes": _episodes(listed, columns, scenario_of, number_of),
            "replays": {
                name: [scenario_of[s], number_of[p], seed, played.same, played.rogue]
                for name, ((s, p, seed), played) in replayed.items()
            },
        }
        counts = ((len(policies), "policy", "policies"), (len(scenario_of), "scenario", "scenarios"))
        of, on = (f"{count} {one if count == 1 else many}" for count, one, many in counts)
        counted = f"{len(ranked):,} episodes of {of} on {on}"
        return report(
            "report.html",
            "report.js",
            data,
            {"title": "Benchmark", "counted": counted},
            {name: played.contents for name, (_, played) in replayed.items()},
        )

    def _policies(self, names: Sequence[str]) -> list[dict[str, Any]]:
        styles = styles_of(names)
        return [
            {
                "name": name,
                "colour": COLOURS.index(styles[name].colour),
                "mark": styles[name].mark,
                "hollow": bool(unwrapped(name)[1]),
                "named": name not in self.nameless,
            }
            for name in names
        ]

    def _ranking(
        self, ranking: Ranking, scenario_of: Mapping[str, int], number_of: Mapping[str, int]
    ) -> dict[str, Any]:
        overall = self.table.overall.get(ranking.group.name, {})
        return {
            "kind": _KINDS.get(ranking.group.kind, ranking.group.kind),
            "scenarios": [scenario_of[name] for name in ranking.group.scenarios],
            "columns": [{"name": column.name, "title": column.heading} for column in ranking.columns],
            "measures": [
                {"column": column.name, "title": column.heading, "about": column.described} for column in OVERALL
            ],
            "policies": [
                {
                    "policy": number_of[policy],
                    "ranks": _rounded([list(ranking.overall[policy]), *map(list, of.values())]),
                    "overall": [_aggregate(overall[policy][column.name]) for column in OVERALL] if overall else [],
                }
                for policy, of in ranking.ranks.items()
            ],
        }

    def _against(self, name: str, number_of: Mapping[str, int]) -> dict[str, Any] | None:
        """Return the comparison of a scenario's policies with its reference, seed by seed; None without one."""
        against = self.table.against.get(name)
        policies = against.policies if against is not None else {}
        columns = [column for column in COMPARED if any(of[column.name].n for of in policies.values())]
        if not columns:
            return None
        return {
            "columns": [{"title": column.heading, "better": column.better} for column in columns],
            "policies": [
                {"policy": number_of[policy], "pairs": [_pair(of[column.name]) for column in columns]}
                for policy, of in policies.items()
            ],
        }

    def _scenario(self, name: str, number_of: Mapping[str, int], rows: Mapping[str, Rows]) -> dict[str, Any]:
        scenario, cells, bounds = self.table.scenarios[name], self.table.estimates[name], self.table.bounds[name]
        shown = with_numbers(cells, [column for column in shown_columns(scenario, cells) if column.page])
        times, curves = _curves(self.table.curves.get(name, {}))
        reference = self.table.references().get(name)
        return {
            "name": name,
            "description": scenario.description,
            "facts": _facts(scenario, bounds),
            "notes": list(self.notes.get(name, [])),
            "bound": _rounded(scenario.detection_time_bound),
            "bound_name": scenario.detection_time_label,
            "headline": headline(scenario).name,
            "reference": None if reference is None else number_of[reference],
            "against": self._against(name, number_of),
            "command": self.commands.get(name),
            "measures": [_described(column, values_of_theory(column, scenario, bounds)) for column in shown],
            "times": times,
            "policies": [
                {
                    "policy": number_of[policy],
                    "episodes": len(of),
                    "failed": np.sum([failed(row) for row in of], axis=0).tolist(),
                    "badness": _rounded(_badness(of, scenario)),
                    "cells": {column.name: _cell(cells[policy], column, of) for column in shown},
                    "curve": curves.get(policy),
                }
                for policy, of in rows.items()
            ],
        }


def _badness(rows: Rows, scenario: Scenario) -> list[float]:
    """Return the means of `badness` over the episodes of a policy, of a guarantee the largest."""
    of = np.array([badness(row, scenario) for row in rows])
    _, *others = of.mean(axis=0)
    if headline(scenario).summary == LARGEST:
        others[0] = of[:, 1].max()
    return [of[:, 0].mean(), *others]


def _described(column: Column, lines: Sequence[tuple[float, str]]) -> dict[str, Any]:
    """Return what the page shows of a column; only columns of the episodes have a strip of their values."""
    return {
        "column": column.name,
        "title": column.heading,
        "better": column.better,
        "whole": column.rule is WHOLE,
        "about": f"{column.described}; the number is the {column.summary} over the episodes",
        "strip": column is not OVER_LOWER_BOUND,
        "lines": [[_rounded(value), words] for value, words in lines],
    }


def _facts(scenario: Scenario, bounds: Bounds) -> list[tuple[str, str]]:
    """Return the main numbers of a scenario, each as its name and its value in words."""
    known = (
        ("robots", f"{scenario.num_robots} {_KINDS.get(scenario.robot.kind, scenario.robot.kind)}"),
        ("episode", f"{scenario.task.duration:g} s"),
        (scenario.detection_time_label, f"{scenario.detection_time_bound:.3g} s"),
    )
    bounded = {
        "lower bound of the mean detection time": bounds.mean_time,
        "lower bound of the worst-case undetected time": bounds.worst_case,
        "best known worst-case undetected time": bounds.best_known,
        "the same in second halves of episodes": bounds.best_known_settled,
        "worst-case undetected time in formation": bounds.in_formation,
    }
    return [*known, *((name, f"{bound:.3g} s") for name, bound in bounded.items() if math.isfinite(bound))]


def _cell(of: Mapping[str, Estimate], column: Column, rows: Rows) -> dict[str, Any]:
    """Return what the page shows of a column of one policy: a number and what tables show beside it, and quartiles."""
    estimate, values = of[column.name], numbers(rows, column)
    words, beside = in_words(estimate)
    known = values[np.isfinite(values)]
    return {
        "words": words,
        "between": beside,
        "value": _rounded(estimate.value),
        "interval": _rounded([*estimate.interval]),
        "known": estimate.n_finite,
        "quartiles": _rounded(np.quantile(known, (0, 0.25, 0.5, 0.75, 1)).tolist()) if len(known) else None,
    }


def _aggregate(of: Estimate) -> list[Any]:
    """Return a number over all scenarios in words, what is beside it, and the number that sorts it; None comes last."""
    return [*in_words(of), None if of.at_least else _rounded(of.value)]


def _pair(of: Paired) -> dict[str, Any]:
    """Return the share of the seeds and the difference of a comparison, in words and as numbers."""
    share, difference = pair_in_words(of)
    return {
        "n": of.n,
        "share": share.value,
        "shares": share.beside,
        "difference": difference.value,
        "differences": difference.beside,
        "better": _rounded([of.better, of.better_low, of.better_high]),
    }


def _curves(curves: Mapping[str, tuple[Any, Any]]) -> tuple[list[float], dict[str, list[Any]]]:
    """Return times [s], dense at first, and by policy the share of the targets that is undetected after each.

    If the last target was never detected, nothing is known beyond the time for which it was present.
    """
    known = {policy: (np.asarray(t), np.asarray(share)) for policy, (t, share) in curves.items() if len(t)}
    if not known:
        return [], {}
    end = max(t[np.searchsorted(share, 0.995 * share[-1])] for t, share in known.values())
    times = 1.05 * max(end, 1e-3) * np.linspace(0, 1, _CURVE + 1) ** 1.5
    shares = {}
    for policy, (t, share) in known.items():
        unseen = 1 - np.concatenate([[0], share])[np.searchsorted(t, times, side="right")]
        shares[policy] = _rounded(np.where((times > t[-1]) & (share[-1] < 1), np.nan, unseen).tolist())
    return _rounded(times.tolist()), shares


def _listed(ranked: Sequence[Row]) -> list[Row]:
    """Return the episodes that the page lists, the worst first."""
    if len(ranked) <= MOST_EPISODES:
        return list(ranked)
    most = max(MOST_EPISODES // len({(row["scenario"], row["policy"]) for row in ranked}), 1)
    counted: Counter[tuple[str, str]] = Counter()
    worst = []
    for row in ranked:
        place = row["scenario"], row["policy"]
        counted[place] += 1
        if counted[place] <= most:
            worst.append(row)
    return worst[:MOST_EPISODES]


def _columns(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the columns by which episodes can be sorted, the most important first."""
    brought = brought_in(rows)
    return [
        {
            "name": column.name,
            "title": column.heading,
            "listed": column in (*brought, *MAIN),
            "whole": column.rule is WHOLE,
            "open": OPEN.name if column is WORST_CASE else None,
        }
        for column in dict.fromkeys((*brought, *SHOWN, *COLUMNS.values()))
    ]


def _episodes(
    rows: Sequence[Row],
    columns: Sequence[Row],
    scenario_of: Mapping[str, int],
    number_of: Mapping[str, int],
) -> dict[str, list[Any]]:
    """Return the columns of the episodes; `failed` has a bit for each of `KINDS`."""
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


def command_of(name: str, overrides: Mapping[str, Any]) -> str:
    """Return the part of a command that names a scenario: `NAME`, and `--set` with its overrides."""
    changes = " ".join(shlex.quote(f"{field}={_literal(value)}") for field, value in overrides.items())
    return " ".join(filter(None, [shlex.quote(name), f"--set {changes}" if changes else ""]))


def _literal(value: Any) -> str:
    return value if isinstance(value, str) else repr(value)
