"""The README's table: `python benchmarks/table.py --out FOLDER`.

Each policy plays each scenario that it can drive, the one it is good at and those it was not made for, on the same
seeds. FOLDER is that of a benchmark, to which `table.json` and `table.md` are added; killed and called again it goes
on. Every number is the interquartile mean over the episodes with its 95 % bootstrap interval, but collisions and what
is over the limit, which are means. `sooner` is the share of the seeds on which a policy's mean detection time is below
that of the paper's method.
"""

import argparse
import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import figures
from rich.console import Console

import lissajous_env
from baselines.benchmark import clairvoyant
from baselines.benchmark.comparison import OPEN, OVER_LIMIT, Comparisons, compare, guarantee_of, limit_of
from baselines.benchmark.running import measure
from baselines.benchmark.statistics import Paired, Statistics
from baselines.benchmark.tables import SHOWN, in_words, number, shown_name
from baselines.benchmark.types import Benchmark
from lissajous_env.console.terminal import make_console, plain
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.storage.files import write_atomically

POLICIES = (
    "kuramoto-mpcc", "kuramoto-mpcc-close", "open-loop-mpcc", "consensus-mpcc", "sweep", "laps",
    "learned-intruders-safe", "learned-rough-safe", "random", "kuramoto", "consensus", "open-loop",
)  # fmt: skip
GRIDS = {"intruders": (54, 24), "rough": (90, 40), "rough-lost": (90, 40)}
"""Columns and rows of contamination where a scenario does not follow it by itself."""
COLUMNS = {
    "detection_time_mean": "detection [s]",
    OVER_LIMIT: "over limit",
    "guaranteed_detection_time": "guaranteed [s]",
    "collisions": "collisions",
    "sensed_fraction": "sensed",
    "distance_mean": "distance [m]",
}


def scenarios() -> list[Scenario]:
    """What is played: `intruders` also with rogues that appear anywhere, for which no patrol of a boundary is made."""

    def made(name: str, **changes: Any) -> Scenario:
        grid = {"task.contamination": GRIDS[name]} if name in GRIDS else {}
        return lissajous_env.scenario(name, **grid, **changes)

    inside = dataclasses.replace(made("intruders", **{"targets.entry": "inside"}), name="intruders-inside")
    names = ("evaders", "evaders-failure", "team", "intruders")
    return [*map(made, names), inside, *map(made, ("rough", "rough-lost", "redundant"))]


def as_rows(comparisons: Comparisons, played: list[Scenario]) -> list[dict[str, Any]]:
    """A row for each policy on each scenario: the numbers with their intervals, and the words of the table."""
    found = []
    for scenario in played:
        reference, against = comparisons.against[scenario.name]
        for policy, of in comparisons.cells[scenario.name].items():
            row: dict[str, Any] = {"scenario": scenario.name, "policy": policy, "reference": reference}
            row["privileged"] = policy == clairvoyant.NAME
            row["columns"] = {shown.column: _number(of, shown) for shown in SHOWN if shown.column in COLUMNS}
            row["sooner"] = _sooner(against[policy]["detection_time_mean"]) if policy in against else None
            found.append(row)
    return found


def as_table(rows: list[dict[str, Any]], played: list[Scenario]) -> dict[str, list]:
    """Columns and rows of text: a row for each policy, a scenario's name and limits in the first of its rows."""
    titles, limits = ["scenario", "policy", *COLUMNS.values(), "sooner"], {each.name: _limits(each) for each in played}
    lines: list[list[str]] = []
    named = ""
    for row in rows:
        name = row["scenario"]
        label = f"*{shown_name(row['policy'])}*" if row["privileged"] else f"`{row['policy']}`"
        cells = [row["columns"].get(column, {}).get("words", "") for column in COLUMNS]
        where = "" if name == named else f"`{name}`{limits[name]}"
        lines.append([where, label, *cells, row["sooner"]["words"] if row["sooner"] else ""])
        named = name
    return {"columns": titles, "rows": lines}


def _limits(scenario: Scenario) -> str:
    limit, (least, formation) = limit_of(scenario), guarantee_of(scenario)
    words = f", limit {number(limit)} s" if limit == limit else ""
    words += f", guarantee at least {number(least)} s" if least > scenario.task.step else ""
    if math.isnan(formation):
        return words
    return words + (f", in formation {number(formation)} s" if formation < math.inf else ", in formation never")


def markdown(table: dict[str, list]) -> str:
    """A table as Markdown has it."""
    lines = [table["columns"], ["---"] * len(table["columns"]), *table["rows"]]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _number(of: dict[str, Statistics], shown: Any) -> dict[str, Any]:
    if shown.column not in of:
        return {"n": 0, "words": ""}
    cell = of[shown.column]
    value, interval = in_words(of, shown)
    low, high = (cell.mean_low, cell.mean_high) if shown.mean else (cell.low, cell.high)
    return {
        "value": cell.mean if shown.mean else cell.iqm,
        "low": low,
        "high": high,
        "n": cell.n_finite,
        "open": of[OPEN].mean if shown.column == "guaranteed_detection_time" else 0.0,
        "at_least": cell.at_least,
        "words": "" if not cell.n_finite else f"{value} ({interval})" if interval else value,
    }


def _sooner(pair: Paired) -> dict[str, Any]:
    words = f"{100 * pair.better:.0f} %"
    if pair.better_low < pair.better_high:
        words += f" ({100 * pair.better_low:.0f}\N{EN DASH}{100 * pair.better_high:.0f})"
    return {"value": pair.better, "low": pair.better_low, "high": pair.better_high, "n": pair.n, "words": words}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=16)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/table"))
    parser.add_argument("--store", action="store_true", help="put the table into docs/figures.json, too")
    options = parser.parse_args()
    played = scenarios()
    settings = Benchmark(policies=POLICIES, episodes=options.episodes, seed=options.seed, batch=options.episodes,
                         clairvoyant=True, out=options.out)  # fmt: skip
    outcome = measure(settings, scenarios=played, console=Console(quiet=True), progress=make_console(stderr=True))
    comparisons = compare(outcome.rows, outcome.scenarios)
    rows = as_rows(comparisons, played)
    table = as_table(rows, played)
    numbers = {"episodes": options.episodes, "seed": options.seed, "rows": rows}
    numbers["limits"] = {each.name: [limit_of(each), *guarantee_of(each)] for each in played}
    write_atomically(options.out / "table.json", json.dumps(plain(numbers), indent=2) + "\n")
    text = markdown(table)
    write_atomically(options.out / "table.md", text)
    if options.store:
        figures.store({"policies": table})
    print(text, end="")
    for failure in outcome.failures:
        print(f"{failure.policy} failed on {failure.scenario}: {failure.error}")


if __name__ == "__main__":
    main()
