"""What a report shows of each policy: columns of the score, what they are called, and the lines they are held to."""

import math
from dataclasses import dataclass
from typing import Any

from baselines.benchmark.comparison import OVER_LIMIT, guarantee_of, limit_of
from lissajous_env.parameters.scenario import Faults, Scenario
from lissajous_env.world.score import brought_columns


@dataclass(frozen=True)
class Measure:
    """A column, shown as a number and as the strip of its episodes."""

    column: str
    title: str
    better: int
    """Whether more of it is better (1), less (-1) or neither (0)."""
    mean: bool = False
    """Whether the mean is shown, and not the interquartile mean."""
    about: str = ""
    strip: bool = True
    """Whether its episodes are drawn."""

    def described(self, scenario: Scenario) -> dict[str, Any]:
        """What the page needs of it, with the lines that are drawn at values that theory names."""
        lines = [(value, words) for value, words in _lines(self.column, scenario) if math.isfinite(value)]
        shown = {name: getattr(self, name) for name in ("column", "title", "better", "mean", "about", "strip")}
        return shown | {"lines": [[float(f"{value:.5g}"), words] for value, words in lines]}


_MEASURES = (
    Measure(
        "guaranteed_detection_time", "guaranteed time [s]", -1,
        about="No rogue of the scenario's top speed stays unseen longer, whatever it does. >: a lower bound, as too "
        "many episodes ended while that time was still growing.",
    ),
    Measure("collisions", "collisions", -1, mean=True, about="Pairs of robots that touched, in an episode."),
    Measure(
        "detection_time_mean", "detection time [s]", -1,
        about="From the appearance of a rogue until it is seen, mean over an episode.",
    ),
    Measure(
        OVER_LIMIT, "over the bound", -1, mean=True, strip=False,
        about="Detection time over the least that any policy can have which does not see rogues from afar.",
    ),
    Measure("detected_within_bound", "within T_max", 1, about="Share of the rogues that were seen within T_max."),
    Measure(
        "coverage_time", "coverage [s]", -1, about="Until every cell has been sensed; (k/n): in k of n episodes it was."
    ),
    Measure("idleness_mean", "idleness [s]", -1, about="Time since a cell was last sensed, mean over cells and time."),
    Measure("recovery_time", "recovery [s]", -1, about="From the end of a fault until the formation is back for good."),
    Measure("min_separation", "least distance [m]", 1, about="Between the bodies' middles of any two robots."),
)  # fmt: skip
"""The most telling first."""

COLUMN_WORDS = {
    "guaranteed_detection_time": "guaranteed [s]",
    "collisions": "collisions",
    "detection_time_mean": "detection [s]",
    OVER_LIMIT: "over the bound",
    "detected_fraction": "detected",
    "detected_within_bound": "within T_max",
    "sensed_fraction": "sensed",
    "coverage_time": "coverage [s]",
    "idleness_mean": "idleness [s]",
    "min_separation": "least distance [m]",
    "return_mean": "return",
}
"""Titles of columns in the list of the episodes, in their order; others are called as they are."""


def measures_of(scenario: Scenario) -> list[Measure]:
    """Measures of a scenario, with the columns that it brings; without a fault there is nothing to recover from."""
    shown = [each for each in _MEASURES if each.column != "recovery_time" or scenario.faults != Faults()]
    return shown + [Measure(column, column.replace("_", " "), 0) for column in brought_columns(scenario)]


def _lines(column: str, scenario: Scenario) -> list[tuple[float, str]]:
    limit, (_, formation) = limit_of(scenario), guarantee_of(scenario)
    bound = scenario.detection_time_bound, scenario.detection_time_label
    return {
        "guaranteed_detection_time": [(formation, "in formation")],
        "detection_time_mean": [(limit, "least"), bound],
        "coverage_time": [bound],
        "min_separation": [(2 * scenario.robot.radius, "touch")],
    }.get(column, [])
