"""Episodes that a report can play: chosen among those of a benchmark, and played again from their seeds."""

import math
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, TypeVar

from baselines.benchmark.clairvoyant import Clairvoyant
from baselines.benchmark.local import may_be_shared
from baselines.benchmark.types import Cell
from lissajous_env.device.devices import cores
from lissajous_env.episodes import missed
from lissajous_env.episodes.evaluation import EpisodeRunner
from lissajous_env.episodes.recording import Recorder, Recording
from lissajous_env.replay.contents import BRIEF, contents
from lissajous_env.world.columns import WORST_CASE
from lissajous_env.world.simulation import Simulation, fold_seed

WORDS = ("none", "few", "each", "all")
FEW_SECONDS = 6.0
"""Time after which no further replays are begun with `few` [s]."""
FEW_BYTES = 11e6
"""Size from which on none are added to those."""
_TOGETHER = 4
"""Episodes that are recorded together: each requires tens of megabytes meanwhile."""

_T = TypeVar("_T")
Key = tuple[str, str, int]
"""Scenario, policy and seed of an episode."""


@dataclass(frozen=True)
class Played:
    """An episode that was played again."""

    contents: dict[str, Any] = field(repr=False)
    """Content that the page needs to play it."""
    same: bool
    """True if it had the same scores as in the benchmark; a policy may draw its own numbers, or round differently."""
    rogue: float | None = None
    """Time at which the rogue that the policy misses appears [s]; None if the replay shows none."""


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


