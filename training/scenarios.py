"""Scenarios of a training: one, or those of a space, of which each split has its purpose."""

import contextlib
import itertools
import warnings
from collections.abc import Iterator
from typing import Any

from lissajous_env import Scenario, ScenarioSpace
from lissajous_env.parameters.assumptions import AssumptionWarning
from lissajous_env.parameters.named import scenario_space, space_and_split
from lissajous_env.world.columns import DETECTION_RATE, OBSERVED, task_score

LEARNED, VALIDATED = "train", "validation"
"""Splits of a space from which a training draws its scenarios, and those of its validations. No training uses the split
`test`."""
MOST_VALIDATED = 16
"""Number of scenarios of a validation, the first ones of their split."""


def space_of(name: str) -> ScenarioSpace | None:
    """Return the space of a name or file, or None if that denotes one scenario.

    Raises:
        ValueError: a split of a space is given.
    """
    if space_and_split(name) is None:
        return None
    if ":" in name:
        rule = f"must be the name of a space without a split, because a training uses the split {LEARNED}"
        raise ValueError(f"scenario {rule} and is validated on {VALIDATED}, got {name}")
    return scenario_space(name)


def validated(space: ScenarioSpace) -> list[Scenario]:
    """Return the scenarios of validations."""
    with without_warnings(space):
        return list(itertools.islice(space.scenarios(VALIDATED), MOST_VALIDATED))


@contextlib.contextmanager
def without_warnings(space: ScenarioSpace | None) -> Iterator[None]:
    """Do not warn about assumptions of the paper that a drawn scenario violates; nothing changes without a space."""
    with warnings.catch_warnings():
        if space is not None:
            warnings.simplefilter("ignore", AssumptionWarning)
        yield


def lean_fields(scenario: Scenario) -> dict[str, Any]:
    """Return the fields that leave out what a training does not need.

    These are the grids that neither the reward nor the targets use and, where it counts how long targets are in sight,
    the rewards for their first detection, which are larger.
    """
    fields: dict[str, Any] = {}
    if scenario.task.reward_observation > 0:
        fields |= {"task.reward_detection": 0.0, "task.reward_waiting": 0.0}
    if scenario.task.reward_idleness == 0:
        fields["task.grid"] = None
    if scenario.task.reward_contamination == 0 and not scenario.task.conservative and scenario.targets.rogues is None:
        fields["task.contamination"] = None
    return fields


def rule_of(task: Scenario) -> str:
    """Return the best rule for a scenario in which actions are velocities."""
    return {OBSERVED: "greedy-cover", DETECTION_RATE: "lead-pursuit"}.get(task_score(task), "index-learned")
