"""Which scenarios there are; and how commands show a recording or write it to a file."""

import dataclasses
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.text import Text

from lissajous_env.console.terminal import AS_USUAL, Column, Output, Speech, make_console, print_left_out, print_table
from lissajous_env.parameters.scenario import PARTS
from lissajous_env.storage.files import check_writable_file
from lissajous_env.wording import nearest

if TYPE_CHECKING:
    from rich.console import Console

    from lissajous_env.episodes.recording import Recording
    from lissajous_env.parameters.scenario import Scenario

_Scenarios = Annotated[
    tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[SCENARIO ...]", help_behavior_hint="")
]
_MOST_PICTURES = 20_000
"""Of a GIF or a film."""


def scenarios(names: _Scenarios = (), output: Speech = AS_USUAL) -> None:
    """List the scenarios, with the numbers that describe their designs; of those that are named, all that is set.

    Args:
        names: names of scenarios, .toml files, or module:attribute; without any, all that have a name.
        output: How it speaks.
    """
    from lissajous_env.parameters import named
    from lissajous_env.parameters.assumptions import violations

    console = output.console()
    given = [named.build(name) for name in names or named.scenarios()]
    made = [each.resolve() for each in given]
    _print_designs(console, made)
    if names:
        for each in given:
            _print_settings(console, each)
            _print_violations(console, violations(each))
    derived = ("num_robots", "detection_time_bound", "detection_time_is_bounded")
    output.give([
        each.to_dict() | {name: getattr(each, name) for name in derived} | {"violations": violations(each)}
        for each in made
    ])  # fmt: skip


def _print_designs(console: "Console", made: "list[Scenario]") -> None:
    narrow = console.width < 110
    columns = [Column("name", left=True, style="bold cyan"), Column("N"), Column("robots", left=True)]
    columns += map(Column, ("rectangle\n[m]", "curve\na:b", "r_s\n[m]", "T_max\n[s]"))
    rows = []
    for each in made:
        curve = each.curve
        name = f"{curve.a}:{curve.b}" + (f":{curve.c}" if curve.half_depth > 0 else "")
        sides = [2 * curve.half_width, 2 * curve.half_height, 2 * curve.half_depth]
        rows.append([
            each.name,
            str(each.num_robots),
            each.robot.kind,
            " x ".join(f"{side:g}" for side in sides if side > 0),
            "series" if curve.harmonics else name,
            f"{each.sensing.radius:.3g}",
            f"{each.detection_time_bound:.3g}" if each.detection_time_is_bounded else "-",
        ])  # fmt: skip
    if not narrow:
        columns.append(Column("description", prose=True))
        rows = [[*row, each.description] for row, each in zip(rows, made, strict=True)]
    left_out = print_table(console, columns, rows)
    console.print()
    if narrow:
        for each in made:
            console.print(Text.assemble((each.name, "bold cyan"), f": {each.description}"), highlight=False)
        console.print()
    print_left_out(console, left_out, "--json has them, and a wider terminal shows them.")
    words = (
        "N robots; r_s sensing radius; T_max = (2 pi / omega) / (N / kappa): the undisturbed formation detects every "
        "target by then. - where that is not so, because r_s is below (8) or N is not a + b."
    )
    console.print(words, style="dim", highlight=False)


def _print_settings(console: "Console", given: "Scenario") -> None:
    """Print the fields in which a scenario differs from what its parts are by default."""
    rows = []
    for part in PARTS:
        values = getattr(given, part)
        for field in dataclasses.fields(values):
            value = getattr(values, field.name)
            if value != field.default:
                rows.append([f"{part}.{field.name}", str(value), str(field.default)])
    for each in given.extensions:
        settings = ", ".join(f"{name} = {value}" for name, value in each.settings.items())
        rows.append(["extensions", f"{each.kind} {each.place}{settings and f' ({settings})'}", ""])
    console.print()
    columns = [Column("field", left=True), Column(given.name, prose=True), Column("default", left=True, rank=1)]
    left_out = print_table(console, columns, rows)
    print_left_out(console, left_out, "--json has all fields.")
    console.print(f"{given.name}: what differs from the defaults; digest {given.digest()}.", style="dim", markup=False)


def _print_violations(console: "Console", sentences: Sequence[str]) -> None:
    """Print the assumptions of the paper that a scenario violates."""
    if sentences:
        console.print("\nAssumptions of the paper that it violates:")
    for words in sentences:
        console.print(f"* {words}", markup=False, highlight=False, soft_wrap=True)


def check_pace(speed: float, fps: float) -> None:
    """Refuse a pace at which nothing can be shown.

    Raises:
        ValueError: a speed below 0.01 or above 1000, or pictures a second below 0.1 or above 50.
    """
    for name, value, least, most in (("speed", speed, 0.01, 1000), ("fps", fps, 0.1, 50)):
        if not least <= value <= most:
            raise ValueError(f"{name} must be from {least:g} to {most:g}, got {value:g}")


def has_display() -> bool:
    """Whether a window can be opened; without a display SDL would draw one that nobody can see or close."""
    if sys.platform in ("win32", "darwin"):
        return True
    driver = os.environ.get("SDL_VIDEODRIVER", "")
    found = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    return driver not in ("dummy", "offscreen") if driver else found


def check_file(out: Path | None, *suffixes: str) -> None:
    """Refuse a file that cannot be written or whose format is not there, before any work is done for it.

    Raises:
        ValueError: another suffix, a folder in its place, or a folder around it that is not there or not writable.
        MissingExtraError: an .mp4 without the library that encodes it.
    """
    if out is None:
        return
    if out.suffix.lower() not in suffixes:
        hint = nearest(out.suffix.lower(), suffixes)
        raise ValueError(f"out must end in {' or '.join(suffixes)}, got {out}{hint}")
    if out.suffix.lower() == ".mp4":
        from lissajous_env.render import mp4

        mp4.pyav()
    check_writable_file(out)


def show(
    recording: "Recording",
    out: Path | None,
    output: Output | None = None,
    speed: float = 1.0,
    fps: float = 10.0,
    against: "Recording | None" = None,
) -> None:
    """Show a recording in a window or, given a file, write it there in the format of its suffix.

    Raises:
        ValueError: a GIF or a film of more than 20,000 pictures.
    """
    from rich.progress import Progress

    from lissajous_env.render import film
    from lissajous_env.replay import Replay

    output = output or Output()
    suffix = "" if out is None else out.suffix.lower()
    films = {".gif": film.save_gif, ".mp4": film.save_mp4}
    if suffix in films and (pictures := recording.duration * fps / speed) > _MOST_PICTURES:
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
        elif suffix in films:
            films[suffix](recording, out, fps=fps, speed=speed, on_frame=lambda: progress.advance(task))
        elif suffix in film.STILLS:
            film.save_sheet(recording, out)
        else:
            recording.save(out)
    output.console().print(f"wrote {out}", markup=False, highlight=False, soft_wrap=True)
