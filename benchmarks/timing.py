"""Times on a noisy machine: all sides take turns in one process, and a ratio is computed over their pairs."""

import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from baselines.benchmark.statistics import between, number

Side = tuple[Callable[[], object], int]
"""A step, and the number of its calls in a round."""
Times = list[float]
"""Time of a call in each round [us]."""


def microseconds(step: Callable[[], object], calls: int) -> float:
    """Return the mean time of a call [us]."""
    begin = time.perf_counter()
    for _ in range(calls):
        step()
    return (time.perf_counter() - begin) / calls * 1e6


def by_turns(sides: Mapping[str, Side], rounds: int) -> dict[str, Times]:
    """Return the mean time of a call of each side in each round [us]; a slow moment affects all, as they take turns."""
    for step, _ in sides.values():
        step()
    times: dict[str, Times] = {name: [] for name in sides}
    for _ in range(rounds):
        for name, (step, calls) in sides.items():
            times[name].append(microseconds(step, calls))
    return times


def ratio(own: Sequence[float], others: Sequence[float]) -> tuple[float, float, float]:
    """Return the median of others / own over the rounds, and its 95 % interval by bootstrap over the rounds."""
    ratios = np.asarray(others, dtype=float) / np.asarray(own, dtype=float)
    drawn = np.random.default_rng(0).choice(ratios, (5000, len(ratios)))
    low, high = np.quantile(np.median(drawn, axis=1), [0.025, 0.975])
    return float(np.median(ratios)), float(low), float(high)


def ratio_in_words(own: Sequence[float], others: Sequence[float]) -> str:
    """Return the ratio others / own and its interval as the text of a cell."""
    middle, low, high = ratio(own, others)
    ends = between(low, high)
    return f"{number(middle)} ({ends})" if ends else number(middle)
