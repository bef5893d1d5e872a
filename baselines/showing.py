"""Commands that show one episode: run, which plays it, and replay, which also shows what was recorded or plays two."""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from baselines.benchmark.progress import Progress
from baselines.benchmark.running import Benchmark, Cell, plan
from baselines.policies.factories import as_factory, is_imported, told_apart
from lissajous_env.console.recordings import check_file, check_pace, has_display, show
from lissajous_env.console.terminal import DEFAULT_OUTPUT, CommandError, Output, OutputOptions, make_console
from lissajous_env.here import beside
from lissajous_env.parameters.overrides import Overrides, parse_overrides
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import few_of, nearest, where_raised

if TYPE_CHECKING:
    from lissajous_env.episodes.recording import Recording

_Out = Annotated[Path | None, tyro.conf.arg(metavar="FILE")]
_PolicyName = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="POLICY")]
_ScenarioName = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SCENARIO")]
_Against = Annotated[str | None, tyro.conf.arg(metavar="POLICY")]
_Names = Annotated[
    tuple[str, ...],
    tyro.conf.Positional,
    tyro.conf.arg(metavar="SCENARIO POLICY | FILE", help_behavior_hint=""),
]
_FORMATS = (".html", ".mp4", ".gif", ".png", ".svg", ".pdf", ".npz")


def run(
    scenario: _ScenarioName,
    policy: _PolicyName,
    seed: int = 0,
    device: str = "cpu",
    out: _Out = None,
    output: OutputOptions = DEFAULT_OUTPUT,
    overrides: Overrides = (),
) -> None:
    """Play one episode: in a window, or to a file: a page, a film, pictures or a recording.

    Example:
        lissajous run intruders sweep --out sweep.gif

    Args:
        scenario: name of the scenario, .toml file, or module:attribute.
        policy: name of the policy, folder of a checkpoint, or module:factory.
        seed: seed of the episode.
        device: cpu, cuda or cuda:k.
        out: .html, .mp4, .gif, .png, .svg, .pdf or .npz to write; without it a window opens where there is a display.
        output: How it speaks.
        overrides: fields changed in the scenario, as in --set task.duration=30 targets.count=5
    """
    from baselines.benchmark import tables

    scenarios, policy = told_apart((scenario, policy))
    check_file(out, *_FORMATS)
    settings = Benchmark(scenarios, (policy,), 1, seed, 1, device, overrides=parse_overrides(overrides))
    recording = _played(settings, output)
    row = recording.score
    tables.print_row(output.console(), row)
    output.print_json(row)
    if out is not None or has_display():
        show(recording, out, output)
    else:
        words = f"there is no display to open a window on; --out writes {', '.join(_FORMATS)} instead"
        progress_console(output).print(words, highlight=False, soft_wrap=True)


def replay(
    names: _Names,
    out: _Out = None,
    against: _Against = None,
    seed: int = 0,
    device: str = "cpu",
    speed: float = 1.0,
    fps: float = 10.0,
    output: OutputOptions = DEFAULT_OUTPUT,
    overrides: Overrides = (),
) -> None:
    """Show an episode, played now or recorded before: as a page, in a window, or as MP4, GIF, PNG, SVG or PDF.

    Example:
        lissajous replay intruders kuramoto-mpcc --against sweep --out replay.html

    Options:
        episode: seed, device, set
        what is shown: out, against, speed, fps

    Args:
        names: scenario and policy, as for `lissajous run`; or a recording, as that writes it to FILE.npz.
        out: .html, .mp4, .gif, .png, .svg, .pdf or .npz to write; without it a window opens: space pauses, left and
            right step, escape quits.
        against: policy that plays the same seed beside it, on an .html page.
        seed: seed of the episode; a recording has its own.
        device: cpu, cuda or cuda:k.
        speed: seconds of the episode shown in one second, from 0.01 to 1000.
        fps: pictures a second of a GIF or MP4, from 0.1 to 50.
        output: How it speaks.
        overrides: fields changed in the scenario, as in --set task.duration=30 targets.count=5
    """
    check_file(out, *_FORMATS)
    check_pace(speed, fps)
    if not names or (len(names) == 1 and not Path(names[0]).is_file()):
        hint = "".join(nearest(name, beside(name, ".npz")) for name in names)
        got = f"but there is no file {names[0]}{hint}" if names else "got nothing"
        raise ValueError(f"names must be a scenario and a policy, or the file of a recording (.npz), {got}")
    if against is not None and (out is None or out.suffix.lower() != ".html"):
        raise ValueError(f"out must end in .html beside --against, got {out or 'none'}")
    if out is None and not has_display():
        raise ValueError(f"out must be given ({', '.join(_FORMATS)}): there is no display to open a window on")
    if against is not None and len(names) > 1:  # refused before the other has been played
        scenarios, _ = told_apart(names)
        plan(Benchmark(scenarios, (against,), 1, seed, 1, device, overrides=parse_overrides(overrides)))
    recording = _recorded(names, seed, device, output, overrides)
    other = None
    if against is not None:
        rival = Benchmark((recording.scenario.name,), (against,), 1, recording.score["seed"], 1, device)
        other = _played(rival, output, recording.scenario)
    show(recording, out, output, speed, fps, other)
    scores = {"score": recording.score} | ({} if other is None else {"against": other.score})
    output.print_json({"wrote": out, **scores})


def _recorded(names: tuple[str, ...], seed: int, device: str, output: Output, overrides: Overrides) -> "Recording":
    """Read the recording of a file, or play a policy on a scenario."""
    from lissajous_env.episodes.recording import load

    file, *others = names
    if others:
        scenarios, policy = told_apart(names)
        changed = parse_overrides(overrides)
        return _played(Benchmark(scenarios, (policy,), 1, seed, 1, device, overrides=changed), output)
    if overrides:
        raise ValueError("overrides must be left out beside a recording, which was played as it is")
    return load(file)


def _played(settings: Benchmark, output: Output, scenario: Scenario | None = None) -> "Recording":
    """Play the one policy of some settings on their one scenario, or on a given one, and record it."""
    from lissajous_env.episodes.recording import record

    if len(settings.scenarios) > 1:
        raise ValueError(f"scenario must be one alone, got {few_of(settings.scenarios)}")
    (cell,) = plan(settings, scenarios=None if scenario is None else [scenario])
    with Progress([(cell, [0])], progress_console(output)) as progress:
        progress.begin(cell)
        acting = made(cell, settings).factory(cell.scenario, 1, settings.device)
        with naming(cell):
            recording = record(acting, cell.scenario, settings.seed, settings.device, lambda: progress.step(1))
        progress.finished(1)
        progress.end()
    return replace(recording, score=recording.score | {"policy": cell.policy})


def progress_console(output: Output) -> Any:
    """Console on stderr for how far work is."""
    return make_console(stderr=True, quiet=output.quiet)


def made(cell: Cell, settings: Benchmark) -> Cell:
    """Make the policy of a cell: what is wrong with a name or a folder is bad input, what fails later is the policy's.

    Returns:
        The cell, with the policy that was made as its factory's result.
    """
    with naming(cell) if is_imported(cell.policy) else nullcontext():
        policy = cell.factory(cell.scenario, settings.worlds, settings.device)
    return replace(cell, factory=as_factory(policy, cell.policy))


@contextmanager
def naming(cell: Cell) -> Iterator[None]:
    """Say which policy it was that failed, and where."""
    try:
        yield
    except (Exception, SystemExit) as error:
        raise CommandError(f"{cell.policy} failed on {cell.scenario.name}: {where_raised(error)}") from error
