"""Shipped policies against the classical ones, as they are and tuned: `python benchmarks/learned.py`.

Every policy plays the same 64 held-out seeds, which neither the training nor the tuning saw, in one run. The tuned
classical policies are those of `benchmarks/tuned.json`, which `python benchmarks/tuning.py` writes. Then the time of a
learned policy's `act` and of its network alone, beside products of matrices by NumPy. `--training` measures the
throughput of `lissajous train` too, `--touches` how rare collisions are, over many more episodes. `--store` puts what
is found into docs/figures.json, and how each shipped policy was made, from its card.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import figures
import numpy as np
from rich.console import Console
from tuning import HELD_OUT, make

import baselines
import lissajous_env
import training
from baselines.benchmark.statistics import Statistics, interquartile_mean, summarize
from baselines.benchmark.tables import SHOWN, in_words, number
from baselines.policies.base import Policy
from training.learned import checkpoint
from training.learned.policy import find

TUNED = Path(__file__).parent / "tuned.json"
LEARNED = {"intruders": "learned-intruders", "rough-lost": "learned-rough"}
OTHERS = {
    "intruders": ("learned-intruders-safe", "kuramoto-mpcc", "arc-mpcc", "sweep", "sweep-safe", "laps"),
    "rough-lost": ("learned-rough-safe", "kuramoto-mpcc", "kuramoto-mpcc-safe", "arc-mpcc-safe", "sweep-safe"),
}
COLUMNS = {"detection_time_mean": "detection [s]", "collisions": "collisions", "recovery_time": "recovery [s]"}


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


def compare(scenario: str, episodes: int) -> dict[str, dict[str, Statistics]]:
    """Play, return the statistics of each policy."""
    seeds = HELD_OUT[:episodes]
    scores: dict[str, dict[str, Statistics]] = {}
    for label, policy in candidates(scenario, len(seeds)).items():
        rows = lissajous_env.evaluate(policy, scenario, seeds)
        scores[label] = {column: summarize([row[column] for row in rows]) for column in COLUMNS}
    return scores


def as_table(scores: dict[str, dict[str, dict[str, Statistics]]]) -> figures.Table:
    """What each policy scored by scenario, and the detection time of the learned one, without a filter, beside its."""
    rows = []
    for scenario, policies in scores.items():
        own = policies[LEARNED[scenario]]["detection_time_mean"].iqm
        for label, of in policies.items():
            words = (in_words(of, shown) for shown in SHOWN if shown.column in COLUMNS)
            cells = [f"{value} ({ends})" if ends else value for value, ends in words]
            name, *tuned = label.partition(",")
            rows.append([f"{scenario}, `{name}`{''.join(tuned)}", *cells, number(own / of["detection_time_mean"].iqm)])
    return {"columns": ["policy", *COLUMNS.values(), "the learned one's detection time, as a share"], "rows": rows}


def ratios(scenario: str, scores: dict[str, dict[str, Statistics]], console: Console) -> None:
    """Print what the learned policy's numbers are as shares of the others'."""
    own = scores[LEARNED[scenario]]
    console.print(f"{LEARNED[scenario]} on {scenario}")
    for label, other in scores.items():
        if other is own:
            continue
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


def touches(scenario: str, seeds: range) -> list[list[str]]:
    """Row of the learned policy, and of it behind the filter: in how many episodes of many robots touch."""
    rows = []
    for name in (LEARNED[scenario], f"{LEARNED[scenario]}-safe"):
        policy = baselines.make(name, scenario, len(seeds))
        played = lissajous_env.evaluate(policy, scenario, seeds)
        touched = [row["seed"] for row in played if row["collisions"] > 0]
        detection = interquartile_mean([row["detection_time_mean"] for row in played])
        rows.append([f"`{name}`", f"{len(touched)}", f"{len(seeds):,}", f"{detection:.3f}"])
    return rows


def made(name: str) -> list[str]:
    """Row of a shipped policy: what it is, by its card, and how long it was trained."""
    card, text = checkpoint.read(find(name))[1:]
    stages = {point.get("stage", 1) for point in text["curve"]}
    learner = "PPO with a central critic" if card.settings.get("critic", "robot") != "robot" else "PPO"
    kind = f"a residual on `{card.base}`" if card.base else "a network of its own"
    count = f", {len(stages)} stages" if len(stages) > 1 else ""
    return [
        f"`{name}`",
        f"`{card.scenario}`",
        f"{kind}, {learner}{count}",
        f"{text['counters']['steps'] / 1e6:.0f} million",
    ]


def throughput(steps: int) -> tuple[float, float]:
    """Robot steps per second of `lissajous train` with the default network, and the environment's share of the time."""
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

    RobotVecEnv._step = timed(RobotVecEnv._step)
    with tempfile.TemporaryDirectory() as folder:
        settings = TrainingSettings("intruders", steps=steps, teacher="none", rivals=(), evaluate_every=10 * steps,
                         evaluation_episodes=1, out=Path(folder))  # fmt: skip
        history = train(settings, Console(quiet=True))
    return history.steps / history.seconds, in_env[0] / history.seconds


def main() -> None:
    parser = argparse.ArgumentParser(description="Shipped policies against the classical ones.")
    parser.add_argument("--scenarios", nargs="+", default=list(LEARNED), choices=list(LEARNED))
    parser.add_argument("--episodes", type=int, default=len(HELD_OUT))
    parser.add_argument("--training", action="store_true", help="measure training too")
    parser.add_argument("--touches", type=int, default=0, help="episodes to count collisions in, seeds 3000 ...")
    parser.add_argument("--training-steps", type=int, default=5_000_000)
    parser.add_argument("--store", action="store_true", help="put the tables into docs/figures.json, too")
    options = parser.parse_args()
    scores = {scenario: compare(scenario, options.episodes) for scenario in options.scenarios}
    tables = {"learned": as_table(scores)}
    figures.show(f"{options.episodes} held-out episodes", tables["learned"])
    for scenario in options.scenarios:
        ratios(scenario, scores[scenario], Console(width=140))
    rows = []
    for name in dict.fromkeys(LEARNED[scenario] for scenario in options.scenarios):
        for worlds in (1, 32, 1024):
            times = times_per_row(name, worlds, 2000 if worlds < 100 else 100)
            rows.append([f"`{name}`, {worlds:,} world{'s' * (worlds > 1)}", *map(number, times)])
    columns = ["time of a robot, median", "act [us]", "its network [us]", "its matrices by NumPy [us]"]
    tables["learned-act"] = {"columns": columns, "rows": rows}
    figures.show("time of a learned policy", tables["learned-act"])
    tables["learned-made"] = {"columns": ["name", "made for", "what it is", "steps of a robot"],
                              "rows": [made(LEARNED[scenario]) for scenario in options.scenarios]}  # fmt: skip
    if options.touches:
        seeds = range(3000, 3000 + options.touches)
        rows = [row for scenario in options.scenarios for row in touches(scenario, seeds)]
        columns = ["policy", "episodes with a collision", "of", "detection [s]"]
        tables["learned-touches"] = {"columns": columns, "rows": rows}
        figures.show("collisions", tables["learned-touches"])
    if options.training:
        rate, share = throughput(options.training_steps)
        columns = ["", "robot steps per second", "in the environment [% of the time]"]
        rows = [["`lissajous train`", f"{rate:,.0f}", number(100 * share)]]
        tables["learned-training"] = {"columns": columns, "rows": rows}
        figures.show("training", tables["learned-training"])
    if options.store:
        figures.store(tables)


if __name__ == "__main__":
    main()
