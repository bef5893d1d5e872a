"""The benchmark: any policies on any scenarios, the same seeds for all; it can be killed and goes on where it stopped.

`episodes.jsonl` is the source of truth: a batch of episodes is on the disk before the next begins. All other files are
made from it at the end.
"""

import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from baselines.benchmark import report, results_folder
from baselines.benchmark.progress import Progress
from baselines.benchmark.rows import what_is_wrong
from baselines.policies import registry
from baselines.policies.factories import Factory, as_factory, is_ones_own, named
from lissajous_env import scenario as make_scenario
from lissajous_env.console.terminal import make_console, plain
from lissajous_env.device.devices import as_device
from lissajous_env.episodes.evaluation import ActingPolicy, episodes
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.storage.folder import Folder
from lissajous_env.wording import where_raised

_MOST_EPISODES = 1_000_000
_MOST_WORLDS = 65_536


@dataclass(frozen=True)
class Benchmark:
    """What is played, and where the results go."""

    scenarios: tuple[str, ...] = ("ideal", "failure", "experiment", "intruders", "rough")
    """Scenarios to play."""
    policies: tuple[str, ...] = ()
    """Policies to play, each where it drives the robots; without any, all of them. Your own: a checkpoint's
    folder, or `module:factory`."""
    episodes: int = 16
    """Episodes of each policy on each scenario."""
    seed: int = 0
    """Seed of episode 0; episode k has seed + k, for every policy."""
    batch: int = 16
    """Episodes that are played, and written, together; changes no result."""
    device: str = "cpu"
    """cpu, cuda or cuda:k."""
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("results/benchmark")
    """Folder of the results. A second call goes on there: it adds what it asks for (scenarios, policies, episodes) to
    what is there, plays nothing twice, and refuses other settings. The files hold all of the folder."""
    engine: Literal["local", "ray"] = "local"
    """local plays here; ray plays over a cluster, and needs the extra `cluster`. It changes no result."""
    address: str | None = None
    """Address of the Ray cluster: auto, HOST:PORT or ray://HOST:PORT; without one, engine ray starts its own here."""
    overrides: Annotated[Mapping[str, Any], tyro.conf.Suppress] = field(default_factory=dict)
    """Fields changed in every scenario, as {"task.duration": 30.0}."""

    def check(self) -> None:
        """Raise ValueError for a value that a rule forbids."""
        for name, most in (("episodes", _MOST_EPISODES), ("batch", _MOST_WORLDS)):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
            if getattr(self, name) > most:
                raise ValueError(f"{name} must be at most {most:,}, got {getattr(self, name)}")
        if not 0 <= self.seed <= 2**31 - self.episodes:
            raise ValueError(f"seed must be from 0 to 2147483647, that of the last episode too, got {self.seed}")
        for name in ("scenarios", "policies"):
            if len(set(getattr(self, name))) < len(getattr(self, name)):
                raise ValueError(f"{name} must name each one once, got {', '.join(getattr(self, name))}")
        if not self.scenarios:
            raise ValueError("scenarios must name at least one")
        if self.engine not in ("local", "ray"):
            raise ValueError(f"engine must be local or ray, got {self.engine!r}")
        if self.address is not None and self.engine != "ray":
            raise ValueError(f"address must be given with engine ray alone, got {self.address!r}")

    @property
    def worlds(self) -> int:
        """Episodes that are played together."""
        # This never depends on what is left to do: a policy may round otherwise in another batch.
        return min(self.batch, self.episodes)


@dataclass(frozen=True)
class Cell:
    """A policy on a scenario."""

    scenario: Scenario
    policy: str
    factory: Factory = field(repr=False)


@dataclass(frozen=True)
class Failure:
    """A policy that raised on a scenario."""

    scenario: str
    policy: str
    error: str
    traceback: str = field(repr=False)


@dataclass
class Outcome:
    """What a benchmark came to."""

    settings: Benchmark
    cells: list[Cell]
    rows: list[dict[str, Any]]
    """Score rows of what was asked for, by scenario, policy and episode."""
    failures: list[Failure]
    kept: int
    """How many of them were there from an earlier call."""
    elapsed: float
    """Time that it took, this call alone [s]."""
    held: dict[str, Any]
    """Settings that the folder holds, those of earlier calls among them."""
    held_scenarios: dict[str, Scenario]
    held_rows: list[dict[str, Any]]
    """Score rows that the folder holds."""

    @property
    def scenarios(self) -> dict[str, Scenario]:
        """The scenarios that were played, by name."""
        return {cell.scenario.name: cell.scenario for cell in self.cells}


def run(
    settings: Benchmark | None = None,
    policies: Mapping[str, Factory | ActingPolicy] | None = None,
    scenarios: Iterable[Scenario] | None = None,
    console: Console | None = None,
) -> list[dict[str, Any]]:
    """Play a benchmark, print its tables, write its files; return its score rows.

    Args:
        settings: What to play.
        policies: Policies of your own by name, each a `factory(scenario, num_worlds, device)` or a policy that was made
            for the one scenario. They are played on every scenario, beside those that `settings.policies` names.
            Only their names are kept with the results.
        scenarios: Scenarios instead of the named ones.
        console: Where to print; `Console(quiet=True)` prints nothing.

    Raises:
        ValueError: settings that cannot be played, or a folder that holds the results of others.
    """
    return measure(settings or Benchmark(), policies, scenarios, console).rows


