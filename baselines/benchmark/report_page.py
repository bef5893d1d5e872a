"""The page of a benchmark, `report.html`: the ranking first, then the failures, each scenario and all episodes."""

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.benchmark import clairvoyant
from baselines.benchmark.bounds import Bounds
from baselines.benchmark.comparison import Comparisons, with_derived
from baselines.benchmark.failures import KINDS, badness, failed, headline, worst_first
from baselines.benchmark.plot_styles import COLOURS, styles_of
from baselines.benchmark.ranking import Ranking, rankings
from baselines.benchmark.replays import Key, Played
from baselines.benchmark.rows import Rows, grouped
from baselines.benchmark.shown_columns import (
    COMPARED,
    MAIN,
    OVER_LOWER_BOUND,
    OVERALL,
    SHOWN,
    brought_in,
    lines_of,
    shown_columns,
)
from baselines.benchmark.statistics import Paired, Statistics
from baselines.benchmark.tables import between, in_words, number, shown_name
from baselines.benchmark.types import Outcome
from baselines.policies.registry import unwrapped
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.report import report
from lissajous_env.world.columns import COLLISIONS, COLUMNS, DETECTION_TIME, LARGEST, OPEN, WHOLE, WORST_CASE, Column

NAME = "report.html"
FORMAT = "lissajous report 2"
MOST_EPISODES = 20_000
"""Largest number of episodes that are listed; of more, the worst of each policy on each scenario."""
_KINDS = {"car": "cars", "curve": "points on the curve"}
_CURVE = 240
"""Number of times of a curve."""
_DIGITS = 5


@dataclass(frozen=True)
class Report:
    """The content of the page."""

    outcome: Outcome
    comparisons: Comparisons
    made: Mapping[str, str]
    """Command, machine and versions of the numbers, in words."""
    commands: Mapping[str, str]
    """Name of each scenario in a command, with its overrides; scenarios without such a name are left out."""
    nameless: frozenset[str]
    """Policies that cannot be named in a command."""

    def ranked(self) -> list[dict[str, Any]]:
        """Return all score rows of the folder, with their derived columns, the worst first."""
        rows = with_derived(self.outcome.held_rows, self.outcome.held_scenarios)
        return [rows[k] for k in worst_first(rows, self.outcome.held_scenarios)]

    def references(self) -> dict[str, str]:
        """Return the policy that the others of a scenario are compared with."""
        return {name: reference for name, (reference, _) in self.comparisons.against.items()}

    def html(self, ranked: Rows, replays: Mapping[Key, Played]) -> str:
        """Make the page.

        Args:
            ranked: result of `ranked`.
            replays: episodes that can be played in it.
        """
        policies = list(dict.fromkeys(row["policy"] for row in self.outcome.held_rows))
        number_of = {name: k for k, name in enumerate(policies)}
        scenario_of = {name: k for k, name in enumerate(self.comparisons.cells)}
        kept, held, columns = _listed(ranked), self.outcome.held_scenarios, _columns(self.outcome.held_rows)
        by = grouped(ranked)
        replayed = {f"replay-{k}": (key, played) for k, (key, played) in enumerate(replays.items())}
        data = {
            "format": FORMAT,
            "made": dict(self.made),
            "kinds": [{"name": kind.name, "words": kind.words, "about": kind.about} for kind in KINDS],
            "policies": self._policies(policies),
            "rankings": [
                self._ranking(each, scenario_of, number_of)
                for each in rankings(with_derived(self.outcome.held_rows, held), held)
            ],
            "scenarios": [self._scenario(name, number_of, by.get(name, {})) for name in scenario_of],
            "failures": [[each.scenario, each.policy, each.error] for each in self.outcome.failures],
            "columns": columns,
            "tradeoff": [DETECTION_TIME.name, COLLISIONS.name],
            "total": len(ranked),
            "episodes": _episodes(kept, columns, scenario_of, number_of),
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
                "shown": shown_name(name),
                "colour": COLOURS.index(styles[name].colour),
                "mark": styles[name].mark,
                "hollow": bool(unwrapped(name)[1]),
                "rival": name != clairvoyant.NAME,
                "named": name not in self.nameless,
            }
            for name in names
        ]

    def _ranking(
        self, ranking: Ranking, scenario_of: Mapping[str, int], number_of: Mapping[str, int]
    ) -> dict[str, Any]:
        overall = self.comparisons.overall.get(", ".join(ranking.scenarios), {})
        return {
            "kind": _KINDS.get(ranking.kind, ranking.kind),
            "scenarios": [scenario_of[name] for name in ranking.scenarios],
            "columns": [{"name": each.name, "title": each.heading} for each in ranking.columns],
            "measures": [{"column": each.name, "title": each.heading, "about": each.described} for each in OVERALL],
            "policies": [
                {
                    "policy": number_of[policy],
                    "ranks": _rounded([list(ranking.overall[policy]), *map(list, of.values())]),
                    "overall": [_aggregate(overall[policy][each.name]) for each in OVERALL] if overall else [],
                }
                for policy, of in ranking.ranks.items()
            ],
        }

    def _against(self, name: str, number_of: Mapping[str, int]) -> dict[str, Any] | None:
        """Return the comparison of a scenario's policies with its reference, seed by seed; None without one."""
        _, policies = self.comparisons.against.get(name, ("", {}))
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
        scenario = self.outcome.held_scenarios[name]
        played = [row for of in rows.values() for row in of]
        cells = self.comparisons.cells[name]
        shown = [each for each in shown_columns(scenario, cells) if each.page]
        shown = [each for each in shown if any(_is_known(row, each) for row in played)]
        bounds = self.comparisons.bounds[name]
        times, curves = _curves(self.outcome.held_curves.get(name, {}))
        reference = self.references().get(name)
        return {
            "name": name,
            "description": scenario.description,
            "facts": _facts(scenario, bounds),
            "notes": self.outcome.theorem.get(name, []),
            "bound": _rounded(scenario.detection_time_bound),
            "bound_name": scenario.detection_time_label,
            "headline": headline(scenario).name,
            "reference": None if reference is None else number_of[reference],
            "against": self._against(name, number_of),
            "command": self.commands.get(name),
            "measures": [_described(each, lines_of(each, scenario, bounds)) for each in shown],
            "times": times,
            "policies": [
                {
                    "policy": number_of[policy],
                    "episodes": len(of),
                    "failed": np.sum([failed(row) for row in of], axis=0).tolist(),
                    "badness": _rounded(_badness(of, scenario)),
                    "cells": {each.name: _cell(cells[policy], each, of) for each in shown},
                    "curve": curves.get(policy),
                }
                for policy, of in rows.items()
            ],
        }


