"""The benchmark: any policies on any scenarios, the same seeds for all; the same command resumes it if it was killed.

`episodes.jsonl` is the source of truth: a batch of episodes is on the disk before the next begins. All other files are
made from it at the end.
"""

import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Any

from rich.console import Console

from baselines.benchmark import cluster, local, replays, results_folder, shown, written
from baselines.benchmark.results_folder import Results
from baselines.benchmark.table import Rows, Table
from baselines.benchmark.theorem import about_theorem
from baselines.benchmark.types import Benchmark, BenchmarkOutcome, Cell, Failure, as_played, cells_of
from baselines.policies import registry
from baselines.policies.registry import Factory
from lissajous_env.console.terminal import Progress, make_console
from lissajous_env.episodes.evaluation import ActingPolicy
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.storage.folder import Folder


def run(
    settings: Benchmark | None = None,
    policies: Mapping[str, Factory | ActingPolicy] | None = None,
    scenarios: Iterable[Scenario] | None = None,
    console: Console | None = None,
) -> list[dict[str, Any]]:
    """Play a benchmark, print its tables, write its files; return its score rows.

    Args:
        settings: Settings of the benchmark.
        policies: Policies of your own by name, each a `factory(scenario, num_worlds, device)` or a policy that was made
            for the one scenario. They are played on every scenario, beside those that `settings.policies` names. Their
            names are stored with the results, and data that identify their code: `lissajous_env.identity`.
        scenarios: Scenarios instead of the named ones.
        console: Console for the output; `Console(quiet=True)` prints nothing.

    Raises:
        ValueError: settings that cannot be played, or a folder with the results of other settings.
    """
    return measure(settings or Benchmark(), policies, scenarios, console).rows


def measure(
    settings: Benchmark,
    policies: Mapping[str, Factory | ActingPolicy] | None = None,
    scenarios: Iterable[Scenario] | None = None,
    console: Console | None = None,
    progress_console: Console | None = None,
) -> BenchmarkOutcome:
    """Do the same as `run`, and return the whole outcome; the progress is shown on a console of its own."""
    if scenarios is None:
        scenarios = [as_played(name) for name in settings.scenarios]
    cells = cells_of(settings, policies, scenarios)
    if settings.engine == "ray":
        cluster.check(settings.device)
    console = console or make_console()
    progress_console = progress_console or make_console(stderr=True, quiet=console.quiet)
    started = time.monotonic()
    with Folder(settings.out, results_folder.FILES) as folder:
        results = Results(folder, settings, cells)
        resumed = len(results.of(cells, settings.episodes))
        raised = _play_missing(settings, cells, results, progress_console)
        rows, stored_rows = results.of(cells, settings.episodes), results.rows()
        table = Table.of(stored_rows, results.scenarios, settings.against)
        elapsed = time.monotonic() - started
        outcome = BenchmarkOutcome(settings, cells, rows, table, results.stored, resumed=resumed, elapsed=elapsed)
        for failure in raised:
            is_wanted = not failure.is_refusal or failure.policy in settings.policies
            (outcome.failures if is_wanted else outcome.left_out).append(failure)
        outcome.theorem = about_theorem(_cells_of(results, outcome), stored_rows, outcome.device)
        written.write_files(folder, outcome, stored_rows)
        note = replays.write_report(folder, outcome, progress_console)
    shown.print_outcome(console, outcome, note)
    return outcome


def _cells_of(results: Results, outcome: BenchmarkOutcome) -> Iterator[Cell]:
    """Yield the cells of a folder: this call's, and others whose names stand for the code that played them."""
    playable = outcome.playable
    for name, policies in results.stored["policies"].items():
        for policy in policies:
            if (name, policy) in playable:
                yield playable[name, policy]
                continue
            with suppress(ValueError):  # an object of an earlier call, or a folder that is gone
                factory = registry.as_factory(policy)
                if registry.fingerprint_of(factory) == results.stored["played"][policy]:
                    yield Cell(results.scenarios[name], policy, factory)


def _play_missing(settings: Benchmark, cells: list[Cell], results: Results, console: Console) -> list[Failure]:
    """Play the episodes that are missing, store each batch, and return the policies that failed."""
    work = [(cell, numbers) for cell in cells if (numbers := results.missing(cell, settings.episodes))]
    failures: dict[int, Failure] = {}
    lock = threading.Lock()
    with Progress(work, console) as progress:

        def finish(cell: Cell, result: Rows | Failure) -> None:
            with lock:
                if isinstance(result, Failure):
                    failures[id(cell)] = result
                    progress.finished(cell, word="refused" if result.is_refusal else "failed")
                else:
                    results.add(result)
                    progress.finished(cell, len(result))

        if work:
            (cluster if settings.engine == "ray" else local).play_all(settings, work, progress, finish)
    return [failures[id(cell)] for cell in cells if id(cell) in failures]
