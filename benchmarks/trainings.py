"""One training command, run for several seeds, compared with the paper's method: `python benchmarks/trainings.py`.

A single training run is one random draw, so this shows the distribution of the results of the README's command. The
best checkpoint of every training after 5 and after 15 million robot steps plays the same held-out episodes, which
neither the trainings nor any tuning saw. Results over all trainings have an interval over trainings and episodes
(`two_level_interval`).

FOLDER contains the folder that `lissajous train` writes for each seed, the rows of its episodes, and `trainings.json`.
If the command is interrupted and called again, it resumes, and trains and plays nothing twice. Unknown options are
passed to `lissajous train`. `--store` puts the table into docs/figures.json, and the curves of all
trainings, by their own evaluations, into docs/trainings.png.
"""

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import figures
import numpy as np
from rich.console import Console
from tuning import HELD_OUT

import baselines
import lissajous_env
import training
from baselines.benchmark.shown import between, number
from baselines.benchmark.statistics import (
    CUT,
    RESAMPLES,
    SHARE_OF_SEEDS,
    interquartile_mean,
    middle_of,
    summarize,
    wins,
)
from lissajous_env.console.terminal import plain
from lissajous_env.storage.files import read_json, write_atomically
from lissajous_env.world.columns import INTERQUARTILE_MEAN, MEAN
from training.learned import checkpoint
from training.learned.history import History

COLUMNS = {
    "detection_time_mean": ("detection [s]", "sooner"),
    "collisions": ("collisions", "fewer"),
    "sensed_fraction": ("sensed", "more"),
}
"""Titles of each column and of its probability of being better than the reference's."""
REFERENCE = "kuramoto-mpcc"
_PANELS = {"detection_time": "detection time [s]", "collisions": "collisions an episode"}
_ROLLOUT = 200_000
"""Largest number of steps beyond the requested ones, because a training ends with a rollout."""


def two_level_interval(
    rows_by_training: Sequence[Sequence[float]] | np.ndarray,
    resamples: int = RESAMPLES,
    cut: float = CUT,
) -> tuple[float, float]:
    """Return the percentile bootstrap interval of the interquartile mean over trainings and the seeds that all played.

    Trainings and seeds are both samples. If only one of them were drawn again, the interval would be too short: A. B.
    Owen, "The Pigeonhole Bootstrap" (Annals of Applied Statistics, 2007).

    In each resample trainings and seeds are drawn again, the same seeds for every training, because a seed that is hard
    for one is hard for all. As with every bootstrap, with K trainings the interval is too short by about
    sqrt((K - 1) / K).

    Args:
        rows_by_training: (K, n) numbers, a row for each training and a column for each seed.
        resamples: Number of resamples.
        cut: Share of the values that is left out at either end; 0 for the mean.

    Raises:
        ValueError: fewer than two trainings or seeds, rows of different lengths, or a value that is not a number.
    """
    try:
        table = np.array([list(row) for row in rows_by_training], dtype=float)
    except ValueError as error:
        raise ValueError("rows_by_training must have the same seeds in every row") from error
    if table.ndim != 2 or min(table.shape) < 2 or not np.isfinite(table).all():
        rule = "must contain finite numbers of at least two trainings on at least two seeds"
        raise ValueError(f"rows_by_training {rule}, got shape {table.shape}")
    generator = np.random.default_rng(0)
    trainings, seeds = (generator.integers(0, size, (resamples, size)) for size in table.shape)
    drawn = np.sort(table[trainings[:, :, None], seeds[:, None, :]].reshape(resamples, -1), axis=1)
    outside = int(cut * table.size)
    return middle_of(drawn[:, outside : table.size - outside].mean(axis=1))


def scored(out: Path, scenario: str, seed: int, steps: int, episodes: int, more: Sequence[str]) -> list[dict[str, Any]]:
    """Train to a number of steps, play the best checkpoint on the held-out seeds, and store the rows beside it.

    Raises:
        ValueError: the training in the folder is beyond these steps and was not played at them.
    """
    folder, kept = out / f"seed-{seed}", out / f"seed-{seed}-{steps}.json"
    if kept.exists() and len(rows := read_json(kept)) == episodes:
        return rows
    if (folder / "checkpoint.json").exists():
        done = checkpoint.read(folder)[2]["counters"]["steps"]
        if done > 1.05 * steps + _ROLLOUT:
            raise ValueError(f"{folder} must contain at most {steps:,} steps to be judged after these, got {done:,}")
    command = [sys.executable, "-m", "lissajous_env", "train", "--scenario", scenario, "--steps", str(steps),
               "--seed", str(seed), "--out", str(folder), "--quiet", *more]  # fmt: skip
    subprocess.run(command, check=True)
    rows = played(training.load(str(folder / "best"), scenario, num_worlds=episodes), scenario, episodes)
    write_atomically(kept, json.dumps(plain(rows)) + "\n")
    return rows


def played(policy: Any, scenario: str, episodes: int) -> list[dict[str, Any]]:
    """Return the rows of the held-out episodes."""
    return lissajous_env.evaluate(policy, scenario, HELD_OUT[:episodes])


