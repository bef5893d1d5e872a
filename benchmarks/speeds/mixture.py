"""Speed of worlds of many scenarios, compared with as many worlds of one, and the time that a new scenario takes.

Both sides of the first table are `VecEnv`s with about as many rows; the ratio is that of the times for a robot's step.
Those of the second are trainings with the same network, worlds and settings of PPO, each in a process of its own; the
ratio is that of their robot steps per second, without evaluations.
"""

import time
from functools import partial

import numpy as np
from figures import Table
from timing import by_turns, ratio_in_words

from baselines.benchmark.shown import number
from lissajous_env import scenario_space
from lissajous_env.parameters.draws import Draws
from speeds import Options, Part
from speeds.training import QUICK, rate_of

SPACE = "monitoring-v1"
TRAININGS = {"the network alone": "none", "on `sweep`": "sweep"}
"""Base of each training."""
_SETTINGS = ["--teacher", "none", "--worlds", "512", "--evaluation-scenarios", "1"]
_TURNS = 5
"""Largest number of turns of the trainings."""
_LENGTH = ["--steps", "1500000", "--evaluate-every", "300000"]


def tables(options: Options) -> dict[str, Table]:
    """Measure, and return the tables `mixture-speed` and `mixture-draw`."""
    from training.sb3 import MixedVecEnv, RobotVecEnv

    size = max(options.worlds // 32, 1)
    rows = []
    for groups in (1, 8) if options.quick else (8, 32):
        mixed = MixedVecEnv(SPACE, groups, max(8 * size // groups, 1), threads=options.threads)
        one = RobotVecEnv(mixed.scenarios[0], 8 * size, threads=options.threads)
        sides = {"mixture": mixed, "one scenario": one}
        rng = np.random.default_rng(0)
        given = {name: rng.uniform(-1, 1, (env.num_envs, 2)).astype(np.float32) for name, env in sides.items()}
        for env in sides.values():
            env.reset()
        calls = 3 if options.quick else 30
        steps = {name: (partial(env.step, given[name]), calls) for name, env in sides.items()}
        times = by_turns(steps, options.rounds)
        each = {name: [1e3 * took / sides[name].num_envs for took in of] for name, of in times.items()}
        middle = {name: np.median(of) for name, of in each.items()}
        speed = ratio_in_words(each["mixture"], each["one scenario"])
        rows.append([f"{groups} groups", *(number(middle[name]) for name in sides), speed])
    columns = ["worlds", "mixture [ns a robot's step]", "one scenario", "speed of the mixture, of that"]
    return {
        "mixture-speed": {"columns": columns, "rows": rows},
        "mixture-training": training(options),
        "mixture-draw": drawing(options),
    }


def training(options: Options) -> Table:
    """Return the robot steps per second of trainings on the space, and on the first scenario of its split `train`."""
    sides = {"mixture": SPACE, "one scenario": Draws(SPACE).next(0)[0].name}
    rows = []
    for name, base in TRAININGS.items():
        rates: dict[str, list[float]] = {side: [] for side in sides}
        for turn in range(min(options.rounds, _TURNS)):
            for side, scenario in sides.items():
                given = ["--scenario", scenario, "--base", base, "--seed", str(turn), *_SETTINGS]
                rates[side].append(rate_of([*given, *(QUICK if options.quick else _LENGTH)]))
        middle = [f"{np.median(of):,.0f}" for of in rates.values()]
        rows.append([name, *middle, ratio_in_words(rates["one scenario"], rates["mixture"])])
    columns = ["training", "mixture [robot steps a second]", "one scenario", "speed of the mixture, of that"]
    return {"columns": columns, "rows": rows}


def drawing(options: Options) -> Table:
    """Return the time of a new scenario: drawn only, with its worlds, and with a given number of robots."""
    from lissajous_env import Simulation

    space, took = scenario_space(SPACE), {"drawn": [], "drawn and simulated": [], "with as many robots": []}
    draws = Draws(space)
    Simulation(draws.next(0)[0], 16)
    for seed in range(3 if options.quick else 40):
        began = time.perf_counter()
        made = space.sample(seed)
        took["drawn"].append(time.perf_counter() - began)
        Simulation(made, 16)
        took["drawn and simulated"].append(time.perf_counter() - began)
        began = time.perf_counter()
        Simulation(draws.next(0)[0], 16)
        took["with as many robots"].append(time.perf_counter() - began)
    rows = [
        [name, number(1e3 * float(np.median(of))), number(1e3 * float(np.quantile(of, 0.95)))]
        for name, of in took.items()
    ]
    return {"columns": ["a new scenario", "median [ms]", "95th percentile"], "rows": rows}


PART = Part(
    "mixture",
    "worlds of many scenarios beside as many of one",
    tables,
    needs={"stable_baselines3": "train", "torch": "train"},
)
