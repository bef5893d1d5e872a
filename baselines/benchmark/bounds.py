"""Theoretical bounds on the scores of a scenario, and the best known values."""

import math
from contextlib import suppress
from functools import cache
from typing import NamedTuple

from baselines.planning.best_known import known_plans
from lissajous_env.episodes.guarantee import guaranteed_time
from lissajous_env.episodes.limits import guaranteed_time_limit, mean_time_limit
from lissajous_env.parameters.scenario import Scenario


class Bounds(NamedTuple):
    """Bounds on the scores of one scenario [s]; NaN for those that do not exist, or are below a control step."""

    mean_time: float
    """Lower bound of the mean detection time of every policy without long-range sensing."""
    worst_case: float
    """Lower bound of the worst-case undetected time; the length of an episode where no policy guarantees anything."""
    in_formation: float
    """Worst-case undetected time of the formation in its equilibrium; inf if a target can stay undetected for ever."""
    best_known: float = math.nan
    """Shortest worst-case undetected time of a stored plan (`baselines.planning.best_known`) without collisions."""
    best_known_settled: float = math.nan
    """The same of the second halves of the episodes."""


@cache
def bounds_of(scenario: Scenario, simulates: bool = True) -> Bounds:
    """Return the bounds of a scenario; if it computes contamination, the formation is simulated once for them.

    With `simulates` false, the bounds on the worst case are NaN.
    """
    worst_case = in_formation = math.nan
    if simulates and scenario.task.contamination is not None:
        worst_case = _beyond_a_step(guaranteed_time_limit(scenario), scenario)
        with suppress(ValueError):  # targets that are too fast for its grid
            in_formation = guaranteed_time(scenario, speed=scenario.rogue_speed)
    known = known_plans(scenario)
    best = min((each.worst_case for each in known), default=math.nan)
    settled = min((each.settled for each in known), default=math.nan)
    return Bounds(_beyond_a_step(mean_time_limit(scenario), scenario), worst_case, in_formation, best, settled)


def _beyond_a_step(bound: float, scenario: Scenario) -> float:
    return bound if bound >= scenario.task.step else math.nan
