"""The worst case if a robot is removed, for each of the robots: `python benchmarks/lost.py --store`.

One robot of `evaders` is removed after 20 s. A cell shows the longest worst-case undetected time of all seeds, `>` if
it was still growing at the end of one of them, and the mean number of collisions.
"""

import warnings
from typing import Any

import figures

import baselines
import lissajous_env
from lissajous_env.parameters.assumptions import AssumptionWarning
from lissajous_env.world.columns import COLLISIONS, OPEN, WORST_CASE

POLICIES = ("kuramoto-mpcc", "kuramoto-mpcc-safe", "consensus-mpcc", "partition", "partition-repair", "line-abreast")
REMOVED_AT = 20.0
"""Time at which the robot is removed [s]."""


def cell_of(rows: list[dict[str, Any]]) -> str:
    """Return the content of a cell for the score rows of its episodes."""
    worst = max(row[WORST_CASE.name] for row in rows)
    is_open = any(row[OPEN.name] for row in rows)
    collisions = sum(row[COLLISIONS.name] for row in rows) / len(rows)
    return f"{'> ' if is_open else ''}{worst:.3g} s, {collisions:.2g} collisions"


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--episodes", type=int, default=16)
    parser.add_argument("--seed", type=int, default=20_000)
    options = parser.parse_args()
    warnings.simplefilter("ignore", AssumptionWarning)
    robots, seeds = range(5), range(options.seed, options.seed + options.episodes)
    rows = []
    for name in POLICIES:
        cells = []
        for robot in robots:
            scenario = lissajous_env.scenario("evaders", **{"faults.removed": ((robot, REMOVED_AT),)})
            cells.append(cell_of(lissajous_env.evaluate(baselines.make(name, scenario, len(seeds)), scenario, seeds)))
        rows.append([f"`{name}`", *cells])
    table = {"columns": ["policy", *(f"robot {robot}" for robot in robots)], "rows": rows}
    figures.publish("lost", "evaders, one robot removed", table, options.store)


if __name__ == "__main__":
    main()
