"""Cost of the contamination field, compared with the same steps without it."""

import statistics
from collections.abc import Callable

import numpy as np
from figures import Table
from timing import Times, by_turns, ratio_in_words

import baselines
import lissajous_env
from baselines.benchmark.statistics import number
from speeds import Options, Part

GRIDS = {"without": None, "36 x 16 cells": (36, 16), "90 x 40 cells": (90, 40)}
_STEPS = 100
"""Number of steps after which the worlds are reset."""


def in_formation(worlds: int, threads: int, grid: tuple[int, int] | None) -> Callable[[], object]:
    """Return a step of the experiment under the paper's method; the cost depends on where rogues may be."""
    scenario = lissajous_env.scenario("experiment", **{"task.contamination": grid})
    alone, policy = lissajous_env.Simulation(scenario), baselines.make("kuramoto-mpcc", scenario)
    actions = []
    for _ in range(_STEPS):
        actions.append(policy.act(alone.observation).numpy().copy())
        alone.step(actions[-1])
    simulation = lissajous_env.Simulation(scenario, num_worlds=worlds, threads=threads)
    wide = [np.repeat(action, worlds, axis=0) for action in actions]
    count = len(wide)

    def step() -> None:
        nonlocal count
        if count == len(wide):
            simulation.reset(seeds=np.zeros(worlds, dtype=int))
            count = 0
        simulation.step(wide[count])
        count += 1

    return step


def rows_of(times: dict[str, Times], where: str, worlds: int) -> list[list[str]]:
    """Return a row for each grid, compared with the side `without`."""
    rows, without = [], times["without"]
    for name, own in times.items():
        more = (statistics.median(own) - statistics.median(without)) / worlds
        beside = ["", ""] if name == "without" else [number(more), ratio_in_words(without, own)]
        row = [f"{where}, {name}", f"{worlds:,}", number(statistics.median(own) / worlds), number(min(own) / worlds)]
        rows.append([*row, *beside])
    return rows


def tables(options: Options) -> dict[str, Table]:
    """Measure, and return the table `contamination`."""
    rows, often = [], 10 if options.quick else _STEPS
    for where, worlds in (("one world", 1), ("batch", options.worlds)):
        sides = {name: (in_formation(worlds, options.threads, grid), often) for name, grid in GRIDS.items()}
        rows += rows_of(by_turns(sides, options.rounds), where, worlds)
    columns = ["", "worlds", "step of a world [us]", "best [us]", "more than without [us]", "ratio"]
    return {"contamination": {"columns": columns, "rows": rows}}


PART = Part("contamination", "a step of `experiment` that follows where rogues may be, beside one without", tables)
