"""The report of a benchmark: tables for the terminal, and the files that are made of its score rows."""

import csv
import io
import json
import os
import platform
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from baselines.statistics import Statistics, summarize
from baselines.stored import NUMBER_COLUMNS, as_settings, plain
from lissajous_env.device import as_device
from lissajous_env.files import write_atomically
from lissajous_env.folder import Folder
from lissajous_env.scenario import Faults, Scenario
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
    Shown("spacing_factor", "spacing\nfactor", -1),
    Shown("recovery_time", "recovery\n\\[s]", -1),
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


def wide_console() -> Console:
    """Console as wide as the terminal, or 120 columns where the output goes to a file."""
    console = Console()
    return console if console.is_terminal or "COLUMNS" in os.environ else Console(width=120)


def print_tables(console: Console, outcome: "Outcome") -> None:
    """Print a table for each scenario, one over all scenarios of a kind of robot, and what failed."""
    cells, scenarios = statistics(outcome.rows), outcome.scenarios
    for name, scenario in scenarios.items():
        title = f"[b]{escape(name)}[/b]  N = {scenario.num_robots}, T_max = {scenario.detection_time_bound:.3g} s"
        errors = {failure.policy: failure.error for failure in outcome.failures if failure.scenario == name}
        # Without a fault there is nothing to recover from.
        shown = [each for each in SHOWN if each.column != "recovery_time" or scenario.faults != Faults()]
        console.print(_table(console, title, cells.get(name, {}), shown, errors), "")
    for names, policies in overall(outcome.rows, scenarios).items():
        console.print(_table(console, f"[b]over {escape(names)}[/b]", policies, _OVERALL), "")
    words = (
        f"Interquartile mean over {outcome.settings.episodes} episodes, below it the 95 % bootstrap interval; "
        f"* best; (k/n): k of n episodes had a number."
    )
    console.print(words, style="dim", highlight=False)
    for failure in outcome.failures:
        words = f"{failure.policy} failed on {failure.scenario}: {failure.error}"
        console.print(words, style="bold red", markup=False, highlight=False)
    if outcome.failures:
        console.print("Tracebacks are in summary.json.", style="red", highlight=False)
    if outcome.kept:
        words = (
            f"{outcome.kept} of {len(outcome.rows)} episodes were in {outcome.settings.out} already, not played "
            "again; to play them anew, delete that folder or take another --out."
        )
        console.print(words, style="yellow", markup=False, highlight=False)
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
    console.print(table, "")


def print_row(console: Console, row: dict[str, Any]) -> None:
    """Print one score row as a table."""
    table = _plain_table(f"[b]{escape(row['policy'])}[/b] on [b]{escape(row['scenario'])}[/b], seed {row['seed']}")
    table.add_column("score", style="cyan", no_wrap=True)
    table.add_column("value", justify="right")
    for name in NUMBER_COLUMNS:
        table.add_row(name, _number(row[name]))
    console.print(table)


NAMES = ("episodes.csv", "summary.json", "detection_time.png", "detection_time_distribution.png", "collisions.png")
"""Files that are made from the episodes."""


def write_files(folder: Folder, outcome: "Outcome") -> None:
    """Write episodes.csv, summary.json and the pictures."""
    from baselines import pictures

    folder.write("episodes.csv", as_csv(outcome.rows))
    settings, cells = outcome.settings, statistics(outcome.rows)
    summary = {
        "machine": machine(settings.device),
        "versions": versions(),
        "command": shlex.join(sys.argv),
        "elapsed_s": outcome.elapsed,
        "seeds": [settings.seed + k for k in range(settings.episodes)],
        "settings": as_settings(settings, outcome.cells),
        "statistics": {
            s: {p: {c: asdict(of) for c, of in cs.items()} for p, cs in ps.items()} for s, ps in cells.items()
        },
        "overall": {
            names: {p: {c: asdict(of) for c, of in cs.items()} for p, cs in ps.items()}
            for names, ps in overall(outcome.rows, outcome.scenarios).items()
        },
        "failures": [asdict(failure) for failure in outcome.failures],
    }
    folder.write("summary.json", json.dumps(plain(summary), indent=2, allow_nan=False) + "\n")
    for name, data in pictures.draw(outcome.rows, cells, outcome.scenarios).items():
        folder.write(name, data)


def write_csv(path: Path, rows: Iterable[dict[str, Any]]) -> None:
    """Write score rows to a file of their own, as `as_csv` has them."""
    write_atomically(path, as_csv(rows))


def as_csv(rows: Iterable[dict[str, Any]]) -> str:
    """Score rows with the columns of `lissajous_env.score.COLUMNS`; NaN is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        writer.writerow(["" if row[name] != row[name] else row[name] for name in COLUMNS])
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


def _table(
    console: Console,
    title: str,
    policies: dict[str, dict[str, Statistics]],
    shown: Sequence[Shown],
    errors: dict[str, str] | None = None,
) -> Table:
    """Table with a row for each policy and as many columns as the terminal has room for."""
    errors = errors or {}
    table = _plain_table(title)
    table.add_column("policy", style="cyan", no_wrap=True)
    for each in shown:
        table.add_column(each.title, justify="right", no_wrap=True)
    best = [_best([of[each.column] for of in policies.values()], each.better) for each in shown]
    for name, of in policies.items():
        cells = [_cell(of[each.column], mark) for each, mark in zip(shown, best, strict=True)]
        label = f"{escape(name)}\n[red]failed[/red]" if name in errors else escape(name)
        table.add_row(label, *cells)
    for name in errors:
        if name not in policies:
            table.add_row(escape(name), "[red]failed[/red]")
    if (
        len(shown) > 1
        and table.__rich_measure__(console, console.options.update(max_width=1000)).maximum > console.width
    ):
        return _table(console, title, policies, shown[:-1], errors)
    return table


def _plain_table(title: str) -> Table:
    style = {"title_justify": "left", "title_style": "", "box": box.SIMPLE_HEAD, "pad_edge": False, "show_edge": False}
    return Table(title=title, **style)


def _best(candidates: list[Statistics], better: int) -> str:
    """Best interquartile mean, as shown, of the policies with most episodes that have a number; none if all agree."""
    most = max((of.n_finite / of.n for of in candidates), default=0)
    values = [of.iqm for of in candidates if of.n_finite / of.n == most]
    if not most or not better or len({_number(of.iqm) for of in candidates}) == 1:
        return ""
    return _number(better * max(better * value for value in values))


def _cell(of: Statistics, best: str) -> str:
    if not of.n_finite:
        return f"{_DASH}\n[dim](0/{of.n})[/dim]"
    value = _number(of.iqm)
    value = f"[bold green]{value}*[/]" if value == best else f"{value} "
    counted = "" if of.n_finite == of.n else f" ({of.n_finite}/{of.n})"
    return f"{value}\n[dim]{_interval(of)}{counted} [/dim]".rstrip()


def _interval(of: Statistics) -> str:
    low, high = _number(of.low), _number(of.high)
    return "" if low == high else f"{low}\N{EN DASH}{high}"


def _number(value: float) -> str:
    """Three significant digits, but no more than three decimals; an em dash for NaN."""
    if value != value:
        return _DASH
    if float(value).is_integer() or abs(value) >= 100:
        return f"{value:.0f}"
    return f"{value:#.3g}" if abs(value) >= 0.9995 else f"{value:.3f}"
