"""The defaults of `lissajous train` on scenarios that are not included, compared with the paper's method.

`python benchmarks/own_scenarios.py` trains each of `benchmarks/own_scenarios/*.toml` for some seeds, and plays the best
checkpoint and the rival on the same held-out seeds; a policy for cars is played with the collision filter. FOLDER
contains a folder for each training, the rows of its episodes, and `own_scenarios.json`, which is written after each
training. If the command is interrupted and called again, it resumes. Unknown options are passed to `lissajous train`.
"""

import json
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import figures
import numpy as np

import baselines
import lissajous_env
from baselines.benchmark.shown import between, number
from baselines.benchmark.statistics import SHARE_OF_SEEDS, summarize, wins
from lissajous_env.console.terminal import plain
from lissajous_env.storage.files import read_json, write_atomically
from training.learned import checkpoint

SCENARIOS = sorted((Path(__file__).parent / "own_scenarios").glob("*.toml"))
RIVALS = {"car": "kuramoto-mpcc", "curve": "kuramoto"}
SUFFIX = {"car": "-safe", "curve": ""}
HELD_OUT = range(10_000, 10_128)
COLUMNS = ("detection_time_mean", "collisions", "detected_fraction")
KEPT = ("seed", *COLUMNS)


def rows_of(path: Path, policy: Any, scenario: Path) -> list[dict[str, Any]]:
    """Return the rows of the held-out episodes of the policy that `policy()` makes; they are stored in a file."""
    if not path.exists():
        played = lissajous_env.evaluate(policy(), lissajous_env.scenario(scenario), HELD_OUT)
        write_atomically(path, json.dumps(plain([{name: row[name] for name in KEPT} for row in played])) + "\n")
    return read_json(path)


def trained(out: Path, scenario: Path, seed: int, steps: int, more: Sequence[str]) -> Path:
    """Train by the command, unless that was done before, and return the folder."""
    folder = out / f"{scenario.stem}-{seed}"
    command = [sys.executable, "-m", "lissajous_env", "train", "--scenario", str(scenario), "--steps", str(steps),
               "--seed", str(seed), "--out", str(folder), *more]  # fmt: skip
    subprocess.run(command, check=True)
    return folder


def judged(ours: list[dict[str, Any]], theirs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the means of both, and the share of seeds on which ours is better, with its interval."""
    found = {}
    for name in COLUMNS:
        pair = [np.array([row[name] for row in rows], dtype=float) for rows in (ours, theirs)]  # None is NaN
        means = {"policy": float(np.nanmean(pair[0])), "rival": float(np.nanmean(pair[1]))}
        won = wins(pair[0], pair[1], 1 if name == "detected_fraction" else -1)
        found[name] = means | {"better": asdict(summarize(won, SHARE_OF_SEEDS))}
    return found


def as_table(results: Sequence[dict[str, Any]]) -> figures.Table:
    """Return a row for each training: detection and collisions of both, and the share of seeds where it is faster."""
    rows = []
    for each in results:
        time_of, collisions = each["columns"]["detection_time_mean"], each["columns"]["collisions"]
        better = time_of["better"]
        share = between(better["low"], better["high"], times=100)
        rows.append([
            each["scenario"], str(each["seed"]), f"`{each['rival']}`",
            number(time_of["policy"]), number(time_of["rival"]), f"{100 * better['value']:.0f} % ({share})",
            number(collisions["policy"]), number(collisions["rival"]), f"{each['minutes']:.0f}",
        ])  # fmt: skip
    titles = ["scenario", "seed", "rival", "detection [s]", "rival's [s]", "faster", "collisions", "rival's", "min"]
    return {"columns": titles, "rows": rows}


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--scenarios", nargs="+", default=[path.stem for path in SCENARIOS])
    parser.add_argument("--seeds", type=int, default=3, help="trainings of each scenario: seeds 0, 1 ...")
    parser.add_argument("--steps", type=int, default=2_000_000)
    parser.add_argument("--out", type=Path, default=Path("results/own_scenarios"))
    options, more = parser.parse_known_args()
    options.out.mkdir(parents=True, exist_ok=True)
    results = []
    for seed in range(options.seeds):
        for scenario in (path for path in SCENARIOS if path.stem in options.scenarios):
            began = time.monotonic()
            made = lissajous_env.scenario(scenario)
            folder, rival = trained(options.out, scenario, seed, options.steps, more), RIVALS[made.robot.kind]
            text = checkpoint.read_text(folder / "best")
            best, done = text["scores"]["steps"], checkpoint.read_text(folder)["counters"]
            ours = rows_of(
                options.out / f"{folder.name}-{done['steps']}.json",
                lambda made=made, name=f"{folder}/best{SUFFIX[made.robot.kind]}": baselines.make(
                    name, made, len(HELD_OUT)
                ),
                scenario,
            )
            theirs = rows_of(
                options.out / f"{scenario.stem}-{rival}.json",
                lambda made=made, rival=rival: baselines.make(rival, made, len(HELD_OUT)),
                scenario,
            )
            results.append({
                "scenario": scenario.stem, "seed": seed, "rival": rival, "steps": done["steps"], "best_after": best,
                "minutes": done["seconds"] / 60, "columns": judged(ours, theirs),
            })  # fmt: skip
            text = {"episodes": len(HELD_OUT), "options": more, "trainings": plain(results)}
            write_atomically(options.out / "own_scenarios.json", json.dumps(text, indent=1) + "\n")
            print(f"{folder.name}: {(time.monotonic() - began) / 60:.1f} min", flush=True)
            figures.show(f"{len(HELD_OUT)} held-out episodes", as_table(results))
    if options.store:
        figures.store({"own-scenarios": as_table(results)})


if __name__ == "__main__":
    main()
