"""The standard comparison: what `lissajous benchmark` plays where nothing is named, and what the README's table shows.

The command, its report, the table of the documentation and the figures for papers all read it here.
"""

from collections.abc import Mapping
from typing import Any

from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario

SCENARIOS = (
    "evaders", "evaders-failure", "evaders-lost", "evaders-fast", "team", "intruders", "intruders-inside", "rough",
    "redundant",
)  # fmt: skip
"""Scenarios on which policies differ."""

POLICIES = (
    "kuramoto-mpcc", "kuramoto-mpcc-safe", "open-loop-mpcc", "consensus-mpcc", "partition", "partition-repair",
    "line-abreast", "sweep", "laps",
    "learned-intruders-proved", "portfolio", "portfolio-guarantee", "random", "kuramoto", "consensus", "open-loop",
)  # fmt: skip
"""Each is played where it drives the robots, also where it was not made for; the clairvoyant goes with them."""

GRIDS = {"intruders": (108, 48), "intruders-inside": (108, 48), "rough": (90, 40), "rough-lost": (90, 40)}
"""Columns and rows of `task.contamination` of scenarios that do not follow the guarantee by themselves, as that makes
their steps slower: a benchmark has a number for the guarantee on all of them."""


def overrides_of(scenario: str, overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields that a benchmark changes in a scenario, given by name: those of the settings, and its grid."""
    grid = {"task.contamination": GRIDS[scenario]} if scenario in GRIDS else {}
    return grid | dict(overrides)


def as_played(scenario: str, overrides: Mapping[str, Any]) -> Scenario:
    """Make a scenario as a benchmark plays it."""
    return named.build(scenario, **overrides_of(scenario, overrides))
