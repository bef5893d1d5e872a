"""Growth of the cost of a step with the robots and targets of one world, compared with another version of this project.

Each row is `swarm` with a curve for a number of robots and bodies of 1 mm, in formation at the speed of the included
scenario. Targets that are detected stay, so that a step keeps its cost. The versions take turns, each in a process of
its own. A time is processor time, and a ratio is the median over pairs of turns, with its 95 % interval by bootstrap.
"""

import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from figures import ROOT, Table
from timing import ratio as ratio_of

from speeds import Options, Part
from speeds.served import CURVES, Side

TARGETS = (1_000, 10_000, 100_000, 1_000_000)
PICTURE = ROOT / "docs" / "growth.png"
# The palette of Okabe and Ito, for colour-blind readers.
COLOURS = {5: "#0072B2", 101: "#009E73", 501: "#E69F00", 1001: "#D55E00"}


def measured(sides: Sequence[Side], rounds: int) -> tuple[Any, list[float]]:
    """Return the times of a step (rounds, sides) [s], by turns, and the largest memory of each side [MB]."""
    steps = [max(1, min(1000, round(0.1 / side.seconds(1)))) for side in sides]
    times = [[side.seconds(count) for side, count in zip(sides, steps, strict=True)] for _ in range(rounds)]
    return np.array(times), [side.peak() for side in sides]


def table_of(measurements: dict[tuple[int, int], tuple[Any, list[float]]]) -> Table:
    """Return a row for each number of robots and targets; with another version, also its time and the ratio."""
    compared = any(times.shape[1] == 2 for times, _ in measurements.values())
    columns = ["one world", "ms a step", "ns a target", "ns each further target", "peak [MB]"]
    columns += ["ms a step before", "times faster", "95 % interval"] if compared else []
    rows = []
    for (robots, targets), (times, peaks) in measurements.items():
        own = statistics.median(times[:, 0])
        fewer = measurements.get((robots, targets // 10))
        more = (own - statistics.median(fewer[0][:, 0])) / (targets * 0.9) * 1e9 if fewer else None
        row = [f"{robots:,} robots, {targets:,} targets", f"{own * 1e3:.3g}", f"{own / targets * 1e9:.3g}"]
        row += ["" if more is None else f"{more:.3g}", f"{peaks[0]:.0f}"]
        if compared:
            ratio, low, high = ratio_of(*times.T)
            row += [f"{statistics.median(times[:, 1]) * 1e3:.3g}", f"{ratio:.3g}", f"{low:.3g} - {high:.3g}"]
        rows.append(row)
    return {"columns": columns, "rows": rows}


def draw(measurements: dict[tuple[int, int], tuple[Any, list[float]]], path: Path) -> None:
    """Draw the time of a step over the number of targets, a line for each number of robots; dashed: other version."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 4.6), dpi=150)
    compared = False
    for robots, colour in COLOURS.items():
        counts = [targets for team, targets in measurements if team == robots]
        if not counts:
            continue
        times = np.array([np.median(measurements[robots, targets][0], axis=0) for targets in counts]) * 1e3
        axes.plot(counts, times[:, 0], "o-", color=colour, label=f"{robots:,} robots")
        if times.shape[1] == 2:
            compared = True
            axes.plot(counts, times[:, 1], "o--", color=colour, markerfacecolor="white", linewidth=1)
    if compared:
        axes.plot([], [], "o--", color="0.4", markerfacecolor="white", linewidth=1, label="before")
    axes.set(xscale="log", yscale="log", xlabel="targets in one world", ylabel="time of a step [ms]")
    axes.grid(which="major", color="0.85", linewidth=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.tight_layout()
    figure.savefig(path)
    plt.close(figure)


def tables(options: Options) -> dict[str, Table]:
    """Measure, draw the picture if it is saved, and return the table `growth`."""
    folders = [ROOT]
    if options.rivals and options.against is not None:
        folders.append(options.against)
    sizes = options.robots or ((5, 101) if options.quick else tuple(CURVES))
    counts = options.targets or ((100, 1000) if options.quick else TARGETS)
    measurements = {}
    for robots in sizes:
        for targets in counts:
            sides = [Side(folder, robots, targets) for folder in folders]
            measurements[robots, targets] = times, _ = measured(sides, options.rounds)
            words = ", ".join(f"{median * 1e3:.3g} ms" for median in np.median(times, axis=0))
            print(f"{robots:,} robots, {targets:,} targets: {words}", flush=True)
    if options.store:
        draw(measurements, PICTURE)
    return {"growth": table_of(measurements)}


PART = Part(
    "growth",
    "a step of one large world beside another checkout, time of the processor",
    tables,
    against=True,
)
