"""Scores of every policy on every scenario, for the pages of the scenarios: `python benchmarks/results.py --store`.

Every policy plays each included scenario whose robots it drives, on the same few seeds; `benchmarks/table.py` plays
fewer of them on more seeds. FOLDER contains the benchmark of each scenario. If the command is interrupted and called
again, it resumes. A number is the interquartile mean over the episodes with its 95 % bootstrap interval; for
collisions, the mean; for a guarantee, the largest, with the median and the number of episodes.
"""

import time
from pathlib import Path

import figures
from rich.console import Console

import lissajous_env
from baselines.benchmark.running import measure
from baselines.benchmark.shown import lines_of
from baselines.benchmark.statistics import SHOWN, with_numbers
from baselines.benchmark.table import Table
from baselines.benchmark.types import Benchmark, BenchmarkOutcome
from lissajous_env.console.terminal import make_console

LARGE = 10_000_000
"""Robots times targets from which on a scenario is played on one seed, by the paper's method and close competitors."""
RIVALS = ("kuramoto", "consensus", "open-loop")


def settings_for(scenario: lissajous_env.Scenario, episodes: int, out: Path) -> Benchmark:
    """Return the benchmark of a scenario; that of a large one is smaller."""
    if scenario.num_robots * scenario.target_capacity >= LARGE:
        return Benchmark((scenario.name,), RIVALS, episodes=1, out=out / scenario.name)
    return Benchmark((scenario.name,), ("all",), episodes=episodes, batch=episodes, out=out / scenario.name)


def as_table(outcome: BenchmarkOutcome) -> dict[str, list]:
    """Return a row for each policy and one for the best known plan; columns without any number are left out."""
    table = Table.of(outcome.rows, outcome.table.scenarios)
    (policies,), (bounds,) = table.estimates.values(), table.bounds.values()
    columns = with_numbers(policies, SHOWN)
    rows = [
        [f"*{line.name}*" if line.is_best_known else f"`{line.name}`", *map(str, line.entries)]
        for line in lines_of(policies, columns, bounds.best_known)
    ]
    return {"columns": ["policy", *(column.heading for column in columns)], "rows": rows}


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--scenarios", nargs="+", default=lissajous_env.scenarios())
    parser.add_argument("--episodes", type=int, default=16)
    parser.add_argument("--out", type=Path, default=Path("results/policies"))
    options = parser.parse_args()
    for name in options.scenarios:
        started = time.process_time()
        settings = settings_for(lissajous_env.scenario(name), options.episodes, options.out)
        outcome = measure(settings, console=Console(quiet=True), progress_console=make_console(stderr=True))
        table = as_table(outcome)
        figures.show(f"{name}, {settings.episodes} seeds, {time.process_time() - started:.0f} s of processors", table)
        for failure in outcome.failures:
            print(f"{failure.policy} failed on {failure.scenario}: {failure.error}")
        if options.store:
            figures.store({f"results {name}": table | {"episodes": settings.episodes}})


if __name__ == "__main__":
    main()
