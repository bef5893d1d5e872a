"""How fast the environment steps, beside what a user would pick instead, both sides in one run.

    pip install ".[bench]" && python benchmarks/throughput.py

Sides: `ParallelEnv.step` against mpe2 `simple_spread_v3` with 5 agents, and the batch against VMAS `discovery` with
5 agents and 20 targets. Figures are medians over rounds in which the sides take turns; the best round stands beside.
"""

import argparse
import os
import platform
import resource
import statistics
import sys
import time
from collections.abc import Callable

import numpy as np

import baselines
import lissajous_env
from lissajous_env.extras import missing

ROBOTS, TARGETS = 5, 20
SETTINGS = {"targets.count": TARGETS, "targets.arrival_rate": 0.0}
# Targets that stay when they are detected, so that no step is an easy one.
STAYING = SETTINGS | {"targets.leave": False}


def microseconds(step: Callable[[], object], calls: int) -> float:
    """Mean time of a call."""
    begin = time.perf_counter()
    for _ in range(calls):
        step()
    return (time.perf_counter() - begin) / calls * 1e6


def measured(sides: dict[str, tuple[Callable[[], object], int]], rounds: int) -> dict[str, tuple[float, float]]:
    """Median and least time of a call of each side [us]; they take turns, so that a slow moment hits them alike."""
    for step, _ in sides.values():
        step()
    times: dict[str, list[float]] = {name: [] for name in sides}
    for _ in range(rounds):
        for name, (step, calls) in sides.items():
            times[name].append(microseconds(step, calls))
    return {name: (statistics.median(values), min(values)) for name, values in times.items()}


def ours_single(scenario: str) -> Callable[[], object]:
    env = lissajous_env.parallel_env(scenario, **STAYING)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    actions = {agent: rng.uniform(-0.3, 0.3, 2).astype(np.float32) for agent in env.agents}

    def step() -> None:
        env.step(actions)
        if not env.agents:
            env.reset()

    return step


def mpe2_single() -> Callable[[], object]:
    from mpe2 import simple_spread_v3

    env = simple_spread_v3.parallel_env(N=ROBOTS, max_cycles=10**9)
    env.reset(seed=0)
    actions = {agent: env.action_space(agent).sample() for agent in env.agents}
    return lambda: env.step(actions)


def ours_batch(
    scenario: str, worlds: int, threads: int, settings: dict, grid: tuple[int, int] | None
) -> Callable[[], object]:
    made = lissajous_env.scenario(scenario, **settings, **{"task.grid": grid, "task.duration": 10_000.0})
    simulation = lissajous_env.Simulation(made, num_worlds=worlds, threads=threads)
    actions = np.random.default_rng(0).uniform(-0.3, 0.3, simulation.action_shape).astype(np.float32)
    return lambda: simulation.step(actions)


def ours_in_formation(worlds: int, threads: int, contamination: tuple[int, int] | None) -> Callable[[], object]:
    """The experiment as the paper's method drives it, all worlds alike; what costs time is where rogues may be."""
    made = lissajous_env.scenario("experiment", **{"task.contamination": contamination})
    alone, policy = lissajous_env.Simulation(made), baselines.make("kuramoto-mpcc", made)
    actions = []
    for _ in range(100):
        actions.append(policy.act(alone.observation).numpy().copy())
        alone.step(actions[-1])
    simulation = lissajous_env.Simulation(made, num_worlds=worlds, threads=threads)
    wide = [np.repeat(action, worlds, axis=0) for action in actions]
    taken = len(wide)

    def step() -> None:
        nonlocal taken
        if taken == len(wide):
            simulation.reset(seeds=np.zeros(worlds, dtype=int))
            taken = 0
        simulation.step(wide[taken])
        taken += 1

    return step


def print_contamination(worlds: int, threads: int, rounds: int) -> None:
    """Print what following contamination costs, in formation."""
    print("\nThe experiment driven by kuramoto-mpcc, with contamination and without: median (best) [us a step]")
    for count in (1, worlds):
        sides = {
            name: (ours_in_formation(count, threads, grid), 100)
            for name, grid in {"without": None, "36 x 16": (36, 16), "90 x 40": (90, 40)}.items()
        }
        times = measured(sides, rounds)
        for name, (median, best) in times.items():
            ratio = median / times["without"][0]
            print(f"  {count} worlds, {name:10s} {median:10.1f} ({best:.1f})  {ratio:5.2f} times that without")


def vmas_batch(worlds: int) -> Callable[[], object]:
    import torch
    import vmas

    torch.set_grad_enabled(False)
    env = vmas.make_env("discovery", num_envs=worlds, n_agents=ROBOTS, n_targets=TARGETS, device="cpu", seed=0)
    env.reset()
    actions = [torch.rand(worlds, 2) * 2 - 1 for _ in range(ROBOTS)]
    return lambda: env.step(actions)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=4096)
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--without-rivals", action="store_true", help="leave out mpe2 and VMAS")
    given = parser.parse_args()
    print(f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores, {given.threads} threads")

    sides = {name: (ours_single(name), 500) for name in ("experiment", "intruders")}
    if not given.without_rivals:
        try:
            sides["mpe2 simple_spread"] = (mpe2_single(), 200)
        except ImportError as error:
            sys.exit(f"error: {missing('benchmarks/throughput.py', 'bench', error)}")
    single = measured(sides, given.rounds)
    print(
        f"\nParallelEnv.step, {ROBOTS} cars, {TARGETS} moving targets that stay, coverage grid on: median (best) [us]"
    )
    for name, (median, best) in single.items():
        print(f"  {name:34s} {median:8.1f} ({best:.1f})")
    if not given.without_rivals:
        rival = single["mpe2 simple_spread"][0]
        ratios = (f"{name} {rival / single[name][0]:.1f}" for name in ("experiment", "intruders"))
        print("  times faster by the medians: " + ", ".join(ratios))

    print_contamination(given.worlds, given.threads, given.rounds)

    batch = {}
    for name, settings in {
        "experiment": SETTINGS,
        "experiment, all stay": STAYING,
        "intruders, all stay": STAYING,
    }.items():
        scenario = name.partition(",")[0]
        for words, grid in {"no grid": None, "36 x 16 grid": (36, 16)}.items():
            step = ours_batch(scenario, given.worlds, given.threads, settings, grid)
            batch[f"{name}, {words}"] = (step, 20)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    if not given.without_rivals:
        batch["VMAS discovery"] = (vmas_batch(given.worlds), 1)
    rates = {name: [given.worlds / time for time in times] for name, times in measured(batch, given.rounds).items()}
    print(f"\nBatch of {given.worlds} worlds: median (best) [million steps of a world per second]")
    for name, (median, best) in rates.items():
        ratio = "" if given.without_rivals else f"  {median / rates['VMAS discovery'][0]:6.1f} times VMAS"
        print(f"  {name:34s} {median:8.3f} ({best:.3f}){ratio}")
    print(f"\nPeak memory of this process with six batches of {given.worlds} worlds: {peak:.0f} MB")


if __name__ == "__main__":
    sys.exit(main())
