"""The time of a call of `baselines.Onboard.act`, for one robot on one core."""

import time

import numpy as np
from figures import Table

import baselines
import lissajous_env
from baselines.benchmark.statistics import number
from baselines.onboard import Limits, inputs_of
from speeds import Options, Part

CASES = (
    ("experiment", "kuramoto-mpcc"),
    ("experiment", "kuramoto-mpcc-safe"),
    ("experiment", "partition-repair"),
    ("intruders", "kuramoto-mpcc"),
    ("team", "kuramoto-mpcc"),
    ("team", "partition-repair"),
)
ROBOT = 1


def times_of_calls(name: str, policy: str, steps: int, rounds: int) -> np.ndarray:
    """Return the time of each call of an episode [us], the least of some rounds with the same inputs."""
    scenario = lissajous_env.scenario(name).resolve()
    simulation, together = lissajous_env.Simulation(scenario), baselines.make(policy, scenario)
    calls = []
    for _ in range(steps):
        calls.append(inputs_of(simulation, ROBOT))
        simulation.step(together.act(simulation.observation))
    onboard = baselines.Onboard(policy, scenario, ROBOT, limits=Limits(*[np.inf] * 4))
    times = np.full(steps, np.inf)
    for _ in range(rounds):
        onboard.reset()
        for k, inputs in enumerate(calls):
            begin = time.perf_counter()
            onboard.act(*inputs)
            times[k] = min(times[k], (time.perf_counter() - begin) * 1e6)
    return times[1:]  # the first call begins an episode


def tables(options: Options) -> dict[str, Table]:
    """Measure, and return the table `onboard`."""
    rows = []
    for scenario, policy in CASES:
        times = times_of_calls(scenario, policy, 20 if options.quick else 600, options.rounds)
        rows.append([f"`{scenario}`, `{policy}`", *(number(float(np.percentile(times, share))) for share in (50, 99))])
    return {
        "onboard": {"columns": ["time of a call on one robot", "median [us]", "99th percentile [us]"], "rows": rows}
    }


PART = Part("onboard", "a call of `Onboard.act` of one robot", tables, rounds=20)
