"""The index rule: robots drive where they expect the most targets per time, and learn where targets appear."""

from typing import Any

import numpy as np

from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.own_row import Rows
from baselines.policies.reacting import Reacting, greedy_division, towards
from lissajous_env.parameters.scenario import Scenario

_NOWHERE = 1e6
"""Distance of a place that is not known [sensing radius]."""


class Index(Reacting):
    """Drive where the expected number of targets per time is largest: rates of cells times the time since a visit.

    The rate of a cell is the mean of a gamma distribution, whose prior is the uniform rate with the weight of half a
    detection. Robots choose one after the other, and leave out what others will cover.

    Raises:
        UnsuitableScenarioError: no targets appear during an episode, or the robots do not share tracks and places.
    """

    learns: bool = True
    """False for uniform rates."""
    delay: float = 0.25
    """Time that is added to the driving time to a place, in units of sensing radius over top speed."""

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu", **settings: Any):
        super().__init__(scenario, num_worlds, device, **settings)
        sensing, self.radius = self.scenario.sensing, self.scenario.sensing_radius
        if self.scenario.targets.arrival_rate == 0:
            raise UnsuitableScenarioError("targets.arrival_rate must be above 0 for an index rule [1/s], got 0")
        if sensing.shared != "team" or min(sensing.tracks_seen, sensing.teammates_seen) == 0:
            rule = "must be team, with sensing.tracks_seen and sensing.teammates_seen above 0, for an index rule"
            raise UnsuitableScenarioError(f"sensing.shared {rule}, got {sensing.shared}")
        self.counts = np.ceil(2 * self.half / (1.7 * self.radius)).astype(int)
        axes = [(np.arange(n) + 0.5) * 2 * h / n - h for n, h in zip(self.counts, self.half, strict=True)]
        self.cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        apart = np.linalg.norm(self.cells[:, None] - self.cells, axis=-1)
        self._near, self._beyond = (apart < self.radius).astype(float), (apart >= 1.2 * self.radius).astype(float)
        shape = (*self.shape, len(self.cells))
        self._idle, self._detections, self._watched_time = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        self.forget(np.ones(self.num_worlds, bool))

    def forget(self, mask: np.ndarray) -> None:
        """Forget all detections; every cell has been idle for the same time."""
        self._idle[mask] = 10 * self.radius / self.top
        self._detections[mask] = self._watched_time[mask] = 0.0

    def expected(self) -> np.ndarray:
        """Return the expected number of undetected targets in each cell (W, N, cells)."""
        return self.rates() * self._idle

    def rates(self) -> np.ndarray:
        """Return the expected rates (W, N, cells) [1/s]."""
        uniform = self.scenario.targets.arrival_rate / len(self.cells)
        if not self.learns:
            return np.full(self._idle.shape, uniform)
        return (self._detections + 0.5) / (self._watched_time + 0.5 / uniform)

    def wish(self, rows: Rows) -> np.ndarray:
        """Update the robots' estimates, divide the cells among the team, and drive to the own one, or the nearest."""
        places = self.sent.next(rows)
        far = np.nan_to_num(np.linalg.norm(places[:, :, :, None] - self.cells, axis=-1), nan=_NOWHERE * self.radius)
        covered = (far < self.radius).any(axis=2)
        waited = self._idle + self.step
        self._watched_time += np.where(covered, waited, 0.0)
        self._idle = np.where(covered, 0.0, waited)
        cell = (rows.position[:, :, None] + rows.track_offset + self.half) / (2 * self.half) * self.counts
        column, line = np.moveaxis(np.clip(cell, 0, self.counts - 1).astype(int), -1, 0)
        world, robot, track = np.nonzero(rows.track_leaves)
        np.add.at(self._detections, (world, robot, (column * self.counts[1] + line)[world, robot, track]), 1.0)
        time, mass = far / self.top + self.delay * self.radius / self.top, self.expected()

        def rates(free: np.ndarray) -> np.ndarray:
            return (mass @ self._near)[:, :, None] * free / time

        def take(cell: np.ndarray) -> None:
            nonlocal mass
            mass = mass * self._beyond[cell]

        goal = greedy_division(rates, take, time.shape[:3])
        goal = np.where(goal < 0, far[:, :, 0].argmin(axis=-1), goal)
        return towards(self.cells[goal] - rows.position, self.radius / 3)
