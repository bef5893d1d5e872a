"""Sentences below tables on whether the theorem of the proved filter applies to the episodes of a policy."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import warp as wp

from baselines.benchmark.table import Rows, grouped
from baselines.benchmark.types import Cell
from baselines.policies import registry
from baselines.policies.base import Filtered
from baselines.policies.safety.proved import Proved, ProvedParameters, unmet_conditions
from lissajous_env.device.devices import compile_quietly
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import counted
from lissajous_env.world.simulation import Simulation

DOES_NOT_APPLY = "does not apply"
"""Words in a sentence on a theorem that does not apply."""
_MOST_SEEDS = 1024
"""Limit on the episodes whose starts are tested, all at once: a world of `hall` takes 0.8 MB and a millisecond."""


def about_theorem(cells: Iterable[Cell], rows: Rows, device: Any = "cpu") -> dict[str, list[str]]:
    """Return by scenario sentences on the theorem of the proved filter, one for all policies to which the same applies.

    Args:
        cells: Policies on scenarios.
        rows: Score rows of their episodes; a policy without any is left out.
        device: Warp device.
    """
    played = grouped(rows)
    policies: dict[str, dict[str, list[str]]] = {}
    for cell in cells:
        begun = [row["seed"] for row in played.get(cell.scenario.name, {}).get(cell.policy, ())]
        if begun and (words := _theorem_of(cell, begun[:_MOST_SEEDS], device)):
            policies.setdefault(cell.scenario.name, {}).setdefault(words, []).append(cell.policy)
    return {
        scenario: [f"The theorem of the proved filter {words} ({', '.join(names)})." for words, names in alike.items()]
        for scenario, alike in policies.items()
    }


def _theorem_of(cell: Cell, seeds: Sequence[int], device: Any) -> str:
    """Return whether the theorem applies to a policy, in words; "" for a policy without the filter."""
    scenario, parameters = cell.scenario, ProvedParameters().of(cell.scenario)
    if registry.split_suffix(cell.policy)[1] != Proved.suffix:
        if registry.is_included(cell.policy) and registry.is_classical(cell.policy):
            return ""
        try:
            policy = cell.factory(scenario, 1, device)
        except Exception:  # a policy of a user that can be made only once, which its replays report
            return ""
        if not isinstance(policy, Filtered) or not isinstance(policy.filter, Proved):
            return ""
        parameters = policy.filter.parameters
    if unmet := unmet_conditions(scenario):
        return f"{DOES_NOT_APPLY}: {'; '.join(unmet)}"
    compatible = compatible_starts(scenario, parameters, seeds, device)
    episodes = counted(len(seeds), "episode")
    if compatible.all():
        return f"applies from the start of {episodes}: no robots collide"
    rule = "in the others robots start too close (condition 6), and may collide until all can come to rest apart"
    return f"applies from the start of {compatible.sum():,} of {episodes} only: {rule}"


def compatible_starts(
    scenario: Scenario, parameters: ProvedParameters, seeds: Sequence[int], device: Any = "cpu"
) -> np.ndarray:
    """Return for each seed whether the tails of all robots are compatible at the start of its episode (condition 6)."""
    proved = Proved(scenario, len(seeds), device, parameters)
    simulation = Simulation(scenario, len(seeds), device=device)
    simulation.reset(seeds=seeds)
    with compile_quietly():
        proved(simulation.observation, wp.zeros_like(proved.action))
    return proved.tails_compatible
