"""Commands that compare policies: benchmark, evaluate; and the list of the policies."""

import dataclasses
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import tyro

from baselines.benchmark.progress import Progress
from baselines.benchmark.running import Benchmark, measure, plan, play
from baselines.policies import registry
from baselines.policies.factories import told_apart
from baselines.showing import made, naming, progress_console
from lissajous_env.console.recordings import check_file
from lissajous_env.console.terminal import (
    DEFAULT_OUTPUT,
    Column,
    CommandError,
    OutputOptions,
    print_left_out,
    print_table,
)
from lissajous_env.parameters.overrides import Overrides, parse_overrides

_Out = Annotated[Path | None, tyro.conf.arg(metavar="FILE")]
_ScenarioOrNone = Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[SCENARIO]")]
_Names = Annotated[
    tuple[str, ...],
    tyro.conf.Positional,
    tyro.conf.arg(metavar="[SCENARIO ...] POLICY", help_behavior_hint=""),
]


def benchmark(
    settings: tyro.conf.OmitArgPrefixes[Benchmark], output: OutputOptions = DEFAULT_OUTPUT, overrides: Overrides = ()
) -> int:
    """Compare policies on scenarios: tables, files and pictures.

    Killed at any moment, it goes on where it stopped when it is called again with the same --out.

    Example:
        lissajous benchmark --scenarios experiment rough --episodes 64 --out results/mine

    Options:
        what is played: scenarios, policies, episodes, seed, set
        report: out, against, clairvoyant, replays
        where it runs: device, batch, engine, address

    Args:
        settings: What is played, and where the results go.
        output: How it speaks.
        overrides: fields changed in every scenario, as in --set task.duration=30 targets.count=5
    """
    from baselines.benchmark import report
    from baselines.benchmark.comparison import compare

    settings = dataclasses.replace(settings, overrides=parse_overrides(overrides))
    try:
        outcome = measure(settings, console=output.console(), progress=progress_console(output))
    except KeyboardInterrupt:
        words = f"finished episodes are kept in {settings.out}, the same command goes on from there"
        raise KeyboardInterrupt(words) from None
    if output.json:
        comparisons = compare(outcome.rows, outcome.scenarios, settings.against)
        summary = report.summarized(outcome, outcome.rows, outcome.scenarios, comparisons)
        output.print_json({**summary, "episodes": outcome.rows})
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
    output: OutputOptions = DEFAULT_OUTPUT,
    overrides: Overrides = (),
) -> None:
    """Play one policy on scenarios and print statistics of every score.

    Example:
        lissajous evaluate experiment kuramoto-mpcc --set "faults.schedule=()"

    Options:
        what is played: episodes, seed, set
        where it runs: device, batch
        files: out

    Args:
        names: scenarios (names, .toml files, module:attribute); then the policy: a name, a checkpoint's folder, or
            module:factory. A folder alone is played on the scenario that it was trained on.
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

    # A folder holds the scenario that its policy was trained on.
    alone = len(names) == 1 and registry.is_folder(names[0])
    scenarios, policy = ((), names[0]) if alone else told_apart(names)
    check_file(out, ".csv")
    changed = parse_overrides(overrides)
    settings = Benchmark(scenarios or (policy,), (policy,), episodes, seed, batch, device, overrides=changed)
    cells = plan(settings, scenarios=[registry.home(policy)] if alone else None)
    rows: list[dict[str, Any]] = []
    numbers = list(range(episodes))
    with Progress([(cell, numbers) for cell in cells], progress_console(output)) as progress:
        for cell in cells:
            progress.begin(cell)
            ready = made(cell, settings)
            with naming(cell):
                for finished in play(ready, settings, numbers, progress.step):
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
    output.print_json({"policy": policy, "statistics": of, "episodes": rows})


def policies(scenario: _ScenarioOrNone = None, output: OutputOptions = DEFAULT_OUTPUT) -> None:
    """List the policies, and what each of them is.

    Example:
        lissajous policies intruders

    Args:
        scenario: name of a scenario, .toml file, or module:attribute: those that drive its robots alone.
        output: How it speaks.
    """
    listed = [registry.describe(name) for name in registry.names(scenario)]
    output.print_json(listed)
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
        "so is module:act, a function act(observation) that returns actions, and a name that a module of the current "
        "folder registers."
    )
    console.print(words, style="dim", highlight=False)


def _described(name: str, kind: str | None, made_for: Sequence[str], learned: bool, description: str) -> list[str]:
    return [name, kind or "any", "learned" if learned else "classical", ", ".join(made_for) or "any", description]
