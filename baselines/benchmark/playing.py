"""A cell of a benchmark played: its episodes, batch by batch, wherever that happens."""

import traceback
from collections.abc import Callable, Iterator

from baselines.benchmark.clairvoyant import Clairvoyant
from baselines.benchmark.detections import detections_of
from baselines.benchmark.rows import refusal_of
from baselines.benchmark.types import Batch, Benchmark, Cell, Failure
from baselines.policies.base import UnsuitableScenarioError
from lissajous_env.console.terminal import plain
from lissajous_env.episodes.evaluation import episodes
from lissajous_env.wording import where_raised
from lissajous_env.world.columns import brought_columns
from lissajous_env.world.simulation import Simulation


def play(cell: Cell, settings: Benchmark, numbers: list[int], on_step: Callable[[int], None]) -> Iterator[Batch]:
    """Play some episodes of a cell, given by number, and yield each batch.

    After each step, `on_step` is called with the number of worlds that took it.

    Raises:
        ValueError: a score that is none, as one of a return that is infinite.
    """
    worlds = settings.worlds
    policy = cell.factory(cell.scenario, worlds, settings.device)
    watch = policy.watch if isinstance(policy, Clairvoyant) else None
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
