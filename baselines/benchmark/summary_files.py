"""The files of a benchmark that are derived from its score rows, except the report page."""

import csv
import io
import json
import math
import os
import platform
import shlex
import sys
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from baselines.benchmark.shown_columns import RATIOS
from baselines.benchmark.statistics import profile_over_scenarios
from baselines.benchmark.table import Group, Table
from baselines.benchmark.types import Outcome
from baselines.benchmark.written import MARKDOWN, markdown, table_of
from lissajous_env.console.terminal import plain
from lissajous_env.device.devices import as_device, memory
from lissajous_env.storage.files import write_atomically
from lissajous_env.storage.folder import Folder
from lissajous_env.world.columns import NAMES

CSV, SUMMARY, REPORT = "episodes.csv", "summary.json", "report.html"
FILES = (CSV, SUMMARY, MARKDOWN, REPORT)
"""Files that are derived from the episodes."""
TAUS = (1.0, 1.05, 1.1, 1.25, 1.5, 2.0, 3.0, 5.0, 10.0)
"""Ratios at which the profiles of summary.json are evaluated."""


def write_files(folder: Folder, outcome: Outcome, rows: Sequence[dict[str, Any]]) -> None:
    """Write episodes.csv, summary.json and table.md of all episodes in the folder, of which `rows` are the scores."""
    folder.write(CSV, as_csv(rows))
    summary = summarized(outcome, outcome.table)
    folder.write(SUMMARY, json.dumps(plain(summary), indent=2, allow_nan=False) + "\n")
    folder.write(MARKDOWN, markdown(table_of(outcome.table)))


def summarized(outcome: Outcome, table: Table) -> dict[str, Any]:
    """Return the content of summary.json for a table of some of an outcome's rows; the failures are those of this call.

    `limits` has the lower bound of the mean detection time of each scenario [s], null without one, and `against` the
    comparison of each policy with the reference on the same seeds. `profiles` has, for the ratios to a bound and to the
    best policy, the share of the episodes that do not exceed each of `ratios`, and its interval over scenarios.
    """
    held = outcome.held
    return {
        "machine": machine(held["device"]),
        "versions": versions(),
        "command": command(),
        "elapsed_s": outcome.elapsed,
        "seeds": sorted({row["seed"] for row in table.rows}),
        "settings": held,
        "limits": {name: of.mean_time for name, of in table.bounds.items()},
        "guarantees": {
            name: {
                "limit": of.worst_case,
                "formation": of.in_formation,
                "best_known": of.best_known,
                "best_known_settled": of.best_known_settled,
            }
            for name, of in table.bounds.items()
        },
        "statistics": table.estimates,
        "against": table.against,
        "overall": table.overall,
        "profiles": {
            "ratios": TAUS,
            "shares": {of.name: _profiles(of) for of in table.groups() if of.name in table.overall},
        },
        "failures": outcome.failures,
        "left_out": outcome.left_out,
    }


def _profiles(group: Group) -> dict[str, dict[str, list[tuple[float, ...]]]]:
    """Return by policy and ratio, for each of `TAUS`, the share of episodes and its interval."""
    return {
        policy: {
            column.name: list(zip(*profile_over_scenarios(group.strata(policy, column), TAUS), strict=True))
            for column in RATIOS
        }
        for policy in group.rows
    }


def write_csv(path: Path, rows: Iterable[dict[str, Any]]) -> None:
    """Write score rows to a CSV file."""
    write_atomically(path, as_csv(rows))


def as_csv(rows: Iterable[dict[str, Any]]) -> str:
    """Return score rows as CSV: `lissajous_env.world.columns.NAMES`, then columns of scenarios; NaN is empty."""
    rows, text = list(rows), io.StringIO()
    columns = dict.fromkeys((*NAMES, *(name for row in rows for name in row)))
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        values = [row.get(name, math.nan) for name in columns]
        writer.writerow(["" if value != value else value for value in values])
    return text.getvalue()


def command() -> str:
    """Return the command line of this process."""
    return shlex.join(sys.argv)


def machine(device: str) -> dict[str, Any]:
    """Return a description of this machine and of a device."""
    warp_device = as_device(device)
    return {
        "cpu": cpu_model(),
        "cores": os.cpu_count(),
        "memory_gib": round(memory() / 2**30, 1),
        "os": platform.platform(),
        "device": device if warp_device.is_cpu else f"{device}: {warp_device.name}",
    }


def versions() -> dict[str, str]:
    """Return the versions of Python and the packages on which the numbers depend."""
    names = ("lissajous-env", "numpy", "warp-lang", "gymnasium", "pettingzoo")
    return {"python": platform.python_version()} | {name: version(name) for name in names}


def cpu_model() -> str:
    """Return the name of this machine's processor."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.machine()


def provenance(device: str) -> dict[str, str]:
    """Return in words the command, machine and versions of numbers that are computed now."""
    of = machine(device)
    return {
        "command": command(),
        "machine": f"{of['cpu']}, {of['cores']} cores, {of['device']}",
        "versions": ", ".join(f"{name} {number}" for name, number in versions().items()),
    }
