"""The command `lissajous guarantee`: critical speeds of evading targets, and worst-case undetected times."""

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from itertools import cycle
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from matplotlib.axes import Axes
from rich.console import Console
from rich.text import Text

from baselines.benchmark.statistics import Estimate, summarize_largest
from baselines.benchmark.tables import in_words
from baselines.policies import factories
from baselines.reproduce.drawing import DARK, GREY, SERIES, Format, Sheet, drawn_as
from lissajous_env.console.terminal import DEFAULT_OUTPUT, Column, OutputOptions, print_table
from lissajous_env.device.devices import cores
from lissajous_env.episodes.guarantee import Reach, check_follows, fastest_rogue, reach_of, worst_undetected_times
from lissajous_env.parameters import named
from lissajous_env.parameters.overrides import Overrides, parse_overrides
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.storage.folder import Folder
from lissajous_env.theory.geometry import largest_speed
from lissajous_env.world.score import is_open

_Scenarios = Annotated[
    tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[SCENARIO ...]", help_behavior_hint="")
]
_PAPER = "experiment", "ideal"
"""The paper's two curves."""
_SMALLEST, _LARGEST = 0.3, 1.35
"""Range of the sensing radii, over that of Eq. (8)."""


def guarantee(
    scenarios: _Scenarios = _PAPER,
    policies: tuple[str, ...] = (),
    radii: int = 22,
    cells: int = 90,
    episodes: int = 8,
    out: Path = Path("guarantee"),
    format: Format = "png",
    output: OutputOptions = DEFAULT_OUTPUT,
    overrides: Overrides = (),
) -> None:
    """Compute how fast a target must be to evade a formation for ever, and the worst-case undetected time of policies.

    The critical speed is printed and drawn for a range of sensing radii. It is the speed of targets that know the
    robots' future and may start anywhere.

    Example:
        lissajous guarantee evaders --policies kuramoto-mpcc open-loop-mpcc

    Args:
        scenarios: names of scenarios, .toml files, or module:attribute; by default the paper's two curves.
        policies: policies whose worst-case undetected time is drawn; the scenarios must have task.contamination.
        radii: number of sensing radii, from 0.3 to 1.35 times that of Eq. (8) of the paper.
        cells: grid cells along the longer side of the rectangle; more of them are more precise and slower.
        episodes: number of episodes per policy.
        out: folder of the pictures.
        format: format of the pictures.
        output: Console output.
        overrides: fields changed in every scenario, as in --set targets.speed_limit=0.3
    """
    for name, value, least, most in (
        ("radii", radii, 2, 200),
        ("cells", cells, 10, 1000),
        ("episodes", episodes, 1, 4096),
    ):
        if not least <= value <= most:
            raise ValueError(f"{name} must be from {least} to {most}, got {value}")
    changed = parse_overrides(overrides)
    made = [named.scenario(name, **changed) for name in scenarios]
    acting = {
        each.name: {policy: factories.named(policy)(each, episodes, "cpu") for policy in policies} for each in made
    }
    for each in made if policies else ():
        check_follows(each)
    console, written = output.console(), [f"critical_speed.{format}"]
    written += [f"unseen-{each.name}.{format}" for each in made if policies]
    with Folder(out, written) as folder, drawn_as(format):
        known = {each.name: reaches(each, radii, cells) for each in made}
        for each in made:
            _print(console, each, known[each.name])
        folder.write(written[0], picture_of_speeds(made, known))
        unseen = {}
        for each in made if policies else ():
            curves = {
                name: worst_undetected_times(policy, each, range(episodes))
                for name, policy in acting[each.name].items()
            }
            unseen[each.name] = curves
            folder.write(f"unseen-{each.name}.{format}", picture_of_unseen(each, curves))
    stated = {
        each.name: {policy: largest_of(curve, each.task.step) for policy, curve in unseen[each.name].items()}
        for each in made if policies
    }  # fmt: skip
    for name, of in stated.items():
        _print_unseen(console, name, of)
    output.print(f"wrote {', '.join(written)} in {out}")
    output.print_json({
        "formations": {name: [each._asdict() for each in rows] for name, rows in known.items()},
        "unseen": {
            name: {policy: curve.max(axis=1).tolist() for policy, curve in curves.items()}
            for name, curves in unseen.items()
        },
        "guarantees": {name: {policy: asdict(of) for policy, of in by.items()} for name, by in stated.items()},
    })  # fmt: skip


def reaches(scenario: Scenario, radii: int, cells: int) -> list[Reach]:
    """Return critical speeds and guaranteed times for sensing radii from 0.3 to 1.35 times that of Eq. (8)."""

    def reach(share: float) -> Reach:
        return reach_of(scenario, scenario.rogue_speed, share * scenario.detection_radius, cells)

    with ThreadPoolExecutor(cores()) as threads:
        return list(threads.map(reach, np.linspace(_SMALLEST, _LARGEST, radii).tolist()))


