"""Commands that put policies to work: benchmark, evaluate, run; and the list of the policies."""

import dataclasses
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from baselines.benchmark.progress import Progress
from baselines.benchmark.running import Benchmark, Cell, measure, plan, play
from baselines.policies import registry
from baselines.policies.factories import as_factory, is_imported, told_apart
from lissajous_env.console.commands import check_file
from lissajous_env.console.terminal import (
    AS_USUAL,
    Column,
    CommandError,
    Output,
    Speech,
    make_console,
    print_left_out,
    print_table,
)
from lissajous_env.parameters.overrides import Overrides, parse_overrides
from lissajous_env.wording import where_raised

_Out = Annotated[Path | None, tyro.conf.arg(metavar="FILE")]
_PolicyName = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="POLICY")]
_ScenarioName = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SCENARIO")]
_ScenarioOrNone = Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[SCENARIO]")]
_Names = Annotated[
    tuple[str, ...],
    tyro.conf.Positional,
    tyro.conf.arg(metavar="SCENARIO [SCENARIO ...] POLICY", help_behavior_hint=""),
]


def benchmark(
    settings: tyro.conf.OmitArgPrefixes[Benchmark], output: Speech = AS_USUAL, overrides: Overrides = ()
) -> int:
    """Compare policies on scenarios: tables, files and pictures.

    Killed at any moment, it goes on where it stopped when it is called again with the same --out.

    Args:
        settings: What is played, and where the results go.
        output: How it speaks.
        overrides: fields changed in every scenario, as in --set task.duration=30 targets.count=5
    """
    from baselines.benchmark import report
    from baselines.benchmark.comparison import compare

    settings = dataclasses.replace(settings, overrides=parse_overrides(overrides))
    try:
        outcome = measure(settings, console=output.console(), progress=_progress(output))
    except KeyboardInterrupt:
        words = f"finished episodes are kept in {settings.out}, the same command goes on from there"
        raise KeyboardInterrupt(words) from None
    if output.json:
        comparisons = compare(outcome.rows, outcome.scenarios, settings.against)
        summary = report.summarized(outcome, outcome.rows, outcome.scenarios, comparisons)
        output.give({**summary, "episodes": outcome.rows})
    if outcome.failures:
        names = dict.fromkeys(f"{each.policy} on {each.scenario}" for each in outcome.failures)
        raise CommandError(f"{', '.join(names)} failed; {settings.out / 'summary.json'} has the tracebacks")
    return 0


def evaluate(
    names: _Names,
    episodes: int = 64,
    seed: int = 0,
    batch: int = 16,
    device: str = "cpu",
    out: _Out = None,
    output: Speech = AS_USUAL,
    overrides: Overrides = (),
) -> None:
    """Play one policy on scenarios and print statistics of every score.

    Args:
        names: scenarios (names, .toml files, module:attribute); then the policy: a name, a checkpoint's folder, or
            module:factory.
        episodes: episodes on each scenario.
        seed: seed of episode 0; episode k has seed + k.
        batch: episodes that are played together; changes no result.
        device: cpu, cuda or cuda:k.
        out: also write the score rows to this CSV file.
        output: How it speaks.
        overrides: fields changed in every scenario, as in --set task.duration=30 targets.count=5
    """
    from baselines.benchmark import report, tables
    from baselines.benchmark.comparison import statistics as statistics_of
    from baselines.benchmark.comparison import with_derived

    scenarios, policy = told_apart(names)
    check_file(out, ".csv")
    changed = parse_overrides(overrides)
    settings = Benchmark(scenarios, (policy,), episodes, seed, batch, device, overrides=changed)
    cells = plan(settings)
    rows: list[dict[str, Any]] = []
    numbers = list(range(episodes))
    with Progress([(cell, numbers) for cell in cells], _progress(output)) as progress:
        for cell in cells:
            progress.begin(cell)
            made = _made(cell, settings)
            with _naming(cell):
                for finished in play(made, settings, numbers, progress.step):
                    rows += finished.rows
                    progress.finished(len(finished.rows))
            progress.end()
    told = with_derived(rows, {cell.scenario.name: cell.scenario for cell in cells})
    statistics, console = statistics_of(told), output.console()
    left_out: list[str] = []
    for name, policies in statistics.items():
        left_out += tables.print_scores(console, policy, name, policies[policy])
    print_left_out(console, left_out, "--json has them, and a wider terminal shows them.")
    if out is not None:
        report.write_csv(out, rows)
        console.print(f"wrote {out}", markup=False, highlight=False, soft_wrap=True)
    of = {name: {column: asdict(of) for column, of in by[policy].items()} for name, by in statistics.items()}
    output.give({"policy": policy, "statistics": of, "episodes": rows})


