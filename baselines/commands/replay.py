"""The command `lissajous replay`: an episode, played now or recorded before, as a page, in a window, or as a film."""

from pathlib import Path
from typing import Annotated

import tyro

from baselines.benchmark.types import Cell
from baselines.commands.playing import DEFAULT_PLAY, FORMATS, PlayOptions, check_file, has_display, record_one, show
from baselines.policies import registry
from baselines.policies.registry import as_factory
from lissajous_env.console.terminal import OutFile, RogueName
from lissajous_env.episodes.recording import load
from lissajous_env.plugins import files_beside
from lissajous_env.wording import nearest, require

_Against = Annotated[str | None, tyro.conf.arg(metavar="POLICY")]
_Names = Annotated[
    tuple[str, ...],
    tyro.conf.Positional,
    tyro.conf.arg(metavar="SCENARIO POLICY | FILE", help_behavior_hint=""),
]


def replay(
    names: _Names,
    out: OutFile = None,
    against: _Against = None,
    speed: float = 1.0,
    fps: float = 10.0,
    rogues: RogueName = None,
    common: PlayOptions = DEFAULT_PLAY,
) -> None:
    """Show an episode, played now or recorded before: as a page, in a window, or as MP4 or GIF.

    Example:
        lissajous replay evaders sweep --against kuramoto-mpcc --out replay.html

    Args:
        names: scenario and policy, or a policy's folder, as for `lissajous run`; or a recording (.npz) of it, for which
            --seed is ignored.
        out: file to write, ending in .html, .mp4, .gif, .npz or .mcap; without it, a window opens.
        against: second policy, shown beside the first on the same seed; requires --out FILE.html.
        speed: playback speed, in seconds of the episode per second, from 0.01 to 1000.
        fps: frames per second of a GIF or MP4, from 0.1 to 50; more of them make a larger file.
    """
    check_file(out, *FORMATS)
    for name, value, least, most in (("speed", speed, 0.01, 1000), ("fps", fps, 0.1, 50)):
        require(least <= value <= most, name, f"must be from {least:g} to {most:g}", value)
    is_recording = len(names) == 1 and not registry.is_folder(names[0])
    if is_recording and not Path(names[0]).is_file():
        rule = "names must be a scenario and a policy, a policy's folder, or the file of a recording (.npz)"
        raise ValueError(f"{rule}, but there is no file {names[0]}{nearest(names[0], files_beside(names[0], '.npz'))}")
    is_page = is_recording and names[0].endswith(".html")
    require(not is_page, "names", "must be of a recording, not of a page, which browsers open", " ".join(names))
    if against is not None and (out is None or out.suffix.lower() != ".html"):
        raise ValueError(f"out must end in .html beside --against, got {out or 'none'}")
    rival = None if against is None else as_factory(against)  # refuses an unknown policy before the first one plays
    if out is None and not has_display():
        raise ValueError(f"out must be given ({', '.join(FORMATS)}): there is no display for a window")
    if not is_recording:
        recording = record_one(common.cell(names, rogues=rogues), common.seed, common)
    elif common.overrides or rogues:
        raise ValueError("overrides must be omitted for a recording, which is replayed unchanged")
    else:
        recording = load(*names)
    other = None
    if rival is not None:
        other = record_one(Cell(recording.scenario, str(against), rival), recording.score["seed"], common)
    show(recording, out, common, speed, fps, other)
    scores = {"score": recording.score} | ({} if other is None else {"against": other.score})
    common.print_json({"wrote": out, **scores})
