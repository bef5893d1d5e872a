"""Rogues that know the future, compared with the worst case of the grid: `python benchmarks/witness.py`.

In each episode a rogue stays undetected for about as long as the contamination stage reports, and is replayed as an
ordinary target. The table has, for each scenario, over its episodes: how many rogues are undetected for the reported
time, up to that in which a rogue crosses a cell, and a control step; how many for longer, and for less; how many for
less than the lower bound of the worst case, by more than a step; the median, least and greatest difference. `--finer`
plays the episodes that are longer or shorter on grids of cells a third as long, and has a table of how many of their
rogues agree with these, up to the same time. `--cost` measures the time of a witness beside that of the contamination
stage. `--out` appends a line of JSON for each episode, and resumes after the last episode of an earlier call.
`--store` puts the table into docs/figures.json.
"""

import json
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import figures
import numpy as np

import baselines
import lissajous_env
from lissajous_env.episodes.witness import Witness, witnesses_of
from lissajous_env.episodes.witness.nearest import longest_ways
from lissajous_env.episodes.witness.played import Played, play, resolution
from lissajous_env.episodes.witness.replayed import replay

CARS = ("kuramoto-mpcc", "open-loop-mpcc", "consensus-mpcc", "arc-mpcc", "kuramoto-gvf", "open-loop-gvf", "sweep")
CARS = (*CARS, "laps", "random", "still", "line-abreast", "partition", "partition-repair", "periodic-paths")
POINTS = "kuramoto", "open-loop", "tracked-reference", "consensus", "arc", "random", "still"
TITLES = ("scenario", "episodes", "within a cell", "longer", "shorter", "below the lower bound", "a cell [s]")
TITLES = (*TITLES, "rogue less grid [s], median", "least", "greatest")
FINER_TITLES = ("scenario", "longer or shorter", "confirmed by a finer grid")
COST_TITLES = ("", "contamination stage [ms per episode]", "witness [ms per episode]", "ratio")
COSTS = ("evaders", "kuramoto-mpcc"), ("evaders", "open-loop-mpcc"), ("evaders-failure", "kuramoto-mpcc")
COSTS = (*COSTS, ("team", "kuramoto-mpcc"), ("redundant", "kuramoto"), ("hall", "kuramoto-mpcc"))
_EXACT = 1e-6
_FINER, _MOST_CELLS = 3, 60_000
"""Factor of a finer grid, and cells from which on there is none."""
_ROUNDS = 3
_LABELS = 200_000_000
"""Limit on the labels of episodes that are played at once, each of which requires 8 bytes."""


def row_of(rogue: Witness) -> dict[str, Any]:
    """Return the times of a rogue and of the grid [s]."""
    step = rogue.played.scenario.task.step
    cell = resolution(rogue.played.scenario) * step + step
    found = {"scenario": rogue.played.scenario.name, "policy": rogue.policy, "seed": rogue.played.seed}
    return found | {"rogue": rogue.undetected, "grid": rogue.stated, "cell": cell, "bound": rogue.resolution + step}


def table_of(rows: Sequence[dict[str, Any]]) -> figures.Table:
    """Return the table of some episodes: a row for each scenario, and one for all."""
    lines = []
    for name in [*dict.fromkeys(row["scenario"] for row in rows), "all"]:
        of = [row for row in rows if name in (row["scenario"], "all")]
        more, outside = np.array([row["rogue"] - row["grid"] for row in of]), np.array([is_outside(row) for row in of])
        counts = [len(of), *(np.count_nonzero(outside == side) for side in (0, 1, -1))]
        counts.append(np.count_nonzero(more < -np.array([row["bound"] for row in of]) - _EXACT))
        size = f"{of[0]['cell']:.2g}" if name != "all" else ""
        spread = [f"{value:.2f}" for value in (np.median(more), more.min(), more.max())]
        lines.append([name if name == "all" else f"`{name}`", *map(str, counts), size, *spread])
    return {"columns": TITLES, "rows": lines}


def finer_table_of(rows: Sequence[dict[str, Any]]) -> figures.Table:
    """Return the table of the episodes that differ by more than a cell, played on finer grids."""
    lines = []
    for name in dict.fromkeys(row["scenario"] for row in rows):
        of = [row for row in rows if row["scenario"] == name and is_outside(row) != 0]
        agree = confirmed(of)
        lines.append([f"`{name}`", str(len(of)), "too many cells" if agree is None else str(agree)])
    return {"columns": FINER_TITLES, "rows": lines}


def is_outside(row: dict[str, Any]) -> int:
    """Return 1 for a rogue that is undetected for longer than the grid reports, by more than a cell; -1 for less."""
    more = row["rogue"] - row["grid"]
    return int(np.sign(more)) if abs(more) > row["cell"] + _EXACT else 0


