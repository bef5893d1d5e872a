"""The files of a benchmark that are derived from its score rows, except the report page."""

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
from typing import Any

from baselines.benchmark import report_page
from baselines.benchmark.comparison import Comparisons
from baselines.benchmark.ratios import TAUS
from baselines.benchmark.types import Outcome
from baselines.benchmark.written import MARKDOWN, markdown, table_of
from lissajous_env.console.terminal import plain
from lissajous_env.device.devices import as_device, memory
from lissajous_env.storage.files import write_atomically
from lissajous_env.storage.folder import Folder
from lissajous_env.world.columns import NAMES as ENTRIES

NAMES = ("episodes.csv", "summary.json", MARKDOWN, report_page.NAME)
"""Files that are derived from the episodes."""


def write_files(folder: Folder, outcome: Outcome, comparisons: Comparisons) -> None:
    """Write episodes.csv, summary.json and table.md of all episodes in the folder."""
    rows = outcome.held_rows
    folder.write("episodes.csv", as_csv(rows))
    summary = summarized(outcome, rows, comparisons)
    folder.write("summary.json", json.dumps(plain(summary), indent=2, allow_nan=False) + "\n")
    folder.write(MARKDOWN, markdown(table_of(comparisons)))


def summarized(outcome: Outcome, rows: Sequence[dict[str, Any]], comparisons: Comparisons) -> dict[str, Any]:
    """Return the content of summary.json for some of an outcome's rows; the failures are those of this call.

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
        "seeds": sorted({row["seed"] for row in rows}),
        "settings": held,
        "limits": {name: of.mean_time for name, of in comparisons.bounds.items()},
        "guarantees": {
            name: {
                "limit": of.worst_case,
                "formation": of.in_formation,
                "best_known": of.best_known,
                "best_known_settled": of.best_known_settled,
            }
            for name, of in comparisons.bounds.items()
        },
        "statistics": _plain_cells(comparisons.cells),
        "against": {
            name: {
                "reference": reference,
                "policies": {p: {c: asdict(of) for c, of in cs.items()} for p, cs in ps.items()},
            }
            for name, (reference, ps) in comparisons.against.items()
        },
        "overall": _plain_cells(comparisons.overall),
        "profiles": {"ratios": TAUS, "shares": comparisons.profiles},
        "failures": [asdict(failure) for failure in outcome.failures],
        "left_out": [asdict(refusal) for refusal in outcome.left_out],
    }


def _plain_cells(cells: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> dict[str, Any]:
    return {s: {p: {c: asdict(of) for c, of in cs.items()} for p, cs in ps.items()} for s, ps in cells.items()}


def write_csv(path: Path, rows: Iterable[dict[str, Any]]) -> None:
    """Write score rows to a CSV file."""
    write_atomically(path, as_csv(rows))


def as_csv(rows: Iterable[dict[str, Any]]) -> str:
    """Return score rows as CSV: `lissajous_env.world.columns.NAMES`, then columns of scenarios; NaN is empty."""
    rows, text = list(rows), io.StringIO()
    columns = dict.fromkeys((*ENTRIES, *(name for row in rows for name in row)))
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
