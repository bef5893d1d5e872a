"""A step of one world compared with mpe2 `simple_spread_v3`, and of a batch compared with VMAS `discovery`."""

import os
import statistics
from collections.abc import Callable

import numpy as np
from figures import Table
from timing import Times, by_turns, ratio_in_words

import lissajous_env
from baselines.benchmark.statistics import number
from speeds import Options, Part

ROBOTS, TARGETS = 5, 20
SETTINGS = {"targets.count": TARGETS, "targets.arrival_rate": 0.0}
# Targets stay when they are detected, so that no step is cheaper than others.
STAYING = SETTINGS | {"targets.leave": False}
NAMED = {"experiment": SETTINGS, "experiment, all stay": STAYING, "intruders, all stay": STAYING}
GRID = (36, 16)
SPREAD, DISCOVERY = "mpe2 simple_spread", "VMAS discovery"

BATCHES: dict[str, tuple[str, dict]] = {
    f"batch, {name}, {words}": (name.partition(",")[0], settings | {"task.grid": grid})
    for name, settings in NAMED.items()
    for words, grid in (("no grid", None), ("36 x 16 grid", GRID))
}
"""Scenario and settings by their names in the tables."""
FOLLOWED = {
    "batch, experiment, all stay, 36 x 16 contamination": (
        "experiment", STAYING | {"task.grid": None, "task.contamination": GRID}
    )
}  # fmt: skip


def single(scenario: str) -> Callable[[], object]:
    """Return `ParallelEnv.step` with the coverage grid."""
    env = lissajous_env.parallel_env(scenario, **STAYING)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    actions = {agent: rng.uniform(-0.3, 0.3, 2).astype(np.float32) for agent in env.agents}

    def step() -> None:
        env.step(actions)
        if not env.agents:
            env.reset()

    return step


def batch(name: str, settings: dict, worlds: int, threads: int) -> Callable[[], object]:
    """Return `Simulation.step` of some worlds, without an end of the episode."""
    scenario = lissajous_env.scenario(name, **settings, **{"task.duration": 10_000.0})
    simulation = lissajous_env.Simulation(scenario, num_worlds=worlds, threads=threads)
    actions = np.random.default_rng(0).uniform(-0.3, 0.3, simulation.action_shape).astype(np.float32)
    return lambda: simulation.step(actions)


def spread() -> Callable[[], object]:
    """Return a step of mpe2 with as many agents."""
    from mpe2 import simple_spread_v3

    env = simple_spread_v3.parallel_env(N=ROBOTS, max_cycles=10**9)
    env.reset(seed=0)
    actions = {agent: env.action_space(agent).sample() for agent in env.agents}
    return lambda: env.step(actions)


def discovery(worlds: int) -> Callable[[], object]:
    """Return a step of VMAS with as many agents, targets and worlds."""
    # Threads of torch wait for each other actively, which takes ten times as long when another program uses a core.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    import torch
    import vmas

    torch.set_grad_enabled(False)
    env = vmas.make_env("discovery", num_envs=worlds, n_agents=ROBOTS, n_targets=TARGETS, device="cpu", seed=0)
    env.reset()
    actions = [torch.rand(worlds, 2) * 2 - 1 for _ in range(ROBOTS)]
    return lambda: env.step(actions)


def rows_of(times: dict[str, Times], worlds: int, rival: str) -> list[list[str]]:
    """Return a row for each side of this package, with the alternative if it was measured; a call steps some worlds."""
    rows = []
    for name, own in times.items():
        if name == rival:
            continue
        middle = statistics.median(own) / worlds
        beside = ["", "", ""]
        if rival in times:
            beside = [rival, number(statistics.median(times[rival]) / worlds), ratio_in_words(own, times[rival])]
        rows.append([name, f"{worlds:,}", number(middle), number(min(own) / worlds), number(1 / middle), *beside])
    return rows


def tables(options: Options) -> dict[str, Table]:
    """Measure, and return the table `speed`."""
    often = 10 if options.quick else 500
    sides = {f"{name}, `ParallelEnv.step`": (single(name), often) for name in ("experiment", "intruders")}
    if options.rivals:
        sides[SPREAD] = (spread(), max(often * 2 // 5, 1))
    rows = rows_of(by_turns(sides, options.rounds), 1, SPREAD)

    sides = {
        name: (batch(*what, options.worlds, options.threads), 2 if options.quick else 20)
        for name, what in {**BATCHES, **FOLLOWED}.items()
    }
    if options.rivals:
        sides[DISCOVERY] = (discovery(options.worlds), 1)
    rows += rows_of(by_turns(sides, options.rounds), options.worlds, DISCOVERY)
    columns = ["", "worlds", "step of a world [us]", "best [us]", "million steps of a world per second", "rival",
               "its step of a world [us]", "ratio"]  # fmt: skip
    return {"speed": {"columns": columns, "rows": rows}}


PART = Part(
    "step",
    f"a step of {ROBOTS} cars and {TARGETS} moving targets, one world beside mpe2, a batch beside VMAS",
    tables,
    rivals={"mpe2": "bench", "vmas": "bench", "torch": "bench"},
)
