"""The report of a benchmark with episodes that it can play: the worst of each policy, played again from their seeds."""

import threading
from collections.abc import Container, Iterable, Mapping, Sequence
from itertools import zip_longest
from typing import Any

from rich.console import Console

from baselines.benchmark.local import on_cores
from baselines.benchmark.report_page import Key, page, worst_first
from baselines.benchmark.results_folder import REPORT
from baselines.benchmark.table import Row
from baselines.benchmark.types import BenchmarkOutcome, Cell
from lissajous_env.console.terminal import bar
from lissajous_env.episodes.recording import record_all
from lissajous_env.identity import provenance
from lissajous_env.replay.contents import BRIEF, contents
from lissajous_env.storage.folder import Folder
from lissajous_env.wording import where_raised

_TOGETHER = 4
"""Episodes that are recorded together: each requires tens of megabytes meanwhile."""


def write_report(folder: Folder, outcome: BenchmarkOutcome, console: Console) -> str:
    """Write `report.html` of all episodes of the folder, with replays of those of this call; return a line about these.

    The choice of the replays depends only on the score rows, so that a benchmark that was interrupted has the same.
    """
    table, cells = outcome.table, outcome.playable
    rows = worst_first(table.rows, table.scenarios)
    wanted = chosen(outcome.settings.replays, rows, cells, table.references)
    recorded, failed = _recorded(wanted, cells, outcome.device, console) if wanted else ({}, [])
    origin = provenance(outcome.stored["device"])
    folder.write(REPORT, page(table, rows, recorded, origin, outcome.failures, outcome.theorem))
    note = f"{REPORT} plays {len(recorded):,} of the episodes; --replays NUMBER adds more"
    return "\n".join([note, *(f"not replayed: {words}" for words in failed)]) if wanted else ""


def chosen(
    count: int, rows: Iterable[Row], cells: Container[tuple[str, str]], references: Mapping[str, str]
) -> list[Key]:
    """Return the episodes to replay: the worst of each policy on each scenario, then the second worst, and so on.

    Before each stands the episode of the same seed of the policy that the others of its scenario are compared with.

    Args:
        count: Number of episodes, without those that stand before them.
        rows: Score rows, the worst first.
        cells: Scenario and policy of those that can be played.
        references: Policy that the others of a scenario are compared with.
    """
    turns: dict[tuple[str, str], list[Key]] = {}
    for row in rows:
        if (place := (row["scenario"], row["policy"])) in cells:
            turns.setdefault(place, []).append((*place, row["seed"]))
    every = {key for keys in turns.values() for key in keys}
    in_turn = [key for turn in zip_longest(*turns.values()) for key in turn if key is not None][:count]
    both = [key for s, p, seed in in_turn for key in ((s, references.get(s, ""), seed), (s, p, seed))]
    return [key for key in dict.fromkeys(both) if key in every]


def _recorded(
    keys: Sequence[Key], cells: Mapping[tuple[str, str], Cell], device: Any, console: Console
) -> tuple[dict[Key, dict[str, Any]], list[str]]:
    """Play episodes again; return their contents for the page, and a sentence for each policy that raised."""
    seeds_of: dict[tuple[str, str], list[int]] = {}
    for scenario, policy, seed in keys:
        seeds_of.setdefault((scenario, policy), []).append(seed)
    recorded: dict[Key, dict[str, Any]] = {}
    failed: list[str] = []

    def record_cell(cell: Cell, seeds: list[int], stopped: threading.Event) -> None:
        if stopped.is_set():
            return
        progress.update(task, description=str(cell))
        try:
            policy = cell.factory(cell.scenario, min(len(seeds), _TOGETHER), device)
            recordings = record_all(policy, cell.scenario, seeds, device)
        except (Exception, SystemExit) as error:
            failed.append(f"{cell.policy} on {cell.scenario.name}: {where_raised(error)}")
            return
        for seed, recording in zip(seeds, recordings, strict=True):
            recording.score["policy"] = cell.policy
            recorded[cell.scenario.name, cell.policy, seed] = contents(recording, BRIEF)
        progress.advance(task, len(seeds))

    with bar(console, "{task.completed} replays") as progress:
        task = progress.add_task("", total=len(keys))
        on_cores([(cells[place], seeds) for place, seeds in seeds_of.items()], device, record_cell)
    return {key: recorded[key] for key in keys if key in recorded}, failed
