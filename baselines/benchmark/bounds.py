"""Bounds on the scores of a scenario, and the best known plans.

The best known plans of the included scenarios are folders in `known`, whose README describes them;
`benchmarks/known.py` writes them.
"""

import math
import tomllib
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

from baselines.benchmark.statistics import number
from baselines.policies.settings import SCENARIO_FILE, PolicySettings
from lissajous_env.episodes.guarantee import IdealFormation
from lissajous_env.episodes.lower_bounds import mean_time_lower_bound, worst_case_lower_bound
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import DETECTION_TIME, task_score

BEST_KNOWN = "best known"
"""Name of the best known plans as a family of plans, and of their line in a table."""
FOLDER = Path(__file__).parent / "known"
FOUND = "found.toml"


@dataclass(frozen=True)
class BestKnown:
    """A stored plan."""

    name: str
    """Name of its folder."""
    scenario: Scenario
    settings: PolicySettings
    worst_case: float
    """Worst-case undetected time of its final episodes [s]."""
    settled: float
    """The same of the second halves of these [s]."""
    command: str
    """Command that found it."""


@cache
def all_known() -> tuple[BestKnown, ...]:
    """Return all stored plans, by name."""
    folders = [path.parent for path in sorted(FOLDER.glob(f"*/{FOUND}"))]
    return tuple(
        BestKnown(
            folder.name,
            named.build(str(folder / SCENARIO_FILE)),
            PolicySettings.read(folder),
            **tomllib.loads((folder / FOUND).read_text(encoding="utf-8")),
        )
        for folder in folders
    )


def known_plans(scenario: Scenario) -> list[BestKnown]:
    """Return the stored plans of a scenario; none if anything but its name and description was changed."""
    digest = scenario.digest()
    return [plan for plan in all_known() if plan.scenario.digest() == digest]


class Bounds(NamedTuple):
    """Bounds on the scores of one scenario [s]; NaN for those that do not exist, or are below a control step."""

    mean_time: float
    """Lower bound of the mean detection time of every policy without long-range sensing; NaN where the task has another
    score."""
    worst_case: float
    """Lower bound of the worst-case undetected time; the length of an episode where no policy guarantees anything."""
    in_formation: float
    """Worst-case undetected time of the formation in its equilibrium; inf if a target can stay undetected for ever."""
    best_known: float = math.nan
    """Shortest worst-case undetected time of a stored plan (`BestKnown`) without collisions."""
    best_known_settled: float = math.nan
    """The same of the second halves of the episodes."""


def least_mean_time(scenario: Scenario) -> float:
    """Return `Bounds.mean_time` of a scenario."""
    bound = mean_time_lower_bound(scenario) if task_score(scenario) is DETECTION_TIME else math.nan
    return _beyond_a_step(bound, scenario)


@cache
def bounds_of(scenario: Scenario) -> Bounds:
    """Return the bounds of a scenario; if it computes contamination, the formation is simulated once for them."""
    worst_case = in_formation = math.nan
    if scenario.task.contamination is not None:
        worst_case = _beyond_a_step(worst_case_lower_bound(scenario), scenario)
        with suppress(ValueError):  # targets that are too fast for its grid
            in_formation = IdealFormation(scenario).guaranteed_time(scenario.rogue_speed)
    known = known_plans(scenario)
    best = min((plan.worst_case for plan in known), default=math.nan)
    settled = min((plan.settled for plan in known), default=math.nan)
    return Bounds(least_mean_time(scenario), worst_case, in_formation, best, settled)


def _beyond_a_step(bound: float, scenario: Scenario) -> float:
    return bound if bound >= scenario.task.step else math.nan


def bounds_in_words(bounds: Bounds) -> str:
    """Return the bounds of a scenario in words, each after a comma."""
    words = f", lower bound {number(bounds.mean_time)} s" if math.isfinite(bounds.mean_time) else ""
    words += f", guaranteed at least {number(bounds.worst_case)} s" if math.isfinite(bounds.worst_case) else ""
    if math.isfinite(bounds.best_known):
        words += f", best known {number(bounds.best_known)} s (second halves {number(bounds.best_known_settled)} s)"
    if bounds.in_formation == math.inf:
        words += ", in formation never"
    return words + (f", in formation {number(bounds.in_formation)} s" if math.isfinite(bounds.in_formation) else "")
