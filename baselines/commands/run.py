"""The command `lissajous run`: one episode, played now or recorded before, and shown."""

from pathlib import Path
from typing import Annotated

import tyro

from baselines.benchmark.types import Benchmark, cells_of
from baselines.commands.playing import (
    DEFAULT_PLAY,
    FORMATS,
    Play,
    check_file,
    has_display,
    record_one,
    show,
)
from baselines.policies import registry
from lissajous_env.console.terminal import OutFile, print_line
from lissajous_env.plugins import beside
from lissajous_env.wording import nearest, require

_Against = Annotated[str | None, tyro.conf.arg(metavar="POLICY")]
_Names = Annotated[
    tuple[str, ...],
    tyro.conf.Positional,
    tyro.conf.arg(metavar="SCENARIO POLICY | FOLDER | FILE", help_behavior_hint=""),
]


def run(
    names: _Names,
    out: OutFile = None,
    against: _Against = None,
    speed: float = 1.0,
    fps: float = 10.0,
    common: Play = DEFAULT_PLAY,
) -> None:
    """Show an episode, played now or recorded before, and print its scores.

    It is shown in a window, or written as a page, a film, a picture, a recording or a log of ROS.

    Example:
        lissajous run evaders kuramoto-mpcc --seed 3 --against sweep --out episode.html

    Args:
        names: scenario (name, .toml file or module:attribute), then policy (name, folder of a checkpoint or of a plan,
            or module:factory); the folder of a policy alone, which is played on the scenario for which it was made; or
            a recording (.npz) alone, for which --seed is ignored.
        out: file to write, ending in .html, .mp4, .gif, .npz (a recording) or .mcap (a log of
            ROS); without it, a window opens if there is a display.
        against: second policy, shown beside the first on the same seed; requires --out FILE.html.
        speed: playback speed, in seconds of the episode per second, from 0.01 to 1000.
        fps: frames per second of a GIF or MP4, from 0.1 to 50; more of them make a larger file.
    """
    from baselines.benchmark import shown
    from baselines.benchmark.theorem import about_theorem
    from lissajous_env.episodes.recording import load

    check_file(out, *FORMATS)
    for name, value, least, most in (("speed", speed, 0.01, 1000), ("fps", fps, 0.1, 50)):
        require(least <= value <= most, name, f"must be from {least:g} to {most:g}", value)
    if against is not None and (out is None or out.suffix.lower() != ".html"):
        raise ValueError(f"out must end in .html beside --against, got {out or 'none'}")
    is_recorded = len(names) == 1 and not registry.is_folder(names[0])
    if not names or (is_recorded and not Path(names[0]).is_file()):
        hint = "".join(nearest(name, beside(name, ".npz")) for name in names)
        got = f"but there is no file {names[0]}{hint}" if names else "got nothing"
        raise ValueError(
            f"names must be a scenario and a policy, a policy's folder, or the file of a recording (.npz), {got}"
        )
    if is_recorded:
        require(not common.overrides, "overrides", "must be omitted for a recording", common.overrides)
        cells, recording = [], load(names[0])
    else:
        settings, cells = common.cells(names)
        recording = record_one(settings, cells, common)
    other, row = None, recording.score
    if against is not None:
        rival = Benchmark((recording.scenario.name,), (against,), 1, row["seed"], 1, common.device)
        other = record_one(rival, cells_of(rival, scenarios=[recording.scenario]), common)
    shown.print_row(common.console(), row, recording.scenario)
    shown.print_theorem(common.console(), about_theorem(cells, [row], common.device))
    common.print_json(row if other is None else row | {"against": other.score})
    if out is not None or has_display():
        show(recording, out, common, speed, fps, other)
    else:
        words = f"there is no display for a window; --out FILE writes {', '.join(FORMATS)} instead"
        print_line(common.progress(), words)