def _badness(rows: Rows, scenario: Scenario) -> list[float]:
    """Return the means of `badness` over the episodes of a policy, of a guarantee the largest."""
    each = np.array([badness(row, scenario) for row in rows])
    _, *others = each.mean(axis=0)
    if headline(scenario).summary == LARGEST:
        others[0] = each[:, 1].max()
    return [each[:, 0].mean(), *others]


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


def _is_known(row: Mapping[str, Any], column: Column) -> bool:
    return math.isfinite(row.get(column.name, math.nan))


def _cell(of: Mapping[str, Statistics], column: Column, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return what the page shows of a column of one policy: a number and what tables show beside it, and quartiles."""
    cell = of[column.name]
    known = [row[column.name] for row in rows if _is_known(row, column)]
    words, beside = in_words(cell)
    return {
        "words": words,
        "between": beside,
        "value": _rounded(cell.value),
        "interval": _rounded([*cell.interval]),
        "known": cell.n_finite,
        "quartiles": _rounded(np.quantile(known, (0, 0.25, 0.5, 0.75, 1)).tolist()) if known else None,
    }


def _aggregate(of: Statistics) -> list[Any]:
    """Return a number over all scenarios in words, what is beside it, and the number that sorts it; None comes last."""
    return [*in_words(of), None if of.at_least else _rounded(of.value)]


def _pair(of: Paired) -> dict[str, Any]:
    """Return the share of the seeds and the difference of a comparison, in words and as numbers."""
    return {
        "n": of.n,
        "share": f"{100 * of.better:.0f} %" if of.n else "",
        "shares": between(of.better_low, of.better_high, 100),
        "difference": number(of.difference),
        "differences": between(of.difference_low, of.difference_high),
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
    found = {}
    for policy, (t, share) in known.items():
        unseen = 1 - np.concatenate([[0], share])[np.searchsorted(t, times, side="right")]
        found[policy] = _rounded(np.where((times > t[-1]) & (share[-1] < 1), np.nan, unseen).tolist())
    return _rounded(times.tolist()), found


def _listed(ranked: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return the episodes that the page lists, the worst first."""
    if len(ranked) <= MOST_EPISODES:
        return list(ranked)
    most = max(MOST_EPISODES // len({(row["scenario"], row["policy"]) for row in ranked}), 1)
    counted: dict[tuple[str, str], int] = {}
    kept = []
    for row in ranked:
        place = row["scenario"], row["policy"]
        counted[place] = counted.get(place, 0) + 1
        if counted[place] <= most:
            kept.append(row)
    return kept[:MOST_EPISODES]


def _columns(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the columns by which episodes can be sorted, the most important first."""
    brought = brought_in(rows)
    return [
        {
            "name": each.name,
            "title": each.heading,
            "listed": each in (*brought, *MAIN),
            "whole": each.rule is WHOLE,
            "open": OPEN.name if each is WORST_CASE else None,
        }
        for each in dict.fromkeys((*brought, *SHOWN, *COLUMNS.values()))
    ]


def _episodes(
    rows: Sequence[Mapping[str, Any]],
    columns: Sequence[Mapping[str, Any]],
    scenario_of: Mapping[str, int],
    number_of: Mapping[str, int],
) -> dict[str, list[Any]]:
    """Return the columns of the episodes; `failed` has a bit for each of `KINDS`."""
    return {
        "scenario": [scenario_of[row["scenario"]] for row in rows],
        "policy": [number_of[row["policy"]] for row in rows],
        "seed": [row["seed"] for row in rows],
        "failed": [sum(fails << k for k, fails in enumerate(failed(row))) for row in rows],
        **{each["name"]: [_rounded(row.get(each["name"], math.nan)) for row in rows] for each in columns},
    }


def _rounded(value: Any) -> Any:
    """Round to a few digits; NaN and infinity become null."""
    if isinstance(value, list):
        return [_rounded(each) for each in value]
    if not math.isfinite(value):
        return None
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value


def command_of(name: str, overrides: Mapping[str, Any]) -> str:
    """Return the part of a command that names a scenario: `NAME`, and `--set` with its overrides."""
    changes = " ".join(shlex.quote(f"{field}={_literal(value)}") for field, value in overrides.items())
    return " ".join(filter(None, [shlex.quote(name), f"--set {changes}" if changes else ""]))


def _literal(value: Any) -> str:
    return value if isinstance(value, str) else repr(value)
