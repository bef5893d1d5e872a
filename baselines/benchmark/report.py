"""The report of a benchmark: tables for the terminal, and the files that are made of its score rows."""

import csv
import io
import json
import math
import os
import platform
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.text import Text

from baselines.benchmark.rows import numbers_of
from baselines.benchmark.statistics import Statistics, summarize
from baselines.benchmark.types import Outcome
from lissajous_env.console.terminal import Column, plain, print_left_out, print_table
from lissajous_env.device.devices import as_device
from lissajous_env.parameters.scenario import Faults, Scenario
from lissajous_env.storage.files import write_atomically
from lissajous_env.storage.folder import Folder
from lissajous_env.world.score import COLUMNS, brought_columns

_DASH = "\N{EM DASH}"


class Shown(NamedTuple):
    """How a column is shown: its title, and whether less of it is better (0: neither)."""

    column: str
    title: str
    better: int


SHOWN = (
    Shown("detection_time_mean", "detection\nmean [s]", -1),
    Shown("detected_within_bound", "within\nT_max", 1),
    Shown("collisions", "colli-\nsions", -1),
    Shown("min_separation", "least\ndistance [m]", 1),
    Shown("detection_time_p95", "detection\np95 [s]", -1),
    Shown("spacing_factor", "spacing\nfactor", -1),
    Shown("recovery_time", "recovery\n[s]", -1),
    Shown("idleness_mean", "idleness\nmean [s]", -1),
)
"""Main columns, the most important first: a narrow terminal leaves out the last."""

_OVERALL = (
    Shown("time_over_bound", "detection\nmean / T_max", -1),
    Shown("detected_within_bound", "within\nT_max", 1),
    Shown("collisions", "colli-\nsions", -1),
    Shown("spacing_factor", "spacing\nfactor", -1),
)
"""Columns that mean the same on every scenario, so that their episodes can be taken together."""

Cells = dict[str, dict[str, dict[str, Statistics]]]
"""Statistics by scenario, policy and column."""


def statistics(rows: Iterable[dict[str, Any]]) -> Cells:
    """Statistics of every column for each policy on each scenario, in the order in which the rows name them."""
    episodes: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for row in rows:
        episodes.setdefault(row["scenario"], {}).setdefault(row["policy"], []).append(row)
    return {
        scenario: {
            policy: {column: summarize([row[column] for row in played]) for column in numbers_of(played[0])}
            for policy, played in policies.items()
        }
        for scenario, policies in episodes.items()
    }


def overall(rows: Sequence[dict[str, Any]], scenarios: Mapping[str, Scenario]) -> Cells:
    """Statistics over all scenarios of a kind of robot, stratified by scenario, of policies that played them all."""
    cells: Cells = {}
    for kind in dict.fromkeys(scenario.robot.kind for scenario in scenarios.values()):
        group = [name for name, scenario in scenarios.items() if scenario.robot.kind == kind]
        strata: dict[str, dict[str, list[dict[str, Any]]]] = {}
        for row in rows:
            if row["scenario"] in group:
                bound = scenarios[row["scenario"]].detection_time_bound
                scaled = row | {"time_over_bound": row["detection_time_mean"] / bound}
                strata.setdefault(row["policy"], {}).setdefault(row["scenario"], []).append(scaled)
        complete = {policy: list(by.values()) for policy, by in strata.items() if len(by) == len(group)}
        if len(group) > 1 and complete:
            cells[", ".join(group)] = {
                policy: {of.column: summarize(*[[row[of.column] for row in each] for each in by]) for of in _OVERALL}
                for policy, by in complete.items()
            }
    return cells


