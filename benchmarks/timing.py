"""Times that hold on a noisy machine: all sides take turns in one process; a ratio of two is that of their pairs."""

import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

Side = tuple[Callable[[], object], int]
"""A step, and how often it is called in a round."""


def microseconds(step: Callable[[], object], calls: int) -> float:
    """Mean time of a call."""
    begin = time.perf_counter()
    for _ in range(calls):
        step()
    return (time.perf_counter() - begin) / calls * 1e6


def by_turns(sides: Mapping[str, Side], rounds: int) -> dict[str, list[float]]:
    """Mean time of a call of each side in each round [us]; they take turns, so that a slow moment hits them alike."""
    for step, _ in sides.values():
        step()
    times: dict[str, list[float]] = {name: [] for name in sides}
    for _ in range(rounds):
        for name, (step, calls) in sides.items():
            times[name].append(microseconds(step, calls))
    return times


def ratio(own: Sequence[float], others: Sequence[float]) -> tuple[float, float, float]:
    """Median of others / own over the rounds, and its 95 % interval by bootstrap over the rounds."""
    ratios = np.asarray(others, dtype=float) / np.asarray(own, dtype=float)
    drawn = np.random.default_rng(0).choice(ratios, (5000, len(ratios)))
    low, high = np.quantile(np.median(drawn, axis=1), [0.025, 0.975])
    return float(np.median(ratios)), float(low), float(high)
