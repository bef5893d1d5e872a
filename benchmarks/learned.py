"""Shipped policies against the classical ones, as they are and tuned: `python benchmarks/learned.py`.

Every policy plays the same 64 held-out seeds, which neither the training nor the tuning saw, in one run. The tuned
classical policies are those of `benchmarks/tuned.json`, which `python benchmarks/tuning.py` writes. Then the time of a
learned policy's NumPy path in one world, beside torch. `--training` measures the throughput of `lissajous train` too.
"""

import argparse
import json
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from tuning import HELD_OUT, make

import baselines
import lissajous_env
import training
from baselines.policy import Policy
from baselines.statistics import Statistics, summarize

TUNED = Path(__file__).parent / "tuned.json"
LEARNED = {
    "intruders": "learned-intruders", "rough": "learned-rough", "failure": "learned-ring", "ideal": "learned-ring",
}  # fmt: skip
OTHERS = {
    "intruders": ("learned-intruders-safe", "kuramoto-mpcc", "kuramoto-arc-mpcc", "sweep", "sweep-safe", "laps"),
    "rough": ("learned-rough-safe", "kuramoto-mpcc", "kuramoto-mpcc-safe", "kuramoto-arc-mpcc-safe", "sweep-safe"),
    "failure": ("kuramoto", "open-loop"),
    "ideal": ("kuramoto", "open-loop"),
}
COLUMNS = {
    "detection_time_mean": "detection in s, IQM (95 % interval)",
    "collisions": "collisions, mean",
    "recovery_time": "recovery in s, IQM",
}


def candidates(scenario: str, worlds: int) -> dict[str, Policy]:
    """Policies that play a scenario, by what the table calls them."""
    made = lissajous_env.scenario(scenario)
    found = {LEARNED[scenario]: baselines.make(LEARNED[scenario], made, worlds)}
    found |= {name: baselines.make(name, made, worlds) for name in OTHERS[scenario]}
    tuned: dict[str, Any] = json.loads(TUNED.read_text()).get(scenario, {})
    for name, by_goal in tuned.items():
        played: list[Any] = [{}]
        for goal, settings in by_goal.items():
            if settings not in played:
                found[f"{name}, tuned ({goal})"] = make(name, made, settings, worlds)
                played.append(settings)
    return found


def compare(scenario: str, episodes: int, console: Console) -> dict[str, dict[str, Statistics]]:
    """Play, print a table, return the statistics of each policy."""
    seeds = HELD_OUT[:episodes]
    table = Table("policy", *COLUMNS.values(), title=f"{scenario}, seeds {seeds[0]} to {seeds[-1]}")
    scores: dict[str, dict[str, Statistics]] = {}
    for label, policy in candidates(scenario, len(seeds)).items():
        rows = lissajous_env.evaluate(policy, scenario, seeds)
        scores[label] = {column: summarize([row[column] for row in rows]) for column in COLUMNS}
        detection, collisions, recovery = scores[label].values()
        times = f"{detection.iqm:.3f} ({detection.low:.3f} to {detection.high:.3f})"
        table.add_row(label, times, f"{collisions.mean:.3f}", f"{recovery.iqm:.2f}")
    console.print(table)
    return scores


def ratios(scenario: str, scores: dict[str, dict[str, Statistics]], console: Console) -> None:
    """Print what the learned policy's numbers are as shares of the others'."""
    own = scores.pop(LEARNED[scenario])
    for label, other in scores.items():
        parts = []
        for column in COLUMNS:
            mine, theirs = own[column], other[column]
            a, b = (mine.mean, theirs.mean) if column == "collisions" else (mine.iqm, theirs.iqm)
            share = "equal" if a == b else f"{a / b:.3f}" if b else "none there"
            parts.append(f"{column} {share}" if np.isfinite(a) and np.isfinite(b) else "")
        apart = own["detection_time_mean"].high < other["detection_time_mean"].low
        console.print(f"  of {label}: {', '.join(filter(None, parts))}; intervals {'apart' if apart else 'overlap'}")


def time_per_row(name: str, backend: str, steps: int = 2000) -> float:
    """Time of a policy's `act` in one world [us per robot]: the median of a step."""
    policy = training.load(name, backend=backend)
    simulation = lissajous_env.Simulation(policy.scenario)
    seen, times = simulation.observation.numpy(), []
    for _ in range(steps):
        begin = time.perf_counter()
        policy.act(seen)
        times.append(time.perf_counter() - begin)
    return float(np.median(times)) / simulation.num_robots * 1e6


def throughput(console: Console, steps: int) -> None:
    """Print robot steps per second of `lissajous train` with the default network, and the environment's share."""
    from training import sb3
    from training.settings import Train
    from training.train import train

    in_env = [0.0]

    def timed(step: Any) -> Any:
        def call(self: Any) -> Any:
            begin = time.perf_counter()
            found = step(self)
            in_env[0] += time.perf_counter() - begin
            return found

        return call

    sb3.RobotVecEnv.step_wait = timed(sb3.RobotVecEnv.step_wait)
    with tempfile.TemporaryDirectory() as folder:
        settings = Train("intruders", steps=steps, teacher="none", rivals=(), evaluate_every=10 * steps,
                         evaluation_episodes=1, out=Path(folder))  # fmt: skip
        course = train(settings, Console(quiet=True))
    rate, share = course.steps / course.seconds, in_env[0] / course.seconds
    console.print(f"training: {rate:,.0f} robot steps per second, {100 * share:.1f} % of the time in the environment")


def main() -> None:
    parser = argparse.ArgumentParser(description="Shipped policies against the classical ones.")
    parser.add_argument("--scenarios", nargs="+", default=list(LEARNED), choices=list(LEARNED))
    parser.add_argument("--episodes", type=int, default=len(HELD_OUT))
    parser.add_argument("--training", action="store_true", help="measure training too")
    parser.add_argument("--training-steps", type=int, default=5_000_000)
    options = parser.parse_args()
    console = Console(width=140)
    for scenario in options.scenarios:
        ratios(scenario, compare(scenario, options.episodes, console), console)
    for name in dict.fromkeys(LEARNED[scenario] for scenario in options.scenarios):
        console.print(f"{name}, one world: {time_per_row(name, 'numpy'):.1f} us per robot by NumPy")
        if find_spec("torch") is not None:
            console.print(f"{name}, one world: {time_per_row(name, 'torch'):.1f} us per robot by torch")
    if options.training:
        throughput(console, options.training_steps)


if __name__ == "__main__":
    main()
