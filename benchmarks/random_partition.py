"""Undetected times of rogues by `partition` at constant and random rates: `python benchmarks/random_partition.py`.

For each range of rates, rogues are trained against cars that share one of four seeds, and then play, on seeds of
episodes that the training does not use, against cars that share another seed. At a constant rate the seed changes
nothing. Prints, on `evaders`, the proved bound, which holds for rogues that know the seed, and the undetected times of
the best script and of the trained rogue. `--rounds 2 --episodes 4` makes it short.
"""

import argparse
import tempfile
import time
from functools import partial
from pathlib import Path

from rich.console import Console

import baselines
import lissajous_env
from baselines.exploitability.bracket import bound_of, bracketed
from baselines.exploitability.survival import survive, with_starts
from baselines.policies.partition_random import PartitionRandom, RandomPartitionParameters
from training.rogue_settings import RogueTraining
from training.sb3.rogue_trainer import train_rogues

RATES = (1.0, 1.0), (0.7, 0.7), (0.4, 1.0), (0.6, 0.6), (0.2, 1.0)
"""Smallest and largest rates, as shares of the rate of `partition`."""
SEEDS, HELD_OUT = (1, 2, 3, 4), 5
SCRIPTS = "wander", "flee", "shadow", "follow-gap"
SCENARIO = "evaders"


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
    policy, episodes = registered(slowest, fastest, HELD_OUT), range(10_000, 10_000 + options.episodes)
    found = {each: survive(policy, settings.make_scenario(each), episodes).summary() for each in SCRIPTS}
    learned = survive(policy, settings.make_scenario(str(out)), episodes).summary()
    scenario = with_starts(bracketed(lissajous_env.scenario(SCENARIO)), "wander", settings.starts)
    bound = bound_of(survive(policy, scenario, episodes[:1]))
    mean, longest = (max(of[name] for of in found.values()) for name in ("mean", "longest"))
    rates = f"{slowest:g}" if slowest == fastest else f"{slowest:g} to {fastest:g}"
    cells = [rates, f"{bound.value:.1f}", f"{mean:.2f}", f"{longest:.2f}"]
    return " | ".join([*cells, f"{learned['mean']:.2f}", f"{learned['longest']:.2f}"])


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
