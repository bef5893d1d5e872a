"""Replays on the pages of the scenarios."""

from pathlib import Path
from string import Template

import baselines
import lissajous_env
from docs.generator.files import write_changed
from lissajous_env.episodes.recording import record
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.replay import page

_MOST_ROBOTS, _MOST_TARGETS = 150, 300
"""More would make a page of many megabytes: there is none of so many robots, and fewer targets are shown."""
_TEMPLATE = Path(__file__).parent / "scenario_replay.md"


def policy_for(given: Scenario) -> str:
    """Name of the policy that pictures and replays show: the paper's method."""
    return "kuramoto" if given.robot.kind == "curve" else "kuramoto-mpcc"


def made(given: Scenario, folder: Path) -> str:
    """Write the replay of a scenario into a folder; return what shows it on a page, empty where none can be made."""
    if given.num_robots > _MOST_ROBOTS:
        return ""
    shown = lissajous_env.scenario(given, **{"targets.count": min(given.targets.count, _MOST_TARGETS)})
    recording = record(baselines.make(policy_for(given), shown), shown, seed=1)
    write_changed(folder / f"{given.name}.html", page(recording))
    fewer = "" if shown == given else f"Of {given.targets.count:,} targets {_MOST_TARGETS} are shown. "
    told = {"name": given.name, "policy": policy_for(given), "fewer": fewer}
    return Template(_TEMPLATE.read_text(encoding="utf-8")).substitute(told)