def largest_of(curve: np.ndarray, step: float) -> Estimate:
    """Return the statistics of the worst cases of some episodes.

    Args:
        curve: (episodes, steps + 1) longest time for which a target can have been undetected [s].
        step: Control step [s].
    """
    longest, elapsed = curve.max(axis=1), (curve.shape[1] - 1) * step
    return summarize_largest(longest, [is_open(*of, elapsed) for of in zip(longest, curve[:, -1], strict=True)])


def picture_of_speeds(scenarios: Sequence[Scenario], known: Mapping[str, Sequence[Reach]]) -> bytes:
    """Draw the critical speed against the sensing radius, a panel for each formation."""
    width = max(3.4 * len(scenarios), 4.5)
    with Sheet("critical_speed", "Speed from which a target can stay undetected for ever", width, 3.3) as sheet:
        for place, (scenario, axes) in enumerate(zip(scenarios, _row(sheet, len(scenarios)), strict=True)):
            curve, rows = scenario.curve, known[scenario.name]
            top = fastest_rogue(scenario) * 1.02
            radius = [each.radius for each in rows]
            speed = [min(each.critical_speed, top) for each in rows]
            axes.fill_between(radius, speed, top, color=SERIES[1], alpha=0.16, lw=0)
            axes.fill_between(radius, 0, speed, color=SERIES[0], alpha=0.16, lw=0)
            bounded = [each for each in rows if each.critical_speed < math.inf]
            axes.plot(
                [each.radius for each in bounded], [each.critical_speed for each in bounded], color=SERIES[0], lw=2
            )
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
        return sheet.picture(
            "Robots stay in the equilibrium (2) on the curve; targets may be anywhere at any time and know the robots' "
            "future. Dashed: the sensing radius of Eq. (8). Dotted: speed of the fastest robot on the curve."
        ).content


def picture_of_unseen(scenario: Scenario, curves: Mapping[str, np.ndarray]) -> bytes:
    """Draw the longest time for which a target can have been undetected over time: the median and range of episodes."""
    with Sheet("unseen", f"Worst-case undetected time: {scenario.name}", 7.2, 3.4) as sheet:
        axes = sheet.figure.add_subplot()
        time = np.arange(scenario.task.steps + 1) * scenario.task.step
        for (policy, curve), colour in zip(curves.items(), cycle(SERIES)):
            axes.fill_between(time, curve.min(axis=0), curve.max(axis=0), color=colour, alpha=0.15, lw=0)
            largest, beside = in_words(largest_of(curve, scenario.task.step))
            axes.plot(time, np.median(curve, axis=0), color=colour, lw=1.5, label=f"{policy}: {largest} s ({beside})")
        axes.axhline(scenario.detection_time_bound, color=DARK, lw=0.9, ls="--")
        axes.annotate(
            scenario.detection_time_label,
            (1.005, scenario.detection_time_bound),
            xycoords=("axes fraction", "data"),
            va="center",
        )
        for _, start, end in scenario.faults.schedule:
            axes.axvspan(start, min(end, time[-1]), color=GREY, alpha=0.12, lw=0)
        axes.set_xlim(0, time[-1])
        axes.set_ylim(bottom=0)
        axes.set_xlabel("time [s]")
        axes.set_ylabel("undetected for at most [s]")
        axes.legend(loc="upper left")
        count = len(next(iter(curves.values())))
        return sheet.picture(
            f"Longest time for which a rogue can have been undetected by then: line, the median of {count} episodes; "
            "shade, all of them; beside the names, the largest. Grey: robots have failed. If a line rises through the "
            "second half of an episode to its end, the episode shows no bound of that time."
        ).content


def _row(sheet: Sheet, count: int) -> list[Axes]:
    return [sheet.figure.add_subplot(1, count, place + 1) for place in range(count)]


def _print_unseen(console: Console, scenario: str, statistics: Mapping[str, Estimate]) -> None:
    """Print the largest worst-case undetected time of each policy."""
    console.print(Text.assemble((scenario, "bold"), "  worst-case undetected time"))
    columns = [Column("policy", left=True), Column("largest\n[s]"), Column("of the episodes")]
    print_table(console, columns, [[policy, *in_words(of)] for policy, of in statistics.items()])
    console.print()


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
            f"{each.radius:.3g}",
            f"{each.radius / scenario.detection_radius:.2f}",
            f"{each.critical_speed:.3g}" if each.critical_speed < math.inf else f"> {highest:.3g}",
            f"{each.guaranteed_time:.1f}" if each.guaranteed_time < math.inf else "for ever",
        ]
        for each in rows
    ]
    print_table(console, [Column(title) for title in columns], shown)
    console.print()
