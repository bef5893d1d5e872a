"""Play the episodes of a cell, and the engine of a benchmark on this machine.

The engine plays as many cells at a time as there are cores, on any threads. Cells with code of users are played
afterwards by the main thread, one after the other: such code may share data between its policies, and Ctrl-C reaches it
there. The rows do not depend on this order.
"""

import threading
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Any

from baselines.benchmark.statistics import refusal_of
from baselines.benchmark.table import Rows
from baselines.benchmark.types import Benchmark, Cell, Failure, Finish, Work
from baselines.policies import registry
from baselines.policies.base import UnsuitableScenarioError
from lissajous_env.console.terminal import Progress, plain
from lissajous_env.device.devices import cores
from lissajous_env.episodes.evaluation import episodes
from lissajous_env.parameters.robot_models import MODELS
from lissajous_env.parameters.rogues import ROGUES
from lissajous_env.wording import where_raised
from lissajous_env.world.columns import extension_columns


class _Stopped(BaseException):
    """Raised in a thread whose work is no longer wanted."""


def play_all(settings: Benchmark, work: Work, progress: Progress, finish: Finish) -> None:
    """Play the remaining episodes on this machine.

    Args:
        settings: Settings of the benchmark.
        work: Cells, each with the numbers of the episodes that are left to play.
        progress: Display of the progress.
        finish: Receives the results, on several threads.
    """

    def play_cell(cell: Cell, numbers: list[int], stopped: threading.Event) -> None:
        progress.begin(cell)
        for result in batches_or_failure(cell, settings, numbers, stopped):
            finish(cell, result)

    on_cores(work, settings.device, play_cell)


def on_cores(work: Work, device: str, job: Callable[[Cell, list[int], threading.Event], None]) -> None:
    """Call `job` for the cells that may be shared on as many threads as there are cores, then here for the others.

    The first error, or Ctrl-C, sets the event that `job` receives with a cell and its numbers, cancels what has not
    begun, and is raised when the running ones have ended.
    """
    stopped = threading.Event()
    shared = [part for part in work if may_be_shared(part[0], device)]
    with ThreadPoolExecutor(cores()) as pool:
        try:
            for future in as_completed([pool.submit(job, *part, stopped) for part in shared]):
                future.result()
        except BaseException:
            stopped.set()
            pool.shutdown(cancel_futures=True)
            raise
    for cell, numbers in work:
        if not may_be_shared(cell, device):
            job(cell, numbers, stopped)


def may_be_shared(cell: Cell, device: str) -> bool:
    """Return whether a cell may be played on any thread: all of its code is of this package, and runs on the CPU."""
    model, rogue = MODELS[cell.scenario.robot.kind], ROGUES.get(cell.scenario.targets.rogues or "")
    are_included = MODELS.is_included(model) and (rogue is None or ROGUES.is_included(rogue))
    return registry.is_included(cell.policy) and are_included and not cell.scenario.extensions and device == "cpu"


def batches_or_failure(
    cell: Cell, settings: Benchmark, numbers: list[int], stopped: threading.Event | None = None
) -> Iterator[Rows | Failure]:
    """Play some episodes of a cell, and yield each batch; if the policy raises, the failure is the last."""
    try:
        yield from batches(cell, settings, numbers, stopped)
    except (Exception, SystemExit) as error:
        yield failure_of(cell, error)


def batches(
    cell: Cell, settings: Benchmark, numbers: list[int], stopped: threading.Event | None = None
) -> Iterator[Rows]:
    """Play some episodes of a cell, given by number, and yield the rows of each batch; `stopped` ends it at a step.

    Raises:
        ValueError: a score is invalid, such as that of an infinite return.
    """
    policy = cell.factory(cell.scenario, settings.worlds, settings.device)
    seeds = [settings.seed + number for number in numbers]
    added = extension_columns(cell.scenario)

    def check(_: Any) -> None:
        if stopped is not None and stopped.is_set():
            raise _Stopped

    for batch in episodes(policy, cell.scenario, seeds, settings.device, check):
        rows = [row | {"policy": cell.policy, "episode": row["seed"] - settings.seed} for row in batch]
        for row in rows:
            if wrong := refusal_of(plain(row), added):
                raise ValueError(f"the score of seed {row['seed']}: {wrong}")
        yield rows


def failure_of(cell: Cell, error: BaseException) -> Failure:
    """Put an error that a policy raised into words."""
    refuses = isinstance(error, UnsuitableScenarioError)
    words = str(error) if refuses else where_raised(error)
    return Failure(cell.scenario.name, cell.policy, words, "".join(traceback.format_exception(error)), refuses)
