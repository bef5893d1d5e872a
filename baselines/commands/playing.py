"""Policies that a command plays: with progress on stderr, and errors that name the policy."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from baselines.benchmark.progress import Progress
from baselines.benchmark.running import Benchmark, Cell, plan
from baselines.policies import registry
from baselines.policies.factories import as_factory, is_imported, split_scenarios_and_policy
from lissajous_env.console.terminal import CommandError, Output, make_console
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import few_of, where_raised

if TYPE_CHECKING:
    from lissajous_env.episodes.recording import Recording

FORMATS = (".html", ".mp4", ".gif", ".npz", ".mcap")
"""Endings of the files that show or store one episode."""


def scenarios_and_policy(names: Sequence[str]) -> tuple[tuple[str, ...], str, Scenario | None]:
    """Return the scenarios and the policy among some names, and the scenario of a policy's folder that is alone.

    Raises:
        ValueError: as `split_scenarios_and_policy`, or the folder has no scenario.
    """
    if len(names) == 1 and registry.is_folder(names[0]):
        return (names[0],), names[0], registry.home(names[0])
    return (*split_scenarios_and_policy(names), None)


def record_one(settings: Benchmark, output: Output, scenario: Scenario | None = None) -> "Recording":
    """Record an episode of the one policy of some settings on their one scenario, or on a given one."""
    from lissajous_env.episodes.recording import record

    if len(settings.scenarios) > 1:
        raise ValueError(f"exactly one scenario must be given, got {few_of(settings.scenarios)}")
    (cell,) = plan(settings, scenarios=None if scenario is None else [scenario])
    with Progress([(cell, [0])], progress_console(output)) as progress:
        progress.begin(cell)
        acting = made(cell, settings).factory(cell.scenario, 1, settings.device)
        with naming(cell):
            recording = record(acting, cell.scenario, settings.seed, settings.device, lambda: progress.step(cell, 1))
        progress.finished(cell, 1)
    return replace(recording, score=recording.score | {"policy": cell.policy})


def progress_console(output: Output) -> Any:
    """Return a console on stderr for the progress."""
    return make_console(stderr=True, quiet=output.quiet)


def made(cell: Cell, settings: Benchmark) -> Cell:
    """Make the policy of a cell, so that a wrong name or folder is reported as bad input rather than a failure.

    Returns:
        The cell with a factory that returns this policy.
    """
    with naming(cell) if is_imported(cell.policy) else nullcontext():
        policy = cell.factory(cell.scenario, settings.worlds, settings.device)
    return replace(cell, factory=as_factory(policy, cell.policy))


@contextmanager
def naming(cell: Cell) -> Iterator[None]:
    """Turn an error into one that names the policy that failed, and where."""
    try:
        yield
    except (Exception, SystemExit) as error:
        raise CommandError(f"{cell.policy} failed on {cell.scenario.name}: {where_raised(error)}") from error
