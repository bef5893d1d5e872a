"""Show recordings in a window or write them to files, for commands."""

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING

from lissajous_env.console.terminal import Output, make_console
from lissajous_env.storage.files import check_writable_file
from lissajous_env.wording import nearest

if TYPE_CHECKING:
    from lissajous_env.episodes.recording import Recording

_MOST_PICTURES = 20_000
"""Limit on the pictures of a GIF or a film."""


def check_pace(speed: float, fps: float) -> None:
    """Check the pace of a film.

    Raises:
        ValueError: the speed is not from 0.01 to 1000, or the pictures per second are not from 0.1 to 50.
    """
    for name, value, least, most in (("speed", speed, 0.01, 1000), ("fps", fps, 0.1, 50)):
        if not least <= value <= most:
            raise ValueError(f"{name} must be from {least:g} to {most:g}, got {value:g}")


def has_display() -> bool:
    """Return True if a window can be opened; without a display, SDL would open an invisible one."""
    driver = os.environ.get("SDL_VIDEODRIVER", "")
    found = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    return driver not in ("dummy", "offscreen") if driver else found


def check_file(out: Path | None, *suffixes: str) -> None:
    """Check that an output file can be written, before any work is done for it.

    Raises:
        ValueError: the suffix is unknown, the path is a folder, or its parent is missing or not writable.
        MissingExtraError: the library for .mp4 or .mcap is not installed.
    """
    if out is None:
        return
    if out.suffix.lower() not in suffixes:
        hint = nearest(out.suffix.lower(), suffixes)
        raise ValueError(f"out must end in {' or '.join(suffixes)}, got {out}{hint}")
    if out.suffix.lower() == ".mp4":
        from lissajous_env.render.film import pyav

        pyav()
    if out.suffix.lower() == ".mcap":
        from lissajous_env.logs.messages import rosbags

        rosbags()
    check_writable_file(out)


def show(
    recording: "Recording",
    out: Path | None,
    output: Output | None = None,
    speed: float = 1.0,
    fps: float = 10.0,
    against: "Recording | None" = None,
) -> None:
    """Show a recording in a window or, if a file is given, write it in the format of its suffix.

    Raises:
        ValueError: a GIF or film would have more than 20,000 pictures.
    """
    from rich.progress import Progress

    from lissajous_env.render import film
    from lissajous_env.replay import Replay

    output = output or Output()
    suffix = "" if out is None else out.suffix.lower()
    if suffix in film.FILMS and (pictures := recording.duration * fps / speed) > _MOST_PICTURES:
        raise ValueError(
            f"speed must be such that a film has at most {_MOST_PICTURES:,} pictures, got {speed:g} with "
            f"{math.ceil(pictures):,}"
        )
    if out is None:
        film.play(recording, speed=speed)
        return
    console = make_console(stderr=True, quiet=output.quiet)
    with Progress(console=console, transient=True, disable=not console.is_interactive or output.quiet) as progress:
        task = progress.add_task("drawing", total=max(recording.duration * fps / speed, 1))
        if suffix == ".html":
            Replay(recording, against).save(out)
        elif suffix in film.FILMS:
            film.save_film(recording, out, fps=fps, speed=speed, on_frame=lambda: progress.advance(task))
        elif suffix == ".mcap":
            from lissajous_env.logs.writing import save_mcap

            save_mcap(recording, out)
        else:
            recording.save(out)
    output.print(f"wrote {out}")
