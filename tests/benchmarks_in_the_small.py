"""Small benchmarks and score rows, for tests."""

import numpy as np
from rich.console import Console

import lissajous_env
from baselines.benchmark.types import Benchmark
from lissajous_env.world.columns import COLUMNS

QUIET = Console(quiet=True)
SHORT = {"task.duration": 2.0}


@lissajous_env.score_column(reduce="max")
def furthest(world):
    """Largest distance of a robot from the middle [m]."""
    return np.abs(world.robots.position[..., 0]).max(axis=1)


def small(out, **changes):
    """Settings of a benchmark that takes a fraction of a second."""
    basis = {"scenarios": ("failure",), "policies": ("kuramoto", "open-loop"), "episodes": 5, "batch": 2, "replays": 0}
    return Benchmark(**basis | {"out": out, "overrides": SHORT} | changes)


def lines(folder):
    """Lines of the journal."""
    return (folder / "episodes.jsonl").read_text().splitlines()


def rows(policy, scenario="intruders", first=0, **columns):
    """Score rows with these columns, one for each seed from `first` on; other columns are 1, and no episode is open."""
    for k, values in enumerate(zip(*columns.values(), strict=True)):
        numbers = dict.fromkeys(COLUMNS, 1.0) | {"unseen_at_end": 0.5, "guarantee_open": 0.0}
        numbers |= dict(zip(columns, values, strict=True))
        yield {"scenario": scenario, "policy": policy, "episode": first + k, "seed": first + k} | numbers
