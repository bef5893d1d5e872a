"""Worst-case undetected times on finer grids, and with longer sensors: `python benchmarks/cells.py`.

A grid closes gaps between discs that are narrower than a cell, as if the sensing radius were a little longer. The table
has, for some scenarios and policies, the mean `guaranteed_detection_time` over the same episodes [s]: on a grid, on
grids whose cells are half and a third as long, and on the finest of these with a sensing radius that is longer by a
quarter and by half of a cell of the first grid. Robots are on open ground in all of them. `--store` puts the table into
docs/figures.json.
"""

from typing import Any

import figures
import numpy as np

import baselines
import lissajous_env
from lissajous_env.world.columns import WORST_CASE

CASES = (
    ("hall", "kuramoto-mpcc", (80, 50)),
    ("hall", "open-loop-mpcc", (80, 50)),
    ("evaders", "kuramoto-mpcc", (90, 40)),
    ("evaders", "open-loop-mpcc", (90, 40)),
    ("evaders-failure", "kuramoto-mpcc", (90, 40)),
    ("team", "kuramoto-mpcc", (80, 80)),
)
CHANGES = (1, 0.0), (2, 0.0), (3, 0.0), (3, 0.25), (3, 0.5)
"""Factor of the columns and rows, and increase of the radius [cell of the first grid]."""
TITLES = ("scenario, policy", "grid", "cell [sensing radius]", "worst case [s]", "cells / 2", "cells / 3")
TITLES = (*TITLES, "cells / 3, radius + cell / 4", "cells / 3, radius + cell / 2")
_FIRST_SEED = 100


def row_of(name: str, policy: str, grid: tuple[int, int], episodes: int) -> list[str]:
    """Return a row of the table."""
    scenario = lissajous_env.scenario(name, **{"task.boundary": "open"})
    radius, cell = scenario.sensing_radius, 2 * scenario.curve.half_width / (grid[0] - 1)
    times = []
    for factor, more in CHANGES:
        changed: dict[str, Any] = {"task.contamination": tuple(factor * cells for cells in grid)}
        variant = lissajous_env.scenario(scenario, **changed | {"sensing.radius": radius + more * cell})
        rows = lissajous_env.evaluate(
            baselines.make(policy, variant, episodes), variant, range(_FIRST_SEED, _FIRST_SEED + episodes)
        )
        times.append(np.mean([row[WORST_CASE.name] for row in rows]))
    cells = [f"{grid[0]} x {grid[1]}", f"{cell / radius:.3f}", *(f"{time:.3g}" for time in times)]
    return [f"`{name}`, `{policy}`", *cells]


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--episodes", type=int, default=6)
    options = parser.parse_args()
    table = {"columns": TITLES, "rows": [row_of(*case, options.episodes) for case in CASES]}
    figures.publish("cells", "cells", table, options.store)


if __name__ == "__main__":
    main()
