"""Shipped policies against the classical ones, as they are and tuned: `python benchmarks/learned.py`.

Every policy plays the same 64 held-out seeds, which neither the training nor the tuning saw, in one run. The tuned
classical policies are those of `benchmarks/tuned.json`, which `python benchmarks/tuning.py` writes. Then the time of a
learned policy's `act` and of its network alone, beside products of matrices by NumPy. `--training` measures the
throughput of `lissajous train` too.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from tuning import HELD_OUT, make

import baselines
import lissajous_env
import training
from baselines.benchmark.statistics import Statistics, summarize
from baselines.policies.base import Policy

TUNED = Path(__file__).parent / "tuned.json"
LEARNED = {"intruders": "learned-intruders", "rough-lost": "learned-rough"}
OTHERS = {
    "intruders": ("learned-intruders-safe", "kuramoto-mpcc", "arc-mpcc", "sweep", "sweep-safe", "laps"),
    "rough-lost": ("learned-rough-safe", "kuramoto-mpcc", "kuramoto-mpcc-safe", "arc-mpcc-safe", "sweep-safe"),
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


def times_per_row(name: str, worlds: int, steps: int = 2000) -> tuple[float, float, float]:
    """Times per robot [us], the median of a step: `act`, the network's kernel alone, and its matrices by NumPy."""
    policy = training.load(name, num_worlds=worlds)
    simulation = lissajous_env.Simulation(policy.scenario, worlds)
    seen, network = simulation.observation.numpy(), policy.network
    rows = np.random.default_rng(0).normal(size=(worlds * simulation.num_robots, network.inputs)).astype(np.float32)
    base = None if policy.base is None else policy.base.action

    def by_matrices() -> None:
        x = rows
        for k, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
            x = x @ weight.T + bias
            x = x if k == len(network.weights) - 1 else np.maximum(x, 0.0)

    found = []
    for call in (lambda: policy.act(seen), lambda: policy._forward.launch(simulation.observation, base), by_matrices):
        times = []
        for _ in range(steps):
            begin = time.perf_counter()
            call()
            times.append(time.perf_counter() - begin)
        found.append(float(np.median(times)) / len(rows) * 1e6)
    return found[0], found[1], found[2]


def throughput(console: Console, steps: int) -> None:
    """Print robot steps per second of `lissajous train` with the default network, and the environment's share."""
    from training.sb3 import RobotVecEnv
    from training.sb3.trainer import train
    from training.settings import TrainingSettings

    in_env = [0.0]

    def timed(step: Any) -> Any:
        def call(self: Any) -> Any:
            begin = time.perf_counter()
            found = step(self)
            in_env[0] += time.perf_counter() - begin
            return found

        return call

    RobotVecEnv.step_wait = timed(RobotVecEnv.step_wait)
    with tempfile.TemporaryDirectory() as folder:
        settings = TrainingSettings("intruders", steps=steps, teacher="none", rivals=(), evaluate_every=10 * steps,
                         evaluation_episodes=1, out=Path(folder))  # fmt: skip
        history = train(settings, Console(quiet=True))
    rate, share = history.steps / history.seconds, in_env[0] / history.seconds
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
        for worlds in (1, 32, 1024):
            whole, alone, by_matrices = times_per_row(name, worlds, 2000 if worlds < 100 else 100)
            words = f"{whole:.2f} us per robot, {alone:.2f} of it the network; by NumPy's matrices {by_matrices:.2f}"
            console.print(f"{name}, {worlds} worlds: {words}")
    if options.training:
        throughput(console, options.training_steps)


if __name__ == "__main__":
    main()
