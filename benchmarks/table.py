"""The README's table: `python benchmarks/table.py --store`.

Plays the default cells of `lissajous benchmark` (`baselines.benchmark.types`) on the same seeds, and puts the
resulting table, `table.md`, into docs/figures.json as well. If the command is interrupted and called again, it resumes.
"""

from pathlib import Path

import figures
from rich.console import Console

from baselines.benchmark.running import measure
from baselines.benchmark.table import Table
from baselines.benchmark.types import Benchmark
from baselines.benchmark.written import markdown, table_of
from lissajous_env.console.terminal import make_console


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--episodes", type=int, default=Benchmark.episodes)
    parser.add_argument("--out", type=Path, default=Benchmark.out)
    options = parser.parse_args()
    settings = Benchmark(episodes=options.episodes, out=options.out, replays=0)
    outcome = measure(settings, console=Console(quiet=True), progress_console=make_console(stderr=True))
    table = table_of(Table.of(outcome.rows, outcome.table.scenarios))
    if options.store:
        figures.store({"policies": table})
    print(markdown(table), end="")
    for failure in outcome.failures:
        print(f"{failure.policy} failed on {failure.scenario}: {failure.error}")


if __name__ == "__main__":
    main()
