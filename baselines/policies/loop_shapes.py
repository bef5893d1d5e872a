"""Shapes of loops in the cells of a rectangle, timed so that cars can drive them: what a partition is selected from."""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from baselines.policies.cells import closed_loop, divisions, evenly_spaced, length_of
from lissajous_env.settings.checks import Checked, flag, number, whole

RESERVE = 0.75
"""Share of the top speed and of the grip that the loops use."""
TURN = 0.4
"""Largest turn in a control step [rad], in which steering is constant."""
_EXTENTS = (0.0, 0.3, 0.6, 0.9)
"""Extents of loops that are compared, from the smallest to that of the cell."""


@dataclass(frozen=True)
class PartitionParameters(Checked):
    """Parameters of a partition, besides the scenario; None selects the best worst-case undetected time."""

    speed: float | None = number(None, 1e-3, 1e4, "m/s")
    """Largest speed on the loops [m/s]; None is 0.75 of the top speed, and less where grip or a turn of 0.4 rad in a
    control step limit it."""
    rows: int | None = whole(None, 1, 1024)
    """Rows of cells, at most as many as robots."""
    extent_x: float | None = number(None, 0, 1)
    """Extent of the loops along x: 0 is a turning circle, 1 the width of the cell."""
    extent_y: float | None = number(None, 0, 1)
    """Extent of the loops along y: 0 is a turning circle, 1 the height of the cell."""
    lanes: int | None = whole(None, 2, 64)
    """Lanes of a loop, an even number."""
    clearance: float | None = number(None, 0, 1e4, "m")
    """Least distance of two bodies on the loops [m]; None is the radius of a body."""
    in_phase: bool = flag(False)
    """True if all loops have the same direction and phase, so that cars on equal loops never come nearer."""

    def _check_together(self) -> None:
        self._require(self.lanes is None or self.lanes % 2 == 0, "lanes", "must be even")


@dataclass(frozen=True)
class Room:
    """Constants that a plan depends on; all lengths are relative to the half height of the rectangle."""

    robots: int
    half_width: float
    """Half width of the rectangle that is monitored."""
    driven: tuple[float, float]
    """Half width and half height of the rectangle in which cars drive."""
    sensing: float
    apart: float
    """Least distance of two robots."""
    turning: float
    speed: float
    """Largest speed, a control step."""
    slowest: float
    """Speed below which cars cannot drive, a control step."""
    grip: float
    """Largest lateral acceleration, per control step squared."""
    target_speed: float
    """Of targets, a control step."""

    @property
    def inside(self) -> bool:
        """Return whether an inset separates the rectangle in which cars drive from the one that is monitored."""
        return self.driven != (self.half_width, 1.0)


@dataclass(frozen=True, eq=False)
class Shape:
    """Cells with loops of one shape."""

    cells: np.ndarray
    """(N, 6) cells."""
    sizes: np.ndarray
    """(N, 2) half extents of the loops."""
    loops: np.ndarray
    """(N, K, 2) places on loops around the origin at each control step, counter-clockwise."""

    def placed(
        self,
        half: tuple[float, float],
        turn_x: int = 0,
        turn_y: int = 0,
        phase_x: float = 0.0,
        phase_y: float = 0.0,
    ) -> np.ndarray:
        """Return the loops (N, K, 2) at their cells, moved inwards where they would leave the rectangle to drive in.

        Args:
            half: Half width and half height of that rectangle.
            turn_x: 1 if neighbours in a row go around in opposite directions.
            turn_y: 1 if neighbouring rows go around in opposite directions.
            phase_x: Phase of the next loop in a row less that of the one before [period].
            phase_y: Phase of the next row less that of the one before [period].
        """
        room = (np.array(half) - self.sizes).min(axis=0)
        outermost = np.abs(self.cells[:, :2]).max(axis=0)
        shrink = np.minimum(1, np.divide(room, outermost, out=np.ones(2), where=outermost > 0))
        column, row = self.cells[:, 4], self.cells[:, 5]
        count = self.loops.shape[1]
        direction = np.where((turn_x * column + turn_y * row) % 2 == 1, -1, 1)
        shift = np.rint((phase_x * column + phase_y * row) * count)
        at = (direction[:, None] * np.arange(count) + shift[:, None]).astype(int) % count
        around = np.take_along_axis(self.loops, at[:, :, None], axis=1)
        return (self.cells[:, :2] * shrink)[:, None] + around


