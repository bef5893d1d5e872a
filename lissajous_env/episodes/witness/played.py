"""Episodes as data for a rogue that knows the future: the ways of the working sensors, and the actions."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from lissajous_env.episodes.evaluation import ActingPolicy, EpisodeRunner
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.contamination.labels import MARGIN, NONE
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import NEVER, NOWHERE


class Way(NamedTuple):
    """A rogue's way: it appears at the end of a step and is undetected at the end of all steps until the last."""

    appears_at: int
    """Step at whose end it appears."""
    places: np.ndarray
    """(K + 1, 2) its positions at the ends of the steps from then on [m]."""

    @property
    def unseen_until(self) -> int:
        """Last step at whose end it is undetected."""
        return self.appears_at + len(self.places) - 1


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
    labels: np.ndarray
    """(K, R, C) labels of the contamination stage in steps 0, P, 2 P ..., with P steps per tick, as in
    `lissajous_env.world.contamination.field`; NONE where no target can be."""
    stays: np.ndarray
    """(K or K - 1, R, C / 32) a bit for each cell in which a target can stay from a tick to the last step before the
    next one: no disc covers it at the end of a step until then."""

    @property
    def steps(self) -> int:
        """T."""
        return len(self.works) - 1


class Watcher:
    """Recorder of the data that a rogue with knowledge of the future requires, from the episodes of a simulation.

    Args:
        simulation: The simulation, with `task.contamination` and without `task.conservative`.
    """

    def __init__(self, simulation: Simulation):
        self.simulation = simulation
        self._kept: dict[str, list[np.ndarray]] = {}

    def keep(self, taken: int) -> None:
        """Copy a moment of all worlds, at the beginning of the episodes and after each step."""
        simulation, kept = self.simulation, self._kept
        if taken == 0:
            kept.clear()
        robots, action = simulation.robots, simulation.action.numpy()
        now = {
            "track": robots.track.numpy()[..., :2].copy(),
            "works": robots.sensor.numpy()[..., 0] < 0.5 * NOWHERE,
            "action": action.copy() if taken else np.zeros_like(action),
            "introduced_at": simulation.contamination.oldest.numpy().copy(),
        }
        period = simulation.scenario.spreading.period
        if taken % period == 0:
            now["labels"] = _labels(simulation, taken)
        if (taken + 1) % period == 0:
            # A target that appears where one was sensed since the tick has another label.
            before, latest = now.get("labels"), now.get("labels")
            if before is None or latest is None:
                before, latest = kept["labels"][-1], _labels(simulation, taken)
            now["stays"] = _words((latest == before) & (latest < int(NONE)))
        for name, array in now.items():
            kept.setdefault(name, []).append(array)

    def episodes(self, seeds: Sequence[int]) -> list[Played]:
        """Return the ended episodes of the first worlds, with their seeds, and delete them here."""
        worlds = np.arange(len(seeds))
        steps, rows = self.simulation.clock.step.numpy(), self.simulation.score(worlds)
        arrays = {name: np.stack(self._kept.pop(name), axis=1) for name in list(self._kept)}
        return [
            Played(
                self.simulation.scenario, seed, row, **{name: array[w, : taken + 1] for name, array in arrays.items()}
            )
            for w, (seed, row, taken) in enumerate(zip(seeds, rows, steps, strict=False))
        ]


def play(policy: ActingPolicy, scenario: Scenario, seeds: list[int], device: Any = "cpu") -> list[Played]:
    """Play an episode in each world of a policy and copy the ways of the sensors and the labels.

    The labels of an episode of `evaders` require 9 MB, those of `hall` 216 MB.

    Args:
        policy: The policy, with as many worlds as there are seeds.
        scenario: The scenario, with `task.contamination`.
        seeds: Seed of each world.
        device: Warp device of the simulation.
    """
    watcher = Watcher(Simulation(scenario, policy.num_worlds, device=device))
    EpisodeRunner(policy, watcher.simulation).play(seeds, watcher.keep)
    return watcher.episodes(seeds)


def _slot(simulation: Simulation, step: int) -> int:
    """Return the slot of the latest tick's labels at the end of a step."""
    hops = simulation.scenario.spreading
    return step * hops.ticks // hops.period % hops.history_length


def _words(table: np.ndarray) -> np.ndarray:
    """Return bool (W, R, C) as bits (W, R, C / 32)."""
    wide = np.pad(table, ((0, 0), (0, 0), (0, -table.shape[2] % 32)))
    return np.packbits(wide, axis=2, bitorder="little").view(np.uint32)


def _labels(simulation: Simulation, step: int) -> np.ndarray:
    """Return the labels (W, R, C) of the nodes at the end of a step with a tick."""
    hops, margin = simulation.scenario.spreading, int(MARGIN)
    inner, slot = slice(margin, margin + hops.rows), _slot(simulation, step)
    labels = simulation.contamination.labels.numpy()[:, slot, inner, margin : margin + hops.columns]
    words = simulation.contamination.there.numpy()[:, inner, 1:-1, slot].copy()
    there = np.unpackbits(words.view(np.uint8), axis=2, count=hops.columns, bitorder="little")
    return np.where(there, labels, int(NONE)).astype(np.int32)


def peaks(played: Played) -> list[tuple[int, int]]:
    """Return (introduction, latest step at which it can be undetected) of the stage's oldest targets, longest first."""
    oldest = played.introduced_at
    last = {int(since): now for now, since in enumerate(oldest) if since < int(NEVER)}
    return sorted(last.items(), key=lambda each: each[0] - each[1])


def resolution(scenario: Scenario) -> int:
    """Return the time in which a rogue crosses a cell of the contamination grid, at least a step [step]."""
    columns, rows = scenario.task.contamination or (1, 1)
    side = 2 * max(scenario.curve.half_width / columns, scenario.curve.half_height / rows)
    moved = scenario.rogue_speed * scenario.task.step
    return max(min(math.ceil(side / moved), scenario.task.steps), 1) if moved > 0 else 1