def judged(rows_by_training: Sequence[list[dict[str, Any]]], reference: list[dict[str, Any]]) -> dict[str, Any]:
    """Return statistics of some trainings by column: of all, of each, and compared with the reference.

    They are means for collisions, which are rare, and interquartile means for all other columns. `better` is the
    probability that an episode of a training is better than the reference's of the same seed; ties count half.
    """
    found = {}
    for column in COLUMNS:
        table = np.array([[row[column] for row in rows] for rows in rows_by_training], dtype=float)
        theirs = np.array([row[column] for row in reference], dtype=float)
        more_is_better, rare = column == "sensed_fraction", column == "collisions"
        won = wins(table, np.broadcast_to(theirs, table.shape), 1 if more_is_better else -1)
        cut, summary = (0.0, MEAN) if rare else (CUT, INTERQUARTILE_MEAN)
        middle = float(table.mean()) if rare else interquartile_mean(table.ravel())
        found[column] = {
            "statistic": summary,
            "value": middle,
            "interval": two_level_interval(table, cut=cut) if len(table) > 1 else None,
            "better": float(won.mean()),
            "better_interval": two_level_interval(won, cut=0.0) if len(table) > 1 else None,
            "trainings": [asdict(summarize(row, summary)) for row in table],
            "trainings_against": [asdict(summarize(row, SHARE_OF_SEEDS)) for row in won],
            "reference": asdict(summarize(theirs, summary)),
        }
    return found


def as_table(after: dict[str, dict[str, Any]]) -> figures.Table:
    """Return the results after some numbers of steps: rows for each training, for all, and for the reference."""
    rows = []
    for steps, judgement in after.items():
        where, columns = f"after {int(steps) / 1e6:g} million steps", [judgement["columns"][name] for name in COLUMNS]
        for k, seed in enumerate(judgement["seeds"]):
            cells = []
            for each in columns:
                against = each["trainings_against"][k]
                cells += [_alone(each["trainings"][k]), _share(against["value"], (against["low"], against["high"]))]
            rows.append([f"{where}, seed {seed}", *cells])
        cells = []
        for each in columns:
            cells += [_spread(each["value"], each["interval"]), _share(each["better"], each["better_interval"])]
        rows.append([f"{where}, all", *cells])
    theirs = [cell for each in columns for cell in (_alone(each["reference"]), "")]
    rows.append([f"`{REFERENCE}`", *theirs])
    return {"columns": ["training", *(title for titles in COLUMNS.values() for title in titles)], "rows": rows}


def _alone(numbers: dict[str, Any]) -> str:
    return _spread(numbers["value"], (numbers["low"], numbers["high"]))


def _spread(value: float, ends: Sequence[float] | None) -> str:
    words = between(*ends) if ends else ""
    return f"{number(value)} ({words})" if words else number(value)


def _share(value: float, ends: Sequence[float] | None) -> str:
    words = between(*ends, times=100) if ends else ""
    return f"{100 * value:.0f} % ({words})" if words else f"{100 * value:.0f} %"


def draw(out: Path, seeds: Sequence[int], path: Path) -> None:
    """Draw the evaluations of all trainings, of detection and of collisions, with the reference as a line."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 5.2), layout="constrained", dpi=120)
    axes = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    histories = {seed: History.read(checkpoint.read_text(out / f"seed-{seed}")) for seed in seeds}
    for axis, (name, title) in zip(axes, _PANELS.items(), strict=True):
        for seed, history in histories.items():
            points = [(point["steps"] / 1e6, point[name]) for point in history.curve if point[name] is not None]
            axis.plot(*zip(*points, strict=True), marker=".", linewidth=1.2, label=f"seed {seed}")
        rival = histories[seeds[0]].rivals[REFERENCE][name]
        axis.axhline(rival, color="black", linestyle="--", linewidth=1, label=REFERENCE)
        axis.set(ylabel=title)
        axis.grid(alpha=0.3)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylim(bottom=0)
    axes[0].legend(frameon=False, fontsize=8, ncols=3)
    # Linear up to a collision in ten episodes, so that zero collisions are shown, too.
    axes[1].set_yscale("symlog", linthresh=0.1)
    axes[1].set_ylim(bottom=-0.01)
    axes[1].set(xlabel="steps of a robot [million]")
    figure.savefig(path)


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--scenario", default="intruders")
    parser.add_argument("--seeds", type=int, default=5, help="trainings: seeds 0, 1 ...")
    parser.add_argument("--steps", type=int, nargs="+", default=[5_000_000, 15_000_000])
    parser.add_argument("--episodes", type=int, default=len(HELD_OUT))
    parser.add_argument("--out", type=Path, default=Path("results/trainings"))
    options, more = parser.parse_known_args()
    console = Console(width=160)
    options.out.mkdir(parents=True, exist_ok=True)
    reference = played(
        baselines.make(REFERENCE, options.scenario, options.episodes), options.scenario, options.episodes
    )
    by_steps: dict[int, list[list[dict[str, Any]]]] = {}
    for seed in range(options.seeds):
        for steps in sorted(options.steps):
            rows = scored(options.out, options.scenario, seed, steps, options.episodes, more)
            by_steps.setdefault(steps, []).append(rows)
            times = [row["detection_time_mean"] for row in rows]
            console.print(f"seed {seed}, {steps:,} steps: detection {interquartile_mean(times):.3g} s")
    result = {}
    for steps, tables in by_steps.items():
        result[str(steps)] = {"episodes": options.episodes, "seeds": list(range(options.seeds)),
                              "reference": REFERENCE, "columns": judged(tables, reference)}  # fmt: skip
    command = f"lissajous train --scenario {options.scenario} {' '.join(more)}".strip()
    text = {"command": command, "scenario": options.scenario, "after": result}
    write_atomically(options.out / "trainings.json", json.dumps(plain(text), indent=2) + "\n")
    table = as_table(result)
    figures.show(f"{command}, {options.episodes} held-out episodes", table)
    draw(options.out, range(options.seeds), options.out / "trainings.png")
    if options.store:
        figures.store({"trainings": table})
        draw(options.out, range(options.seeds), figures.ROOT / "docs" / "trainings.png")


if __name__ == "__main__":
    main()
