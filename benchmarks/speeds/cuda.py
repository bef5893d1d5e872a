"""A step of a batch on a GPU compared with all threads of the CPU, in the same program by turns."""

import statistics
from collections.abc import Callable
from functools import partial

import numpy as np
import warp as wp
from figures import Table
from timing import by_turns, ratio_in_words

import baselines
import lissajous_env
from baselines.benchmark.statistics import number
from speeds import Options, Part
from speeds.step import STAYING

LONG = {"task.duration": 10_000.0}
BATCHES: dict[str, tuple[str, dict, str | None]] = {
    "experiment, all stay": ("experiment", STAYING, None),
    "intruders, all stay": ("intruders", STAYING, None),
    "watch": ("watch", {}, None),
    "evaders, with contamination": ("evaders", {}, None),
    "experiment by `kuramoto-mpcc`": ("experiment", {}, "kuramoto-mpcc"),
    "evaders-walls by `partition`": ("evaders-walls", {}, "partition"),
}
"""Scenario, its settings, and the policy, or None for constant actions, by their names in the table."""
SIZES = 1, 16
"""Batches, as multiples of the option `--worlds`."""
STEPS = {"cpu": 2, "cuda": 20}
"""Steps of a device between two waits for it."""


def batch(name: str, settings: dict, policy: str | None, worlds: int, threads: int, device: str) -> Callable:
    """Return a function of a number of steps, which plays them and waits for the device, without an end of episodes."""
    scenario = lissajous_env.scenario(name, **settings, **LONG)
    simulation = lissajous_env.Simulation(scenario, num_worlds=worlds, threads=threads, device=device)
    constant = np.random.default_rng(0).uniform(-0.3, 0.3, simulation.action_shape).astype(np.float32)
    action = wp.array(constant, device=device)
    acting = baselines.make(policy, scenario, worlds, device) if policy else None

    def play(steps: int) -> None:
        for _ in range(steps):
            simulation.step(acting.act(simulation.observation) if acting else action)
        wp.synchronize_device(device)

    return play


def tables(options: Options) -> dict[str, Table]:
    """Measure, and return the table `cuda`."""
    rows = []
    for name, what in BATCHES.items():
        for worlds in (size * options.worlds for size in SIZES):
            sides = {
                device: (partial(batch(*what, worlds, options.threads, device), steps), 1)
                for device, steps in STEPS.items()
            }
            times = {
                device: [time / STEPS[device] / worlds for time in measured]
                for device, measured in by_turns(sides, options.rounds).items()
            }
            cpu, cuda = (statistics.median(measured) for measured in times.values())
            robots = lissajous_env.scenario(what[0]).num_robots
            cells = [number(cpu), number(cuda), number(robots / cuda), ratio_in_words(times["cuda"], times["cpu"])]
            rows.append([name, f"{worlds:,}", *cells])
            print(*rows[-1], flush=True)
    columns = ["", "worlds", "step of a world on the CPU [us]", "on the GPU [us]",
               "million steps of a robot per second on the GPU", "ratio"]  # fmt: skip
    return {"cuda": {"columns": columns, "rows": rows}}


PART = Part("cuda", "a step of a batch on a GPU beside all CPU threads", tables, rounds=5, gpu=True)
