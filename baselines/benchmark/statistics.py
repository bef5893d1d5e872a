"""The columns of tables of policies, and their estimates: one number for many episodes, with its bootstrap interval.

R. Agarwal, M. Schwarzer, P. S. Castro, A. Courville, M. G. Bellemare, "Deep Reinforcement Learning at the Edge of the
Statistical Precipice" (NeurIPS 2021) gives the reasons for interquartile means: the mean follows outliers, the median
wastes half of the runs.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from lissajous_env.parameters.scenario import Faults, Scenario
from lissajous_env.wording import counted, shown
from lissajous_env.world.columns import (
    COLLISIONS,
    COLUMNS,
    FINITE,
    IDENTITY,
    INTERQUARTILE_MEAN,
    LARGEST,
    MEAN,
    NAMES,
    RECOVERY,
    WITHIN_BOUND,
    Column,
    task_score,
)

RESAMPLES = 2000
"""Bootstrap resamples: the ends of the interval then vary by about 2 % of its width from seed to seed."""
CUT = 0.25
"""Share of the values that an interquartile mean leaves out at either end."""

SHARE_OF_SEEDS = "share of seeds"
"""Summary of a column that is 1 on a seed on which a policy is better than another, 0 if it is worse, 1/2 in a tie."""

DASH, _TO = "\N{EM DASH}", "\N{EN DASH}"

Values = Sequence[float] | np.ndarray


@dataclass(frozen=True)
class Estimate:
    """Estimate of a score from a sample, with its interval; a number that does not exist is NaN."""

    summary: str
    """Kind of `value`: `Column.summary`, or `SHARE_OF_SEEDS`, the probability of improvement over the reference."""
    n: int
    """Size of the sample."""
    known: int
    """Number of episodes or scenarios of the sample that have a number; the others count in `n` alone."""
    value: float = np.nan
    """Number that stands for the sample; it may be infinite."""
    low: float = np.nan
    """Lower end of the 95 % bootstrap interval of `value`; NaN for a largest value, which has none."""
    high: float = np.nan
    """Upper end of the same."""
    min: float = np.nan
    median: float = np.nan
    """Median; of largest values it counts open ones as infinite, which `value`, `min` and `max` do not."""
    max: float = np.nan
    open: int = 0
    """Number of open values, which show no bound."""
    at_least: bool = False
    """True if `value` is a lower bound of the largest value."""
    worst: int | None = None
    """Seed of the worst episode; None where it is unknown, or no value is better than another."""
    sample: Literal["episodes", "scenarios"] = "episodes"
    """Kind of the sample."""


def interquartile_mean(values: Values) -> float:
    """Return the mean of the middle half: int(n / 4) of n sorted values are cut off at each end; NaN for no values."""
    ordered = np.sort(np.asarray(values, dtype=float))
    outside = int(CUT * len(ordered))
    return float(ordered[outside : len(ordered) - outside].mean()) if len(ordered) else np.nan


def bootstrap_interval(values: Values, cut: float = CUT) -> tuple[float, float]:
    """Return the 95 % percentile bootstrap interval of the interquartile mean of some values, which may be infinite.

    NaN below two values. `cut` is the share that is left out at either end: with 0 the interval is that of the mean.
    """
    samples = np.asarray(values, dtype=float)
    n = len(samples)
    if n < 2:
        return np.nan, np.nan
    outside = int(cut * n)
    means = np.empty(RESAMPLES)
    for part in np.array_split(np.arange(RESAMPLES), 1 + n // 64):  # of some MB each
        resamples = np.repeat(np.tile(samples, len(part)), draws(n)[part].ravel()).reshape(len(part), n)
        means[part] = np.sort(resamples)[:, outside : n - outside].mean(axis=1)
    # Between two infinite values there is no point, so an end is then one of the values.
    method = "linear" if np.isfinite(means).all() else "inverted_cdf"
    low, high = np.quantile(means, [0.025, 0.975], method=method)
    return float(low), float(high)


def summarize(values: Values, summary: str = INTERQUARTILE_MEAN) -> Estimate:
    """Return the estimate of a score: the interquartile mean or, with another summary, the mean, without NaN."""
    numbers = np.asarray(values, dtype=float)
    known = numbers[~np.isnan(numbers)]
    if not len(known):
        return Estimate(summary, len(numbers), 0)
    is_middle = summary == INTERQUARTILE_MEAN
    value = interquartile_mean(known) if is_middle else float(known.mean())
    interval = bootstrap_interval(known, CUT if is_middle else 0.0)
    spread = float(known.min()), float(np.median(known)), float(known.max())
    return Estimate(summary, len(numbers), len(known), value, *interval, *spread)


def summarize_largest(
    values: Values,
    without_bound: Sequence[bool] | np.ndarray | bool = False,
    growing: Sequence[bool] | np.ndarray | bool = False,
) -> Estimate:
    """Return the estimate of a worst case, for which the largest one stands.

    Args:
        values: Worst cases, by episode; NaN for none, infinite for one without a bound.
        without_bound: True for an episode that shows no bound of its worst case.
        growing: True for an episode at whose end the worst case was still growing; if all episodes with the largest
            value are of this kind, it is a lower bound as well.
    """
    worst = np.asarray(values, dtype=float)
    known = ~np.isnan(worst)
    is_open, still_growing = (np.broadcast_to(flags, worst.shape)[known] for flags in (without_bound, growing))
    worst = worst[known]
    if not len(worst):
        return Estimate(LARGEST, len(known), 0)
    is_open = is_open | np.isinf(worst)
    finite = worst[np.isfinite(worst)]
    largest = float(finite.max()) if len(finite) else np.inf
    return Estimate(
        LARGEST,
        len(known),
        len(worst),
        largest,
        min=float(worst.min()),
        median=float(np.median(np.where(is_open, np.inf, worst))),
        max=largest,
        open=int(is_open.sum()),
        at_least=bool(is_open.any() or still_growing[worst == largest].all()),
    )


@lru_cache(maxsize=16)
def draws(size: int) -> np.ndarray:
    """Return counts (RESAMPLES, size) of the draws of each of `size` values, with replacement."""
    generator, counts = np.random.default_rng([0, size]), np.empty((RESAMPLES, size), dtype=np.uint16)
    for row in counts:  # one by one: all counts of 64 bits would take four times the memory
        row[:] = generator.multinomial(size, np.full(size, 1 / size))
    return counts


def number(value: float) -> str:
    """Format a number with three digits or all before the point, at most three decimals; an em dash for NaN."""
    if value != value:
        return DASH
    if value == math.inf:
        return "infinite"
    if abs(value) >= 1e7:
        return f"{value:.3g}"
    if float(value).is_integer() or abs(value) >= 100:
        return f"{value:z.0f}"
    return f"{value:#.3g}".removesuffix(".") if abs(value) >= 0.9995 else f"{value:z.3f}"


def in_words(estimate: Estimate) -> tuple[str, str]:
    """Return the number that stands for the episodes as tables show it, and its interval ("" if both ends agree).

    A largest value has no interval: beside it are the median of the sample, unless half of it is open, and the number
    of its episodes or scenarios, or of the open ones. A lower bound is written `> 59.9`, a share of seeds in percent.
    """
    if not estimate.known:
        return DASH, ""
    if estimate.summary == SHARE_OF_SEEDS:
        return f"{100 * estimate.value:.0f} %", between(estimate.low, estimate.high, lambda share: f"{100 * share:.0f}")
    value = number(estimate.value)
    if estimate.summary != LARGEST:
        return value, between(estimate.low, estimate.high)
    value = ("> " if estimate.at_least else "") + value if math.isfinite(estimate.value) else "no bound"
    median = f"median {number(estimate.median)}" if math.isfinite(estimate.median) else ""
    if not estimate.open:
        return value, f"{median}, {counted(estimate.known, estimate.sample.removesuffix('s'))}"
    return value, ", ".join(filter(None, (median, f"{estimate.open} of {estimate.known} open")))


def between(low: float, high: float, form: Callable[[float], str] = number) -> str:
    """Return both ends of an interval as tables show them; "" for NaN, or if both read the same.

    Without an upper end it is `at least` the lower one; without either it is "".
    """
    if low != low or low == math.inf:
        return ""
    if high == math.inf:
        return f"at least {form(low)}"
    ends = form(low), form(high)
    return "" if ends[0] == ends[1] else (" to " if low < 0 else _TO).join(ends)


def best_of(policies: Mapping[str, Mapping[str, Estimate]], column: Column) -> set[str]:
    """Return the names of the policies whose number of a column reads as the best one; none if all read the same.

    Only policies compete whose share of episodes with a number is the largest, and whose estimate is no lower bound; by
    the share of seeds on which they are better than the reference, only those that are better on more than half.
    """
    estimates = {name: of_policy[column.name] for name, of_policy in policies.items() if column.name in of_policy}
    words = {name: in_words(estimate)[0] for name, estimate in estimates.items()}
    most = max((estimate.known / estimate.n for estimate in estimates.values()), default=0)
    if not most or not column.better or len({*words.values()}) == 1:
        return set()
    fit = {
        name: column.better * estimate.value
        for name, estimate in estimates.items()
        if estimate.known / estimate.n == most
        and not estimate.at_least
        and (estimate.summary != SHARE_OF_SEEDS or estimate.value > 0.5)
    }
    return {name for name in fit if words[name] == words[max(fit, key=lambda other: fit[other])]}


OVER_LOWER_BOUND = Column(
    "over_lower_bound",
    "ratio of the mean detection time to a lower bound for every policy without long-range sensing",
    better=-1,
    summary=MEAN,
    order=2,
    main=True,
)
"""Derived column; the bound is one of an expectation, so that the mean counts."""
SCORE_OVER_BEST = Column(
    "score_over_best",
    "score of the task over that of the best policy on the same scenario and seed, unless that is 0; where larger "
    "scores are better, its inverse, so that no policy is below 1",
    title="score / best",
    better=-1,
)
"""Derived column."""
WORST_CASE_OVER_BEST = Column(
    "worst_case_over_best",
    "worst-case undetected time over the shortest of a policy on the same scenario and seed",
    title="guarantee / best",
    better=-1,
    summary=LARGEST,
)
"""Derived column."""
IMPROVEMENT = Column(
    "score_improvement",
    "share of the seeds on which the policy has a better score of the task than the reference; ties count half",
    title="better",
    better=1,
    summary=SHARE_OF_SEEDS,
    order=6,
    main=True,
)
"""Derived column: the probability of improvement."""
OVERALL = (SCORE_OVER_BEST, WORST_CASE_OVER_BEST, OVER_LOWER_BOUND, COLLISIONS, IMPROVEMENT)
"""Columns with the same meaning on every scenario, so that scenarios can be combined."""
DERIVED = {column.name: column for column in OVERALL if column is not COLLISIONS}
"""Columns that `baselines.benchmark.table` adds to score rows, by name."""
_ORDERED = [column for column in (*COLUMNS.values(), *DERIVED.values()) if column.order]
SHOWN = tuple(sorted(_ORDERED, key=lambda column: column.order))
"""Columns of tables of policies, the most important first."""
MAIN = tuple(column for column in SHOWN if column.main)
_KNOWN = IDENTITY | COLUMNS | DERIVED


def column_of(name: str) -> Column:
    """Return the column of a score row with this name, or one that describes a column of a scenario's own."""
    about = "a score column that the scenario adds"
    return _KNOWN.get(name) or Column(name, about, rule=FINITE, empty="none")


