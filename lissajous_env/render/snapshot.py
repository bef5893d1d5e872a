"""What a picture shows of a world at one time, on the host: made from a simulation, or from a recording of one."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from lissajous_env.world.coverage import last_sensed
from lissajous_env.world.score import detection_times
from lissajous_env.world.state import REMOVED

if TYPE_CHECKING:
    from lissajous_env.world.simulation import Simulation


@dataclass(frozen=True)
class Snapshot:
    """One world at one time. N robots, T target slots, R rows and C columns of the grid."""

    step: int
    """Control steps taken in the episode."""
    world: int
    """Which world of the batch it was."""
    seed: int
    """Seed of the episode."""
    position: np.ndarray
    """(N, 3) x, y, z of the robots [m]."""
    heading: np.ndarray
    """(N,) headings of the robots [rad]."""
    status: np.ndarray
    """(N,) WORKING, STUCK or REMOVED of `lissajous_env.world.state`."""
    target_position: np.ndarray
    """(T, 2) x, y of the targets [m]; that of one that left is where it was detected."""
    motion: np.ndarray
    """(T,) STILL, DRIFTING, WANDERING or FLEEING of `lissajous_env.world.targets.motion`."""
    appears_at: np.ndarray
    """(T,) step in which a target appears."""
    found_at: np.ndarray
    """(T,) step in which it was detected; above `step` before."""
    found_early: np.ndarray
    """(T,) share of that step that was left then."""
    sensed_at: np.ndarray
    """(R, C) step in which a cell was last sensed, or of a large grid every so manieth; the lowest row comes first."""
    contact: np.ndarray
    """(M, 2) pairs of robots that have collided and not yet parted."""
    collisions: int
    """Collisions in the episode so far."""
    trail: tuple[np.ndarray, np.ndarray] | None = None
    """Steps (K,) up to now and positions (K, N, 2) of the robots at them [m], where they are known."""

    @classmethod
    def of(cls, simulation: "Simulation", world: int = 0, most_cells: tuple[int, int] | None = None) -> "Snapshot":
        """Copy what a picture shows of one world; the simulation is only read.

        Args:
            simulation: Which is read.
            world: Which of its worlds.
            most_cells: Rows and columns of the grid at most, evenly chosen; None takes all.
        """
        clock, robots, targets = simulation.clock, simulation.robots, simulation.targets
        step, cells = int(of_world(clock.step, world)), simulation.cells
        rows, columns = (
            slice(None) if most_cells is None else _every(length, most_cells[axis])
            for axis, length in enumerate(cells.sensed_at.shape[1:])
        )
        kept = np.arange(cells.sensed_at.shape[2])[columns]
        sensed_at = of_world(cells.sensed_at, world, (rows, columns))
        sensed_at = last_sensed(sensed_at, of_world(cells.in_discs, world, (slice(None), rows)), step, kept)
        status = of_world(robots.status, world)
        # A pair of which one was removed never parts; it is in contact no longer all the same.
        there = status != int(REMOVED)
        return cls(
            step=step,
            world=world,
            seed=int(of_world(clock.seed, world)),
            position=of_world(robots.position, world),
            heading=of_world(robots.heading, world),
            status=status,
            target_position=of_world(targets.position, world),
            motion=of_world(targets.motion, world),
            appears_at=of_world(targets.appears_at, world),
            found_at=of_world(targets.found_at, world),
            found_early=of_world(targets.found_early, world),
            sensed_at=sensed_at,
            contact=np.argwhere((of_world(simulation.tally.contact, world) > 0) & np.outer(there, there)),
            collisions=int(of_world(simulation.tally.collisions, world)),
        )

    @property
    def present(self) -> np.ndarray:
        """(T,) bool: targets that are there and not yet detected."""
        return (self.appears_at <= self.step) & (self.found_at > self.step)

    @property
    def found(self) -> np.ndarray:
        """(T,) bool: targets that were detected."""
        return self.found_at <= self.step

    def mean_detection_time(self, step: float) -> float:
        """Mean over the targets so far of the time until detection [s]; NaN without targets.

        As in the score, one that is not yet detected counts with the time that it has been there.
        """
        waited, _ = detection_times(self.appears_at, self.found_at, self.found_early, self.step)
        return float(waited.mean()) * step if waited.size else np.nan


def thinned(cells: np.ndarray, most: tuple[int, int]) -> np.ndarray:
    """Return every so manieth row and column of a grid (R, C), at most so many."""
    rows, columns = (_every(length, limit) for length, limit in zip(cells.shape, most, strict=True))
    return cells[rows, columns]


def _every(length: int, limit: int) -> slice:
    """Every so manieth of a number of things, at most so many."""
    stride = -(-length // max(limit, 1))
    return slice(stride // 2, None, stride)


def of_world(array: Any, world: int, part: Any = ...) -> np.ndarray:
    """Return a part of one world of a device array, copied to the host without the others."""
    if array.device.is_cpu and array.size > 0:
        return np.array(np.asarray(array)[world][part])  # a fifth of the time of `numpy`, which looks after streams
    whole = array.ndim == 1 or array.size == 0
    return np.array((array.numpy()[world] if whole else array[world].numpy())[part])
