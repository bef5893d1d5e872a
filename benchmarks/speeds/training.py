"""Speed of training, compared with another checkout.

Each side runs in a process of its own, in turns, with the same settings. Its rate is the number of robot steps of
reinforcement learning after the first evaluation over the time that they took, without evaluations and imports. A
ratio is the interquartile mean over the pairs of neighbouring runs, with its 95 % interval. A second table has the
fraction of a training's time that its environment takes.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from figures import ROOT, Table
from rich.console import Console

from baselines.benchmark.shown import between, number
from baselines.benchmark.statistics import summarize
from speeds import Options, Part

SCENARIO = "intruders"
_SAME = ["--teacher", "none", "--steps", "1500000", "--evaluate-every", "300000", "--epochs", "4"]
"""Options of all sides: the task, and the interval of the time measurements."""
QUICK_STEPS = 4000
QUICK = [
    "--steps",
    str(QUICK_STEPS),
    "--evaluate-every",
    "1000",
    "--worlds",
    "4",
    "--rollout",
    "8",
    "--imitation-steps",
    "0",
]
"""Options that replace these in a trial of the commands."""
OURS = "here"


def rate(checkout: Path, seed: int, quick: bool) -> float:
    """Train once, and return the robot steps per second."""
    options = ["--scenario", SCENARIO, "--seed", str(seed), *_SAME, *(QUICK if quick else [])]
    return rate_of([*options, *(["--base", "none"] if checkout == ROOT else [])], checkout)  # others may have no base


def rate_of(options: Sequence[str], checkout: Path = ROOT) -> float:
    """Return the robot steps per second of `lissajous train` with some options after its first evaluation.

    Kernels are loaded and threads start before the first evaluation.
    """
    with tempfile.TemporaryDirectory() as folder:
        always = ["--out", folder, "--evaluation-episodes", "1", "--rivals"]
        _run(["-m", "lissajous_env", "train", *always, *options], checkout)
        curve = json.loads((Path(folder) / "checkpoint.json").read_text())["curve"]
    first, last = next(point for point in curve if point["steps"] > 0), curve[-1]  # without the untrained policy
    return (last["steps"] - first["steps"]) / (last["seconds"] - first["seconds"])


def _run(arguments: Sequence[str], checkout: Path) -> str:
    """Run Python in a process that imports a checkout, and return what it prints."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.pathsep.join(map(str, (checkout, declared(checkout, Path(folder)))))
        done = subprocess.run([sys.executable, *arguments], check=True, cwd=folder, stdout=subprocess.PIPE,
                              env=os.environ | {"PYTHONPATH": path}, text=True)  # fmt: skip
    return done.stdout


def declared(checkout: Path, folder: Path) -> Path:
    """Return a folder for the path that declares the entry points of a checkout, as if it were installed.

    Otherwise another version would import modules of the installed version.
    """
    project = tomllib.loads((checkout / "pyproject.toml").read_text())["project"]
    made = folder / "declared" / f"{project['name'].replace('-', '_')}-0.dist-info"
    made.mkdir(parents=True)
    (made / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: 0\n")
    groups = {"console_scripts": project.get("scripts", {}), **project.get("entry-points", {})}
    lines = [line for group, of in groups.items() for line in (f"[{group}]", *(f"{a} = {b}" for a, b in of.items()))]
    (made / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return made.parent


def rows_of(rates: dict[str, list[float]]) -> list[list[str]]:
    """Return a row for each side: its rate, and the ratio of this checkout's rate to it."""
    rows = []
    for side, theirs in rates.items():
        own = summarize(theirs)
        ratio = summarize([a / b for a, b in zip(rates[OURS], theirs, strict=True)])
        words = "" if side == OURS else f"{number(ratio.value)} ({between(ratio.low, ratio.high)})"
        rows.append([side, f"{own.value:,.0f}", f"{max(theirs):,.0f}", words])
    return rows


def environment(steps: int) -> tuple[float, float]:
    """Return the robot steps per second of `lissajous train` with the default network, and the environment's share."""
    from training.sb3 import RobotVecEnv
    from training.sb3.trainer import train
    from training.settings import TrainingSettings

    in_env = [0.0]

    def timed(step: Any) -> Any:
        def call(self: Any) -> Any:
            begin = time.perf_counter()
            result = step(self)
            in_env[0] += time.perf_counter() - begin
            return result

        return call

    RobotVecEnv.step_wait = timed(RobotVecEnv.step_wait)
    with tempfile.TemporaryDirectory() as folder:
        settings = TrainingSettings(SCENARIO, steps=steps, base="none", teacher="none", rivals=(), out=Path(folder),
                                    evaluate_every=10 * steps, evaluation_episodes=1)  # fmt: skip
        history = train(settings, Console(quiet=True))
    return history.steps / history.seconds, in_env[0] / history.seconds


def tables(options: Options) -> dict[str, Table]:
    """Measure, and return the tables `training-speed` and `learned-training`."""
    sides = {OURS: ROOT}
    if options.rivals and options.against is not None:
        sides[options.against.name] = options.against
    rates: dict[str, list[float]] = {side: [] for side in sides}
    for turn in range(options.rounds):
        for side, checkout in sides.items():
            rates[side].append(rate(checkout, turn, options.quick))
            print(f"round {turn}, {side}: {rates[side][-1]:,.0f} steps/s", flush=True)
    columns = ["training", "robot steps per second", "best", "times as fast here"]
    own, share = environment(1000 if options.quick else 5_000_000)
    return {
        "training-speed": {"columns": columns, "rows": rows_of(rates)},
        "learned-training": {
            "columns": ["", "robot steps per second", "in the environment [% of the time]"],
            "rows": [["`lissajous train`", f"{own:,.0f}", number(100 * share)]],
        },
    }


PART = Part(
    "training",
    "`lissajous train`, beside another checkout where one is given",
    tables,
    rounds=5,
    needs={"stable_baselines3": "train", "torch": "train"},
)
