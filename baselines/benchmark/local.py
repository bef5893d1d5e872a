"""The episodes of a cell played, and a benchmark on this machine: as many cells at a time as the process has cores.

An included policy may be played on any thread. What a user brings is played by the main thread, one cell after the
other: such code may share data between its policies, and Ctrl-C reaches it there. The rows do not depend on it.
"""

import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

from baselines.benchmark import clairvoyant, results_folder
from baselines.benchmark.detections import detections_of
from baselines.benchmark.progress import Progress
from baselines.benchmark.rows import refusal_of
from baselines.benchmark.types import Batch, Benchmark, Cell, Failure
from baselines.policies import registry
from baselines.policies.base import UnsuitableScenarioError
from lissajous_env.console.terminal import plain
from lissajous_env.device.devices import cores
from lissajous_env.episodes.evaluation import episodes
from lissajous_env.wording import where_raised
from lissajous_env.world.columns import brought_columns
from lissajous_env.world.simulation import Simulation

_Work = deque[tuple[Cell, list[int]]]


class _Stopped(BaseException):
    """Raised in a thread whose work is no longer wanted."""


def play_all(
    settings: Benchmark, work: list[tuple[Cell, list[int]]], kept: results_folder.Episodes, progress: Progress
) -> list[Failure]:
    """Play the remaining episodes, and store each batch when it has ended; return the policies that failed.

    Args:
        settings: Settings of the benchmark.
        work: Cells, each with the numbers of the episodes that are left to play.
        kept: Folder in which the rows are stored.
        progress: Display of the finished episodes.
    """
    failures: dict[int, Failure] = {}
    keeping, stopped = threading.Lock(), threading.Event()

    def play_cell(cell: Cell, numbers: list[int]) -> None:
        def on_step(worlds: int) -> None:
            if stopped.is_set():
                raise _Stopped
            progress.step(cell, worlds)

        progress.begin(cell)
        batches = play(cell, settings, numbers, on_step)
        while True:
            try:
                batch = next(batches, None)
            except (Exception, SystemExit) as error:
                failures[id(cell)] = failure_of(cell, error)
                progress.end(cell, failures[id(cell)].word)
                return
            if batch is None:
                progress.end(cell)
                return
            with keeping:
                kept.add(batch)
            progress.finished(cell, len(batch.rows))

    def play_each(left: _Work) -> None:
        try:
            while left and not stopped.is_set():
                try:
                    cell, numbers = left.popleft()
                except IndexError:  # another thread plays the last one
                    return
                play_cell(cell, numbers)
        except _Stopped:  # the thread that stopped this one raises its own error
            pass
        except BaseException:
            stopped.set()
            raise

    left = [(cell, numbers) for cell, numbers in work if numbers]
    shared = deque(each for each in left if settings.device == "cpu" and may_be_shared(each[0]))
    own = deque(each for each in left if settings.device != "cpu" or not may_be_shared(each[0]))
    with ThreadPoolExecutor(cores()) as pool:
        helpers = [pool.submit(play_each, shared) for _ in range(min(cores(), len(shared)) - (0 if own else 1))]
        try:
            play_each(own)
            play_each(shared)
            for helper in helpers:
                helper.result()
        except BaseException:
            stopped.set()
            raise
    return [failures[id(cell)] for cell, _ in work if id(cell) in failures]


def may_be_shared(cell: Cell) -> bool:
    """Return whether all code that plays a cell is of this package."""
    shipped = cell.policy == clairvoyant.NAME or registry.ships(cell.policy)
    return shipped and not cell.scenario.extensions and cell.scenario.robot.kind in clairvoyant.KINDS


def play(cell: Cell, settings: Benchmark, numbers: list[int], on_step: Callable[[int], None]) -> Iterator[Batch]:
    """Play some episodes of a cell, given by number, and yield each batch.

    After each step, `on_step` is called with the number of worlds that took it.

    Raises:
        ValueError: a score that is none, as one of a return that is infinite.
    """
    worlds = settings.worlds
    policy = cell.factory(cell.scenario, worlds, settings.device)
    watch = policy.watch if isinstance(policy, clairvoyant.Clairvoyant) else None
    numbers_left = iter(numbers)
    seeds = [settings.seed + number for number in numbers]
    brought = brought_columns(cell.scenario)
    played: list[Simulation] = []

    def after_step(simulation: Simulation) -> None:
        played[:] = [simulation]
        on_step(worlds)

    for batch in episodes(policy, cell.scenario, seeds, settings.device, after_step, watch):
        rows = [row | {"policy": cell.policy, "episode": next(numbers_left)} for row in batch]
        for row in rows:
            if wrong := refusal_of(plain(row), brought):
                raise ValueError(f"the score of seed {row['seed']}: {wrong}")
        yield Batch(rows, detections_of(played[0], rows))


def failure_of(cell: Cell, error: BaseException) -> Failure:
    """Put an error that a policy raised into words."""
    refuses = isinstance(error, UnsuitableScenarioError)
    words = str(error) if refuses else where_raised(error)
    return Failure(cell.scenario.name, cell.policy, words, "".join(traceback.format_exception(error)), refuses)
