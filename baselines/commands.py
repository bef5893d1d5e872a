"""Commands that put policies to work: benchmark, evaluate, run."""

import dataclasses
import sys
from pathlib import Path
from typing import Annotated

import tyro
from rich.markup import escape

from baselines.benchmark import Benchmark, measure, plan, play
from baselines.progress import Progress
from lissajous_env.cli import Overrides, parse_overrides

_Out = Annotated[Path | None, tyro.conf.arg(metavar="FILE")]
_PolicyName = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="POLICY")]
_ScenarioName = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SCENARIO")]
_ScenarioNames = Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="SCENARIO ...")]


def benchmark(settings: tyro.conf.OmitArgPrefixes[Benchmark], overrides: Overrides = ()) -> int:
    """Compare policies on scenarios: tables, files and pictures.

    Killed at any moment, it goes on where it stopped when it is called again with the same --out.

    Args:
        settings: What is played, and where the results go.
        overrides: fields changed in every scenario, as in --set task.duration=30 targets.count=5
    """
    settings = dataclasses.replace(settings, overrides=parse_overrides(overrides))
    try:
        outcome = measure(settings)
    except KeyboardInterrupt:
        words = f"finished episodes are kept in {settings.out}, the same command goes on from there"
        raise KeyboardInterrupt(words) from None
    return 1 if outcome.failures else 0


def evaluate(
    policy: _PolicyName,
    scenarios: _ScenarioNames,
    episodes: int = 64,
    seed: int = 0,
    batch: int = 16,
    device: str = "cpu",
    out: _Out = None,
    overrides: Overrides = (),
) -> None:
    """Play one policy on scenarios and print statistics of every score.

    Args:
        policy: name of the policy, folder of a checkpoint, or module:factory.
        scenarios: names of the scenarios.
        episodes: episodes on each scenario.
        seed: seed of episode 0; episode k has seed + k.
        batch: episodes that are played together.
        device: cpu, cuda or cuda:k.
        out: also write the score rows to this CSV file.
        overrides: fields changed in every scenario, as in --set task.duration=30 targets.count=5
    """
    from baselines import report

    changed = parse_overrides(overrides)
    settings = Benchmark(scenarios, (policy,), episodes, seed, batch, device, overrides=changed)
    cells = plan(settings)
    console = report.wide_console()
    rows = []
    numbers = list(range(episodes))
    with Progress([(cell, numbers) for cell in cells]) as progress:
        for cell in cells:
            progress.begin(cell)
            for finished in play(cell, settings, numbers, progress.step):
                rows += finished
                progress.finished(len(finished))
            progress.end()
    for name, policies in report.statistics(rows).items():
        report.print_scores(console, f"[b]{escape(policy)}[/b] on [b]{escape(name)}[/b]", policies[policy])
    if out is not None:
        report.write_csv(out, rows)
        console.print(f"wrote {out}", markup=False, highlight=False, soft_wrap=True)


def run(
    scenario: _ScenarioName,
    policy: _PolicyName,
    seed: int = 0,
    device: str = "cpu",
    out: _Out = None,
    overrides: Overrides = (),
) -> None:
    """Play one episode: in a window, or to a GIF, PNG or NPZ file.

    Args:
        scenario: name of the scenario.
        policy: name of the policy, folder of a checkpoint, or module:factory.
        seed: seed of the episode.
        device: cpu, cuda or cuda:k.
        out: .gif, .png or .npz to write; without it a window opens where there is a display.
        overrides: fields changed in the scenario, as in --set task.duration=30 targets.count=5
    """
    from baselines import report
    from lissajous_env.commands import check_file, has_display, show
    from lissajous_env.replay import record

    check_file(out, ".gif", ".png", ".npz")
    settings = Benchmark((scenario,), (policy,), 1, seed, 1, device, overrides=parse_overrides(overrides))
    (cell,) = plan(settings)
    with Progress([(cell, [0])]) as progress:
        progress.begin(cell)
        made = cell.factory(cell.scenario, 1, device)
        recording = record(made, cell.scenario, seed, device, on_step=lambda: progress.step(1))
        progress.finished(1)
        progress.end()
    console = report.wide_console()
    report.print_row(console, recording.score | {"policy": policy})
    if out is None and not has_display():
        print("there is no display to open a window on; --out writes a .gif, .png or .npz instead", file=sys.stderr)
        return
    show(recording, out)
