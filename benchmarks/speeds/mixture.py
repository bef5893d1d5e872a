"""Speed of worlds of many scenarios, compared with as many worlds of one, and the time that a new scenario takes.

Both sides are `VecEnv`s with about as many rows; the ratio is that of the times for a robot's step.
"""

import time
from functools import partial

import numpy as np
from figures import Table
from timing import by_turns, ratio_in_words

from baselines.benchmark.tables import number
from lissajous_env import scenario_space
from lissajous_env.parameters.draws import Draws
from speeds import Options, Part

SPACE = "monitoring-v1"


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
        steps = {name: (partial(env.step_rows, given[name]), calls) for name, env in sides.items()}
        times = by_turns(steps, options.rounds)
        each = {name: [1e3 * took / sides[name].num_envs for took in of] for name, of in times.items()}
        middle = {name: np.median(of) for name, of in each.items()}
        speed = ratio_in_words(each["mixture"], each["one scenario"])
        rows.append([f"{groups} groups", *(number(middle[name]) for name in sides), speed])
    columns = ["worlds", "mixture [ns a robot's step]", "one scenario", "speed of the mixture, of that"]
    return {"mixture-speed": {"columns": columns, "rows": rows}, "mixture-draw": drawing(options)}


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
