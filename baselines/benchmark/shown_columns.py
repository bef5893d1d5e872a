"""The columns that tables, report and figures show: scores, numbers derived from them, and the values of theory."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from baselines.benchmark.bounds import Bounds
from lissajous_env.parameters.scenario import Faults, Scenario
from lissajous_env.world.columns import (
    COLLISIONS,
    COLUMNS,
    COVERAGE,
    DETECTION_TIME,
    FINITE,
    IDENTITY,
    LARGEST,
    MEAN,
    NAMES,
    RECOVERY,
    SENSED,
    SEPARATION,
    SPACING,
    WITHIN_BOUND,
    WORST_CASE,
    Column,
)

OVER_LOWER_BOUND = Column(
    "over_lower_bound",
    "ratio of the mean detection time to a lower bound for every policy without long-range sensing",
    better=-1,
    summary=MEAN,
    place=2,
    main=True,
)
"""Derived column; the bound is one of an expectation, so that the mean counts."""
TIME_OVER_BOUND = Column(
    "time_over_bound", "mean detection time of an episode over T_max", title="detection / T_max", better=-1
)
"""Derived column."""
DETECTION_OVER_BEST = Column(
    "detection_over_best",
    "mean detection time over that of the fastest policy on the same scenario and seed",
    title="detection / best",
    better=-1,
)
"""Derived column."""
WORST_CASE_OVER_BOUND = Column(
    "worst_case_over_bound",
    "worst-case undetected time over its lower bound in the scenario, infinite if the episode shows no bound",
    title="guarantee / lower bound",
    better=-1,
    summary=LARGEST,
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
COMPARED = (DETECTION_TIME, WORST_CASE, COLLISIONS, SENSED)
"""Columns by which policies are compared seed by seed, and ranked."""
RATIOS = (OVER_LOWER_BOUND, DETECTION_OVER_BEST, WORST_CASE_OVER_BOUND, WORST_CASE_OVER_BEST)
"""Ratios of a time to a bound, and to the best policy of the run."""
OVER_SCENARIOS = RATIOS[1:]
"""Columns whose statistics are over scenarios, each with the mean or the largest over its seeds."""
OVERALL = (OVER_LOWER_BOUND, TIME_OVER_BOUND, WITHIN_BOUND, COLLISIONS, SPACING, *OVER_SCENARIOS)
"""Columns with the same meaning on every scenario, so that episodes of all scenarios can be combined."""
DERIVED = {column.name: column for column in (*RATIOS, TIME_OVER_BOUND)}
"""Columns that `baselines.benchmark.table` adds to score rows, by name."""
SHOWN = tuple(
    sorted(
        (column for column in (*COLUMNS.values(), OVER_LOWER_BOUND) if column.place), key=lambda column: column.place
    )
)
"""Columns of tables of policies, the most important first."""
MAIN = tuple(column for column in SHOWN if column.main)


def column_of(name: str) -> Column:
    """Return the column of a score row with this name, or one that describes a column of a scenario's own."""
    about = "a score column that the scenario adds"
    return COLUMNS.get(name) or DERIVED.get(name) or Column(name, about, rule=FINITE, empty="none")


def numbers_of(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the numbers of a score row, those that its scenario adds among them."""
    return tuple(name for name in row if name not in IDENTITY)


def brought_in(rows: Iterable[Mapping[str, Any]]) -> list[Column]:
    """Return the columns that scenarios add, from score rows or from estimates by column.

    A scenario that was read from a folder no longer has its extensions, but their columns are in its rows.
    """
    known = dict.fromkeys(name for row in rows for name in row)
    return [column_of(name) for name in known if name not in (*NAMES, *DERIVED)]


def shown_columns(scenario: Scenario, policies: Mapping[str, Mapping[str, Any]]) -> list[Column]:
    """Return the columns that tables of a scenario show: the main ones, those that it adds, and the others.

    The recovery time is left out without a fault. `policies` has estimates by policy and column.
    """
    others = [column for column in SHOWN if not column.main and (column is not RECOVERY or scenario.faults != Faults())]
    return [*MAIN, *brought_in(policies.values()), *others]


def values_of_theory(column: Column, scenario: Scenario, bounds: Bounds) -> list[tuple[float, str]]:
    """Return the values that theory names for a column of a scenario, each with its label."""
    bound = scenario.detection_time_bound, scenario.detection_time_label
    lines = {
        WORST_CASE: [(bounds.in_formation, "in formation"), (bounds.best_known, "best known")],
        DETECTION_TIME: [(bounds.mean_time, "least"), bound],
        COVERAGE: [bound],
        SEPARATION: [(2 * scenario.robot.radius, "collision")],
    }.get(column, [])
    return [(value, words) for value, words in lines if math.isfinite(value)]
