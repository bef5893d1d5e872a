"""The command `lissajous score`: a log of robots, scored as the simulation scores its own episodes."""

from pathlib import Path
from typing import Annotated

import tyro

from baselines.benchmark import shown
from baselines.benchmark.table import Table
from baselines.benchmark.written import as_csv
from baselines.commands.playing import FORMATS, check_file, show
from lissajous_env.console.terminal import (
    DEFAULT_OUTPUT,
    LogFiles,
    Output,
    Overrides,
    ScenarioOption,
    bar,
    parse_overrides,
)
from lissajous_env.logs.poses import TOPICS
from lissajous_env.logs.reading import read
from lissajous_env.logs.scoring import own_scenario
from lissajous_env.logs.scoring import score as score_log
from lissajous_env.logs.writing import save_mcap
from lissajous_env.parameters import named
from lissajous_env.settings.checks import whole_number
from lissajous_env.storage.files import write_atomically

_Out = Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE ...", help_behavior_hint="")]


def score(
    logs: LogFiles,
    scenario: ScenarioOption = None,
    topics: tuple[str, ...] = TOPICS,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    gap: float | None = None,
    episodes: int = 1,
    seed: int | None = None,
    out: _Out = (),
    output: Output = DEFAULT_OUTPUT,
    overrides: Overrides = (),
) -> None:
    """Score a log of robots like a simulated episode, with virtual targets.

    Example:
        lissajous score lab.mcap --scenario lab.toml --episodes 16 --out lab.html

    Args:
        logs: rosbag2 file (.mcap) or folder, or several that belong together, as one for each robot; a log that --out
            FILE.mcap wrote contains its own scenario.
        scenario: name of a scenario, .toml file, or module:attribute; its robots and rectangle are those of the log.
        topics: topics of the robots' poses in their order, or one name in which {} stands for their numbers; for /tf
            and arrays of poses also with a part, as in /tf:car_{}.
        origin: x, y [m] and heading [rad] of the middle of the rectangle in the frame of the log.
        gap: longest time without a pose during which a robot counts as working [s]; by default 0.5 s, or the control
            step if that is longer.
        episodes: number of draws of virtual targets, each of which is scored.
        seed: seed of the first draw; by default that of the log, or 0.
        out: files to write: .csv (score rows), .html (page of the episode), or any other that `lissajous run` writes.
    """
    whole_number("episodes", episodes, 1, 1_000_000)
    for file in out:
        check_file(file, ".csv", *FORMATS)
        if {file.resolve(), file.resolve().parent} & {log.resolve() for log in logs}:
            raise ValueError(f"out must be another file than the log, got {file}")
    log = read(logs, topics, origin=origin)
    given = scenario
    if overrides and (given := scenario or own_scenario(log)) is not None:
        given = named.scenario(given, **parse_overrides(overrides))
    first = seed if seed is not None else int((log.episode or {}).get("seed", 0))
    seeds, is_shown = range(first, first + episodes), any(file.suffix.lower() not in (".csv", ".mcap") for file in out)
    with bar(output.progress()) as shown_bar:
        task = shown_bar.add_task(f"scoring {log.name}", total=None)
        scored = score_log(log, given, seeds, gap, lambda: shown_bar.advance(task), is_shown)
    console, played = output.console(), scored.recording.scenario
    output.print(f"{log.name}: {len(log.tracks)} robots, {played.task.duration:g} s from {scored.log.start:.3f} s on")
    if episodes == 1:
        shown.print_row(console, scored.rows[0], played)
    else:
        ((policy, estimates),) = Table.of(scored.rows, {played.name: played}).estimates[played.name].items()
        shown.print_scores(console, policy, played, estimates)
    for note in scored.notes:
        output.print(f"note: {note}", "yellow")
    for file in out:
        if file.suffix.lower() == ".csv":
            write_atomically(file, as_csv(scored.rows))
        elif file.suffix.lower() == ".mcap":
            save_mcap(scored.log, file)
        else:
            show(scored.recording, file, output)
            continue
        output.print(f"wrote {file}")
    output.print_json({"log": log.name, "start": scored.log.start, "notes": scored.notes, "episodes": scored.rows})
