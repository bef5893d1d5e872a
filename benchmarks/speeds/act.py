"""The time of a learned policy's `act` and of its network, compared with matrix products by NumPy."""

import statistics

import numpy as np
from figures import Table
from timing import by_turns

import lissajous_env
import training
from baselines.benchmark.shown import number
from speeds import Options, Part

POLICY = "learned-intruders"
WORLDS = (1, 32, 1024)


def times_per_row(worlds: int, calls: int, rounds: int) -> list[float]:
    """Return times per robot [us], the median of the rounds: `act`, the network's kernel, and its matrices by NumPy."""
    policy = training.load(POLICY, num_worlds=worlds)
    simulation = lissajous_env.Simulation(policy.scenario, worlds)
    seen, network = simulation.observation.numpy(), policy.network
    rows = np.random.default_rng(0).normal(size=(worlds * simulation.num_robots, network.inputs)).astype(np.float32)
    base = None if policy.base is None else policy.base.action

    def by_matrices() -> None:
        x = rows
        for k, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
            x = x @ weight.T + bias
            x = x if k == len(network.weights) - 1 else np.maximum(x, 0.0)

    sides = {
        "act": (lambda: policy.act(seen), calls),
        "network": (lambda: policy._forward.launch(simulation.observation, base), calls),
        "matrices": (by_matrices, calls),
    }
    return [statistics.median(times) / len(rows) for times in by_turns(sides, rounds).values()]


def tables(options: Options) -> dict[str, Table]:
    """Measure, and return the table `learned-act`."""
    rows = []
    for worlds in WORLDS:
        calls = 1 if options.quick else 100 if worlds < 100 else 5
        times = times_per_row(worlds, calls, options.rounds)
        rows.append([f"`{POLICY}`, {worlds:,} world{'s' * (worlds > 1)}", *map(number, times)])
    columns = ["time of a robot, median", "act [us]", "its network [us]", "its matrices by NumPy [us]"]
    return {"learned-act": {"columns": columns, "rows": rows}}


PART = Part("act", "`act` of a learned policy beside its network alone and its matrices by NumPy", tables, rounds=20)
