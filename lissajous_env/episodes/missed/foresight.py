"""Actions of a rogue with foresight from all positions, as labels for a rogue that observes the present alone.

`search` computes one path, exactly. For a training, the time for which a target at any position can still stay
undetected follows from the recorded positions of the sensors, by dynamic programming:

    V(t, x) = 0 where a disc senses x at t, else max over |y - x| <= speed * step of U(t + 1, y)
    U(t, y) = 0 where a disc senses y at t, else step + V(t, y)

on a grid, backward in time. The action with foresight leads to the y of the maximum. It is computed for the positions
that the learner visited: S. Ross, G. Gordon and D. Bagnell, "A Reduction of Imitation Learning and Structured
Prediction to No-Regret Online Learning" (AISTATS 2011). Discs are enlarged by `MARGIN`, and V is blurred by `BLUR`
cells in each step, so that labels lead away from positions at which a small error is the end.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from lissajous_env.device.discs import in_discs
from lissajous_env.episodes.missed.played import sensing_robots
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import NOWHERE

MARGIN = 1 / 30
"""Distance by which discs are enlarged [sensing radius]."""
BLUR = 0.5
"""Standard deviation of the blur in each step [cells]."""
REACH = 2.0
"""Distance that a rogue moves in a stage of the recursion [cells]."""
MOST_CELLS = 320
"""Largest number of cells along the longer side; where cells would be smaller, a stage has several control steps."""
HORIZON = 6.0
"""Time for which a rogue that is undetected at the end of an episode is assumed to stay undetected [s]."""
_DIRECTIONS, _ROUNDING = 16, 1e-9


class Moment(NamedTuple):
    """The sensors and the live rogues of W worlds at a moment of an episode. N robots, V rogues."""

    sensors: np.ndarray
    """(N, W, 2) positions of the robots that sense [m], NOWHERE for others."""
    rows: np.ndarray
    """(V, D) rows of the rogues."""
    worlds: np.ndarray
    """(V,) their worlds."""
    places: np.ndarray
    """(V, 2) their positions [m]."""

    @classmethod
    def of(cls, simulation: Simulation) -> "Moment":
        """Return the present moment of a simulation."""
        senses, position = sensing_robots(simulation)[..., None], simulation.robots.position.numpy()[..., :2]
        worlds, slots = np.nonzero(simulation.rogues.present.numpy())
        rows = simulation.rogues.observation.numpy()[worlds, slots]
        places = simulation.targets.position.numpy()[worlds, slots]
        return cls(np.where(senses, position, NOWHERE).swapaxes(0, 1), rows, worlds, places)


class Labels(NamedTuple):
    """Rows (V, D), actions with foresight (V, 2), and the time that the best action gains over the mean one (V,)."""

    rows: np.ndarray
    actions: np.ndarray
    gains: np.ndarray


class Foresight:
    """The recursion for the rogues of a scenario.

    Args:
        scenario: The scenario.
        margin: Distance by which discs are enlarged [sensing radius].
        blur: Standard deviation of the blur in each step [cells].
    """

    def __init__(self, scenario: Scenario, margin: float = MARGIN, blur: float = BLUR):
        curve, self._step = scenario.curve, scenario.task.step
        self._half = np.array([curve.half_width, curve.half_height])
        self._radius, self._blur = (1 + margin) * scenario.sensing_radius, blur
        self._speed = scenario.rogue_speed
        longest = 2 * self._half.max()
        cell = max(self._speed * self._step / REACH, longest / MOST_CELLS)
        self.stage = max(round(REACH * cell / (self._speed * self._step)), 1)
        """Control steps of a stage."""
        counts = np.ceil(2 * self._half / cell - 1e-6).astype(int)
        self._cell = 2 * self._half / counts
        self._centres = [(np.arange(n) + 0.5) * d - h for n, d, h in zip(counts, self._cell, self._half, strict=True)]
        reach = self.stage * self._speed * self._step
        offsets = [np.arange(-int(reach / d + 1e-6), int(reach / d + 1e-6) + 1) * d for d in self._cell]
        self._near = np.hypot(offsets[1][:, None], offsets[0][None]) <= reach * (1 + 1e-6)
        turn = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
        ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
        self._choices = np.concatenate([np.zeros((1, 2)), ring, ring / 2]).astype(np.float32)

    def sensed(self, sensors: np.ndarray) -> np.ndarray:
        """Return (W, rows, columns) True for the cells that a disc senses at a moment."""
        x, y = self._centres
        return in_discs(x, y, sensors, self._radius)

    def label(self, moments: Sequence[Moment]) -> Labels:
        """Return the labels of the rogues in all whole stages of episodes of one length, the stages in order of time.

        Those of the last moment have no labels.

        Raises:
            ValueError: the episodes are shorter than a stage.
        """
        last = len(moments) - 1
        if last < self.stage:
            least, got = self.stage * self._step, last * self._step
            raise ValueError(f"task.duration must be at least {least:g} s for rogues to learn, got {got:g} s")
        labels = []
        for end, value in self.values(moments, HORIZON):
            # Rogues of the moments of a stage head for the best place at its end.
            for now in range(end - self.stage, end) if end >= self.stage else ():
                _, rows, worlds, places = moments[now]
                labels.append((rows, *self.best_actions(places, worlds, end - now, value)))
        rows, actions, gains = zip(*reversed(labels), strict=True)
        return Labels(np.concatenate(rows), np.concatenate(actions), np.concatenate(gains))

    def values(self, moments: Sequence[Moment], horizon: float = 0.0) -> Iterator[tuple[int, np.ndarray]]:
        """Yield the moment at the end of each stage, and V then (W, rows, columns) [s], the last one first.

        Args:
            moments: Moments of episodes of one length.
            horizon: Time for which a rogue that is undetected at the end is assumed to stay undetected [s].
        """
        last = len(moments) - 1
        value = np.where(self.sensed(moments[last].sensors), 0.0, horizon).astype(np.float32)
        for now in range(last, -1, -self.stage):
            yield now, value
            if now >= self.stage:
                value = self._before(value, moments[now - self.stage : now + 1])

    def _before(self, after: np.ndarray, moments: Sequence[Moment]) -> np.ndarray:
        """Return the values at the beginning of a stage from those at its end."""
        begin, *later = (self.sensed(moment.sensors) for moment in moments)
        blocked = np.any(later, axis=0)
        value = ndimage.gaussian_filter(after, (0, self._blur, self._blur), mode="nearest", truncate=3.0)
        value = np.where(blocked, 0.0, value + self.stage * self._step).astype(np.float32)
        value = ndimage.maximum_filter(value, footprint=self._near[None], mode="constant")
        value[begin] = 0.0
        return value

    def best_actions(
        self, places: np.ndarray, worlds: np.ndarray, steps: int, value: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the actions with foresight (V, 2), and the times that they gain over the mean action (V,) [s].

        Args:
            places: Positions of rogues (V, 2) [m].
            worlds: Their worlds (V,).
            steps: Control steps until the end of the stage.
            value: V at the end of the stage.
        """
        reach = self._speed * self._step * steps
        aims = np.clip(places[:, None] + reach * self._choices, -self._half, self._half)
        column, row = np.moveaxis((aims + self._half) / self._cell - 0.5, -1, 0)
        at = np.stack(np.broadcast_arrays(worlds[:, None], row, column))
        times = ndimage.map_coordinates(value, at, float, order=1, mode="nearest")
        longest = times.max(axis=1)
        best = (times > longest[:, None] - _ROUNDING).argmax(axis=1)  # the first of those that are equally good
        return self._choices[best], (longest - times.mean(axis=1)).astype(np.float32)
