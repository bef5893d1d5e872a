"""Commands about the world itself: which scenarios there are, and recordings of episodes."""

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from lissajous_env.replay import Recording

_File = Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
_Out = Annotated[Path | None, tyro.conf.arg(metavar="FILE")]


def scenarios() -> None:
    """List the scenarios, with the numbers that describe their designs."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from lissajous_env import library

    console = Console()
    narrow = console.width < 110
    table = Table(box=None, header_style="bold", padding=(0, 2, 0, 0), pad_edge=False)
    table.add_column("name", style="bold cyan", no_wrap=True)
    for title in ("N", "robots", "rectangle\n\\[m]", "curve\na:b", "r_s\n\\[m]", "T_max\n\\[s]"):
        table.add_column(title, justify="left" if title == "robots" else "right", no_wrap=True)
    if not narrow:
        table.add_column("description")
    made = [library.scenario(name).resolve() for name in library.scenarios()]
    for each in made:
        curve = each.curve
        sides = [2 * curve.half_width, 2 * curve.half_height, 2 * curve.half_depth]
        table.add_row(
            each.name,
            str(each.num_robots),
            each.robot.kind,
            " x ".join(f"{side:g}" for side in sides if side > 0),
            f"{curve.a}:{curve.b}" + (f":{curve.c}" if curve.half_depth > 0 else ""),
            f"{each.sensing.radius:.3g}",
            f"{each.detection_time_bound:.3g}",
            *([] if narrow else [escape(each.description)]),
        )
    console.print(table, "")
    if narrow:
        for each in made:
            console.print(f"[bold cyan]{each.name}[/]: {escape(each.description)}", highlight=False)
        console.print()
    words = "N robots; r_s sensing radius; T_max = (2 pi / omega) / (N / kappa), by which a target is detected."
    console.print(words, style="dim", highlight=False)


def replay(file: _File, out: _Out = None, speed: float = 1.0, fps: float = 10.0) -> None:
    """Show a recording: in a window, or as a GIF or PNG file.

    Args:
        file: recording, as `lissajous run SCENARIO POLICY --out FILE.npz` writes it.
        out: .gif or .png to write; without it a window opens: space pauses, left and right step, escape quits.
        speed: seconds of the episode shown in one second.
        fps: pictures a second of a GIF.
    """
    from lissajous_env.replay import load

    check_file(out, ".gif", ".png")
    if not file.is_file():
        raise ValueError(f"file must be a recording (.npz), but there is no file {file}")
    if out is None and not has_display():
        raise ValueError("out must be given (.gif or .png): there is no display to open a window on")
    show(load(file), out, speed, fps)


def has_display() -> bool:
    """Whether a window can be opened; without a display SDL would draw one that nobody can see or close."""
    if sys.platform in ("win32", "darwin"):
        return True
    driver = os.environ.get("SDL_VIDEODRIVER", "")
    found = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    return driver not in ("dummy", "offscreen") if driver else found


def check_file(out: Path | None, *suffixes: str) -> None:
    """Refuse a file to write whose format or folder is not there, before any work is done.

    Raises:
        ValueError: another suffix, or a folder that does not exist.
    """
    if out is None:
        return
    if out.suffix.lower() not in suffixes:
        raise ValueError(f"out must end in {' or '.join(suffixes)}, got {out}")
    if not out.absolute().parent.is_dir():
        raise ValueError(f"out must be in a folder that is there, got {out}")


def show(recording: "Recording", out: Path | None, speed: float = 1.0, fps: float = 10.0) -> None:
    """Show a recording in a window or, given a file, write it there in the format of its suffix."""
    from rich.console import Console
    from rich.progress import Progress

    from lissajous_env.replay import play

    if out is None:
        play(recording, speed=speed)
        return
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(f"drawing {out.name}", total=max(recording.duration * fps / max(speed, 1e-9), 1))
        if out.suffix.lower() == ".gif":
            recording.save_gif(out, fps=fps, speed=speed, on_frame=lambda: progress.advance(task))
        elif out.suffix.lower() == ".png":
            recording.save_png(out)
        else:
            recording.save(out)
    print(f"wrote {out}")
