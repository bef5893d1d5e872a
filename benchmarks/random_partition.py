"""Undetected times of rogues by `partition` at constant and random rates: `python benchmarks/random_partition.py`.

For each range of rates, rogues are trained against cars that share one of four seeds, and then play, on seeds of
episodes that the training does not use, against cars that share another seed. At a constant rate the seed changes
nothing. Prints, on `evaders`, the proved bound, also valid for rogues that know the seed, and the undetected times of
the best script and of the trained rogue, all of these from 5 s on, when the cars are on their loops. `--rounds 2
--episodes 4` makes it short.
"""

import argparse
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console

import baselines
import lissajous_env
from baselines.exploitability.bracket import bracketed
from baselines.policies.partition_random import PartitionRandom, RandomPartitionParameters
from lissajous_env.episodes.evaluation import EpisodeRunner
from lissajous_env.episodes.guarantee import worst_undetected_times
from training.rogue_settings import RogueTraining
from training.sb3.rogue_trainer import train_rogues

RATES = (1.0, 1.0), (0.7, 0.7), (0.4, 1.0), (0.6, 0.6), (0.2, 1.0)
"""Smallest and largest rates, as shares of the rate of `partition`."""
SEEDS, HELD_OUT = (1, 2, 3, 4), 5
SCRIPTS = "wander", "flee", "shadow", "follow-gap"
SCENARIO = "evaders"
LATER = 5.0
"""Time from which on rogues and the bound count [s]."""


def registered(slowest: float, fastest: float, seed: int) -> str:
    """Register a partition with such rates, and return its name."""
    name = f"rates-{slowest:g}-{fastest:g}-seed-{seed}"
    parameters = RandomPartitionParameters(slowest=slowest, fastest=fastest, seed=seed)
    baselines.register(name, "car", partial(PartitionRandom, parameters=parameters))
    return name


def row(slowest: float, fastest: float, options: argparse.Namespace) -> str:
    """Train rogues against a range of rates, and return the row of the table."""
    seeds = SEEDS if slowest < fastest else SEEDS[:1]
    against = "+".join(registered(slowest, fastest, seed) for seed in seeds)
    out = options.out / f"{slowest:g}-{fastest:g}"
    settings = RogueTraining(
        SCENARIO, against, options.rounds, 0, evaluation_episodes=options.episodes, threads=1, out=out
    )
    train_rogues(settings, Console(quiet=True))
    policy, seeds = registered(slowest, fastest, HELD_OUT), range(10_000, 10_000 + options.episodes)
    found = [undetected(policy, settings.make_scenario(each), seeds) for each in SCRIPTS]
    learned = undetected(policy, settings.make_scenario(str(out)), seeds)
    scenario = bracketed(lissajous_env.scenario(SCENARIO))
    bound = worst_undetected_times(baselines.make(policy, scenario), scenario, seeds[:1])
    best = [max(of[k] for of in found) for k in range(2)]
    rates = f"{slowest:g}" if slowest == fastest else f"{slowest:g} to {fastest:g}"
    cells = [rates, f"{bound[:, round(LATER / scenario.task.step) :].max():.1f}"]
    return " | ".join([*cells, *(f"{time:.2f}" for time in (*best, *learned))])


def undetected(policy: str, scenario: lissajous_env.Scenario, seeds: range) -> tuple[float, float]:
    """Return the mean undetected time of the rogues that appear from `LATER` on, and that of the best ones [s]."""
    simulation = lissajous_env.Simulation(scenario, len(seeds))
    runner = EpisodeRunner(lissajous_env.policy(policy, scenario, len(seeds)), simulation)
    runner.play(seeds)
    appeared = simulation.targets.appears_at.numpy()
    times = []
    for w in range(len(seeds)):
        of_world, _ = simulation.detection_times(w)
        began = appeared[w][appeared[w] <= scenario.task.steps]
        times.append(of_world[began * scenario.task.step >= LATER])
    return float(np.concatenate(times).mean()), float(np.mean([each.max() for each in times]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=16)
    parser.add_argument("--episodes", type=int, default=32)
    parser.add_argument("--out", type=Path, help="folder of the trainings, which resume there; temporary by default")
    options = parser.parse_args()
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        options.out = options.out or Path(folder)
        print("| rate | proved bound | best script, mean | best start | learned, mean | best start |")
        print("|---|---|---|---|---|---|")
        for slowest, fastest in RATES:
            print(f"| {row(slowest, fastest, options)} |", flush=True)
    print(f"{time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    main()