def refusal_of(row: Mapping[str, Any], added: Sequence[str] = ()) -> str | None:
    """Return the rule that a score row of plain values, as in JSON, violates; None for a valid row.

    Args:
        row: The row.
        added: Names of the columns that the scenario adds, in their order.
    """
    if tuple(row) != (*NAMES, *added):
        return "must have the columns of a score row"
    for name, value in row.items():
        if wrong := column_of(name).refusal(value):
            return f"{name} {wrong}, got {shown(value)}"
    return None


def score_names(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the numbers of a score row, those that its scenario adds among them."""
    return tuple(name for name in row if name not in IDENTITY)


def added_columns(rows: Iterable[Mapping[str, Any]]) -> list[Column]:
    """Return the columns that scenarios add, from score rows or from estimates by column.

    A scenario that was read from a folder no longer has its extensions, but their columns are in its rows.
    """
    known = dict.fromkeys(name for row in rows for name in row)
    return [column_of(name) for name in known if name not in (*NAMES, *DERIVED)]


def columns_of(
    scenario: Scenario, policies: Mapping[str, Mapping[str, Estimate]], only_main: bool = False
) -> list[Column]:
    """Return the columns with numbers of a scenario's table: its score, the main ones, those it adds, all others.

    The recovery time is left out without a fault, the share within T_max where actions are velocities, and all others
    if `only_main`. `policies` has estimates by policy.
    """
    first = task_score(scenario), *MAIN, *added_columns(policies.values())
    left_out = {RECOVERY: scenario.faults == Faults(), WITHIN_BOUND: not scenario.has_formation}
    others = () if only_main else (column for column in SHOWN if not left_out.get(column))
    return with_numbers(policies, dict.fromkeys((*first, *others)))


def with_numbers(policies: Mapping[Any, Mapping[str, Estimate]], columns: Iterable[Column]) -> list[Column]:
    """Return the columns of which some policy has a number."""
    known = {name for estimates in policies.values() for name, estimate in estimates.items() if estimate.known}
    return [column for column in columns if column.name in known]
