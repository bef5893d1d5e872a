"""The command `lissajous guarantee`: critical speeds of evading targets."""

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from baselines.reproduce.drawing import DARK, GREY, SERIES, Format, Picture, sheet
from lissajous_env.console.terminal import (
    DEFAULT_OUTPUT,
    Column,
    OutputOptions,
    Overrides,
    ScenarioNames,
    parse_overrides,
    print_table,
)
from lissajous_env.device.devices import cores
from lissajous_env.episodes.guarantee import Reach, fastest_rogue, reach_of
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.storage.folder import Folder
from lissajous_env.theory.geometry import largest_speed

_PAPER = "experiment", "ideal"
"""The paper's two curves."""
_SMALLEST, _LARGEST = 0.3, 1.35
"""Range of the sensing radii, over that of Eq. (8)."""


def guarantee(
    scenarios: ScenarioNames = _PAPER,
    radii: int = 22,
    cells: int = 90,
    out: Path = Path("guarantee"),
    format: Format = "png",
    output: OutputOptions = DEFAULT_OUTPUT,
    overrides: Overrides = (),
) -> None:
    """Compute how fast a target must be to evade a formation for ever.

    The critical speed is printed and drawn for a range of sensing radii. It is the speed of targets that know the
    robots' future and may start anywhere.

    Example:
        lissajous guarantee evaders team

    Args:
        scenarios: names of scenarios, .toml files, or module:attribute; by default the paper's two curves.
        radii: number of sensing radii, from 0.3 to 1.35 times that of Eq. (8) of the paper.
        cells: grid cells along the longer side of the rectangle; more of them are more precise and slower.
        out: folder of the picture.
        format: format of the picture.
    """
    for name, value, least, most in (("radii", radii, 2, 200), ("cells", cells, 10, 1000)):
        if not least <= value <= most:
            raise ValueError(f"{name} must be from {least} to {most}, got {value}")
    changed = parse_overrides(overrides)
    formations = [named.scenario(name, **changed) for name in scenarios]
    picture = f"critical_speed.{format}"
    with Folder(out, [picture]) as folder:
        known = {scenario.name: reaches(scenario, radii, cells) for scenario in formations}
        for scenario in formations:
            _print(output.console(), scenario, known[scenario.name])
        folder.write(picture, picture_of_speeds(formations, known).content(format))
    output.print(f"wrote {picture} in {out}")
    output.print_json({name: [row._asdict() for row in rows] for name, rows in known.items()})


def reaches(scenario: Scenario, radii: int, cells: int) -> list[Reach]:
    """Return critical speeds and guaranteed times for sensing radii from 0.3 to 1.35 times that of Eq. (8)."""

    def reach(share: float) -> Reach:
        return reach_of(scenario, scenario.rogue_speed, share * scenario.detection_radius, cells)

    with ThreadPoolExecutor(cores()) as threads:
        return list(threads.map(reach, np.linspace(_SMALLEST, _LARGEST, radii).tolist()))


def picture_of_speeds(scenarios: Sequence[Scenario], known: Mapping[str, Sequence[Reach]]) -> Picture:
    """Draw the critical speed against the sensing radius, a panel for each formation."""
    width = max(3.4 * len(scenarios), 4.5)
    with sheet("critical_speed", "Speed from which a target can stay undetected for ever", width, 3.3) as picture:
        panels = picture.figure.subplots(1, len(scenarios), squeeze=False)[0]
        for place, (scenario, axes) in enumerate(zip(scenarios, panels, strict=True)):
            curve, rows = scenario.curve, known[scenario.name]
            top = fastest_rogue(scenario) * 1.02
            radius = [row.radius for row in rows]
            speed = [min(row.critical_speed, top) for row in rows]
            axes.fill_between(radius, speed, top, color=SERIES[1], alpha=0.16, lw=0)
            axes.fill_between(radius, 0, speed, color=SERIES[0], alpha=0.16, lw=0)
            bounded = [row for row in rows if row.critical_speed < math.inf]
            axes.plot([row.radius for row in bounded], [row.critical_speed for row in bounded], color=SERIES[0], lw=2)
            axes.axvline(scenario.detection_radius, color=DARK, lw=0.9, ls="--")
            axes.axhline(scenario.formation.phase_rate * largest_speed(curve), color=GREY, lw=0.9, ls=":")
            axes.set_title(f"{scenario.name}: N = {scenario.num_robots}, a = {curve.a}, b = {curve.b}")
            axes.set_xlim(radius[0], radius[-1])
            axes.set_ylim(0, top)
            axes.set_xlabel("sensing radius [m]")
            if place == 0:
                axes.set_ylabel("speed of the target [m/s]")
            place_of: dict[str, Any] = {"transform": axes.transAxes, "va": "top"}
            axes.text(0.98, 0.95, "every target\nis detected", ha="right", color=SERIES[0], **place_of)
            axes.text(0.03, 0.95, "it can evade\nfor ever", color=SERIES[1], **place_of)
        picture.caption = (
            "Robots stay in the equilibrium (2) on the curve; targets may be anywhere at any time and know the robots' "
            "future. Dashed: the sensing radius of Eq. (8). Dotted: speed of the fastest robot on the curve."
        )
    return picture


def _print(console: Console, scenario: Scenario, rows: Sequence[Reach]) -> None:
    """Print a row for each sensing radius."""
    speed = scenario.rogue_speed
    console.print(
        Text.assemble(
            (scenario.name, "bold"),
            f"  N = {scenario.num_robots}, T_max = {scenario.detection_time_bound:.3g} s, "
            f"Eq. (8) requires {scenario.detection_radius:.3g} m",
        )
    )
    columns = [
        "sensing\nradius [m]",
        "over that\nof Eq. (8)",
        "evaded for ever\nfrom [m/s]",
        f"at {speed:g} m/s undetected\nfor at most [s]",
    ]
    highest = fastest_rogue(scenario)
    shown = [
        [
            f"{row.radius:.3g}",
            f"{row.radius / scenario.detection_radius:.2f}",
            f"{row.critical_speed:.3g}" if row.critical_speed < math.inf else f"> {highest:.3g}",
            f"{row.guaranteed_time:.1f}" if row.guaranteed_time < math.inf else "for ever",
        ]
        for row in rows
    ]
    print_table(console, [Column(title) for title in columns], shown)
    console.print()
