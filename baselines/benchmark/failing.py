"""The ways in which an episode fails, and the order of episodes, the worst first."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from baselines.benchmark.table import Row
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import COLLISIONS, DETECTED, DETECTION_TIME, OPEN, SENSED, WORST_CASE, Column

_HALF = 0.5


@dataclass(frozen=True)
class Kind:
    """A way to fail."""

    name: str
    words: str
    """Predicate of which the policy is the subject."""
    about: str
    """Rule in words."""
    applies: Callable[[Row], bool]
    """Function that tests a score row."""


KINDS = (
    Kind(
        "unseen",
        "missed more than half",
        "Less than half of the targets were detected, or less than half of the cells were covered.",
        lambda row: row[DETECTED.name] < _HALF or row[SENSED.name] < _HALF,
    ),
    Kind(
        "open",
        "lost the guarantee",
        "The worst-case undetected time was still growing when the episode ended and was at least half of the episode, "
        "or no robot was left.",
        lambda row: row[OPEN.name] == 1,
    ),
    Kind("collided", "collided", "Two robots collided.", lambda row: row[COLLISIONS.name] > 0),
)
"""The gravest first."""


def failed(row: Row) -> list[bool]:
    """Return for each of `KINDS` whether an episode failed in that way; NaN is no failure."""
    return [kind.applies(row) for kind in KINDS]


def headline(scenario: Scenario) -> Column:
    """Return the main column of a scenario: the worst-case undetected time if computed, else the detection time."""
    return DETECTION_TIME if scenario.task.contamination is None else WORST_CASE


def badness(row: Row, scenario: Scenario) -> tuple[float, ...]:
    """Return a key by which episodes are sorted, larger being worse.

    It is the number of ways in which the episode failed, then the headline of its scenario over T_max, the collisions,
    and the mean detection time over T_max. A missing number counts as 0.
    """
    bound = scenario.detection_time_bound
    times = (row[headline(scenario).name] / bound, row[COLLISIONS.name], row[DETECTION_TIME.name] / bound)
    return sum(failed(row)), *(0.0 if math.isnan(number) else number for number in times)


def worst_first(rows: Sequence[Row], scenarios: Mapping[str, Scenario]) -> list[int]:
    """Return the indices of some rows, the worst episode first; of equal ones the earlier first."""
    return sorted(range(len(rows)), key=lambda k: badness(rows[k], scenarios[rows[k]["scenario"]]), reverse=True)
