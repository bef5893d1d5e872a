"""How the cost of a step grows with the robots and the targets of one world, beside another version of this project.

    git worktree add ../before 644d874
    python benchmarks/growth.py --against ../before --store

Each row is `swarm` on a curve for so many robots, at the same ground speed, in formation; targets stay when they are
detected, so that no step is an easy one. The versions take turns, each in a process of its own, on one thread: a time
is that of the processor, a ratio the median over pairs of turns, with its 95 % interval by bootstrap. A second table
has the largest worlds on one thread and on all, by what the first thread has to work, which takes a share as large as
the others': where as many cores are idle, a step takes as long. `--store` puts both tables into docs/figures.json and
the picture into docs/growth.png.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import figures
import numpy as np
from timing import ratio as ratio_of

CURVES = {5: (3, 2), 101: (51, 50), 501: (251, 250), 1001: (501, 500)}
TARGETS = (1_000, 10_000, 100_000, 1_000_000)
PICTURE = figures.ROOT / "docs" / "growth.png"
# Okabe and Ito's, which the colour-blind tell apart.
COLOURS = {5: "#0072B2", 101: "#009E73", 501: "#E69F00", 1001: "#D55E00"}


def serve(robots: int, targets: int, threads: int) -> None:
    """Make a world; for each line on standard input, take so many steps and print the seconds that one took.

    First those of the processor, on all threads together, then of the first thread alone.

    An empty line ends it: the largest memory of this process [MB] is printed.
    """
    import lissajous_env

    a, b = CURVES[robots]
    overrides = {"curve.a": a, "curve.b": b, "targets.count": targets, "targets.leave": False}
    overrides |= {"formation.phase_rate": 0.02 * 51 / a, "task.duration": 1e5}
    simulation = lissajous_env.Simulation(lissajous_env.scenario("swarm", **overrides), threads=threads)
    made = simulation.scenario
    rate = made.formation.phase_rate / made.formation.alpha / made.robot.phase_rate_max
    action = np.full(simulation.action_shape, rate, dtype=np.float32)
    for _ in range(3):
        simulation.step(action)
    print("ready", flush=True)
    for line in sys.stdin:
        if not line.strip():
            break
        begin = time.process_time(), time.thread_time()
        for _ in range(int(line)):
            simulation.step(action)
        passed = time.process_time() - begin[0], time.thread_time() - begin[1]
        print(*(each / int(line) for each in passed), flush=True)
    # Not `ru_maxrss`, which begins with what the process had that started this one.
    told = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    print(int(told["VmHWM"].split()[0]) / 1024, flush=True)


class Side:
    """A version in a process of its own."""

    def __init__(self, folder: Path, robots: int, targets: int, threads: int):
        command = [sys.executable, __file__, "--serve", str(robots), str(targets), "--threads", str(threads)]
        environment = {**os.environ, "PYTHONPATH": str(folder)}
        self._process = subprocess.Popen(
            command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._answer()

    def seconds(self, steps: int, first: bool) -> float:
        """Time that a step takes, of all threads or of the first alone, as the mean of some."""
        return float(self._ask(str(steps)).split()[first])

    def peak(self) -> float:
        """End the process; its largest memory [MB]."""
        peak = float(self._ask(""))
        self._process.wait()
        return peak

    def _ask(self, line: str) -> str:
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        return self._answer()

    def _answer(self) -> str:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            sys.exit(f"error: a process that measures ended with {self._process.wait()}")
        return line


def measured(sides: Sequence[Side], rounds: int, first: bool = False) -> tuple[Any, list[float]]:
    """Seconds of a step (rounds, sides), by turns, and the largest memory of each side [MB]."""
    steps = [max(1, min(1000, round(0.1 / side.seconds(1, first)))) for side in sides]
    times = [[side.seconds(count, first) for side, count in zip(sides, steps, strict=True)] for _ in range(rounds)]
    return np.array(times), [side.peak() for side in sides]


def table_of(found: dict[tuple[int, int], tuple[Any, list[float]]]) -> figures.Table:
    """A row for each number of robots and targets; with another version, what it takes and the ratio beside."""
    compared = any(times.shape[1] == 2 for times, _ in found.values())
    columns = ["one world", "ms a step", "ns a target", "ns each further target", "peak [MB]"]
    columns += ["ms a step before", "times faster", "95 % interval"] if compared else []
    rows = []
    for (robots, targets), (times, peaks) in found.items():
        own = statistics.median(times[:, 0])
        fewer = found.get((robots, targets // 10))
        more = (own - statistics.median(fewer[0][:, 0])) / (targets * 0.9) * 1e9 if fewer else None
        row = [f"{robots:,} robots, {targets:,} targets", f"{own * 1e3:.3g}", f"{own / targets * 1e9:.3g}"]
        row += ["" if more is None else f"{more:.3g}", f"{peaks[0]:.0f}"]
        if compared:
            ratio, low, high = ratio_of(*times.T)
            row += [f"{statistics.median(times[:, 1]) * 1e3:.3g}", f"{ratio:.3g}", f"{low:.3g} - {high:.3g}"]
        rows.append(row)
    return {"columns": columns, "rows": rows}


def threads_table(threads: int, rounds: int) -> figures.Table:
    """A row for each of the largest worlds: the time of a step on one thread, on all, and the ratio."""
    rows = []
    for targets in TARGETS[-2:]:
        sides = [Side(figures.ROOT, 1001, targets, count) for count in (threads, 1)]
        times, _ = measured(sides, rounds, first=True)
        ratio, low, high = ratio_of(*times.T)
        row = [f"1,001 robots, {targets:,} targets", str(threads)]
        row += [f"{each * 1e3:.3g}" for each in np.median(times, axis=0)[::-1]]
        rows.append([*row, f"{ratio:.3g}", f"{low:.3g} - {high:.3g}"])
    columns = ["one world", "threads", "ms a step on one", "ms on all", "times faster", "95 % interval"]
    return {"columns": columns, "rows": rows}


def draw(found: dict[tuple[int, int], tuple[Any, list[float]]], path: Path) -> None:
    """Time of a step over the number of targets, a line for each number of robots; dashed is the other version."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(7, 4.6), dpi=150)
    compared = False
    for robots, colour in COLOURS.items():
        counts = [targets for each, targets in found if each == robots]
        if not counts:
            continue
        times = np.array([np.median(found[robots, targets][0], axis=0) for targets in counts]) * 1e3
        axes.plot(counts, times[:, 0], "o-", color=colour, label=f"{robots:,} robots")
        if times.shape[1] == 2:
            compared = True
            axes.plot(counts, times[:, 1], "o--", color=colour, markerfacecolor="white", linewidth=1)
    if compared:
        axes.plot([], [], "o--", color="0.4", markerfacecolor="white", linewidth=1, label="before")
    axes.set(xscale="log", yscale="log", xlabel="targets in one world", ylabel="time of a step [ms]")
    axes.grid(which="major", color="0.85", linewidth=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="upper left")
    figure.tight_layout()
    figure.savefig(path)
    plt.close(figure)


