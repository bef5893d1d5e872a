"""The rogue that a policy misses: the way on which a target that knows the robots' future stays undetected for longest.

A rogue changes nothing that robots observe before they detect it. So the best answer to an episode can be computed
after it, from the recorded ways of the sensors, and it is exact up to a fine lattice:

1. The episode is played once. The contamination stage reports when the worst case began and ended.
2. On a lattice that is finer than its cells, the nodes are followed in which a rogue of that time can be undetected. A
   move is allowed if no disc can detect the rogue on it, within steps as well (`Search`). If the rogue of that time is
   detected too early, since the stage rounds to its cells, the search covers all times.
3. The way is traced back through these nodes, and replayed in the same world as an ordinary target. The time at which
   the simulation detects it is the result: a lower bound of the worst case, whatever the search assumed.

The same replay computes the bound of `task.conservative`, which no rogue exceeds. The worst case lies between the two.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from lissajous_env.episodes.evaluation import ActingPolicy, name_of
from lissajous_env.episodes.guarantee import check_follows
from lissajous_env.episodes.witness.played import Played, play
from lissajous_env.episodes.witness.replayed import Replayed, replay
from lissajous_env.episodes.witness.search import Way, longest_way, resolution
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import WORST_CASE
from lissajous_env.world.simulation import fold_seed

__all__ = ["Played", "Replayed", "Way", "Witness", "witness_of", "witnesses_of"]


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

    @property
    def resolution(self) -> float:
        """Time in which a rogue crosses a cell, or a control step if that is longer [s]."""
        return resolution(self.played.scenario) * self.played.scenario.task.step


def witness_of(
    policy: ActingPolicy, scenario: str | Scenario, seed: int = 0, device: Any = "cpu", thorough: bool = False
) -> Witness | None:
    """Return the rogue that a policy misses for longest in an episode; None if no rogue is undetected at any moment.

    Args:
        policy: The policy, for one world.
        scenario: The scenario, with `task.contamination`.
        seed: Seed of the episode.
        device: Warp device of the simulation.
        thorough: True to search all times, also where the rogue of the reported worst case is undetected as stated.

    Raises:
        ValueError: `task.contamination` of the scenario is None.
    """
    return witnesses_of(policy, scenario, [seed] * policy.num_worlds, device, thorough)[0]


def witnesses_of(
    policy: ActingPolicy,
    scenario: str | Scenario,
    seeds: Sequence[int],
    device: Any = "cpu",
    thorough: bool = False,
) -> list[Witness | None]:
    """Return the rogue of `witness_of` for each seed; the policy has as many worlds as there are seeds."""
    scenario = named.scenario(scenario)
    check_follows(scenario)
    episodes = play(policy, scenario, [fold_seed(seed) for seed in seeds], device)
    ways = [longest_way(each, thorough) for each in episodes]
    there = [k for k, way in enumerate(ways) if way is not None]
    found = replay([episodes[k] for k in there], [way for way in ways if way is not None], device) if there else []
    replayed = dict(zip(there, found, strict=True))
    return [
        None if way is None else Witness(name_of(policy), played, way, replayed[k])
        for k, (played, way) in enumerate(zip(episodes, ways, strict=True))
    ]
