"""The missed rogue: the path on which a target that knows the robots' future stays undetected for longest.

A rogue changes nothing that robots observe before they detect it. So the best answer to an episode can be computed
after it, from the recorded tracks of the sensors:

1. The episode is played once. The contamination stage reports when the rogues appear that stay undetected for longest.
2. From there, the nodes of a fine lattice that a rogue can reach undetected are followed until there are none, and a
   path to the last of them is traced back (`search`). Where no path lasts as long as the stage reports, rogues that
   appear at other steps are followed, too.
3. The path is replayed in the same world as an ordinary target. The time at which the simulation detects it is the
   result: a lower bound of the worst case, whatever the search assumed.

The replay also computes the bound of `task.conservative`, which no rogue exceeds. The worst case lies between the two.
Rogues that observe the present alone learn from the same knowledge of the future (`foresight`).
"""

from dataclasses import dataclass
from typing import Any

from lissajous_env.episodes.evaluation import ActingPolicy, name_of
from lissajous_env.episodes.missed.played import PlayedEpisode, play, replay
from lissajous_env.episodes.missed.search import Path, longest_path
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import WORST_CASE

__all__ = ["MissedRogue", "Path", "PlayedEpisode", "missed_rogue", "play"]


@dataclass(frozen=True, eq=False)
class MissedRogue:
    """A rogue that a policy misses in an episode."""

    policy: str
    """Name of the policy."""
    played: PlayedEpisode
    """The episode."""
    path: Path
    """Steps and positions of the rogue."""
    undetected: float
    """Time from its appearance to its detection, or to the end of the episode, as an ordinary target of the simulation
    [s]."""
    detected: bool
    """True if the simulation detected it."""
    upper_bound: float
    """Worst-case undetected time of `task.conservative`, which no rogue exceeds [s]."""

    @property
    def on_grid(self) -> float:
        """Worst-case undetected time of the contamination stage, which rounds to its cells [s]."""
        return float(self.played.score[WORST_CASE.name])

    @property
    def appears(self) -> float:
        """Time at which the rogue appears [s]."""
        return self.path.appears_at * self.played.scenario.task.step


def missed_rogue(
    policy: ActingPolicy, scenario: str | Scenario, seed: int = 0, device: Any = "cpu"
) -> MissedRogue | None:
    """Return the rogue that a policy misses for longest in an episode; None if no rogue is undetected at any moment.

    Args:
        policy: The policy.
        scenario: The scenario, with `task.contamination`.
        seed: Seed of the episode.
        device: Warp device of the simulation.

    Raises:
        ValueError: `task.contamination` of the scenario is None, or the seed is invalid.
    """
    played = play(policy, scenario, seed, device)
    path = longest_path(played)
    return None if path is None else MissedRogue(name_of(policy), played, path, *replay(played, path, device))
