"""The stages of rogues in a step and in a reset; none where `targets.rogues` is None."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.program import Stage
from lissajous_env.device.stage import TARGET
from lissajous_env.device.warp_abi import fields_of
from lissajous_env.parameters.rogues import Rogue, rogue_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import shown
from lissajous_env.world.rogues.acting import choose_action, fill_rows, move_rogues, reward_rogues
from lissajous_env.world.state import Rogues


def rogue_motion(scenario: Scenario, rogues: Any) -> list[Stage]:
    """Return the stages in which scripted rogues decide, and all rogues move."""
    if scenario.targets.rogues is None:
        return []
    rogue = rogue_of(scenario.targets.rogues)
    if rogue is None:
        decides = []
    elif rogue.members:
        decides = _mixed_decisions(rogue.members, scenario, rogues)
    else:
        decides = [_decision(rogue, scenario, rogues)]
    return [*decides, Stage("rogues", move_rogues)]


def _mixed_decisions(members: Sequence[Rogue], scenario: Scenario, rogues: Any) -> list[Stage]:
    """Return the stages of a mixture: each member decides for all rogues, and the action of one of them is chosen."""
    stages, before = [], 0
    for name in dict.fromkeys(each.name for each in members):
        same = [each for each in members if each.name == name]
        after = before + len(same)
        apart = Rogues()
        for field, array in fields_of(rogues).items():
            setattr(apart, field, wp.zeros_like(array) if field == "action" else array)
        decision = _decision(same[0], scenario, apart)
        stages.append(dataclasses.replace(decision, own={"rogues": apart}))
        own = {"low": before / len(members), "high": after / len(members), "decided": apart.action}
        stages.append(Stage(f"choice of {decision.name}", choose_action, own=own))
        before = after
    return stages


def _decision(rogue: Rogue, scenario: Scenario, rogues: Any) -> Stage:
    """Return the stage in which a scripted or learned rogue decides."""
    name = f"rogue {rogue.name}"
    if rogue.bind is not None:
        return Stage(name, rogue.bind(scenario, rogues))
    if isinstance(rogue.decide, wp.Kernel):
        return Stage(name, rogue.decide, TARGET)

    def decide() -> None:
        action = np.asarray(rogue.decide(rogues.observation.numpy().copy()))
        shape = tuple(rogues.action.shape)
        if action.shape != shape or action.dtype.kind not in "fiu" or not np.isfinite(action).all():
            got = f"{action.dtype} of shape {action.shape}" if action.shape != shape else shown(action)
            raise ValueError(f"{name} must return finite numbers of shape {shape}, got {got}")
        rogues.action.assign(action.astype(np.float32))

    decide.__doc__ = rogue.about
    return Stage(name, decide)


def rogue_results(scenario: Scenario) -> list[Stage]:
    """Return the stages in which rogues are rewarded and observe."""
    own = {"bounds_per_step": scenario.task.step / scenario.detection_time_bound}
    is_on = scenario.targets.rogues is not None
    return [
        Stage("rogue reward", reward_rogues, when=is_on),
        Stage("rogue observation", fill_rows, barrier=False, when=is_on, own=own),
    ]
