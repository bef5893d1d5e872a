"""Episodes as data for a rogue that knows the future: the tracks of the working sensors, and the actions."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lissajous_env.episodes.evaluation import ActingPolicy, EpisodeRunner
from lissajous_env.episodes.guarantee import check_follows
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.selection import fold_seed
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

    def oldest_rogues(self) -> list[tuple[int, int]]:
        """Return (introduction, last step at which it is undetected) of the stage's rogues, the longest first."""
        last = {int(since): now for now, since in enumerate(self.introduced_at) if since < int(NEVER)}
        return sorted(last.items(), key=lambda rogue: rogue[0] - rogue[1])


def play(policy: ActingPolicy, scenario: str | Scenario, seeds: Sequence[int], device: Any = "cpu") -> list[Played]:
    """Play an episode in each world of a policy and copy the tracks of the sensors.

    Raises:
        ValueError: `task.contamination` of the scenario is None.
    """
    scenario = named.build(scenario)
    check_follows(scenario)
    scenario = replace(scenario, task=replace(scenario.task, conservative=False))
    simulation, folded = Simulation(scenario, policy.num_worlds, device=device), [fold_seed(seed) for seed in seeds]
    moments: list[tuple[np.ndarray, ...]] = []

    def copy(taken: int) -> None:
        robots, action = simulation.robots, simulation.action.numpy()
        moments.append(
            (
                robots.track.numpy()[..., :2].copy(),
                robots.sensor.numpy()[..., 0] < 0.5 * NOWHERE,
                action.copy() if taken else np.zeros_like(action),
                simulation.contamination.oldest.numpy().copy(),
            )
        )

    EpisodeRunner(policy, simulation).play(folded, copy)
    steps, rows = simulation.clock.step.numpy(), simulation.score()
    arrays = [np.stack(array, axis=1) for array in zip(*moments, strict=True)]
    return [
        Played(scenario, seed, row, *(array[w, : steps[w] + 1] for array in arrays))
        for w, (seed, row) in enumerate(zip(folded, rows, strict=True))
    ]


def resolution(scenario: Scenario) -> int:
    """Return the time in which a rogue crosses a cell of the contamination grid, at least a step [step]."""
    columns, rows = scenario.task.contamination or (1, 1)
    side = 2 * max(scenario.curve.half_width / columns, scenario.curve.half_height / rows)
    moved = scenario.rogue_speed * scenario.task.step
    return max(min(math.ceil(side / moved), scenario.task.steps), 1) if moved > 0 else 1
