"""Knowledge of a scenario: its form in a benchmark, bounds, best known plans, and whether a theorem applies.

The best known plans of the included scenarios, with robots that start as in the scenario, are folders in `known`. A
folder is that of a plan, with the scenario as a benchmark plays it, and `found.toml`: the command that found the plan
and its figures, those of its final episodes. The folder `NAME` contains the plan with the shortest known worst-case
undetected time of whole episodes of the scenario NAME without collisions; `NAME-settled` has that of their second
halves, if it is another plan. `benchmarks/known.py` writes them.
"""

import math
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from baselines.policies import registry
from baselines.policies.base import Policy
from baselines.policies.factories import Factory
from baselines.policies.safety.filtered import Filtered
from baselines.policies.safety.proved import Proved, ProvedParameters, unmet_conditions
from baselines.policies.settings import SCENARIO_FILE, PolicySettings
from lissajous_env.device.devices import compile_quietly
from lissajous_env.episodes.guarantee import guaranteed_time
from lissajous_env.episodes.limits import guaranteed_time_limit, mean_time_limit
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.simulation import Simulation

GRIDS = {
    "intruders": (108, 48),
    "intruders-inside": (108, 48),
    "intruders-walls": (108, 48),
    "rough": (90, 40),
    "rough-lost": (90, 40),
}
"""Columns and rows of `task.contamination` of scenarios that do not follow the guarantee by themselves, as that makes
their steps slower: a benchmark has a number for the guarantee on all of them."""
BEST_KNOWN = "best known"
"""Name of the best known plans as a family of plans, and of their line in a table."""
FOLDER = Path(__file__).parent / "known"
FOUND = "found.toml"
SUFFIX = "-proved"
_MOST_SEEDS = 1024
"""Limit on the episodes whose starts are checked."""
_TOGETHER = 64
"""Starts that are checked at the same time."""


def overrides_of(scenario: str, overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields that a benchmark changes in a scenario, given by name: those of the settings, and its grid."""
    grid = {"task.contamination": GRIDS[scenario]} if scenario in GRIDS else {}
    return grid | dict(overrides)


def as_played(scenario: str, overrides: Mapping[str, Any]) -> Scenario:
    """Make a scenario as a benchmark plays it."""
    return named.build(scenario, **overrides_of(scenario, overrides))


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


class Bounds(NamedTuple):
    """Bounds on the scores of one scenario [s]; NaN for those that do not exist, or are below a control step."""

    mean_time: float
    """Lower bound of the mean detection time of every policy without long-range sensing."""
    worst_case: float
    """Lower bound of the worst-case undetected time; the length of an episode where no policy guarantees anything."""
    in_formation: float
    """Worst-case undetected time of the formation in its equilibrium; inf if a target can stay undetected for ever."""
    best_known: float = math.nan
    """Shortest worst-case undetected time of a stored plan (`BestKnown`) without collisions."""
    best_known_settled: float = math.nan
    """The same of the second halves of the episodes."""


@cache
def bounds_of(scenario: Scenario, simulates: bool = True) -> Bounds:
    """Return the bounds of a scenario; if it computes contamination, the formation is simulated once for them.

    With `simulates` false, the bounds on the worst case are NaN.
    """
    worst_case = in_formation = math.nan
    if simulates and scenario.task.contamination is not None:
        worst_case = _beyond_a_step(guaranteed_time_limit(scenario), scenario)
        with suppress(ValueError):  # targets that are too fast for its grid
            in_formation = guaranteed_time(scenario, speed=scenario.rogue_speed)
    known = known_plans(scenario)
    best = min((each.worst_case for each in known), default=math.nan)
    settled = min((each.settled for each in known), default=math.nan)
    return Bounds(_beyond_a_step(mean_time_limit(scenario), scenario), worst_case, in_formation, best, settled)


def _beyond_a_step(bound: float, scenario: Scenario) -> float:
    return bound if bound >= scenario.task.step else math.nan


def about_theorem(
    played: Iterable[tuple[Scenario, str, Factory]], rows: Iterable[Mapping[str, Any]], device: Any = "cpu"
) -> dict[str, list[str]]:
    """Return by scenario sentences on the theorem of the proved filter, one for all policies to which the same applies.

    Args:
        played: Scenario, name and factory of policies.
        rows: Score rows of their episodes; a policy without any is left out.
        device: Warp device.
    """
    seeds: dict[tuple[str, str], dict[int, None]] = {}
    for row in rows:
        seeds.setdefault((row["scenario"], row["policy"]), {})[row["seed"]] = None
    said: dict[tuple[str, str], list[str]] = {}
    for scenario, name, factory in played:
        begun = [*seeds.get((scenario.name, name), ())]
        words = _theorem_of(scenario, name, factory, begun[:_MOST_SEEDS], device) if begun else ""
        if words:
            said.setdefault((scenario.name, words), []).append(name)
    sentences: dict[str, list[str]] = {}
    for (place, words), policies in said.items():
        sentences.setdefault(place, []).append(f"The theorem of the proved filter {words} ({', '.join(policies)}).")
    return sentences


def _theorem_of(scenario: Scenario, name: str, factory: Factory, seeds: Sequence[int], device: Any) -> str:
    """Return whether the theorem applies to a policy, in words; "" for a policy without the filter."""
    parameters, unmet = ProvedParameters().of(scenario), [*unmet_conditions(scenario)]
    if registry.unwrapped(name)[1] != SUFFIX:
        if registry.ships(name) and registry.is_classical(name):
            return ""
        try:
            policy = factory(scenario, 1, device)
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
    apart = compatible_starts(scenario, parameters, seeds, device)
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