def chosen(asked: Sequence[str], ranked: Sequence[Mapping[str, Any]]) -> list[list[Key]]:
    """Return the episodes to replay, in rounds; those of a round matter more than those of the next.

    Args:
        asked: As `Benchmark.replays` has them.
        ranked: Score rows, the worst first.
    """
    of: dict[tuple[str, str], list[Key]] = {}
    for row in ranked:
        of.setdefault((row["scenario"], row["policy"]), []).append((row["scenario"], row["policy"], row["seed"]))
    rounds: list[list[Key]] = [[]]
    for word in asked:
        if word in ("few", "each"):
            rounds.append([keys[0] for keys in of.values()])
            rounds.append([keys[place] for keys in of.values() for place in (len(keys) // 2, -1)])
        elif word == "all" or word.isdecimal():
            most = None if word == "all" else int(word)
            rounds.append([key for keys in of.values() for key in keys[:most]])
        elif (key := _episode(word, of)) is not None:
            rounds[0].append(key)
    return [list(dict.fromkeys(keys)) for keys in rounds if keys]


def make(
    rounds: Sequence[Sequence[Key]],
    cells: Mapping[tuple[str, str], Cell],
    rows: Mapping[Key, Mapping[str, Any]],
    references: Mapping[str, str],
    device: Any,
    hurried: bool,
    on_begin: Callable[[Cell], None],
    on_failure: Callable[[Cell, BaseException], None],
) -> Iterator[tuple[Key, Played]]:
    """Play episodes again, round after round, and yield each; before them, the same seeds of their reference.

    They are played on as many threads as the benchmark's, and yielded in the same order on any number.

    Args:
        rounds: Episodes to play; those without a cell are left out.
        cells: Policies on scenarios, by name.
        rows: Score rows of the benchmark.
        references: Policy that the others of a scenario are compared with.
        device: Warp device.
        hurried: End after `FEW_SECONDS` or `FEW_BYTES`.
        on_begin: Called with each cell before it is played.
        on_failure: Called with a cell whose policy raised this time, and with what it raised.
    """
    began, size, done = time.monotonic(), 0, set()

    def play(cell: Cell, seeds: list[int]) -> list[tuple[Key, Played]]:
        recorded, found = record_together(cell, seeds, device), []
        rogues = _missed(cell, [played for _, played in recorded])
        for (recording, _), rogue in zip(recorded, rogues, strict=True):
            key = (cell.scenario.name, cell.policy, int(recording.score["seed"]))
            same, appears = _agree(recording.score, rows[key]), None if rogue is None else rogue.appears
            found.append((key, Played(contents(recording, BRIEF, rogue), same, appears)))
        return found

    def begun(pool: ThreadPoolExecutor) -> Iterator[tuple[Cell, Future[list[tuple[Key, Played]]]]]:
        for keys in rounds:
            wanted = [key for key in keys if key in rows and key[:2] in cells]
            for place, seeds in _batches(wanted, references, rows):
                cell, left = cells[place], [seed for seed in seeds if (*place, seed) not in done]
                if not left:
                    continue
                if hurried and (time.monotonic() - began > FEW_SECONDS or size > FEW_BYTES):
                    return
                on_begin(cell)
                done.update((*place, seed) for seed in left)
                shared = device == "cpu" and may_be_shared(cell)
                yield cell, pool.submit(play, cell, left) if shared else _called(play, cell, left)

    with ThreadPoolExecutor(cores()) as pool:
        for cell, future in _ahead(begun(pool), cores()):
            try:
                episodes = future.result()
            except (Exception, SystemExit) as error:
                on_failure(cell, error)
                continue
            size += sum(_size(played.contents) for _, played in episodes)
            yield from episodes


def _ahead(begun: Iterator[_T], most: int) -> Iterator[_T]:
    """Yield in order what an iterator yields, which is up to `most` entries ahead."""
    waiting: deque[_T] = deque()
    for each in begun:
        waiting.append(each)
        if len(waiting) > most:
            yield waiting.popleft()
    yield from waiting


def _called(function: Callable[..., _T], *given: Any) -> Future[_T]:
    """Call a function in this thread, and return its result as a thread of a pool does."""
    future: Future[_T] = Future()
    try:
        future.set_result(function(*given))
    except (Exception, SystemExit) as error:
        future.set_exception(error)
    return future


def record_together(
    cell: Cell, seeds: Sequence[int], device: Any = "cpu"
) -> list[tuple[Recording, missed.Played | None]]:
    """Play some episodes of a cell side by side and record them, with data for the rogue with foresight if required."""
    policy = cell.factory(cell.scenario, len(seeds), device)
    simulation = Simulation(cell.scenario, policy.num_worlds, device=device)
    if isinstance(policy, Clairvoyant):
        policy.watch(simulation)
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
    long = [k for k, each in enumerate(episodes) if each is not None and each.score[WORST_CASE.name] > bound]
    chosen = [each for k, each in enumerate(episodes) if k in long and each is not None]
    found = dict(zip(long, missed.missed_in(chosen, cell.policy, prove=False) if chosen else [], strict=True))
    return [found.get(k) for k in range(len(episodes))]


def _batches(
    keys: Sequence[Key], references: Mapping[str, str], rows: Mapping[Key, Any]
) -> Iterator[tuple[tuple[str, str], list[int]]]:
    """Group episodes of a cell, a few at a time, after those beside which they are shown; scenario by scenario."""
    queues = []
    for scenario in dict.fromkeys(key[0] for key in keys):
        of, reference, queue = [key for key in keys if key[0] == scenario], references.get(scenario), []
        for k in range(0, len(of), _TOGETHER):
            few = of[k : k + _TOGETHER]
            beside = [(scenario, reference, key[2]) for key in few if reference is not None]
            seeds_of: dict[tuple[str, str], list[int]] = {}
            for key in dict.fromkeys([*(key for key in beside if key in rows), *few]):
                seeds_of.setdefault(key[:2], []).append(key[2])
            queue += seeds_of.items()
        queues.append(queue)
    for k in range(max(map(len, queues), default=0)):
        yield from (queue[k] for queue in queues if k < len(queue))


def _episode(word: str, names: Iterable[tuple[str, str]]) -> Key | None:
    """Return the episode that `SCENARIO:POLICY:SEED` names; names of scenarios and policies may contain colons."""
    cell, _, seed = word.rpartition(":")
    found = next((name for name in names if f"{name[0]}:{name[1]}" == cell), None)
    return (*found, int(seed)) if found and seed.isascii() and seed.isdecimal() else None


def _agree(score: Mapping[str, Any], row: Mapping[str, Any]) -> bool:
    """Return whether two score rows have the same numbers."""
    numbers = [(row[c], score[c]) for c in row if c in score and isinstance(row[c], (int, float)) and c != "episode"]
    return all(a == b or math.isclose(a, b, rel_tol=1e-9) or (a != a and b != b) for a, b in numbers)


def _size(value: Any) -> int:
    """Return the approximate size of an object as JSON [bytes]."""
    if isinstance(value, str):
        return len(value) + 2
    if isinstance(value, Mapping):
        return sum(len(name) + 4 + _size(each) for name, each in value.items())
    return sum(map(_size, value)) + 2 if isinstance(value, (list, tuple)) else 8
