"""The report of a benchmark with episodes that it can play: chosen among all, and played again from their seeds."""

import math
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rich import progress as bars
from rich.console import Console

from baselines.benchmark import written
from baselines.benchmark.bounds import as_played, overrides_of
from baselines.benchmark.local import may_be_shared
from baselines.benchmark.progress import bar
from baselines.benchmark.report_page import Played, Report, command_of
from baselines.benchmark.table import Row
from baselines.benchmark.types import Cell, Key, Outcome
from baselines.policies import registry
from baselines.policies.factories import is_ones_own, named
from lissajous_env.device.devices import cores
from lissajous_env.episodes import missed
from lissajous_env.episodes.evaluation import EpisodeRunner
from lissajous_env.episodes.recording import Recorder, Recording
from lissajous_env.identity import provenance
from lissajous_env.replay.contents import BRIEF, contents
from lissajous_env.storage.folder import Folder
from lissajous_env.wording import where_raised
from lissajous_env.world.columns import WORST_CASE
from lissajous_env.world.simulation import Simulation, fold_seed

WORDS = ("none", "few", "each", "all")
FEW = 8
"""Number of episodes that `few` replays, each of another policy or scenario."""
_TOGETHER = 4
"""Episodes that are recorded together: each requires tens of megabytes meanwhile."""


def write_report(folder: Folder, outcome: Outcome, progress: Console) -> str:
    """Write `report.html` of all episodes of the folder, and return a line about its replays.

    It depends only on the score rows and their seeds, so that a benchmark that was interrupted has the same report.
    """
    origin = provenance(outcome.stored["device"])
    report = Report(outcome.table, origin, _commands(outcome), _nameless(outcome), outcome.failures, outcome.theorem)
    ranked, cells, asked = report.ranked(), playable(outcome), outcome.settings.replays
    folder.write(written.REPORT, report.html(ranked, {}))
    wanted = with_references(chosen(asked, ranked, cells), cells, ranked, outcome.table.references())
    if not wanted:
        return ""
    played: dict[Key, Played] = {}
    failed = []
    counted = bars.TextColumn("{task.completed} replays")
    with bar(progress, bars.TextColumn("{task.description}"), counted) as shown:
        task = shown.add_task("", total=len(wanted))
        for cell, result in play_again(wanted, cells, ranked, outcome.device):
            shown.update(task, description=f"{cell.scenario.name} {cell.policy}")
            if isinstance(result, BaseException):
                failed.append(f"{cell.policy} on {cell.scenario.name}: {where_raised(result)}")
            else:
                played |= result
                shown.advance(task, len(result))
    folder.write(written.REPORT, report.html(ranked, played))
    more = "; --replays each adds the best, the median and the worst of all" if "few" in asked else ""
    said = [f"{written.REPORT} plays {len(played):,} of the episodes{more}"]
    return "\n".join([*said, *(f"not replayed: {words}" for words in failed)])


def playable(outcome: Outcome) -> dict[tuple[str, str], Cell]:
    """Return the cells of this call, and those of earlier calls whose policy and scenario are unchanged."""
    cells = {(cell.scenario.name, cell.policy): cell for cell in outcome.cells}
    for name, policies in outcome.stored["policies"].items():
        scenario = outcome.table.scenarios[name]
        for policy in policies:
            whole = scenario.digest() == outcome.stored["digests"][name]  # no extension is missing
            known = (name, policy) not in cells and whole and policy in registry.names(scenario)
            if known and registry.parts(policy) == outcome.stored["played"][policy]:
                cells[name, policy] = Cell(scenario, policy, named(policy))
    failed = {(failure.scenario, failure.policy) for failure in outcome.failures}
    return {place: cell for place, cell in cells.items() if place not in failed}


