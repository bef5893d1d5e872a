"""What counts as a failure of an episode, and which of two episodes is the worse."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from baselines.benchmark.comparison import OPEN
from lissajous_env.parameters.scenario import Scenario

HALF = 0.5


@dataclass(frozen=True)
class Kind:
    """A way to fail."""

    name: str
    words: str
    """What the policy did, in a word or two."""
    about: str
    """By which numbers it did."""
    holds: Callable[[Mapping[str, Any]], bool]
    """Whether a score row, with its derived columns, has it."""


KINDS = (
    Kind(
        "unseen",
        "left half unseen",
        "Less than half of the rogues were detected, or less than half of the cells ever sensed.",
        lambda row: row["detected_fraction"] < HALF or row["sensed_fraction"] < HALF,
    ),
    Kind(
        "open",
        "lost the guarantee",
        "The worst-case undetected time was still growing when the episode ended and was at least half of the episode, "
        "or no robot was left.",
        lambda row: row[OPEN] == 1,
    ),
    Kind("collided", "collided", "Two robots touched.", lambda row: row["collisions"] > 0),
)
"""The gravest first."""


def failed(row: Mapping[str, Any]) -> list[bool]:
    """Of each of `KINDS`, whether an episode failed in that way; NaN, as where nothing is followed, is no failure."""
    return [kind.holds(row) for kind in KINDS]


def headline(scenario: Scenario) -> str:
    """Return the column that a scenario is about: the guaranteed time where it is followed, else the detection time."""
    followed = scenario.task.contamination is not None
    return "guaranteed_detection_time" if followed else "detection_time_mean"


def badness(row: Mapping[str, Any], scenario: Scenario) -> tuple[float, ...]:
    """By what episodes are put in order, the worst the largest.

    First how many ways of failing it has; then the headline of its scenario over T_max, collisions, and the mean
    detection time over T_max. A number that is missing counts as none.
    """
    bound = scenario.detection_time_bound
    times = (row[headline(scenario)] / bound, row["collisions"], row["detection_time_mean"] / bound)
    return sum(failed(row)), *(0.0 if math.isnan(each) else each for each in times)


def worst_first(rows: Sequence[Mapping[str, Any]], scenarios: Mapping[str, Scenario]) -> list[int]:
    """Places of some rows, the worst episode first; of equal ones the earlier first."""
    return sorted(range(len(rows)), key=lambda k: badness(rows[k], scenarios[rows[k]["scenario"]]), reverse=True)
