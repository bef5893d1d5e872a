"""Episodes as a rogue that knows the future sees them: the ways of the working sensors, and the actions."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from lissajous_env.episodes.evaluation import ActingPolicy, EpisodeRunner
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import NEVER, NOWHERE


@dataclass(frozen=True, eq=False)
class Played:
    """A played episode. T steps, N robots, S sub-steps, A components of an action."""

    scenario: Scenario
    """The scenario."""
    seed: int
    """Seed of the world."""
    score: dict[str, Any]
    """Score row of the episode."""
    track: np.ndarray
    """(T + 1, N, S + 1, 2) positions of the robots through the step that led to a moment [m]."""
    works: np.ndarray
    """(T + 1, N) bool: robots that sense in that step."""
    action: np.ndarray
    """(T + 1, N, A) float32 actions of that step, zero at the reset."""
    introduced_at: np.ndarray
    """(T + 1,) earliest introduction of any target that can be undetected [step], NEVER if there is none."""

    @property
    def steps(self) -> int:
        """T."""
        return len(self.works) - 1


def play(policy: ActingPolicy, scenario: Scenario, seeds: list[int], device: Any = "cpu") -> list[Played]:
    """Play an episode in each world of a policy and copy the ways of the sensors.

    Args:
        policy: The policy, with as many worlds as there are seeds.
        scenario: The scenario, with `task.contamination`.
        seeds: Seed of each world.
        device: Warp device of the simulation.
    """
    simulation = Simulation(scenario, policy.num_worlds, device=device)
    kept: dict[str, list[np.ndarray]] = {"track": [], "works": [], "action": [], "introduced_at": []}

    def keep(taken: int) -> None:
        robots, action = simulation.robots, simulation.action.numpy()
        kept["track"].append(robots.track.numpy()[..., :2].copy())
        kept["works"].append(robots.sensor.numpy()[..., 0] < 0.5 * NOWHERE)
        kept["action"].append(action.copy() if taken else np.zeros_like(action))
        kept["introduced_at"].append(simulation.contamination.oldest.numpy().copy())

    EpisodeRunner(policy, simulation).play(seeds, keep)
    steps, rows = simulation.clock.step.numpy(), simulation.score()
    arrays = {name: np.stack(each, axis=1) for name, each in kept.items()}
    return [
        Played(simulation.scenario, seed, row, **{name: array[w, : taken + 1] for name, array in arrays.items()})
        for w, (seed, row, taken) in enumerate(zip(seeds, rows, steps, strict=True))
    ]


def peaks(played: Played) -> list[tuple[int, int]]:
    """Return (introduction, latest step at which it can be undetected) of the stage's oldest targets, longest first."""
    oldest = played.introduced_at
    last = {int(since): now for now, since in enumerate(oldest) if since < int(NEVER)}
    return sorted(last.items(), key=lambda each: each[0] - each[1])
