"""The command `lissajous evaluate`: statistics of every score of one policy."""

from typing import Annotated, Any

import tyro

from baselines.benchmark import shown
from baselines.benchmark.local import batches
from baselines.benchmark.table import Table
from baselines.benchmark.theorem import about_theorem
from baselines.benchmark.written import as_csv
from baselines.commands.playing import DEFAULT_PLAY, PlayOptions, check_file, naming, with_policy
from lissajous_env.console.terminal import OutFile, Progress, RogueName
from lissajous_env.storage.files import write_atomically

_Names = Annotated[
    tuple[str, ...],
    tyro.conf.Positional,
    tyro.conf.arg(metavar="[SCENARIO ...] POLICY", help_behavior_hint=""),
]


def evaluate(
    names: _Names,
    episodes: int = 64,
    batch: int = 16,
    out: OutFile = None,
    rogues: RogueName = None,
    common: PlayOptions = DEFAULT_PLAY,
) -> None:
    """Play one policy on scenarios and print statistics of every score.

    Example:
        lissajous evaluate evaders kuramoto-mpcc --episodes 16

    Args:
        names: scenarios (names, .toml files, module:attribute); then the policy: a name, the folder of a checkpoint or
            of a plan, or module:factory. If only a folder is given, its policy is played on the scenario for which it
            was made.
        episodes: number of episodes on each scenario; more of them narrow the intervals.
        batch: number of episodes that are played together; it changes the speed, not the results.
        out: CSV file to which the score rows are written; without it they are only summarized.
    """
    check_file(out, ".csv")
    settings, cells = common.cells(names, episodes, batch, rogues)
    rows: list[dict[str, Any]] = []
    numbers = list(range(episodes))
    with Progress([(cell, numbers) for cell in cells], common.progress()) as progress:
        for k, cell in enumerate(cells):
            progress.begin(cell)
            cells[k] = with_policy(cell, settings.worlds, settings.device)
            with naming(cell):
                for finished in batches(cells[k], settings, numbers):
                    rows += finished
                    progress.finished(cell, len(finished))
    table = Table.of(rows, {cell.scenario.name: cell.scenario for cell in cells})
    console = common.console()
    (policy,) = settings.policies
    statistics = {name: policies[policy] for name, policies in table.estimates.items()}
    for name, estimates in statistics.items():
        shown.print_scores(console, policy, table.scenarios[name], estimates)
    shown.print_theorem(console, about_theorem(cells, rows, common.device))
    if out is not None:
        write_atomically(out, as_csv(rows))
        common.print(f"wrote {out}")
    common.print_json({"policy": policy, "statistics": statistics, "episodes": rows})
