"""How fast a training learns, beside another checkout and beside Stable-Baselines3's own loop, by turns in one run.

    git worktree add ../before 644d874
    python benchmarks/training_speed.py --against ../before

Each side runs `lissajous train` in a process of its own, A B A B, and its rate is what its checkpoint says: steps of a
robot over the time that they took, evaluations and imports left out. `ppo` is reinforcement learning alone, from the
first evaluation on, with the same settings on all sides; `ppo, defaults` with each side's own, as `whole`, which is the
README's command for 5 million steps. A ratio is the interquartile mean over the pairs of neighbouring runs, with its
95 % interval. `--store` puts the table into docs/figures.json.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import figures

from baselines.benchmark.statistics import summarize
from baselines.benchmark.tables import between, number

ROOT = Path(__file__).resolve().parent.parent
_ALONE = ["--teacher", "none", "--steps", "1500000", "--evaluate-every", "300000"]
PARTS = {
    "ppo": [*_ALONE, "--critic", "robot", "--epochs", "4"],
    "ppo, defaults": _ALONE,
    "whole": ["--steps", "5000000", "--evaluate-every", "1000000"],
}
"""Options of a part: what is learned, and how often the time is taken."""
OURS, LIBRARY = "here", "the library's loop"


def rate(side: str, checkout: Path, scenario: str, part: str, seed: int) -> float:
    """Train once; steps of a robot per second."""
    with tempfile.TemporaryDirectory() as folder:
        options = ["--scenario", scenario, "--seed", str(seed), "--out", folder, "--evaluation-episodes", "1",
                   "--rivals", *PARTS[part]]  # fmt: skip
        start = ["-c", _LIBRARY] if side == LIBRARY else ["-m", "lissajous_env", "train"]
        subprocess.run([sys.executable, *start, *options], check=True, cwd=folder, stdout=subprocess.DEVNULL,
                       env=os.environ | {"PYTHONPATH": str(checkout)})  # fmt: skip
        curve = json.loads((Path(folder) / "checkpoint.json").read_text())["curve"]
    # How a training begins belongs to the whole; before the first evaluation kernels are loaded and threads start.
    first = {"steps": 0, "seconds": 0.0} if part == "whole" else curve[0]
    return (curve[-1]["steps"] - first["steps"]) / (curve[-1]["seconds"] - first["seconds"])


_LIBRARY = """
import sys
import torch
from stable_baselines3 import PPO
from training.sb3 import ppo

threads = torch.get_num_threads()

def library(policy, env, threads=None, **settings):
    return PPO(policy, env, **settings)

ppo.RobotPPO = library
torch.set_num_threads = lambda count: None
sys.argv = ["lissajous", "train", *sys.argv[1:]]
from lissajous_env.console.cli import main
main()
"""
"""`lissajous train`, with `PPO` itself and torch's own threads."""


def as_rows(part: str, rates: dict[str, list[float]]) -> list[list[str]]:
    """A row for each side: its rate, and how many times as fast this checkout is."""
    rows = []
    for side, theirs in rates.items():
        own = summarize(theirs)
        ratio = summarize([a / b for a, b in zip(rates[OURS], theirs, strict=True)])
        words = "" if side == OURS else f"{number(ratio.iqm)} ({between(ratio.low, ratio.high)})"
        rows.append([f"{part}, {side}", f"{own.iqm:,.0f}", f"{max(theirs):,.0f}", words])
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, help="another checkout")
    parser.add_argument("--scenario", default="intruders")
    parser.add_argument("--parts", nargs="+", default=list(PARTS), choices=list(PARTS))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--store", action="store_true", help="put the table into docs/figures.json, too")
    given = parser.parse_args(arguments)
    rows = []
    for part in given.parts:
        sides = {OURS: ROOT}
        if given.against is not None:
            sides[given.against.name] = given.against.resolve()
        if part == "ppo":
            sides[LIBRARY] = ROOT
        rates: dict[str, list[float]] = {side: [] for side in sides}
        for turn in range(given.rounds):
            for side, checkout in sides.items():
                rates[side].append(rate(side, checkout, given.scenario, part, turn))
                print(f"{part}, round {turn}, {side}: {rates[side][-1]:,.0f} steps/s", flush=True)
        rows += as_rows(part, rates)
    columns = ["training", "robot steps per second", "best", "times as fast here"]
    figures.show("speed of a training", {"columns": columns, "rows": rows})
    if given.store:
        figures.store({"training-speed": {"columns": columns, "rows": rows}})


if __name__ == "__main__":
    main()
