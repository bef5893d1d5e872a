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


def policy_for(given: Scenario) -> str:
    """Return the name of the policy in pictures and replays: the paper's method, or the best one for `_BEST`."""
    return _BEST.get(given.name, "kuramoto" if given.actuation == "curve" else "kuramoto-mpcc")


def made(given: Scenario, folder: Path) -> str:
    """Write the replay of a scenario into a folder; return Markdown that shows it, empty if it is too large."""
    if given.num_robots > _MOST_ROBOTS:
        return ""
    shown = lissajous_env.scenario(given, **{"targets.count": min(given.targets.count, _MOST_TARGETS)})
    recording = record(baselines.make(policy_for(given), shown), shown, seed=1)
    write_changed(folder / f"{given.name}.html", Replay(recording).html())
    fewer = "" if shown == given else f"Of {given.targets.count:,} targets {_MOST_TARGETS} are shown. "
    told = {"name": given.name, "policy": policy_for(given), "fewer": fewer}
    return Template(_TEMPLATE.read_text(encoding="utf-8")).substitute(told)
