"""The command `lissajous reproduce`: the paper's figures and claims, simulated again."""

import dataclasses
import shlex
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from baselines.reproduce import claims, detection, experiment, resilience, theorems, three_dimensions, tracking
from baselines.reproduce.claims import Claim, Part
from baselines.reproduce.drawing import Format, Picture
from baselines.reproduce.episodes import Player
from lissajous_env.console.terminal import DEFAULT_OUTPUT, Device, Output, bar
from lissajous_env.device.devices import as_device
from lissajous_env.parameters.assumptions import quietly
from lissajous_env.settings.checks import whole_number
from lissajous_env.storage.folder import Folder
from lissajous_env.wording import counted, require

PARTS: dict[str, Callable[[Player], Part]] = {part.__name__: part for part in (
    detection.fig2, detection.fig3, resilience.fig4, three_dimensions.fig5, resilience.fig6, experiment.fig7,
    experiment.fig8, tracking.fig9, theorems.theorem1, theorems.theorem2, resilience.theorem3, resilience.theorem4,
    theorems.lemmas, theorems.bounds, theorems.rogues, three_dimensions.knot, tracking.experiment1, tracking.printed,
    tracking.window,
)}  # fmt: skip
"""Parts of the paper by name, in the order of the table."""

_PAGE = "README.md"
_Names = Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[NAME ...]")]
_Out = Annotated[Path, tyro.conf.arg(metavar="FOLDER")]


def reproduce(
    figures: _Names = ("all",),
    out: _Out = Path("results/reproduce"),
    seed: int = 0,
    device: Device = "cpu",
    format: Format = "png",
    output: Output = DEFAULT_OUTPUT,
) -> list[Claim]:
    """Simulate the paper's figures and claims again: pictures, and a table of the claims that agree.

    The folder receives a picture for each figure of the paper, and README.md with the table and the pictures. All parts
    together take about a minute.

    Example:
        lissajous reproduce fig6 theorem4

    Args:
        figures: parts of the paper: fig2 to fig9, theorem1 to theorem4, lemmas, bounds, rogues, knot, experiment1,
            printed, window; by default all of them.
        out: folder of the results; existing results in it are replaced.
        seed: seed of the first episode; episode k has seed + k.
        format: format of the pictures.

    Returns:
        The rows of the table.

    Raises:
        ValueError: an unknown name (the message offers the nearest), a seed out of range or a device that is not there.
    """
    chosen = _chosen(figures)
    whole_number("seed", seed, 0, 2**31 - 1001)
    as_device(device)
    results: list[Claim] = []
    pictures: list[Picture] = []
    formatted = [] if format == "png" else ["--format", format]
    command = shlex.join(["lissajous", "reproduce", *figures, "--seed", str(seed), *formatted])
    console, notes = output.console(), output.progress()
    with Folder(out, (_PAGE, *(f"{name}.{format}" for name in chosen))) as folder:
        try:
            for result in _played(chosen, Player(seed, device), notes):
                if isinstance(result, Picture):
                    folder.write(f"{result.name}.{format}", result.content(format))
                    pictures.append(result)
                else:
                    results.append(result)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"what was finished is in {out}") from None
        finally:
            folder.write(_PAGE, claims.as_page(results, pictures, format, command))
    claims.print_claims(console, results)
    output.print(f"\n{claims.summary(results)}. {counted(len(pictures), 'picture')} and README.md are in {out}")
    output.print_json(results)
    return results


def _chosen(figures: Sequence[str]) -> list[str]:
    """Return the names of the parts, in the order of the table."""
    known = [*PARTS, "all"]
    for name in figures:
        require(name in known, "figures", f"must be some of {', '.join(known)}", name, known)
    return list(PARTS) if "all" in figures or not figures else [name for name in PARTS if name in figures]


def _played(chosen: Sequence[str], player: Player, console: Console) -> Part:
    """Make the parts one after the other, with a bar on stderr, or a line for each where that is no terminal."""
    with bar(console, "{task.completed}/{task.total}") as progress:
        task = progress.add_task("", total=len(chosen))
        for name in chosen:
            about = (PARTS[name].__doc__ or "").partition("\n")[0].rstrip(".")
            progress.update(task, description=f"{name}: {about}")
            began = time.monotonic()
            with quietly():  # the claims themselves state which assumptions their scenarios violate
                results = list(PARTS[name](player))
            for result in results:
                yield result if isinstance(result, Picture) else dataclasses.replace(result, part=name)
            progress.advance(task)
            if not console.is_interactive:
                console.print(f"{name}: {time.monotonic() - began:.1f} s", highlight=False)