def main() -> None:
    """Measure, print and store."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, help="folder of another version of this project")
    parser.add_argument("--robots", type=int, nargs="+", default=list(CURVES), choices=list(CURVES))
    parser.add_argument("--targets", type=int, nargs="+", default=list(TARGETS))
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--store", action="store_true", help="write docs/figures.json and docs/growth.png")
    parser.add_argument("--serve", type=int, nargs=2, metavar=("ROBOTS", "TARGETS"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.serve:
        serve(*given.serve, given.threads)
        return
    folders = [figures.ROOT, *([given.against.resolve()] if given.against else [])]
    found = {}
    for robots in given.robots:
        for targets in given.targets:
            sides = [Side(folder, robots, targets, 1) for folder in folders]
            found[robots, targets] = measured(sides, given.rounds)
            print(json.dumps([robots, targets, np.median(found[robots, targets][0], axis=0).tolist()]), flush=True)
    tables = {"growth": table_of(found), "growth_threads": threads_table(given.threads, given.rounds)}
    figures.show("one world on one thread, time of the processor, medians", tables["growth"])
    figures.show("one world, what the first thread has to work, medians", tables["growth_threads"])
    if given.store:
        figures.store(tables)
        draw(found, PICTURE)


if __name__ == "__main__":
    main()
