"""The best known plans of the included scenarios: folders in `known`, whose README describes them.

`benchmarks/known.py` writes them.
"""

import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from baselines.policies.settings import SCENARIO_FILE, PolicySettings
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario

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
