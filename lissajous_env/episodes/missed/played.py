"""Episodes as data for a rogue that knows the future: the tracks of the working sensors, and the actions."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

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

    def oldest_rogues(self) -> list[tuple[int, int]]:
        """Return (introduction, last step at which it is undetected) of the stage's rogues, the longest first."""
        last = {int(since): now for now, since in enumerate(self.introduced_at) if since < int(NEVER)}
        return sorted(last.items(), key=lambda rogue: rogue[0] - rogue[1])


class Watcher:
    """Recorder of the data that a rogue with knowledge of the future requires, from the episodes of a simulation.

    Args:
        simulation: The simulation, with `task.contamination` and without `task.conservative`.
    """

    def __init__(self, simulation: Simulation):
        self.simulation = simulation
        self._moments: list[tuple[np.ndarray, ...]] = []

    def keep(self, taken: int) -> None:
        """Copy a moment of all worlds, at the beginning of the episodes and after each step."""
        if taken == 0:
            self._moments.clear()
        robots, action = self.simulation.robots, self.simulation.action.numpy()
        self._moments.append(
            (
                robots.track.numpy()[..., :2].copy(),
                robots.sensor.numpy()[..., 0] < 0.5 * NOWHERE,
                action.copy() if taken else np.zeros_like(action),
                self.simulation.contamination.oldest.numpy().copy(),
            )
        )

    def episodes(self, seeds: Sequence[int]) -> list[Played]:
        """Return the ended episodes of the first worlds, with their seeds, and delete them here."""
        steps, rows = self.simulation.clock.step.numpy(), self.simulation.score(np.arange(len(seeds)))
        arrays = [np.stack(array, axis=1) for array in zip(*self._moments, strict=True)]
        self._moments.clear()
        return [
            Played(self.simulation.scenario, seed, row, *(array[w, : steps[w] + 1] for array in arrays))
            for w, (seed, row) in enumerate(zip(seeds, rows, strict=True))
        ]


def resolution(scenario: Scenario) -> int:
    """Return the time in which a rogue crosses a cell of the contamination grid, at least a step [step]."""
    columns, rows = scenario.task.contamination or (1, 1)
    side = 2 * max(scenario.curve.half_width / columns, scenario.curve.half_height / rows)
    moved = scenario.rogue_speed * scenario.task.step
    return max(min(math.ceil(side / moved), scenario.task.steps), 1) if moved > 0 else 1