def run(
    scenario: _ScenarioName,
    policy: _PolicyName,
    seed: int = 0,
    device: str = "cpu",
    out: _Out = None,
    output: Speech = AS_USUAL,
    overrides: Overrides = (),
) -> None:
    """Play one episode: in a window, or to a GIF, PNG or NPZ file.

    Args:
        scenario: name of the scenario, .toml file, or module:attribute.
        policy: name of the policy, folder of a checkpoint, or module:factory.
        seed: seed of the episode.
        device: cpu, cuda or cuda:k.
        out: .gif, .png or .npz to write; without it a window opens where there is a display.
        output: How it speaks.
        overrides: fields changed in the scenario, as in --set task.duration=30 targets.count=5
    """
    from baselines.benchmark import tables
    from lissajous_env.console.commands import has_display, show
    from lissajous_env.episodes.recording import record

    scenarios, policy = told_apart((scenario, policy))
    check_file(out, ".gif", ".png", ".npz")
    settings = Benchmark(scenarios, (policy,), 1, seed, 1, device, overrides=parse_overrides(overrides))
    (cell,) = plan(settings)
    notes = _progress(output)
    with Progress([(cell, [0])], notes) as progress:
        progress.begin(cell)
        acting = _made(cell, settings).factory(cell.scenario, 1, device)
        with _naming(cell):
            recording = record(acting, cell.scenario, seed, device, on_step=lambda: progress.step(1))
        progress.finished(1)
        progress.end()
    row = recording.score | {"policy": policy}
    tables.print_row(output.console(), row)
    output.give(row)
    if out is not None or has_display():
        show(recording, out, output)
    else:
        words = "there is no display to open a window on; --out writes a .gif, .png or .npz instead"
        notes.print(words, highlight=False, soft_wrap=True)


def policies(scenario: _ScenarioOrNone = None, output: Speech = AS_USUAL) -> None:
    """List the policies, and what each of them is.

    Args:
        scenario: name of a scenario, .toml file, or module:attribute: those that drive its robots alone.
        output: How it speaks.
    """
    listed = [registry.describe(name) for name in registry.names(scenario)]
    output.give(listed)
    console = output.console()
    columns = [
        Column("name", left=True, style="bold cyan"),
        Column("robots", left=True),
        Column("made", left=True, rank=2),
        Column("for", prose=True, rank=1),
        Column("what it is", prose=True),
    ]
    rows = [_described(**each) for each in listed]
    left_out = print_table(console, columns, rows)
    print_left_out(console, left_out, "--json has them, and a wider terminal shows them.")
    words = (
        "\nA checkpoint's folder is a policy too, and module:factory: factory(scenario, num_worlds, device) makes one; "
        "so is module:act, a function act(observation) that returns actions."
    )
    console.print(words, style="dim", highlight=False)


def _described(name: str, kind: str | None, made_for: Sequence[str], learned: bool, description: str) -> list[str]:
    return [name, kind or "any", "learned" if learned else "classical", ", ".join(made_for) or "any", description]


def _progress(output: Output) -> Any:
    return make_console(stderr=True, quiet=output.quiet)


def _made(cell: Cell, settings: Benchmark) -> Cell:
    """Make the policy of a cell: what is wrong with a name or a folder is bad input, what fails later is the policy's.

    Returns:
        The cell, with the policy that was made as its factory's result.
    """
    with _naming(cell) if is_imported(cell.policy) else nullcontext():
        policy = cell.factory(cell.scenario, settings.worlds, settings.device)
    return replace(cell, factory=as_factory(policy, cell.policy))


@contextmanager
def _naming(cell: Cell) -> Iterator[None]:
    """Say which policy it was that failed, and where."""
    try:
        yield
    except Exception as error:
        raise CommandError(f"{cell.policy} failed on {cell.scenario.name}: {where_raised(error)}") from error
