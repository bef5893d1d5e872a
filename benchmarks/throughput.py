"""How fast the environment steps, beside what a user would pick instead, both sides in one run.

    pip install ".[bench]" && python benchmarks/throughput.py

Sides: `ParallelEnv.step` against mpe2 `simple_spread_v3` with 5 agents, and the batch against VMAS `discovery` with
5 agents and 20 targets; then what following contamination costs. Figures are medians over rounds in which the sides
take turns, with the best round; a ratio is the median over rounds, with its 95 % interval. `--store` puts them into
docs/figures.json, with the machine.
"""

import argparse
import os
import platform
import resource
import statistics
import sys
from collections.abc import Callable
from pathlib import Path

import figures
import numpy as np
import warp
from timing import by_turns, ratio

import baselines
import lissajous_env
from baselines.benchmark.tables import between, number
from lissajous_env.extras import missing

ROBOTS, TARGETS = 5, 20
SETTINGS = {"targets.count": TARGETS, "targets.arrival_rate": 0.0}
# Targets that stay when they are detected, so that no step is an easy one.
STAYING = SETTINGS | {"targets.leave": False}
SPREAD, DISCOVERY = "mpe2 simple_spread", "VMAS discovery"

Times = list[float]
"""Time of a call in each round [us]."""


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


def vmas_batch(worlds: int) -> Callable[[], object]:
    # Threads of torch that wait for each other in a loop take ten times as long where another program has a core.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    import torch
    import vmas

    torch.set_grad_enabled(False)
    env = vmas.make_env("discovery", num_envs=worlds, n_agents=ROBOTS, n_targets=TARGETS, device="cpu", seed=0)
    env.reset()
    actions = [torch.rand(worlds, 2) * 2 - 1 for _ in range(ROBOTS)]
    return lambda: env.step(actions)


def machine(threads: int) -> figures.Table:
    """What is measured on."""
    told = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    models = [line.partition(": ")[2] for line in told.splitlines() if line.startswith("model name")]
    of = {
        "processor": models[0] if models else platform.processor() or platform.machine(),
        "cores": str(os.cpu_count()),
        "threads": str(threads),
        "Python": platform.python_version(),
        "Warp": warp.__version__,
    }
    return {"columns": ["", *of], "rows": [["measured on", *of.values()]]}


def speed_rows(times: dict[str, Times], worlds: int, rival: str) -> list[list[str]]:
    """A row for each of our sides, beside the rival if it is among them; each call steps so many worlds."""
    rows = []
    for name, own in times.items():
        if name == rival:
            continue
        middle = statistics.median(own) / worlds
        beside = ["", "", ""]
        if rival in times:
            beside = [rival, number(statistics.median(times[rival]) / worlds), words_of(own, times[rival])]
        rows.append([name, f"{worlds:,}", number(middle), number(min(own) / worlds), number(1 / middle), *beside])
    return rows


def contamination_rows(times: dict[str, Times], where: str, worlds: int) -> list[list[str]]:
    """A row for each grid, beside the side that is called `without`."""
    rows, without = [], times["without"]
    for name, own in times.items():
        more = (statistics.median(own) - statistics.median(without)) / worlds
        beside = ["", ""] if name == "without" else [number(more), words_of(without, own)]
        row = [f"{where}, {name}", f"{worlds:,}", number(statistics.median(own) / worlds), number(min(own) / worlds)]
        rows.append([*row, *beside])
    return rows


def words_of(own: Times, others: Times) -> str:
    """The ratio others / own and its interval."""
    middle, low, high = ratio(own, others)
    ends = between(low, high)
    return f"{number(middle)} ({ends})" if ends else number(middle)


def main() -> None:
    """Measure, print and store."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=4096)
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--without-rivals", action="store_true", help="leave out mpe2 and VMAS")
    parser.add_argument("--store", action="store_true", help="put the tables into docs/figures.json, too")
    given = parser.parse_args()
    tables = {"machine": machine(given.threads)}
    figures.show("machine", tables["machine"])

    sides = {f"{name}, `ParallelEnv.step`": (ours_single(name), 500) for name in ("experiment", "intruders")}
    if not given.without_rivals:
        try:
            sides[SPREAD] = (mpe2_single(), 200)
        except ImportError as error:
            sys.exit(f"error: {missing('benchmarks/throughput.py', 'bench', error)}")
    rows = speed_rows(by_turns(sides, given.rounds), 1, SPREAD)

    batch = {}
    for name, settings in {
        "experiment": SETTINGS,
        "experiment, all stay": STAYING,
        "intruders, all stay": STAYING,
    }.items():
        scenario = name.partition(",")[0]
        for words, grid in {"no grid": None, "36 x 16 grid": (36, 16)}.items():
            step = ours_batch(scenario, given.worlds, given.threads, settings, grid)
            batch[f"batch, {name}, {words}"] = (step, 20)
    followed = STAYING | {"task.contamination": (36, 16)}
    step = ours_batch("experiment", given.worlds, given.threads, followed, None)
    batch["batch, experiment, all stay, 36 x 16 contamination"] = (step, 20)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    if not given.without_rivals:
        batch[DISCOVERY] = (vmas_batch(given.worlds), 1)
    rows += speed_rows(by_turns(batch, given.rounds), given.worlds, DISCOVERY)
    columns = ["", "worlds", "step of a world [us]", "best [us]", "million steps of a world per second", "rival",
               "its step of a world [us]", "ratio"]  # fmt: skip
    tables["speed"] = {"columns": columns, "rows": rows}
    title = f"{ROBOTS} cars, {TARGETS} moving targets; `ParallelEnv.step`: targets that stay, coverage grid on; medians"
    figures.show(title, tables["speed"])
    tables["memory"] = {"columns": ["", "worlds in each", "peak [MB]"],
                        "rows": [["seven batches", f"{given.worlds:,}", f"{peak:.0f}"]]}  # fmt: skip
    figures.show("memory of the process", tables["memory"])

    rows = []
    for where, worlds in (("one world", 1), ("batch", given.worlds)):
        grids = {"without": None, "36 x 16 cells": (36, 16), "90 x 40 cells": (90, 40)}
        sides = {name: (ours_in_formation(worlds, given.threads, grid), 100) for name, grid in grids.items()}
        rows += contamination_rows(by_turns(sides, given.rounds), where, worlds)
    columns = ["", "worlds", "step of a world [us]", "best [us]", "more than without [us]", "ratio"]
    tables["contamination"] = {"columns": columns, "rows": rows}
    figures.show("experiment driven by kuramoto-mpcc, what following contamination costs; medians",
                 tables["contamination"])  # fmt: skip
    if given.store:
        figures.store(tables)


if __name__ == "__main__":
    main()
