"""Replays for the pages of the scenarios."""

from pathlib import Path
from string import Template

import baselines
import lissajous_env
from docs.generator.files import write_changed
from lissajous_env.episodes.recording import record
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.replay import Replay

_MOST_ROBOTS, _MOST_TARGETS = 150, 300
"""Size limits, as larger pages have many megabytes: no replay for more robots, and at most so many targets."""
_TEMPLATE = Path(__file__).parent / "scenario_replay.md"


_BEST = {"watch": "learned-watch", "intercept": "learned-intercept", "hotspots": "index-learned"}
"""The best policies of tasks with feedback."""


def policy_for(scenario: Scenario) -> str:
    """Return the name of the policy in pictures and replays: the paper's method, or the best one for `_BEST`."""
    return _BEST.get(scenario.name, "kuramoto" if scenario.actuation == "curve" else "kuramoto-mpcc")


def write_replay(scenario: Scenario, folder: Path) -> str:
    """Write the replay of a scenario into a folder; return Markdown that shows it, empty if it is too large."""
    if scenario.num_robots > _MOST_ROBOTS:
        return ""
    shown = lissajous_env.scenario(scenario, **{"targets.count": min(scenario.targets.count, _MOST_TARGETS)})
    recording = record(baselines.make(policy_for(scenario), shown), shown, seed=1)
    write_changed(folder / f"{scenario.name}.html", Replay(recording).html())
    fewer = "" if shown == scenario else f"Of {scenario.targets.count:,} targets {_MOST_TARGETS} are shown. "
    fields = {"name": scenario.name, "policy": policy_for(scenario), "fewer": fewer}
    return Template(_TEMPLATE.read_text(encoding="utf-8")).substitute(fields)
