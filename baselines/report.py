"""The report of a benchmark: tables for the terminal, and the files that are made of its score rows."""

import csv
import io
import json
import os
import platform
import shlex
import sys
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from baselines.statistics import Statistics, summarize
from baselines.stored import NUMBER_COLUMNS, as_settings, plain
from lissajous_env.device import as_device
from lissajous_env.files import write_atomically
from lissajous_env.scenario import Scenario
from lissajous_env.score import COLUMNS

if TYPE_CHECKING:
    from baselines.benchmark import Outcome

_DASH = "\N{EM DASH}"


class Shown(NamedTuple):
    """How a column is shown: its title, and whether less of it is better (0: neither)."""

    column: str
    title: str
    better: int


SHOWN = (
    Shown("detection_time_mean", "detection\nmean \\[s]", -1),
    Shown("detected_within_bound", "within\nT_max", 1),
    Shown("collisions", "colli-\nsions", -1),
    Shown("min_separation", "least\ndistance \\[m]", 1),
    Shown("detection_time_p95", "detection\np95 \\[s]", -1),
    Shown("recovery_time", "recovery\n\\[s]", -1),
    Shown("spacing_factor", "spacing\nfactor", -1),
    Shown("idleness_mean", "idleness\nmean \\[s]", -1),
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
            policy: {column: summarize([row[column] for row in played]) for column in NUMBER_COLUMNS}
            for policy, played in policies.items()
        }
        for scenario, policies in episodes.items()
    }


def overall(rows: Sequence[dict[str, Any]], scenarios: Iterable[Scenario]) -> Cells:
    """Statistics over several scenarios, stratified by scenario, by the scenarios that policies have in common."""
    bound = {scenario.name: scenario.detection_time_bound for scenario in scenarios}
    rows = [row | {"time_over_bound": row["detection_time_mean"] / bound[row["scenario"]]} for row in rows]
    played: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for row in rows:
        played.setdefault(row["policy"], {}).setdefault(row["scenario"], []).append(row)
    cells: Cells = {}
    groups = list(dict.fromkeys(tuple(by_scenario) for by_scenario in played.values() if len(by_scenario) > 1))
    for group in groups:
        # A policy that played further scenarios as well takes part with those of the group.
        members = {policy: by for policy, by in played.items() if set(group) <= set(by)}
        if len(members) > 1:
            cells[", ".join(group)] = {
                policy: {each.column: summarize(*[[r[each.column] for r in by[s]] for s in group]) for each in _OVERALL}
                for policy, by in members.items()
            }
    return cells


def print_tables(console: Console, outcome: "Outcome") -> None:
    """Print a table for each scenario, one over all scenarios, and what failed."""
    cells = statistics(outcome.rows)
    failed = {(each.scenario, each.policy): each.error for each in outcome.failures}
    scenarios = {cell.scenario.name: cell.scenario for cell in outcome.cells}
    for name, scenario in scenarios.items():
        title = f"[b]{escape(name)}[/b]  N = {scenario.num_robots}, T_max = {scenario.detection_time_bound:.3g} s"
        errors = {policy: error for (of, policy), error in failed.items() if of == name}
        console.print(_table(title, cells.get(name, {}), SHOWN, console.width, errors))
    for names, policies in overall(outcome.rows, scenarios.values()).items():
        console.print(_table(f"[b]over {escape(names)}[/b]", policies, _OVERALL, console.width, {}))
    words = (
        f"Interquartile mean over {outcome.settings.episodes} episodes, its 95 % bootstrap interval below; * best; "
        f"{_DASH} and (k/n): k of n episodes had a number."
    )
    console.print(words, style="dim", highlight=False)
    for failure in outcome.failures:
        words = f"{failure.policy} failed on {failure.scenario}: {failure.error}"
        console.print(words, style="bold red", markup=False, highlight=False)
    where = f"{len(outcome.rows)} episodes in {outcome.settings.out} (episodes.csv, summary.json, pictures)"
    console.print(f"{where}, {outcome.elapsed:.1f} s", markup=False, highlight=False, soft_wrap=True)


def print_scores(console: Console, title: str, columns: dict[str, Statistics]) -> None:
    """Print every column of one policy on one scenario as a row."""
    table = _plain_table(title)
    table.add_column("score", style="cyan", no_wrap=True)
    for name in ("interquartile mean", "95 % interval", "mean", "std", "min", "max", "n"):
        table.add_column(name, justify="right")
    for name, of in columns.items():
        numbers = [_number(value) for value in (of.mean, of.std, of.min, of.max)]
        counted = str(of.n) if of.n_finite == of.n else f"{of.n_finite}/{of.n}"
        table.add_row(name, f"[b]{_number(of.iqm)}[/b]", _interval(of), *numbers, counted)
    console.print(table)