def confirmed(rows: Sequence[dict[str, Any]]) -> int | None:
    """Return how many rogues of a scenario agree with a finer grid; None if it would have too many cells."""
    found = 0
    for policy in dict.fromkeys(row["policy"] for row in rows):
        of = [row for row in rows if row["policy"] == policy]
        columns, lines = (
            _FINER * cells for cells in lissajous_env.scenario(of[0]["scenario"]).task.contamination or ()
        )
        if columns * lines > _MOST_CELLS:
            return None
        scenario = lissajous_env.scenario(of[0]["scenario"], **{"task.contamination": (columns, lines)})
        for first in range(0, len(of), 16):
            some = of[first : first + 16]
            acting = baselines.make(policy, scenario, len(some))
            scores = lissajous_env.evaluate(acting, scenario, [row["seed"] for row in some])
            finer = [float(score["guaranteed_detection_time"]) for score in scores]
            pairs = zip(some, finer, strict=True)
            found += sum(abs(row["rogue"] - value) <= row["cell"] + _EXACT for row, value in pairs)
    return found


def measured(names: Sequence[str], seeds: int, together: int, out: Path | None) -> list[dict[str, Any]]:
    """Play the episodes, some seeds of every policy before further seeds, and return a row for each."""
    lines = out.read_text(encoding="utf-8").splitlines() if out is not None and out.exists() else []
    rows = [json.loads(line) for line in lines]
    done = {(row["scenario"], row["policy"], row["seed"]) for row in rows}
    for first in range(0, seeds, together):
        for name in names:
            scenario = lissajous_env.scenario(name)
            for policy in [each for each in dict.fromkeys((*CARS, *POINTS)) if each in baselines.names(scenario)]:
                wanted = [seed for seed in range(first, first + together) if (name, policy, seed) not in done]
                at_once = max(_LABELS // labels_of(scenario), 1)
                for batch in [wanted[k : k + at_once] for k in range(0, len(wanted), at_once)]:
                    acting = baselines.make(policy, scenario, len(batch))
                    found = witnesses_of(acting, scenario, batch, prove=False)
                    new = [row_of(rogue) for rogue in found if rogue is not None]
                    rows += new
                    if out is not None:
                        with out.open("a", encoding="utf-8") as file:
                            file.writelines(json.dumps(row) + "\n" for row in new)
                    print(name, policy, f"seeds {batch[0]} to {batch[-1]}", flush=True)
    return rows


def labels_of(scenario: lissajous_env.Scenario) -> int:
    """Return the number of labels that the search reads of an episode."""
    hops = scenario.spreading
    return scenario.task.steps // hops.period * hops.columns * hops.rows


def costs_of(name: str, policy: str, worlds: int) -> list[str]:
    """Return a row of the costs of the stage and of a witness, measured by turns on the same episodes."""
    scenario = lissajous_env.scenario(name)
    bare = lissajous_env.scenario(scenario, **{"task.contamination": None})
    worlds = min(worlds, max(_LABELS // labels_of(scenario), 1))
    episodes = play(baselines.make(policy, scenario, worlds), scenario, list(range(worlds)))
    sides: list[tuple[Callable[[], Any], list[float]]] = [
        (lambda made=made: repeat(made, episodes), []) for made in (scenario, bare)
    ]
    sides.append((lambda: replay(episodes, [each.way for each in longest_ways(episodes) if each.way], prove=False), []))
    for _ in range(_ROUNDS):
        for act, times in sides:
            began = time.process_time()
            act()
            times.append(time.process_time() - began)
    whole, alone, witness = (1e3 * statistics.median(times) / worlds for _, times in sides)
    cells = [f"{whole - alone:.3g}", f"{witness:.3g}", f"{witness / (whole - alone):.2g}"]
    return [f"`{name}`, `{policy}`", *cells]


def repeat(scenario: lissajous_env.Scenario, episodes: Sequence[Played]) -> None:
    """Repeat episodes by their actions."""
    simulation = lissajous_env.Simulation(scenario, len(episodes), threads=1)
    simulation.reset(seeds=[each.seed for each in episodes])
    for now in range(1, episodes[0].steps + 1):
        simulation.step(np.stack([each.action[now] for each in episodes]))


def main() -> None:
    parser = figures.parser(__doc__)
    known = [name for name in lissajous_env.scenarios() if lissajous_env.scenario(name).task.contamination]
    parser.add_argument("--seeds", type=int, default=32)
    parser.add_argument("--together", type=int, default=16, help="seeds of every policy before further ones")
    parser.add_argument("--scenarios", nargs="+", default=known)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--finer", action="store_true", help="check the others on finer grids instead")
    parser.add_argument("--cost", action="store_true", help="measure times instead")
    options = parser.parse_args()
    if options.cost:
        rows = [costs_of(*each, options.together) for each in COSTS if each[0] in options.scenarios]
        made, name = {"columns": COST_TITLES, "rows": rows}, "witness cost"
    else:
        rows = measured(options.scenarios, options.seeds, options.together, options.out)
        made, name = (finer_table_of(rows), "witness finer") if options.finer else (table_of(rows), "witness")
    figures.publish(name, name, made, options.store)


if __name__ == "__main__":
    main()