def _commands(outcome: Outcome) -> dict[str, str]:
    """Return the name of each scenario in a command, for those with a name that leads to the same one."""
    overrides, commands = outcome.settings.overrides, {}
    for given in dict.fromkeys((*outcome.settings.scenarios, *outcome.table.scenarios)):
        try:
            scenario = as_played(given, overrides)
        except (ValueError, OSError, ImportError):
            continue
        if scenario.digest() == outcome.stored["digests"].get(scenario.name):
            words = command_of(given, plain_fields(overrides_of(given, overrides)))
            commands.setdefault(scenario.name, words)
    return commands


def plain_fields(overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return the overrides that can be written on a command line."""
    return {name: value for name, value in overrides.items() if isinstance(value, (str, int, float, tuple, type(None)))}


def _nameless(outcome: Outcome) -> frozenset[str]:
    """Return the policies that were passed as Python objects, so that no command can name them."""
    policies = {policy for of in outcome.stored["policies"].values() for policy in of}
    return frozenset(name for name in policies if name not in registry.names() and not is_ones_own(name))


def check(asked: Sequence[str], cells: Iterable[Cell], seeds: range) -> None:
    """Raise ValueError for a word that selects no episode."""
    names = {(cell.scenario.name, cell.policy) for cell in cells}
    for word in asked:
        if word in WORDS or (word.isascii() and word.isdecimal()):
            continue
        if (key := _episode(word, names)) is None or key[2] not in seeds:
            raise ValueError(
                f"replays must be {', '.join(WORDS)}, a number, or SCENARIO:POLICY:SEED of an episode that is played, "
                f"got {word!r}"
            )


def chosen(asked: Sequence[str], ranked: Sequence[Row], cells: Container[tuple[str, str]]) -> list[Key]:
    """Return the episodes to replay.

    Args:
        asked: As `Benchmark.replays` has them.
        ranked: Score rows, the worst first.
        cells: Scenario and policy of those that can be played.
    """
    of: dict[tuple[str, str], list[Key]] = {}
    for row in ranked:
        if (place := (row["scenario"], row["policy"])) in cells:
            of.setdefault(place, []).append((*place, row["seed"]))
    keys: list[Key] = []
    for word in asked:
        if word == "few":
            keys += [episodes[0] for episodes in of.values()][:FEW]
        elif word == "each":
            keys += [episodes[k] for episodes in of.values() for k in (0, len(episodes) // 2, -1)]
        elif word == "all" or word.isdecimal():
            most = None if word == "all" else int(word)
            keys += [key for episodes in of.values() for key in episodes[:most]]
        elif (key := _episode(word, of)) is not None:
            keys.append(key)
    return list(dict.fromkeys(keys))


def with_references(
    keys: Iterable[Key],
    cells: Container[tuple[str, str]],
    ranked: Iterable[Row],
    references: Mapping[str, str],
) -> list[Key]:
    """Return episodes with those of the same seeds of the policy that the others of their scenario are compared with.

    Args:
        keys: Episodes.
        cells: Scenario and policy of those that can be played.
        ranked: Score rows of the benchmark.
        references: Policy that the others of a scenario are compared with.
    """
    there = {(row["scenario"], row["policy"], row["seed"]) for row in ranked}
    both = [key for s, p, seed in keys for key in ((s, references.get(s, ""), seed), (s, p, seed))]
    return [key for key in dict.fromkeys(both) if key in there and key[:2] in cells]


def play_again(
    keys: Iterable[Key], cells: Mapping[tuple[str, str], Cell], ranked: Iterable[Row], device: Any
) -> Iterator[tuple[Cell, dict[Key, Played] | BaseException]]:
    """Play episodes again, some of a cell at a time, and yield these, or what their policy raised.

    Args:
        keys: Episodes to play.
        cells: Policies on scenarios, by name.
        ranked: Score rows of the benchmark.
        device: Warp device.
    """
    rows = {(row["scenario"], row["policy"], row["seed"]): row for row in ranked}
    seeds_of: dict[tuple[str, str], list[int]] = {}
    for scenario, policy, seed in keys:
        seeds_of.setdefault((scenario, policy), []).append(seed)
    batches = [
        (cells[place], seeds[k : k + _TOGETHER])
        for place, seeds in seeds_of.items()
        for k in range(0, len(seeds), _TOGETHER)
    ]

    def play(cell: Cell, seeds: list[int]) -> dict[Key, Played]:
        recorded, played = record_together(cell, seeds, device), {}
        rogues = _missed(cell, [episode for _, episode in recorded])
        for (recording, _), rogue in zip(recorded, rogues, strict=True):
            key = (cell.scenario.name, cell.policy, int(recording.score["seed"]))
            same, appears = _agree(recording.score, rows[key]), None if rogue is None else rogue.appears
            played[key] = Played(contents(recording, BRIEF, rogue), same, appears)
        return played

    with ThreadPoolExecutor(cores()) as pool:
        shared = [k for k, (cell, _) in enumerate(batches) if device == "cpu" and may_be_shared(cell)]
        futures = {k: pool.submit(play, *batches[k]) for k in shared}
        try:
            for k, batch in enumerate(batches):
                try:
                    result = futures[k].result() if k in futures else play(*batch)
                except (Exception, SystemExit) as error:
                    result = error
                yield batch[0], result
        finally:
            pool.shutdown(cancel_futures=True)


def record_together(
    cell: Cell, seeds: Sequence[int], device: Any = "cpu"
) -> list[tuple[Recording, missed.Played | None]]:
    """Play some episodes of a cell side by side and record them, with data for the rogue with foresight if required."""
    policy = cell.factory(cell.scenario, len(seeds), device)
    simulation = Simulation(cell.scenario, policy.num_worlds, device=device)
    runner, recorded = EpisodeRunner(policy, simulation), []
    task = cell.scenario.task
    watcher = missed.Watcher(simulation) if task.contamination is not None and not task.conservative else None
    # A policy that was made already plays as many worlds as it was made for.
    for first in range(0, len(seeds), policy.num_worlds):
        batch = [fold_seed(seed) for seed in seeds[first : first + policy.num_worlds]]
        recorders = [Recorder(simulation, world) for world in range(len(batch))]

        def take(taken: int, recorders: Sequence[Recorder] = recorders) -> None:
            steps = simulation.clock.step.numpy()
            for recorder in recorders:
                if steps[recorder.world] == taken:  # it may end before its time
                    recorder.take()
            if watcher is not None:
                watcher.keep(taken)

        runner.play(batch + batch[-1:] * (policy.num_worlds - len(batch)), take)
        played = watcher.episodes(batch) if watcher is not None else [None for _ in batch]
        recorded += zip((recorder.recording(cell.policy) for recorder in recorders), played, strict=True)
    return recorded


def _missed(cell: Cell, episodes: Sequence[missed.Played | None]) -> list[missed.MissedRogue | None]:
    """Return the rogues that a policy misses for longer than T_max, the detection-time bound of the paper."""
    bound = cell.scenario.detection_time_bound
    long = [k for k, episode in enumerate(episodes) if episode is not None and episode.score[WORST_CASE.name] > bound]
    chosen = [episode for k, episode in enumerate(episodes) if k in long and episode is not None]
    rogues = dict(zip(long, missed.missed_in(chosen, cell.policy, prove=False) if chosen else [], strict=True))
    return [rogues.get(k) for k in range(len(episodes))]


def _episode(word: str, names: Iterable[tuple[str, str]]) -> Key | None:
    """Return the episode that `SCENARIO:POLICY:SEED` names; names of scenarios and policies may contain colons."""
    cell, _, seed = word.rpartition(":")
    place = next((name for name in names if f"{name[0]}:{name[1]}" == cell), None)
    return (*place, int(seed)) if place and seed.isascii() and seed.isdecimal() else None


def _agree(score: Mapping[str, Any], row: Mapping[str, Any]) -> bool:
    """Return whether two score rows have the same numbers."""
    numbers = [(row[c], score[c]) for c in row if c in score and isinstance(row[c], (int, float)) and c != "episode"]
    return all(a == b or math.isclose(a, b, rel_tol=1e-9) or (a != a and b != b) for a, b in numbers)
