"""A log of robots: the path of each over time, and what else was recorded of it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lissajous_env.wording import require


def _increasing(name: str, time: Any) -> np.ndarray:
    """Return the times of a series or track as float64 [s]; they must be finite and increase."""
    time = np.asarray(time, float)
    steps: Any = np.diff(np.atleast_1d(time))
    fits = np.isfinite(time).all() and (steps > 0).all()
    require(fits, f"time of a {name}", "must be finite and increase [s]", time)
    return time


@dataclass(frozen=True)
class Series:
    """Values over time."""

    time: np.ndarray
    """(K,) float64 increasing times [s]."""
    value: np.ndarray
    """(K, ...) values."""
    names: tuple[str, ...] = ()
    """Names of the columns, where the messages have any."""

    def __post_init__(self) -> None:
        time, value = _increasing("series", self.time), np.asarray(self.value)
        fits = time.ndim == 1 and time.size > 0 and value.shape[:1] == time.shape
        require(fits, "value of a series", "must have one row for each time, at least one", (time.shape, value.shape))
        fits = not self.names or value.shape[1:] == (len(self.names),)
        require(fits, "names of a series", "must be as many as the columns of its values", self.names)
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "value", value)

    def in_force(self, time: np.ndarray, late: float = 1e-6, before: Any = None) -> np.ndarray:
        """Return the values at some times [s]: the latest until `late` [s] after each, else `before` or the first."""
        row = np.searchsorted(self.time, time + late, side="right") - 1
        value = self.value[np.maximum(row, 0)]
        return value if before is None else np.where(row < 0, before, value)


@dataclass(frozen=True)
class Track:
    """Path of a robot."""

    time: np.ndarray
    """(K,) float64 increasing times [s]."""
    position: np.ndarray
    """(K, 3) float64 x, y, z [m], with the origin in the middle of the rectangle."""
    heading: np.ndarray
    """(K,) float64 headings, not wrapped [rad]; NaN where the log has none."""
    speed: np.ndarray
    """(K,) float64 speeds over the ground, forwards [m/s]; NaN where the log has none."""

    def __post_init__(self) -> None:
        count = np.size(self.time)
        for name, shape in {"time": (count,), "position": (count, 3), "heading": (count,), "speed": (count,)}.items():
            array = np.asarray(getattr(self, name), float)
            require(array.shape == shape, f"{name} of a track", f"must have the shape {shape}", array.shape)
            object.__setattr__(self, name, array)
        require(count > 1, "a track", "must have two poses at least", count)
        _increasing("track", self.time)
        require(np.isfinite(self.position).all(), "position of a track", "must be finite [m]", self.position.min())

    def __len__(self) -> int:
        return len(self.time)

    def without_repeats(self, gap: float) -> "Track":
        """Return this track without repeated poses that others follow within a gap [s]: they were not measured."""
        poses = np.column_stack([self.position, np.nan_to_num(self.heading)])
        firsts = np.flatnonzero(np.append(True, np.diff(poses, axis=0).any(axis=1)))
        is_brief = np.append(np.diff(self.time[firsts]) <= gap, False)
        rows = ~np.repeat(is_brief, np.diff(firsts, append=len(self)))
        rows[firsts] = True
        return Track(*(values[rows] for values in vars(self).values()))


@dataclass(frozen=True)
class Log:
    """A log of N robots."""

    name: str
    """Name of its file."""
    tracks: tuple[Track, ...]
    """Path of each robot."""
    commands: dict[int, Series] = field(default_factory=dict)
    """Commands (K, A) of the robots that have any, with the names of `lissajous_env.logs.commands.COMMAND_NAMES`."""
    phases: dict[int, Series] = field(default_factory=dict)
    """Phases (K,) of the robots that have any [rad]."""
    statuses: dict[int, Series] = field(default_factory=dict)
    """Statuses (K,) of the robots that have any: WORKING, as before the first, FAILED or REMOVED of `world.state`."""
    episode: dict[str, Any] | None = None
    """Scenario, seed and policy of a log that a simulation wrote."""
    begin: float | None = None
    """Recorded value of `start` [s]; None if there is none."""
    labels: tuple[str, ...] = ()
    """Numbers of the robots in the log's names; by default 0, 1, 2 ..."""
    notes: tuple[str, ...] = ()
    """Remarks of the reader: what was left out, corrected, or seems wrong."""

    def label(self, robot: int) -> str:
        """Return the number of a robot in the log's names."""
        return self.labels[robot] if self.labels else str(robot)

    def called(self, robots: Sequence[int]) -> str:
        """Return robots in words, by their labels, such as "robots 0, 1 and 4"."""
        *others, last = [self.label(robot) for robot in robots]
        return f"robots {', '.join(others)} and {last}" if others else f"robot {last}"

    def grouped(self, words: Sequence[tuple[int, str]]) -> list[str]:
        """Return the words on each robot as notes, one for all robots with the same words."""
        those: dict[str, list[int]] = {}
        for robot, note in words:
            those.setdefault(note, []).append(robot)
        return [f"{self.called(robots)}: {note}" for note, robots in those.items()]

    @property
    def start(self) -> float:
        """Time at which the episode begins [s]: `begin`, or the first time at which every robot has a pose."""
        return max(float(track.time[0]) for track in self.tracks) if self.begin is None else self.begin
