"""The report of a benchmark as a page, the ranking first, then what failed: `report.html`."""

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.benchmark import clairvoyant
from baselines.benchmark.comparison import COMPARED, OVER_LIMIT, Comparisons, guarantee_of, limit_of, with_derived
from baselines.benchmark.failures import KINDS, badness, failed, headline, worst_first
from baselines.benchmark.looks import COLOURS, looks_of
from baselines.benchmark.measures import MEASURES, OVERALL_MEASURES, TITLES, Measure, measures_of, title_of
from baselines.benchmark.ranking import Ranking, rankings
from baselines.benchmark.replays import Key, Played
from baselines.benchmark.rows import NUMBER_COLUMNS, numbers_of
from baselines.benchmark.statistics import Paired, Statistics
from baselines.benchmark.tables import between, in_words, number, shown_name
from baselines.benchmark.types import Outcome
from baselines.policies.registry import unwrapped
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.report import report

NAME = "report.html"
FORMAT = "lissajous report 2"
MOST_EPISODES = 20_000
"""Episodes that are listed; of more, the worst of each policy on each scenario."""
_KINDS = {"car": "cars", "curve": "points on the curve"}
_CURVE = 240
"""Times of a curve."""
_DIGITS = 5
_LISTED = ("coverage_time", "idleness_mean")
"""Columns that the table of the episodes shows beside the main ones and a scenario's own."""