def print_row(console: Console, row: dict[str, Any]) -> None:
    """Print one score row as a table."""
    table = _plain_table(f"[b]{escape(row['policy'])}[/b] on [b]{escape(row['scenario'])}[/b], seed {row['seed']}")
    table.add_column("score", style="cyan", no_wrap=True)
    table.add_column("value", justify="right")
    for name in NUMBER_COLUMNS:
        table.add_row(name, _number(row[name]))
    console.print(table)


def write_files(folder: Path, outcome: "Outcome") -> None:
    """Write episodes.csv, summary.json and the pictures."""
    from baselines import pictures

    write_csv(folder / "episodes.csv", outcome.rows)
    scenarios = {cell.scenario.name: cell.scenario for cell in outcome.cells}
    settings = outcome.settings
    cells = statistics(outcome.rows)
    summary = {
        "machine": machine(settings.device),
        "versions": versions(),
        "command": shlex.join(sys.argv),
        "elapsed": outcome.elapsed,
        "seeds": [settings.seed + k for k in range(settings.episodes)],
        "settings": as_settings(settings, outcome.cells),
        "statistics": {
            s: {p: {c: asdict(of) for c, of in cs.items()} for p, cs in ps.items()} for s, ps in cells.items()
        },
        "overall": {
            names: {p: {c: asdict(of) for c, of in cs.items()} for p, cs in ps.items()}
            for names, ps in overall(outcome.rows, scenarios.values()).items()
        },
        "failures": [asdict(failure) for failure in outcome.failures],
    }
    write_atomically(folder / "summary.json", json.dumps(plain(summary), indent=2, allow_nan=False) + "\n")
    for name, data in pictures.draw(outcome.rows, cells, scenarios).items():
        write_atomically(folder / name, data)


def write_csv(path: Path, rows: Iterable[dict[str, Any]]) -> None:
    """Write score rows with the columns of `lissajous_env.score.COLUMNS`; NaN is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        writer.writerow(["" if row[name] != row[name] else row[name] for name in COLUMNS])
    write_atomically(path, text.getvalue())


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


def _table(
    title: str, policies: dict[str, dict[str, Statistics]], shown: Sequence[Shown], width: int, errors: dict[str, str]
) -> Table:
    table = _plain_table(title)
    names = [*policies, *(name for name in errors if name not in policies)]
    table.add_column("policy", style="cyan", no_wrap=True)
    room = width - max(len(name) for name in names) - 2
    columns = shown[: max(room // 14, 1)]
    for each in columns:
        table.add_column(each.title, justify="right", no_wrap=True)
    best = {each.column: _best([of[each.column] for of in policies.values()], each.better) for each in columns}
    for name in names:
        if name not in policies:
            table.add_row(escape(name), "[red]failed[/red]")
            continue
        cells = [_cell(policies[name][each.column], best[each.column]) for each in columns]
        table.add_row(escape(name), *cells)
    return table


def _plain_table(title: str) -> Table:
    return Table(
        title=title, title_justify="left", title_style="", box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False
    )


def _best(candidates: list[Statistics], better: int) -> float:
    """Best interquartile mean among the policies with most episodes that have a number; NaN for none."""
    most = max((of.n_finite / of.n for of in candidates), default=0)
    values = [of.iqm for of in candidates if of.n_finite / of.n == most]
    return better * max(better * value for value in values) if most and better else np.nan


def _cell(of: Statistics, best: float) -> str:
    if not of.n_finite:
        return f"{_DASH}\n[dim](0/{of.n})[/dim]"
    value = _number(of.iqm)
    value = f"[bold green]{value}*[/]" if value == _number(best) else f"{value} "
    counted = "" if of.n_finite == of.n else f" ({of.n_finite}/{of.n})"
    return f"{value}\n[dim]{_interval(of)}{counted} [/dim]".rstrip()


def _interval(of: Statistics) -> str:
    low, high = _number(of.low), _number(of.high)
    return "" if low == high else f"{low}\N{EN DASH}{high}"


def _number(value: float) -> str:
    """Three significant digits, without an exponent where it can be; an em dash for NaN."""
    if value != value:
        return _DASH
    if value == 0 or (float(value).is_integer() and abs(value) < 1e6):
        return f"{value:.0f}"
    return (
        f"{value:#.3g}".rstrip(".")
        if 1e-3 <= abs(value) < 1000
        else f"{value:.0f}"
        if abs(value) >= 1000
        else f"{value:.1g}"
    )
