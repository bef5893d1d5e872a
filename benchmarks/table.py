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
from pathlib import Path
from typing import Any

from rich.console import Console

import lissajous_env
from baselines.benchmark import clairvoyant
from baselines.benchmark.comparison import OPEN, OVER_LIMIT, Comparisons, compare, limit_of
from baselines.benchmark.running import measure
from baselines.benchmark.statistics import Paired, Statistics
from baselines.benchmark.tables import SHOWN, in_words, shown_name
from baselines.benchmark.types import Benchmark
from lissajous_env.console.terminal import make_console, plain
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.storage.files import write_atomically

POLICIES = (
    "kuramoto-mpcc", "kuramoto-mpcc-safe", "open-loop-mpcc", "consensus-gvf", "sweep", "laps", "learned-intruders",
    "learned-intruders-safe", "learned-rough", "kuramoto", "open-loop", "random", "still",
)  # fmt: skip
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
    names = [name for name in ("team", "evaders", "evaders-failure") if name in lissajous_env.scenarios()]
    inside = lissajous_env.scenario("intruders", **{"targets.entry": "inside"})
    inside = dataclasses.replace(inside, name="intruders-inside")
    made = [lissajous_env.scenario(name) for name in (*names, "intruders")]
    return [*made, inside, *(lissajous_env.scenario(name) for name in ("rough", "rough-lost", "redundant"))]


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


def markdown(rows: list[dict[str, Any]], limits: dict[str, float]) -> str:
    """The table, with a row for each policy and a scenario's name in the first of its rows."""
    kept = [name for name in COLUMNS if any(row["columns"].get(name, {}).get("n") for row in rows)]
    head = ["scenario", "policy", *(COLUMNS[name] for name in kept), "sooner"]
    lines = [head, ["---"] * len(head)]
    named = ""
    for row in rows:
        name, limit = row["scenario"], limits[row["scenario"]]
        where = f"`{name}`" + (f", limit {limit:.2f} s" if limit == limit else "") if name != named else ""
        label = f"*{shown_name(row['policy'])}*" if row["privileged"] else f"`{row['policy']}`"
        cells = [row["columns"].get(column, {}).get("words", "") for column in kept]
        lines.append([where, label, *cells, row["sooner"]["words"] if row["sooner"] else ""])
        named = name
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
    options = parser.parse_args()
    played = scenarios()
    settings = Benchmark(policies=POLICIES, episodes=options.episodes, seed=options.seed, batch=options.episodes,
                         clairvoyant=True, out=options.out)  # fmt: skip
    outcome = measure(settings, scenarios=played, console=Console(quiet=True), progress=make_console(stderr=True))
    comparisons = compare(outcome.rows, outcome.scenarios)
    rows, limits = as_rows(comparisons, played), {scenario.name: limit_of(scenario) for scenario in played}
    text = markdown(rows, limits)
    table = {"episodes": options.episodes, "seed": options.seed, "limits": limits, "rows": rows}
    write_atomically(options.out / "table.json", json.dumps(plain(table), indent=2) + "\n")
    write_atomically(options.out / "table.md", text)
    print(text, end="")
    for failure in outcome.failures:
        print(f"{failure.policy} failed on {failure.scenario}: {failure.error}")


if __name__ == "__main__":
    main()
