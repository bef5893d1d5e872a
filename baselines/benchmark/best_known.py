"""The best known plans of the included scenarios, with robots that start as in the scenario: folders in `known`.

A folder is that of a plan, with the scenario as a benchmark plays it, and `found.toml`: the command that found the plan
and its figures, those of its final episodes. The folder `NAME` contains the plan with the shortest known worst-case
undetected time of whole episodes of the scenario NAME without collisions; `NAME-settled` has that of their second
halves, if it is another plan. `benchmarks/known.py` writes them.
"""

import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from baselines.policies.settings import SCENARIO_FILE, PolicySettings
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario

NAME = "best known"
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