def smallest_distance(placed: np.ndarray, others: np.ndarray | None = None) -> float:
    """Return the smallest distance of two robots at any control step, or half way between two.

    Args:
        placed: (N, K, 2) places on loops.
        others: (M, K, 2) places of other robots, if the distances from these are wanted.
    """
    places = _with_middles(placed)
    if others is None:
        first, second = np.triu_indices(len(placed), 1)
        between = places[first] - places[second]
    else:
        between = places[:, None] - _with_middles(others)[None]
    return math.sqrt(float((between**2).sum(axis=-1).min(initial=math.inf)))


def _with_middles(placed: np.ndarray) -> np.ndarray:
    return np.concatenate([placed, (placed + np.roll(placed, -1, axis=1)) / 2], axis=1)


def shapes_of(room: Room, parameters: PartitionParameters, half: tuple[float, float]):
    """Yield the shapes of loops that cars can drive: in own cells, and within an inset also in shared ones."""
    yield from _loops_in_cells(room, parameters, half, 1)
    for members in range(2, room.robots + 1 if room.inside and not parameters.in_phase else 2):
        if room.robots % members == 0:
            yield from _loops_in_cells(room, parameters, half, members)


def _loops_in_cells(room: Room, parameters: PartitionParameters, half: tuple[float, float], members: int):
    """Yield the shapes of loops on each of which so many cars follow one another at even distances."""
    found = divisions(room.robots // members, half)
    if parameters.rows is not None:
        found = [cells for cells in found if len(np.unique(np.round(cells[:, 1], 9))) == parameters.rows]
    else:
        stretch = [float(np.max(np.maximum(cells[:, 2] / cells[:, 3], cells[:, 3] / cells[:, 2]))) for cells in found]
        found = [cells for cells, each in zip(found, stretch, strict=True) if each <= 2.5 * min(stretch)]
    extents = (*_EXTENTS, 1.0) if room.inside else _EXTENTS  # sensors have to reach across the inset
    extents_x = extents if parameters.extent_x is None else (parameters.extent_x,)
    extents_y = extents if parameters.extent_y is None else (parameters.extent_y,)
    all_lanes = (2, 4, 6) if parameters.lanes is None else (parameters.lanes,)
    for cells, along_x, along_y, lanes in itertools.product(found, extents_x, extents_y, all_lanes):
        share = np.array([along_x, along_y])
        largest = np.minimum(cells[:, 2:4], room.driven)
        sizes = room.turning + share * np.maximum(largest - room.turning, 0)
        if lanes > 2 and sizes.min() < 3 * room.turning:
            continue
        corners = (room.turning,) if lanes > 2 else (room.turning, float(sizes.min()))
        for corner in dict.fromkeys(corners):
            distinct, which = np.unique(np.round(sizes, 12), axis=0, return_inverse=True)
            loops = [closed_loop(size[0], size[1], corner, lanes) for size in distinct]
            if all(loop is not None for loop in loops):
                timed = _timed(loops, room, corner, members)[which.ravel()]
                count = timed.shape[1]
                shared = [np.roll(loop, -k * count // members, axis=0) for loop in timed for k in range(members)]
                yield Shape(np.repeat(cells, members, axis=0), np.repeat(sizes, members, axis=0), np.array(shared))


def speed_on(corner: float, room: Room) -> float:
    """Return the largest speed on a loop with corners of some radius, a control step."""
    return max(min(room.speed, math.sqrt(room.grip * corner), TURN * corner), 1.02 * room.slowest)


def _timed(loops: list, room: Room, corner: float, members: int) -> np.ndarray:
    """Return places (M, K, 2) on loops at each control step, for the shortest period that the cars can drive.

    The period is a multiple of the number of members of a loop.
    """
    count = max(math.ceil(max(map(length_of, loops)) / speed_on(corner, room) - 1e-9), 8)
    count = members * math.ceil(count / members)
    return np.stack([evenly_spaced(loop, count) for loop in loops])
