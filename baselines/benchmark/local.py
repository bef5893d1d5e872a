"""The benchmark on this machine: as many cells at a time as the process has cores.

An included policy may be played on any thread. What a user brings is played by the main thread, one cell after the
other: such code may share data between its policies, and Ctrl-C reaches it there. The rows do not depend on it.
"""

import threading
from collections import deque
from concurrent.futures import ThreadPoolExecutor

from baselines.benchmark import clairvoyant, results_folder
from baselines.benchmark.playing import failure_of, play
from baselines.benchmark.progress import Progress
from baselines.benchmark.types import Benchmark, Cell, Failure
from baselines.policies import registry
from lissajous_env.device.devices import cores

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
