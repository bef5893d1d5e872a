"""Sentences on whether the theorem of the proved filter applies to episodes that were played."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from baselines.benchmark.types import Cell
from baselines.policies import registry
from baselines.policies.base import Policy
from baselines.policies.safety.filtered import Filtered
from baselines.policies.safety.proved import Proved, ProvedParameters, unmet_conditions
from lissajous_env.device.devices import compile_quietly
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.simulation import Simulation

SUFFIX = "-proved"
_MOST_SEEDS = 1024
"""Limit on the episodes whose starts are checked."""
_TOGETHER = 64
"""Starts that are checked at the same time."""


def about_theorem(
    cells: Iterable[Cell], rows: Iterable[Mapping[str, Any]], device: Any = "cpu"
) -> dict[str, list[str]]:
    """Return sentences by scenario, one for all policies with the filter on it to which the same applies.

    Args:
        cells: Policies on scenarios.
        rows: Score rows of their episodes; a policy without any is left out.
        device: Warp device.
    """
    seeds: dict[tuple[str, str], dict[int, None]] = {}
    for row in rows:
        seeds.setdefault((row["scenario"], row["policy"]), {})[row["seed"]] = None
    said: dict[tuple[str, str], list[str]] = {}
    for cell in cells:
        played = [*seeds.get((cell.scenario.name, cell.policy), ())]
        words = _of_cell(cell, played[:_MOST_SEEDS], device) if played else ""
        if words:
            said.setdefault((cell.scenario.name, words), []).append(cell.policy)
    sentences: dict[str, list[str]] = {}
    for (scenario, words), policies in said.items():
        sentences.setdefault(scenario, []).append(f"The theorem of the proved filter {words} ({', '.join(policies)}).")
    return sentences


def _of_cell(cell: Cell, seeds: Sequence[int], device: Any) -> str:
    """Return whether the theorem applies to a policy, in words; "" for a policy without the filter."""
    parameters, unmet = ProvedParameters().of(cell.scenario), [*unmet_conditions(cell.scenario)]
    if registry.unwrapped(cell.policy)[1] != SUFFIX:
        if registry.ships(cell.policy) and registry.is_classical(cell.policy):
            return ""
        try:
            policy = cell.factory(cell.scenario, 1, device)
        except Exception:  # a policy of a user that can be made only once, which its replays report
            return ""
        filtered = (part for part in _inside(policy) if isinstance(part, Filtered))
        inside = next((part for part in filtered if isinstance(part.filter, Proved)), None)
        if inside is None:
            return ""
        parameters = inside.filter.parameters
        if inside is not policy:
            unmet.append(f"4: the filter must decide last, got {type(policy).__name__}, which can change its actions")
    if unmet:
        return f"does not apply: {'; '.join(unmet)}"
    apart = compatible_starts(cell.scenario, parameters, seeds, device)
    if apart.all():
        return f"applies from the start of {_counted(len(seeds))}: no robots collide"
    which = f"from the start of {apart.sum():,} of {_counted(len(seeds))}"
    rule = "robots start too close in the others, and may collide until all can come to rest apart"
    return f"applies {which} only; 6: {rule}"


def _counted(episodes: int) -> str:
    return "1 episode" if episodes == 1 else f"{episodes:,} episodes"


def _inside(policy: Any) -> Iterator[Any]:
    """Yield a policy and those that it uses, the outermost first."""
    yield policy
    for value in getattr(policy, "__dict__", {}).values():
        if isinstance(value, Policy):
            yield from _inside(value)


def compatible_starts(
    scenario: Scenario, parameters: ProvedParameters, seeds: Sequence[int], device: Any = "cpu"
) -> np.ndarray:
    """Return for each seed whether the tails of all robots are compatible at the start of its episode (condition 6)."""
    worlds = min(len(seeds), _TOGETHER)
    proved = Proved(scenario, worlds, device, parameters)
    simulation, compatible = Simulation(scenario, worlds, device=device), []
    wanted = wp.zeros_like(proved.action)
    for begin in range(0, len(seeds), worlds):
        batch = [*seeds[begin : begin + worlds]]
        proved.reset()
        simulation.reset(seeds=batch + batch[:1] * (worlds - len(batch)))
        with compile_quietly():
            proved(simulation.observation, wanted)
        compatible.append(proved.holds[: len(batch)])
    return np.concatenate(compatible)