def print_tables(console: Console, outcome: Outcome) -> None:
    """Print a table for each scenario, one over all scenarios of a kind of robot, and what failed."""
    cells, scenarios, settings = statistics(outcome.rows), outcome.scenarios, outcome.settings
    left_out: list[str] = []
    for name, scenario in scenarios.items():
        title = Text.assemble(
            (name, "bold"), f"  N = {scenario.num_robots}, T_max = {scenario.detection_time_bound:.3g} s"
        )
        failed = {failure.policy for failure in outcome.failures if failure.scenario == name}
        # Without a fault there is nothing to recover from.
        shown = [each for each in SHOWN if each.column != "recovery_time" or scenario.faults != Faults()]
        shown += [Shown(column, column.replace("_", "\n", 1), 0) for column in brought_columns(scenario)]
        left_out += _print_policies(console, title, cells.get(name, {}), shown, failed)
    for names, policies in overall(outcome.rows, scenarios).items():
        left_out += _print_policies(console, Text(f"over {names}", "bold"), policies, _OVERALL)
    print_left_out(console, left_out, f"episodes.csv in {settings.out} has them, and a wider terminal shows them.")
    counted = "1 episode, below it" if settings.episodes == 1 else f"{settings.episodes} episodes, below it"
    words = (
        f"Interquartile mean over {counted} the 95 % bootstrap interval; * best; (k/n): k of n episodes had a number."
    )
    _say(console, words, "dim")
    for failure in outcome.failures:
        _say(console, f"{failure.policy} failed on {failure.scenario}: {failure.error}", "bold red")
    if outcome.failures:
        _say(console, "Tracebacks are in summary.json.", "red")
    if outcome.kept:
        words = (
            f"{outcome.kept} of {len(outcome.rows)} episodes were in {settings.out} already, not played "
            "again; to play them anew, delete that folder or take another --out."
        )
        _say(console, words, "yellow")
    words = f"{len(outcome.rows)} episodes"
    if len(outcome.held_rows) > len(outcome.rows):
        words += f" asked for, {len(outcome.held_rows)} with those of earlier calls,"
    _say(console, f"{words} in {settings.out} (episodes.csv, summary.json, pictures), {outcome.elapsed:.1f} s", "")


def print_scores(console: Console, policy: str, scenario: str, columns: dict[str, Statistics]) -> list[str]:
    """Print every score of one policy on one scenario as a row; return the columns there was no room for."""
    _print_title(console, Text.assemble((policy, "bold"), " on ", (scenario, "bold")))
    names = ("interquartile mean", "95 % interval", "n", "mean", "std", "min", "max")
    rows = []
    for name, of in columns.items():
        mean, std, least, most = (number(value) for value in (of.mean, of.std, of.min, of.max))
        counted = str(of.n) if of.n_finite == of.n else f"{of.n_finite}/{of.n}"
        interval = _interval(of) if of.n_finite > 1 else _DASH
        rows.append([name, Text(number(of.iqm), "bold"), interval, counted, mean, std, least, most])
    left_out = print_table(console, [Column("score", left=True, style="cyan"), *map(Column, names)], rows)
    console.print()
    return left_out


def print_row(console: Console, row: dict[str, Any]) -> None:
    """Print one score row as a table."""
    _print_title(
        console, Text.assemble((row["policy"], "bold"), " on ", (row["scenario"], "bold"), f", seed {row['seed']}")
    )
    rows = [[name, number(row[name])] for name in numbers_of(row)]
    print_table(console, [Column("score", left=True, style="cyan"), Column("value")], rows)


NAMES = ("episodes.csv", "summary.json", "detection_time.png", "detection_time_distribution.png", "collisions.png")
"""Files that are made from the episodes."""


def write_files(folder: Folder, outcome: Outcome) -> None:
    """Write episodes.csv, summary.json and the pictures, of all that the folder holds."""
    from baselines.benchmark import pictures

    rows, scenarios = outcome.held_rows, outcome.held_scenarios
    folder.write("episodes.csv", as_csv(rows))
    summary = summarized(outcome, rows, scenarios)
    folder.write("summary.json", json.dumps(plain(summary), indent=2, allow_nan=False) + "\n")
    for name, data in pictures.draw(rows, statistics(rows), scenarios, outcome.held_curves).items():
        folder.write(name, data)


def summarized(outcome: Outcome, rows: Sequence[dict[str, Any]], scenarios: Mapping[str, Scenario]) -> dict[str, Any]:
    """What is known of some of an outcome's rows, as summary.json has it; the failures are those of this call."""
    held = outcome.held
    return {
        "machine": machine(held["device"]),
        "versions": versions(),
        "command": shlex.join(sys.argv),
        "elapsed_s": outcome.elapsed,
        "seeds": sorted({row["seed"] for row in rows}),
        "settings": held,
        "statistics": {
            s: {p: {c: asdict(of) for c, of in cs.items()} for p, cs in ps.items()}
            for s, ps in statistics(rows).items()
        },
        "overall": {
            names: {p: {c: asdict(of) for c, of in cs.items()} for p, cs in ps.items()}
            for names, ps in overall(rows, scenarios).items()
        },
        "failures": [asdict(failure) for failure in outcome.failures],
    }


