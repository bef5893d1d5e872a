"""The value of feedback: by how much a policy that reacts to targets is better than a patrol that observes none."""

import functools
import json
from pathlib import Path
from typing import Any

from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario

_FILE = Path(__file__).with_name("feedback.json")
"""Measured values of scenarios, by name: `python benchmarks/feedback.py --store` writes it."""


@functools.cache
def measured() -> dict[str, dict[str, Any]]:
    """Return for each measured scenario its `value` of feedback, its 95 % interval, and the policy that reaches it.

    `sees_all` is the ratio for a rule that sees all targets, with its interval; it is no bound.
    """
    values: dict[str, dict[str, Any]] = json.loads(_FILE.read_text(encoding="utf-8"))
    return values


def value_of_feedback(scenario: Scenario) -> float | None:
    """Return the score of the best rule that reacts to targets over that of the best patrol, so that above 1 is better.

    It is 1 where targets appear independently of everything and leave when they are first observed: then no
    observation says where an undetected target is. It is None where it has not been measured.
    """
    entry = measured().get(scenario.name)
    if entry is not None and scenario.resolve() == named.build(scenario.name).resolve():
        return float(entry["value"])
    targets = scenario.targets
    leaves_at_sight = targets.leave and not targets.respawn and scenario.sight <= scenario.sensing_radius
    independent = targets.entry != "hotspots" and not scenario.extensions
    return 1.0 if leaves_at_sight and independent else None
