"""The columns of the score that tables, report and figures show: titles, directions, and the lines they are held to."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from baselines.benchmark.comparison import OVER_LIMIT, OVERALL, guarantee_of, limit_of
from baselines.benchmark.rows import NUMBER_COLUMNS
from lissajous_env.parameters.scenario import Faults, Scenario


@dataclass(frozen=True)
class Measure:
    """A column and how it is shown: as a number in every table, in the report also as the strip of its episodes."""

    column: str
    title: str
    better: int
    """Whether more of it is better (1), less (-1) or neither (0)."""
    mean: bool = False
    """Whether the mean is shown: of what is rare the middle half knows nothing, and a bound holds for means alone."""
    about: str = ""
    main: bool = False
    """Whether the README's table and tables for papers have it."""
    page: bool = True
    """Whether the report has it beside the policies of a scenario."""
    strip: bool = True
    """Whether its episodes are drawn there."""

    def described(self, scenario: Scenario) -> dict[str, Any]:
        """Return what the page needs of it, with the lines that are drawn at values that theory names."""
        lines = [(value, words) for value, words in _lines(self.column, scenario) if math.isfinite(value)]
        shown = {name: getattr(self, name) for name in ("column", "title", "better", "mean", "about", "strip")}
        return shown | {"lines": [[float(f"{value:.5g}"), words] for value, words in lines]}


MEASURES = (
    Measure(
        "detection_time_mean", "detection [s]", -1, main=True,
        about="From the appearance of a rogue until it is seen, mean over an episode.",
    ),
    Measure(
        OVER_LIMIT, "over limit", -1, mean=True, main=True, strip=False,
        about="Detection time over the least that any policy can have which does not see rogues from afar.",
    ),
    Measure(
        "guaranteed_detection_time", "guaranteed [s]", -1, main=True,
        about="No rogue of the scenario's top speed stays unseen longer, whatever it does. >: a lower bound, as too "
        "many episodes ended while that time was still growing.",
    ),
    Measure("collisions", "collisions", -1, mean=True, main=True, about="Pairs of robots that touched, in an episode."),
    Measure("sensed_fraction", "sensed", 1, main=True, about="Share of the cells that some robot has ever sensed."),
    Measure("distance_mean", "distance [m]", 0, main=True, page=False, about="Way of a robot, mean over the robots."),
    Measure("idleness_mean", "idleness [s]", -1, about="Time since a cell was last sensed, mean over cells and time."),
    Measure("detected_within_bound", "within T_max", 1, about="Share of the rogues that were seen within T_max."),
    Measure("min_separation", "least distance [m]", 1, about="Between the bodies' middles of any two robots."),
    Measure("recovery_time", "recovery [s]", -1, about="From the end of a fault until the formation is back for good."),
    Measure(
        "coverage_time", "coverage [s]", -1, about="Until every cell has been sensed; (k/n): in k of n episodes it was."
    ),
    Measure("detection_time_p95", "detection p95 [s]", -1, page=False, about="95th percentile of the detection time."),
    Measure("spacing_factor", "spacing factor", -1, page=False, about="Largest distance of neighbours over (8)."),
)  # fmt: skip
"""The most important first: a narrow terminal leaves out the last."""

TITLES = {each.column: each.title for each in MEASURES} | {"detected_fraction": "detected", "return_mean": "return"}
"""Titles of columns; others are called as they are."""

OVERALL_MEASURES = (
    Measure("time_over_bound", "detection / T_max", -1, about="Mean detection time of an episode over T_max."),
    Measure("detected_within_bound", "within T_max", 1, about="Share of the rogues that were seen within T_max."),
    Measure("collisions", "collisions", -1, mean=True, about="Pairs of robots that touched, in an episode."),
    Measure("spacing_factor", "spacing factor", -1, about="Largest distance of neighbours over that of (8)."),
)
"""Those that mean the same on every scenario, so that their episodes can be taken together."""
assert tuple(each.column for each in OVERALL_MEASURES) == OVERALL


def measures_of(scenario: Scenario, policies: Mapping[str, Mapping[str, Any]]) -> list[Measure]:
    """Return the measures of a scenario; the columns that it brings stand after the main ones.

    Without a fault there is nothing to recover from. `policies` has what is known of each policy by column: a scenario
    that was read from a folder no longer has its extensions, but their columns are in the rows.
    """
    shown = [each for each in MEASURES if each.column != "recovery_time" or scenario.faults != Faults()]
    known = dict.fromkeys(column for of in policies.values() for column in of)
    own = [column for column in known if column not in (*NUMBER_COLUMNS, OVER_LIMIT)]
    brought = [Measure(column, title_of(column), 0, about="A score column of the scenario's own.") for column in own]
    return [*(each for each in shown if each.main), *brought, *(each for each in shown if not each.main)]


def title_of(column: str) -> str:
    """Return the title of any column."""
    return TITLES.get(column, column.replace("_", " "))


def _lines(column: str, scenario: Scenario) -> list[tuple[float, str]]:
    limit, (_, formation) = limit_of(scenario), guarantee_of(scenario)
    bound = scenario.detection_time_bound, scenario.detection_time_label
    return {
        "guaranteed_detection_time": [(formation, "in formation")],
        "detection_time_mean": [(limit, "least"), bound],
        "coverage_time": [bound],
        "min_separation": [(2 * scenario.robot.radius, "touch")],
    }.get(column, [])
