"""The benchmark: any policies on any scenarios, the same seeds for all; the same command resumes it if it was killed.

`episodes.jsonl` is the source of truth: a batch of episodes is on the disk before the next begins. All other files are
made from it at the end.
"""

import threading
import time
from collections.abc import Iterable, Mapping
from typing import Any

from rich.console import Console

from baselines.benchmark import cluster, local, replays, results_folder, tables, written
from baselines.benchmark.bounds import as_played
from baselines.benchmark.progress import Progress
from baselines.benchmark.results_folder import Results
from baselines.benchmark.table import Table
from baselines.benchmark.theorem import about_theorem
from baselines.benchmark.types import POLICIES, Benchmark, Cell, Failure, Outcome, Rows
from baselines.policies import registry
from baselines.policies.factories import Factory, as_factory, is_ones_own, named
from lissajous_env.console.terminal import make_console
from lissajous_env.device.devices import as_device
from lissajous_env.episodes.evaluation import ActingPolicy
from lissajous_env.parameters.named import build
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.storage.folder import Folder
from lissajous_env.wording import few_of

ALL = "all"
"""Word that names every policy."""


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
    progress: Console | None = None,
) -> Outcome:
    """Do the same as `run`, and also return the policies that failed; `progress` is shown on a console of its own."""
    if scenarios is None:
        scenarios = [as_played(name, settings.overrides) for name in settings.scenarios]
    cells = plan(settings, policies, scenarios)
    console = console or make_console()
    progress = progress or make_console(stderr=True, quiet=console.quiet)
    started = time.monotonic()
    with (
        Folder(settings.out, (*results_folder.FILES, *written.FILES)) as folder,
        Results(folder, settings, cells) as results,
    ):
        resumed = len(results.of(cells, settings.episodes))
        raised = _play_all(settings, cells, results, progress)
        rows, stored_rows = results.of(cells, settings.episodes), results.rows()
        table = Table.of(stored_rows, results.scenarios, settings.against)
        outcome = Outcome(
            settings, cells, rows, table, results.stored, resumed=resumed, elapsed=time.monotonic() - started
        )
        for failure in raised:
            is_wanted = not failure.is_refusal or failure.policy in settings.policies
            (outcome.failures if is_wanted else outcome.left_out).append(failure)
        outcome.theorem = about_theorem(replays.playable(outcome).values(), stored_rows, outcome.device)
        written.write_files(folder, outcome, stored_rows)
        said = replays.write_report(folder, outcome, progress)
    if len(rows) < len(stored_rows):
        table = Table.of(rows, outcome.scenarios, settings.against)
    tables.print_tables(console, outcome, table, said)
    return outcome


def plan(
    settings: Benchmark,
    policies: Mapping[str, Factory | ActingPolicy] | None = None,
    scenarios: Iterable[Scenario] | None = None,
) -> list[Cell]:
    """Check the settings and list what is to be played.

    Raises:
        ValueError: a value that a rule forbids, an unknown name, or a policy or scenario that has no partner.
    """
    settings.check()
    own = {name: named(name) for name in settings.policies if is_ones_own(name)}
    own |= {name: as_factory(policy, name) for name, policy in (policies or {}).items()}
    kinds = {name: _kind_of(name) for name in own if registry.is_folder(name)}
    others = [name for name in settings.policies if name not in own and settings.policies != (ALL,)]
    played = [
        build(scenario, **settings.overrides) for scenario in (settings.scenarios if scenarios is None else scenarios)
    ]
    for name in others:
        if not any(name in registry.names(scenario) for scenario in played):
            registry.make(name, played[0])  # names the defect
    cells = []
    for scenario in played:
        chosen = [name for name in others if name in registry.names(scenario)]
        if not own and not others:
            chosen = _default(scenario, settings.policies == (ALL,))
        before = len(cells)
        cells += [Cell(scenario, name, named(name)) for name in chosen]
        cells += [Cell(scenario, name, of) for name, of in own.items() if kinds.get(name) in (None, scenario.actuation)]
        if len(cells) == before and not (own and len(played) > 1):
            kind, got = f"robots of kind {scenario.actuation}", few_of((*others, *own))
            raise ValueError(f"policies must contain one for {scenario.name}, which has {kind}; got {got}")
    if not cells:
        raise ValueError(f"policies must contain one for the scenarios, got {few_of(own)}")
    if settings.against is not None and settings.against not in {cell.policy for cell in cells}:
        names = few_of((cell.policy for cell in cells), settings.against)
        raise ValueError(f"against must be one of the policies ({names}), got {settings.against}")
    if len({(cell.scenario.name, cell.policy) for cell in cells}) < len(cells):
        raise ValueError(f"scenarios must differ in name, got {few_of(scenario.name for scenario in played)}")
    if settings.engine == "ray":
        cluster.check(settings.device)
    else:
        as_device(settings.device)
    return cells


def _kind_of(folder: str) -> str | None:
    """Return the kind of robot of a folder's policy; None if only playing the policy shows it."""
    try:
        return registry.home(folder).actuation
    except ValueError:
        return None


def _default(scenario: Scenario, everything: bool) -> list[str]:
    """Return the policies that are played where none is named: the standard ones and those that users registered.

    `everything` adds all other registered ones; of those with a filter, the paper's method alone and what was made for
    this very scenario.
    """
    fitting = registry.names(scenario)
    chosen = [name for name in POLICIES if name in fitting]
    for name in fitting:
        is_added = registry.made_for(name, scenario.name) and (everything or not registry.ships(name))
        is_plain = not registry.unwrapped(name)[1] or (everything and registry.describe(name)["made_for"])
        if is_added and is_plain and name not in chosen:
            chosen.append(name)
    return chosen


def _play_all(settings: Benchmark, cells: list[Cell], results: Results, console: Console) -> list[Failure]:
    """Play the episodes that are missing, store each batch, and return the policies that failed."""
    work = [(cell, numbers) for cell in cells if (numbers := results.missing(cell, settings.episodes))]
    failures: dict[int, Failure] = {}
    lock = threading.Lock()
    with Progress(work, console) as progress:

        def finish(cell: Cell, result: Rows | Failure) -> None:
            with lock:
                if isinstance(result, Failure):
                    failures[id(cell)] = result
                    progress.failed(cell, result.word)
                else:
                    results.add(result)
                    progress.finished(cell, len(result))

        if work:
            (cluster if settings.engine == "ray" else local).play_all(settings, work, progress, finish)
    return [failures[id(cell)] for cell in cells if id(cell) in failures]