def measure(
    settings: Benchmark,
    policies: Mapping[str, Factory | ActingPolicy] | None = None,
    scenarios: Iterable[Scenario] | None = None,
    console: Console | None = None,
    progress: Console | None = None,
) -> Outcome:
    """Do the same as `run`, and tell which policies failed as well; `progress` is shown on a console of its own."""
    cells = plan(settings, policies, scenarios)
    console = console or make_console()
    progress = progress or make_console(stderr=True, quiet=console.quiet)
    started = time.monotonic()
    with Folder(settings.out, (*results_folder.NAMES, *report.NAMES)) as folder:
        held = results_folder.keep_settings(folder, settings, cells)
        held_scenarios = results_folder.scenarios_of(folder.path, held)
        with results_folder.Episodes(folder, held) as kept:
            found = len(kept.of(cells, settings.episodes))
            failures = _play_all(settings, cells, kept, progress)
            rows, held_rows = kept.of(cells, settings.episodes), kept.all()
        elapsed = time.monotonic() - started
        outcome = Outcome(settings, cells, rows, failures, found, elapsed, held, held_scenarios, held_rows)
        report.write_files(folder, outcome)
    report.print_tables(console, outcome)
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
    others = [name for name in settings.policies if name not in own]
    made = [
        make_scenario(each, **settings.overrides) for each in (settings.scenarios if scenarios is None else scenarios)
    ]
    for name in others:
        if not any(name in registry.names(scenario) for scenario in made):
            registry.make(name, made[0])  # says what is wrong with it
    cells = []
    for scenario in made:
        fitting = registry.names(scenario)
        chosen = [name for name in others if name in fitting] if others or own else _usual(fitting, scenario)
        cells += [Cell(scenario, name, named(name)) for name in chosen]
        cells += [Cell(scenario, name, factory) for name, factory in own.items()]
        if not chosen and not own:
            kind = f"robots of kind {scenario.robot.kind}"
            raise ValueError(f"policies must hold one for {scenario.name}, which has {kind}; got {', '.join(others)}")
    if len({(cell.scenario.name, cell.policy) for cell in cells}) < len(cells):
        raise ValueError(f"scenarios must differ in name, got {', '.join(scenario.name for scenario in made)}")
    if settings.engine == "ray":
        _cluster().check(settings.device, settings.address)
    else:
        as_device(settings.device)
    return cells


def _usual(names: Iterable[str], scenario: Scenario) -> list[str]:
    """Policies that are played where none is named.

    Of those with the collision filter, the paper's method alone and what was made for this very scenario.
    """
    chosen = [name for name in names if registry.made_for(name, scenario.name)]
    filtered = [name for name in chosen if name == "kuramoto-mpcc-safe" or registry.is_specialist(name)]
    return [name for name in chosen if not registry.unwrapped(name)[1] or name in filtered]


def play(
    cell: Cell, settings: Benchmark, numbers: list[int], on_step: Callable[[int], None]
) -> Iterator[list[dict[str, Any]]]:
    """Play some episodes of a cell, given by number, and yield the score rows of each batch.

    After each step, `on_step` is called with the number of worlds that took it.

    Raises:
        ValueError: a score that is none, as one of a return that is infinite.
    """
    worlds = settings.worlds
    policy = cell.factory(cell.scenario, worlds, settings.device)
    numbers_left = iter(numbers)
    seeds = [settings.seed + number for number in numbers]
    for batch in episodes(policy, cell.scenario, seeds, settings.device, lambda _: on_step(worlds)):
        rows = [row | {"policy": cell.policy, "episode": next(numbers_left)} for row in batch]
        for row in rows:
            if wrong := what_is_wrong(plain(row)):
                raise ValueError(f"the score of seed {row['seed']} {wrong}")
        yield rows


def failure(cell: Cell, error: Exception) -> Failure:
    """Put an error that a policy raised into words."""
    return Failure(cell.scenario.name, cell.policy, where_raised(error), "".join(traceback.format_exception(error)))


def _play_all(settings: Benchmark, cells: list[Cell], kept: results_folder.Episodes, console: Console) -> list[Failure]:
    work = [(cell, kept.missing(cell, settings.episodes)) for cell in cells]
    with Progress(work, console) as progress:
        if settings.engine == "ray":
            return _cluster().play_all(settings, work, kept, progress)
        return _play_here(settings, work, kept, progress)


def _play_here(
    settings: Benchmark, work: list[tuple[Cell, list[int]]], kept: results_folder.Episodes, progress: Progress
) -> list[Failure]:
    failures = []
    for cell, numbers in work:
        if not numbers:
            continue
        progress.begin(cell)
        batches = play(cell, settings, numbers, progress.step)
        while True:
            try:
                batch = next(batches, None)
            except Exception as error:
                failures.append(failure(cell, error))
                progress.end("failed")
                break
            if batch is None:
                progress.end()
                break
            kept.add(batch)
            progress.finished(len(batch))
    return failures


def _cluster() -> Any:
    """Return `baselines.benchmark.cluster`, which needs this module."""
    from baselines.benchmark import cluster

    return cluster