def write_csv(path: Path, rows: Iterable[dict[str, Any]]) -> None:
    """Write score rows to a file of their own, as `as_csv` has them."""
    write_atomically(path, as_csv(rows))


def as_csv(rows: Iterable[dict[str, Any]]) -> str:
    """Score rows with the columns of `lissajous_env.world.score.COLUMNS`, then those of scenarios; NaN is empty."""
    rows, text = list(rows), io.StringIO()
    columns = dict.fromkeys((*COLUMNS, *(name for row in rows for name in row)))
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        values = [row.get(name, math.nan) for name in columns]
        writer.writerow(["" if value != value else value for value in values])
    return text.getvalue()


def machine(device: str) -> dict[str, Any]:
    """What the numbers were made on."""
    memory = None
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        memory = round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1)
    warp_device = as_device(device)
    return {
        "cpu": _cpu_model(),
        "cores": os.cpu_count(),
        "memory_gib": memory,
        "os": platform.platform(),
        "device": device if warp_device.is_cpu else f"{device}: {warp_device.name}",
    }


def versions() -> dict[str, str]:
    """Versions of what the numbers depend on."""
    names = ("lissajous-env", "numpy", "warp-lang", "gymnasium", "pettingzoo")
    return {"python": platform.python_version()} | {name: version(name) for name in names}


def _cpu_model() -> str:
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


def _print_policies(
    console: Console,
    title: Text,
    policies: dict[str, dict[str, Statistics]],
    shown: Sequence[Shown],
    failed: Iterable[str] = (),
) -> list[str]:
    """Print a table with a row for each policy; return the columns there was no room for."""
    best = [_best([of[each.column] for of in policies.values()], each.better) for each in shown]
    rows = []
    for name in dict.fromkeys([*policies, *failed]):
        of = policies.get(name)
        cells = ["" if of is None else _cell(of[each.column], mark) for each, mark in zip(shown, best, strict=True)]
        rows.append([Text.assemble(name, ("\nfailed", "red")) if name in failed else name, *cells])
    columns = [Column(each.title, name=each.column) for each in shown]
    _print_title(console, title)
    left_out = print_table(console, [Column("policy", left=True, style="cyan"), *columns], rows)
    console.print()
    return left_out


def _print_title(console: Console, title: Text) -> None:
    console.print(title, soft_wrap=True, highlight=False)


def _say(console: Console, words: str, style: str) -> None:
    console.print(words, style=style, markup=False, highlight=False, soft_wrap=True)


def _best(candidates: list[Statistics], better: int) -> str:
    """Best interquartile mean, as shown, of the policies with most episodes that have a number; none if all agree."""
    most = max((of.n_finite / of.n for of in candidates), default=0)
    values = [of.iqm for of in candidates if of.n_finite / of.n == most]
    if not most or not better or len({number(of.iqm) for of in candidates}) == 1:
        return ""
    return number(better * max(better * value for value in values))


def _cell(of: Statistics, best: str) -> Text:
    if not of.n_finite:
        return Text.assemble(_DASH, (f"\n(0/{of.n})", "dim"))
    value = number(of.iqm)
    shown = (f"{value}*", "bold green") if value == best else f"{value} "
    counted = "" if of.n_finite == of.n else f" ({of.n_finite}/{of.n})"
    below = f"{_interval(of)}{counted}"
    return Text.assemble(shown, (f"\n{below} ", "dim") if below else "")


def _interval(of: Statistics) -> str:
    low, high = number(of.low), number(of.high)
    return "" if low == high else f"{low}\N{EN DASH}{high}"


def number(value: float) -> str:
    """Three significant digits, but no more than three decimals; an em dash for NaN."""
    if value != value:
        return _DASH
    if abs(value) >= 1e7:
        return f"{value:.3g}"
    if float(value).is_integer() or abs(value) >= 100:
        return f"{value:.0f}"
    return f"{value:#.3g}" if abs(value) >= 0.9995 else f"{value:.3f}"