@dataclass(frozen=True)
class Report:
    """All that the page is made of."""

    outcome: Outcome
    comparisons: Comparisons
    made: Mapping[str, str]
    """What the numbers were made with, in words, by what it is."""
    commands: Mapping[str, str]
    """Name of each scenario in a command, and what changes it, by its name; without those that none names."""
    nameless: frozenset[str]
    """Policies that no command names."""

    def ranked(self) -> list[dict[str, Any]]:
        """Return the score rows that the folder holds, with their derived columns, the worst first."""
        rows = with_derived(self.outcome.held_rows, self.outcome.held_scenarios)
        return [rows[k] for k in worst_first(rows, self.outcome.held_scenarios)]

    def references(self) -> dict[str, str]:
        """Return the policy that the others of a scenario are compared with."""
        return {name: reference for name, (reference, _) in self.comparisons.against.items()}

    def html(self, ranked: Sequence[Mapping[str, Any]], replays: Mapping[Key, Played]) -> str:
        """Make the page.

        Args:
            ranked: What `ranked` returned.
            replays: Episodes that can be played in it.
        """
        policies = list(dict.fromkeys(row["policy"] for row in self.outcome.held_rows))
        number_of = {name: k for k, name in enumerate(policies)}
        scenario_of = {name: k for k, name in enumerate(self.comparisons.cells)}
        kept, held = _listed(ranked), self.outcome.held_scenarios
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
            "scenarios": [self._scenario(name, number_of, ranked) for name in scenario_of],
            "failures": [[each.scenario, each.policy, each.error] for each in self.outcome.failures],
            "columns": _columns(self.outcome.held_rows),
            "total": len(ranked),
            "episodes": _episodes(kept, scenario_of, number_of),
            "replays": {
                name: [scenario_of[s], number_of[p], seed, played.same]
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
        looks = looks_of(names)
        return [
            {
                "name": name,
                "shown": shown_name(name),
                "colour": COLOURS.index(looks[name].colour),
                "mark": looks[name].mark,
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
            "columns": [{"name": column, "title": title_of(column)} for column in ranking.columns],
            "measures": [
                {"column": each.column, "title": each.title, "about": each.about} for each in OVERALL_MEASURES
            ],
            "policies": [
                {
                    "policy": number_of[policy],
                    "ranks": _rounded([list(ranking.overall[policy]), *map(list, of.values())]),
                    "overall": [in_words(overall[policy], each) for each in OVERALL_MEASURES] if overall else [],
                }
                for policy, of in ranking.ranks.items()
            ],
        }

    def _against(self, name: str, number_of: Mapping[str, int]) -> dict[str, Any] | None:
        """How the policies of a scenario compare with its reference, seed by seed."""
        _, policies = self.comparisons.against.get(name, ("", {}))
        columns = [column for column in COMPARED if any(of[column].n for of in policies.values())]
        if not columns:
            return None
        return {
            "columns": [{"title": title_of(column), "better": COMPARED[column]} for column in columns],
            "policies": [
                {"policy": number_of[policy], "pairs": [_pair(of[column]) for column in columns]}
                for policy, of in policies.items()
            ],
        }

    def _scenario(self, name: str, number_of: Mapping[str, int], ranked: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        scenario = self.outcome.held_scenarios[name]
        rows: dict[str, list[Mapping[str, Any]]] = {}
        for row in ranked:
            if row["scenario"] == name:
                rows.setdefault(row["policy"], []).append(row)
        played = [row for of in rows.values() for row in of]
        cells = self.comparisons.cells[name]
        measures = [m for m in measures_of(scenario, cells) if m.page and any(_is_known(row, m) for row in played)]
        times, curves = _curves(self.outcome.held_curves.get(name, {}))
        reference = self.references().get(name)
        return {
            "name": name,
            "description": scenario.description,
            "facts": _facts(scenario),
            "bound": _rounded(scenario.detection_time_bound),
            "bound_name": scenario.detection_time_label,
            "headline": headline(scenario),
            "reference": None if reference is None else number_of[reference],
            "against": self._against(name, number_of),
            "command": self.commands.get(name),
            "measures": [each.described(scenario) for each in measures],
            "times": times,
            "policies": [
                {
                    "policy": number_of[policy],
                    "episodes": len(of),
                    "failed": np.sum([failed(row) for row in of], axis=0).tolist(),
                    "badness": _rounded(np.mean([[*badness(row, scenario)] for row in of], axis=0).tolist()),
                    "cells": {each.column: _cell(cells[policy], each, of) for each in measures},
                    "curve": curves.get(policy),
                }
                for policy, of in rows.items()
            ],
        }


def _facts(scenario: Scenario) -> list[tuple[str, str]]:
    """Numbers that a scenario is known by, each as its name and value in words."""
    limit, (least, formation) = limit_of(scenario), guarantee_of(scenario)
    known = (
        ("robots", f"{scenario.num_robots} {_KINDS.get(scenario.robot.kind, scenario.robot.kind)}"),
        ("episode", f"{scenario.task.duration:g} s"),
        (scenario.detection_time_label, f"{scenario.detection_time_bound:.3g} s"),
        ("least mean detection time", f"{limit:.3g} s" if math.isfinite(limit) else ""),
        ("least guaranteed time", f"{least:.3g} s" if least >= scenario.task.step else ""),
        ("guaranteed in formation", f"{formation:.3g} s" if math.isfinite(formation) else ""),
    )
    return [(name, value) for name, value in known if value]


def _is_known(row: Mapping[str, Any], measure: Measure) -> bool:
    return math.isfinite(row.get(measure.column, math.nan))


def _cell(of: Mapping[str, Statistics], measure: Measure, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What is shown of a column of one policy: a number as the tables have it, its interval, and quartiles."""
    cell = of[measure.column]
    value = cell.mean if measure.mean else cell.iqm
    low, high = (cell.mean_low, cell.mean_high) if measure.mean else (cell.low, cell.high)
    known = [row[measure.column] for row in rows if _is_known(row, measure)]
    words, ends = in_words(of, measure)
    return {
        "words": words,
        "between": ends,
        "value": _rounded(value),
        "interval": _rounded([low, high]),
        "known": cell.n_finite,
        "quartiles": _rounded(np.quantile(known, (0, 0.25, 0.5, 0.75, 1)).tolist()) if known else None,
    }


def _pair(of: Paired) -> dict[str, Any]:
    """What is shown of a comparison: words for the share of the seeds and for the difference, and their numbers."""
    return {
        "n": of.n,
        "share": f"{100 * of.better:.0f} %" if of.n else "",
        "shares": between(of.better_low, of.better_high, 100),
        "difference": number(of.difference),
        "differences": between(of.difference_low, of.difference_high),
        "better": _rounded([of.better, of.better_low, of.better_high]),
    }


def _curves(curves: Mapping[str, tuple[Any, Any]]) -> tuple[list[float], dict[str, list[Any]]]:
    """Times [s], close at first and wide later, and the share of the targets that is unseen after each, by policy.

    Where the last target was never seen nothing is known beyond the time for which it was there.
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
    """The episodes that are listed, the worst first."""
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
    """The columns that episodes can be put in order by, the most telling first."""
    names = dict.fromkeys(name for row in rows for name in numbers_of(row))
    own = [name for name in names if name not in NUMBER_COLUMNS]
    names = [name for name in (*own, *TITLES, *names) if name in names or name == OVER_LIMIT]
    listed = (*own, *(each.column for each in MEASURES if each.main or each.column in _LISTED))
    return [{"name": name, "title": title_of(name), "listed": name in listed} for name in dict.fromkeys(names)]


def _episodes(
    rows: Sequence[Mapping[str, Any]], scenario_of: Mapping[str, int], number_of: Mapping[str, int]
) -> dict[str, list[Any]]:
    """Columns of the episodes; `failed` has a bit for each of `KINDS`."""
    columns = dict.fromkeys([*(name for row in rows for name in numbers_of(row)), OVER_LIMIT])
    return {
        "scenario": [scenario_of[row["scenario"]] for row in rows],
        "policy": [number_of[row["policy"]] for row in rows],
        "seed": [row["seed"] for row in rows],
        "failed": [sum(fails << k for k, fails in enumerate(failed(row))) for row in rows],
        **{name: [_rounded(row.get(name, math.nan)) for row in rows] for name in columns},
    }


def _rounded(value: Any) -> Any:
    """Round to a few digits; what is no number, or not finite, becomes null."""
    if isinstance(value, list):
        return [_rounded(each) for each in value]
    if not math.isfinite(value):
        return None
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value


def command_of(name: str, overrides: Mapping[str, Any]) -> str:
    """What names a scenario in a command: `NAME`, and `--set` with what changes it."""
    changes = " ".join(shlex.quote(f"{field}={_literal(value)}") for field, value in overrides.items())
    return " ".join(filter(None, [shlex.quote(name), f"--set {changes}" if changes else ""]))


def _literal(value: Any) -> str:
    return value if isinstance(value, str) else repr(value)
