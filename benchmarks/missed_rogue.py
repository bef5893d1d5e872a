"""Rogues that know the future, compared with the worst case of the grid: `python benchmarks/missed_rogue.py`.

In each episode the path on which a rogue stays undetected for longest is searched, and replayed as an ordinary target.
The table has, for each scenario, over its episodes: how many rogues are undetected for the time that the contamination
stage reports, up to that in which a rogue crosses a cell, and a control step; how many for longer, and for less; the
median, least and greatest difference; and the processor time of a search. `--store` puts the table into
docs/figures.json.
"""

import time
from collections.abc import Sequence
from typing import NamedTuple

import figures
import numpy as np

import baselines
import lissajous_env
from baselines.policies.base import UnsuitableScenarioError
from lissajous_env.episodes.missed import play
from lissajous_env.episodes.missed.played import crossing_steps, replay
from lissajous_env.episodes.missed.search import longest_path
from lissajous_env.world.columns import WORST_CASE

CARS = ("kuramoto-mpcc", "open-loop-mpcc", "consensus-mpcc", "arc-mpcc", "kuramoto-gvf", "open-loop-gvf", "sweep")
CARS = (*CARS, "laps", "random", "still", "line-abreast", "partition", "partition-repair", "periodic-paths")
POINTS = "kuramoto", "open-loop", "tracked-reference", "consensus", "arc", "random", "still"
TITLES = ("scenario", "episodes", "within a cell", "longer", "shorter", "a cell [s]")
TITLES = (*TITLES, "rogue less grid [s], median", "least", "greatest", "search [ms], median")


class Result(NamedTuple):
    """Times of an episode [s]."""

    scenario: str
    less_grid: float
    """Undetected time of the rogue, less the worst case of the grid."""
    cell: float
    """Time in which a rogue crosses a cell, and a control step."""
    cost: float
    """Processor time of the search."""


def measured(name: str, policy: str, seeds: Sequence[int]) -> list[Result]:
    """Search the rogue that a policy misses in some episodes, one after the other; none if it does not suit."""
    results, scenario = [], lissajous_env.scenario(name)
    cell = (crossing_steps(scenario) + 1) * scenario.task.step
    try:
        acting = baselines.make(policy, scenario, 1)
    except UnsuitableScenarioError:
        return results
    for seed in seeds:
        played = play(acting, scenario, seed)
        began = time.process_time()
        path = longest_path(played)
        cost = time.process_time() - began
        if path is not None:
            undetected, *_ = replay(played, path)
            results.append(Result(name, undetected - played.score[WORST_CASE.name], cell, cost))
    return results


def row_of(name: str, results: Sequence[Result]) -> list[str]:
    """Return the row of some episodes."""
    more = np.array([result.less_grid for result in results])
    outside = np.where(np.abs(more) > np.array([result.cell for result in results]) + 1e-6, np.sign(more), 0)
    counts = [len(results), *(np.count_nonzero(outside == side) for side in (0, 1, -1))]
    cells = {f"{result.cell:.2g}" for result in results}
    spread = [f"{value:.2f}" for value in (np.median(more), more.min(), more.max())]
    cost = f"{1e3 * np.median([result.cost for result in results]):.0f}"
    return [name, *map(str, counts), cells.pop() if len(cells) == 1 else "", *spread, cost]


def main() -> None:
    parser = figures.parser(__doc__)
    known = [name for name in lissajous_env.scenarios() if lissajous_env.scenario(name).task.contamination]
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--scenarios", nargs="+", default=known)
    options = parser.parse_args()
    rows, results = [], []
    for name in options.scenarios:
        policies = [policy for policy in dict.fromkeys((*CARS, *POINTS)) if policy in baselines.names(name)]
        of_scenario = [result for policy in policies for result in measured(name, policy, range(options.seeds))]
        rows.append(row_of(f"`{name}`", of_scenario))
        results += of_scenario
        print(*rows[-1], sep=" | ", flush=True)
    rows.append(row_of("all", results))
    figures.publish("missed rogue", "missed rogue", {"columns": TITLES, "rows": rows}, options.store)


if __name__ == "__main__":
    main()
