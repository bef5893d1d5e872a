"""The missed rogue: the path on which a target that knows the robots' future stays undetected for longest.

A rogue changes nothing that robots observe before they detect it. So the best answer to an episode can be computed
after it, from the recorded ways of the sensors:

1. The episode is played once, and the labels of the contamination stage are stored.
2. The labels are traced backwards from the worst case: a rough way from node to node (`tracing`). Near it, a way that
   no disc detects, within steps as well, is searched on a lattice that is finer than the cells (`tube`). Where there
   is none, the place at which the rogue is lost is blocked, and the next rough way is traced.
3. Where no way is undetected for as long as the stage reports, the stage computes the labels again with larger discs,
   which close narrow gaps, and their ways are traced (`larger`). What it reports then bounds the worst case from below.
4. The way is replayed in the same world as an ordinary target. The time at which the simulation detects it is the
   result: a lower bound of the worst case, whatever the search assumed.

The replay can compute the bound of `task.conservative`, too, which no rogue exceeds. The worst case lies between the
two.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from lissajous_env.episodes.evaluation import ActingPolicy, name_of
from lissajous_env.episodes.guarantee import check_follows
from lissajous_env.episodes.witness.nearest import longest_ways
from lissajous_env.episodes.witness.played import Played, Watcher, Way, play
from lissajous_env.episodes.witness.replayed import Replayed, replay
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import WORST_CASE
from lissajous_env.world.simulation import fold_seed

__all__ = ["Played", "Replayed", "Watcher", "Way", "Witness", "witness_of", "witnesses_in", "witnesses_of"]


@dataclass(frozen=True, eq=False)
class Witness:
    """A rogue that a policy misses in an episode."""

    policy: str
    """Name of the policy."""
    played: Played
    """The episode."""
    way: Way
    """Steps and positions of the rogue."""
    replayed: Replayed
    """The rogue as an ordinary target of the simulation."""
    resolution: float
    """Time by which the contamination stage may be longer than the worst case [s]: a rogue crosses a cell in it, or it
    is a control step if that is longer. Where the search finds no such rogue, it is what the stage loses with larger
    discs, below which the worst case is not: `lissajous_env.episodes.witness.larger` contains the proof."""

    @property
    def undetected(self) -> float:
        """Time from its appearance to its detection, or to the end of the episode, in the simulation [s]."""
        return self.replayed.undetected

    @property
    def stated(self) -> float:
        """Worst-case undetected time of the contamination stage, which rounds to its cells [s]."""
        return float(self.played.score[WORST_CASE.name])

    @property
    def proved(self) -> float:
        """Worst-case undetected time of `task.conservative`, which no rogue exceeds [s]."""
        return self.replayed.proved

    @property
    def appears(self) -> float:
        """Time at which the rogue appears [s]."""
        return self.way.appears_at * self.played.scenario.task.step


def witness_of(
    policy: ActingPolicy,
    scenario: str | Scenario,
    seed: int = 0,
    device: Any = "cpu",
    prove: bool = True,
) -> Witness | None:
    """Return the rogue that a policy misses for longest in an episode; None if no rogue is undetected at any moment.

    Args:
        policy: The policy, for one world.
        scenario: The scenario, with `task.contamination`.
        seed: Seed of the episode.
        device: Warp device of the simulation.
        prove: True to compute the bound of `task.conservative`, too.

    Raises:
        ValueError: `task.contamination` of the scenario is None.
    """
    return witnesses_of(policy, scenario, [seed] * policy.num_worlds, device, prove)[0]


def witnesses_of(
    policy: ActingPolicy,
    scenario: str | Scenario,
    seeds: Sequence[int],
    device: Any = "cpu",
    prove: bool = True,
) -> list[Witness | None]:
    """Return the rogue of `witness_of` for each seed; the policy has as many worlds as there are seeds."""
    scenario = named.build(scenario)
    check_follows(scenario)
    scenario = dataclasses.replace(scenario, task=dataclasses.replace(scenario.task, conservative=False))
    episodes = play(policy, scenario, [fold_seed(seed) for seed in seeds], device)
    return witnesses_in(episodes, name_of(policy), device, prove)


def witnesses_in(
    episodes: Sequence[Played], policy: str, device: Any = "cpu", prove: bool = True
) -> list[Witness | None]:
    """Return the rogue of `witness_of` in each of some episodes of a scenario, which a policy of this name played."""
    longest = longest_ways(episodes)
    ways = [each.way for each in longest]
    there = [k for k, way in enumerate(ways) if way is not None]
    chosen = [episodes[k] for k in there], [way for way in ways if way is not None]
    found = replay(*chosen, device, prove) if there else []
    replayed = dict(zip(there, found, strict=True))
    return [
        None
        if way is None
        else Witness(policy, played, way, replayed[k], longest[k].resolution * played.scenario.task.step)
        for k, (played, way) in enumerate(zip(episodes, ways, strict=True))
    ]
