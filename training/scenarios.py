"""Scenarios of a training: one, or those of a space, of which each split has its purpose."""

import contextlib
import itertools
import warnings
from collections.abc import Iterator
from typing import Any

import baselines
from lissajous_env import Scenario, ScenarioSpace, evaluate
from lissajous_env import scenario as make_scenario
from lissajous_env.parameters import named
from lissajous_env.parameters.assumptions import AssumptionWarning
from lissajous_env.parameters.extensions import ScoreColumn
from lissajous_env.parameters.named_spaces import scenario_space, space_and_split

LEARNED, EVALUATED = "train", "validation"
"""Splits of a space from which a training draws its scenarios, and those of its evaluations. No training uses the
split `test`."""

EPISODES, FIRST_SEED = 8, 900_000
"""Episodes of the reference policy in each scenario, and the seed of the first."""
PENALTY = 10.0
"""Penalty of an episode in which as many targets wait as with the reference policy."""
WAITING = 8.0
"""Mean number of targets that wait with the reference policy."""
LEAST = 0.01
"""Smallest mean number of waiting targets by which a penalty is divided."""


def space_of(name: str) -> ScenarioSpace | None:
    """Return the space of a name or file, or None if that denotes one scenario.

    Raises:
        ValueError: a split of a space is given.
    """
    if space_and_split(name) is None:
        return None
    if ":" in name:
        rule = f"must be the name of a space without a split, because a training uses the split {LEARNED}"
        raise ValueError(f"scenario {rule} and is evaluated on {EVALUATED}, got {name}")
    return scenario_space(name)


def evaluated(space: ScenarioSpace, count: int) -> list[Scenario]:
    """Return the first scenarios of the split for evaluations."""
    return list(itertools.islice(space.scenarios(EVALUATED), count))


@contextlib.contextmanager
def without_warnings(space: ScenarioSpace | None) -> Iterator[None]:
    """Do not warn about assumptions of the paper that a drawn scenario violates; nothing changes without a space."""
    with warnings.catch_warnings():
        if space is not None:
            warnings.simplefilter("ignore", AssumptionWarning)
        yield


def uses_of_feedback(made: Scenario) -> tuple[str, ...]:
    """Return the reasons for which a policy that observes can be better on a scenario than a patrol on a timetable.

    A target is detected in the first step in which a sensor reaches it, and targets appear and move independently of
    one another. So an observation does not tell where undetected targets are: it never lists one, and detected ones are
    no sign of others. It can help against robots that fail at random, and with what an extension adds.
    """
    reasons = []
    if made.faults.rate > 0 or made.faults.lost > 0:
        reasons.append("robots fail or are removed at random, which their ring neighbours observe")
    if made.task.reward_formation != 0:
        reasons.append("the formation is rewarded, whose phases neighbours observe")
    if names := [each.name for each in made.extensions if not isinstance(each, ScoreColumn)]:
        reasons.append(f"its extensions ({', '.join(names)}) may add information, or a reward that depends on it")
    return tuple(reasons)


def about_feedback(made: Scenario) -> tuple[str, ...]:
    """Return sentences on the value of feedback in a scenario, to be printed before a training."""
    if reasons := uses_of_feedback(made):
        return (f"feedback can be of use on {made.name}: {'; '.join(reasons)}",)
    useful: dict[str, list[str]] = {}
    for name in named.scenarios():
        for reason in uses_of_feedback(make_scenario(name)):
            useful.setdefault(reason, []).append(name)
    words = "; ".join(f"{', '.join(names)} ({reason})" for reason, names in useful.items())
    return (
        f"on {made.name} feedback has no value: nothing that a robot observes tells where undetected targets are, so "
        "the best policy is a patrol on a timetable. Training can improve a patrol, its base; from scratch (--base "
        "none) a team may learn to stand still.",
        f"Scenarios in which feedback has a value: {words or 'none'}.",
    )


def lean(made: Scenario) -> Scenario:
    """Return a scenario without the coverage grid unless its reward depends on it."""
    return make_scenario(made, **{"task.grid": None}) if made.task.reward_idleness == 0 else made


def leaner(made: Scenario) -> Scenario:
    """Return a scenario without the grids of coverage and contamination unless its reward or its targets need them."""
    made = lean(made)
    if made.task.reward_contamination != 0 or made.task.conservative:
        return made
    try:
        return make_scenario(made, **{"task.contamination": None})
    except ValueError:  # its rogues need it
        return made


def in_units_of(reference: str, made: Scenario, device: Any) -> Scenario:
    """Return a scenario in which waiting targets are penalized relative to a reference policy, other rewards unchanged.

    The reward for the targets becomes `-PENALTY / steps * waiting / mean`, where `waiting` is the number of undetected
    targets and `mean` its mean in episodes of the reference policy. So each scenario of a space counts equally, as in
    the geometric mean by which evaluations are compared; with the scenario's own reward, those in which targets wait
    long would determine what is learned. Targets arrive more often, so that `WAITING` of them wait with the reference
    policy, or at most one in each step: the penalty then has equally little noise in each scenario. A scenario without
    a reward for targets, or without arriving ones, is returned as it is.

    Args:
        reference: Name of the reference policy.
        made: Scenario.
        device: Warp device.
    """
    task, rate = made.task, made.targets.arrival_rate
    if rate == 0 or (task.reward_waiting == 0 and task.reward_detection == 0):
        return made
    played = lean(made)
    rows = evaluate(
        baselines.make(reference, played, EPISODES, device), played, range(FIRST_SEED, FIRST_SEED + EPISODES), device
    )
    waited = sum(row["targets"] * row["detection_time_mean"] for row in rows if row["targets"])
    mean = max(waited / (len(rows) * task.duration), LEAST)
    often = min(WAITING * rate / mean, 1.0 / task.step)
    changes = {"targets.arrival_rate": often, "task.reward_detection": 0.0}
    return make_scenario(made, **changes, **{"task.reward_waiting": -PENALTY * rate / (often * mean * task.duration)})


def cautious(made: Scenario, caution: float) -> Scenario:
    """Return a scenario whose penalty for collisions is multiplied by a factor."""
    return make_scenario(made, **{"task.reward_collision": caution * made.task.reward_collision})
