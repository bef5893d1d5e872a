"""Rogues that know the future, compared with the worst case of the grid: `python benchmarks/witness.py`.

In each episode a rogue stays undetected for as long as it can and is replayed as an ordinary target. Its time is a
lower bound of the worst case, `task.conservative` is an upper bound, `guaranteed_detection_time` rounds to the cells of
its grid. The table has the difference of the rogue's time from the latter over the episodes; the numbers of episodes in
which it is within the time in which a rogue crosses a cell, above it, and below it; and the median of the rogue's time
divided by the upper bound. A rogue is detected within a step, and the grid counts whole steps, so a difference of up to
one step is ignored. `--store` puts the table
into docs/figures.json, `--out` writes a line of JSON for each episode.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import figures
import numpy as np

import baselines
import lissajous_env
from lissajous_env.episodes.witness import Witness, witnesses_of

PLAYED = {
    "evaders": ("kuramoto-mpcc", "open-loop-mpcc", "kuramoto-gvf", "sweep", "laps", "random"),
    "evaders-failure": ("kuramoto-mpcc", "open-loop-mpcc", "laps"),
    "team": ("kuramoto-mpcc", "open-loop-mpcc", "laps"),
    "redundant": ("kuramoto", "open-loop"),
}
TITLES = (
    "episodes",
    "rogue less grid [s], median",
    "least",
    "most",
    "within a cell",
    "above",
    "below",
    "over the proved",
)
_EXACT = 1e-6


def row_of(rogue: Witness) -> dict[str, Any]:
    """Return the times of a rogue and of the grid [s]."""
    times = {"rogue": rogue.undetected, "grid": rogue.stated, "proved": rogue.proved, "cell": rogue.resolution}
    return {"scenario": rogue.played.scenario.name, "policy": rogue.policy, "seed": rogue.played.seed, **times}


def cells_of(rows: list[dict[str, Any]], step: float) -> list[str]:
    """Return the cells of a table for the episodes of a policy."""
    rogue, grid, proved, cell = (np.array([row[name] for row in rows]) for name in ("rogue", "grid", "proved", "cell"))
    more = rogue - grid
    above, below = more > cell + step + _EXACT, more < -cell - _EXACT
    shares = [f"{100 * np.mean(each):.3g} %" for each in (~above & ~below, above, below)]
    spread = [f"{value:.2f}" for value in (np.median(more), more.min(), more.max())]
    return [str(len(rows)), *spread, *shares, f"{np.median(rogue / np.maximum(proved, step)):.2f}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=32)
    parser.add_argument("--scenarios", nargs="+", default=tuple(PLAYED))
    parser.add_argument("--out", type=Path)
    parser.add_argument("--store", action="store_true", help="put the table into docs/figures.json, too")
    options = parser.parse_args()
    table, lines = [], []
    for name in options.scenarios:
        scenario = lissajous_env.scenario(name)
        for policy in PLAYED[name]:
            acting = baselines.make(policy, scenario, options.seeds)
            rows = [row_of(rogue) for rogue in witnesses_of(acting, scenario, range(options.seeds)) if rogue]
            lines += [json.dumps(row) for row in rows]
            table.append([f"`{name}`, `{policy}`", *cells_of(rows, scenario.task.step)])
            print(*table[-1], sep="  ", flush=True)
    made = {"columns": ["", *TITLES], "rows": table}
    figures.show(f"{options.seeds} seeds", made)
    if options.out is not None:
        options.out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    if options.store:
        figures.store({"witness": made})


if __name__ == "__main__":
    main()
