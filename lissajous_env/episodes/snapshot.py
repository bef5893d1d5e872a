"""State of one world at one time, on the host, from a simulation or a recording."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from lissajous_env.world.coverage import last_sensed
from lissajous_env.world.episode import Detections
from lissajous_env.world.selection import of_world
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import REMOVED, WORKING


@dataclass(frozen=True, kw_only=True)
class Snapshot(Detections):
    """State of one world at one time. N robots, T target slots, R rows and C columns of the coverage grid."""

    world: int
    """Index of the world in the batch."""
    seed: int
    """Seed of the episode."""
    position: np.ndarray
    """(N, 3) x, y, z of the robots [m]."""
    heading: np.ndarray
    """(N,) headings of the robots [rad]."""
    status: np.ndarray
    """(N,) WORKING, FAILED or REMOVED of `lissajous_env.world.state`."""
    target_position: np.ndarray
    """(T, 2) x, y of the targets [m]; for targets that left, where they were detected."""
    motion: np.ndarray
    """(T,) STILL, DRIFTING, WANDERING, FLEEING or CUSTOM of `lissajous_env.world.targets.motion`."""
    sensed_at: np.ndarray
    """(R, C) step in which a cell was last sensed, 0 also for never; the lowest row comes first."""
    contact: np.ndarray
    """(M, 2) pairs of robots that collided in this step, or earlier and have not yet parted."""
    collisions: int
    """Collisions in the episode so far."""

    @classmethod
    def of(cls, simulation: Simulation, world: int = 0) -> "Snapshot":
        """Copy the state of one world of a simulation."""
        clock, robots, targets = simulation.clock, simulation.robots, simulation.targets
        step, cells = int(of_world(clock.step, world)), simulation.cells
        sensed_at = last_sensed(of_world(cells.sensed_at, world), of_world(cells.in_discs, world), step)
        # The contact of a pair with a removed robot is never reset, but it has ended. That of this step may have, too.
        there, touched = of_world(robots.status, world) != REMOVED, of_world(simulation.tally.contact, world)
        of_targets, of_robots = ("motion", "appears_at", "found_at", "found_early"), ("position", "heading", "status")
        arrays: dict[str, Any] = {name: of_world(getattr(targets, name), world) for name in of_targets}
        return cls(
            step=step,
            world=world,
            seed=int(of_world(clock.seed, world)),
            target_position=of_world(targets.position, world),
            sensed_at=sensed_at,
            contact=np.argwhere((np.abs(touched) == max(step, 1)) | (touched > 0) & np.outer(there, there)),
            collisions=int(of_world(simulation.tally.collisions, world)),
            earlier=int(of_world(targets.earlier, world).sum()),
            earlier_time=float(of_world(targets.earlier_time, world).sum()),
            **arrays | {name: of_world(getattr(robots, name), world) for name in of_robots},
        )

    @property
    def present(self) -> np.ndarray:
        """(T,) bool: targets that are present and undetected."""
        return self.appeared & ~self.detected

    def in_sight(self, sight: float) -> np.ndarray:
        """Return (T,) bool: targets within `sight` [m] of a working robot; those that left, at their detection."""
        robots = self.position[self.status == WORKING, :2]
        nearest = np.full(len(self.target_position), np.inf)
        for place in robots:
            nearest = np.minimum(nearest, np.hypot(*(self.target_position - place).T))
        return self.appeared & (nearest < sight)


def thinned(cells: np.ndarray, most: tuple[int, int]) -> np.ndarray:
    """Return a grid (R, C) of times as one of at most `most` rows and columns, the earliest of each block of cells."""
    for axis, (length, limit) in enumerate(zip(cells.shape, most, strict=True)):
        cells = np.minimum.reduceat(cells, range(0, length, -(-length // max(limit, 1))), axis=axis)
    return cells
