"""A log of robots: the path of each over time, and what else was recorded of it."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Series:
    """Values over time."""

    time: np.ndarray
    """(K,) float64 increasing times [s]."""
    value: np.ndarray
    """(K, ...) values."""

    def __len__(self) -> int:
        return len(self.time)

    def before(self, time: np.ndarray) -> np.ndarray:
        """Return the latest values at or before some times; the first value before the first time."""
        tolerance = 1e-6
        return self.value[np.maximum(np.searchsorted(self.time, time + tolerance, side="right") - 1, 0)]


@dataclass(frozen=True)
class Track:
    """Path of a robot."""

    time: np.ndarray
    """(K,) float64 increasing times [s]."""
    position: np.ndarray
    """(K, 3) float64 x, y, z [m], with the origin in the middle of the rectangle."""
    heading: np.ndarray
    """(K,) float64 headings, not wrapped [rad]."""
    speed: np.ndarray
    """(K,) float64 speeds over the ground, forwards [m/s]."""

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True)
class Log:
    """A log of N robots."""

    name: str
    """Name of its file."""
    tracks: tuple[Track, ...]
    """Path of each robot."""
    commands: dict[int, Series] = field(default_factory=dict)
    """Commands (K, A) of the robots that have any: of a car, steering angle [rad] and throttle."""
    phases: dict[int, Series] = field(default_factory=dict)
    """Phases (K,) of the robots that have any [rad]."""
    statuses: dict[int, Series] = field(default_factory=dict)
    """Statuses (K,) of the robots that have any: WORKING, STUCK or REMOVED of `lissajous_env.world.state`."""
    episode: dict[str, Any] | None = None
    """Scenario, seed and policy of a log that a simulation wrote."""

    @property
    def start(self) -> float:
        """Earliest time at which every robot has a pose [s]."""
        return max(float(track.time[0]) for track in self.tracks)

    @property
    def end(self) -> float:
        """Latest time at which every robot has a pose [s]."""
        return min(float(track.time[-1]) for track in self.tracks)
