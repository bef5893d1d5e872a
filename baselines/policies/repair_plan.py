"""Loops on which the ring neighbours of a failed robot cover its cell.

Every robot has loops for four cases: none of its ring neighbours has failed, the previous one, the next one, or both.
In each case there is the rectangle around the robot's own cell and those of the failed neighbours, with a few loops of
different shapes in it, the best first. The robot drives one that is clear of the stopped robots. All of them have the
period and the phase of the plan, so that what they differ by is small: two robots on equal loops in phase never come
nearer than the centres of these.
"""

import itertools
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from baselines.policies.cells import are_adjacent, closed_loop, evenly_spaced, length_of
from baselines.policies.ideal_motion import coverage, worst_undetected_time
from baselines.policies.loop_shapes import Room, smallest_distance, speed_on
from baselines.policies.partition_plan import Plan

SHAPES = 4
"""Loops of different shapes for each case."""
OFFSETS = 4
"""Distances along x and y from the middle of a rectangle at which the quality of a loop is computed."""
UNKNOWN = 10.0
"""Cost from which on a loop has no guarantee."""
TOWARDS = 0.3
"""Share of the way to a neighbour's cell by which a robot that cannot watch both alone moves its loop."""
_SHARES = (0.0, 0.3, 0.6, 1.0)
_ALIKE = 1e-6
"""Difference of two places, in half heights of the rectangle, up to which they are the same."""
_DISTINCT = 0.1
"""Difference of two shapes' half extents, in turning radii, from which on they count as different."""


class Takeover(NamedTuple):
    """Loops of each robot; row SHAPES c + s is for case c, the sum of 1 for the previous and 2 for the next robot."""

    loop: np.ndarray
    """(4 SHAPES, N, K, 2) places at each control step of a period [m]."""
    away: np.ndarray
    """(4 SHAPES, N, 2) middle of each loop less the place that is best for it [m]."""
    cost: np.ndarray
    """(4 SHAPES, N, OFFSETS, OFFSETS) cost of a loop whose middle is k, l times `offset` from that place."""
    offset: float
    """Spacing of these distances [m]."""
    corners: np.ndarray
    """(4 SHAPES, N) corners of the rectangle that only this robot watches, as bits: 1 at the left and bottom, 2 at the
    right and bottom, 4 at the left and top, 8 at the right and top."""


def slowed(plan: Plan, reserve: float) -> Plan:
    """Return a plan whose loops last longer by a factor, so that the cars can drive longer loops in the same time."""
    count = math.ceil(plan.loop.shape[1] * reserve - 1e-9)
    loop = np.stack([_at_even_distances(each, count) for each in plan.loop])
    return replace(plan, loop=loop, speed=plan.speed * plan.loop.shape[1] / count, worst=math.nan)


def _at_even_distances(loop: np.ndarray, count: int) -> np.ndarray:
    """Return `count` places on a loop given by fewer, at equal times, by its Fourier series."""
    waves = np.fft.fft(loop, axis=0)
    rates = np.fft.fftfreq(len(loop), 1 / len(loop))
    time = np.arange(count)[:, None] / count
    return np.real(np.exp(2j * np.pi * time * rates) @ waves) / len(loop)


def takeover(plan: Plan, cell: np.ndarray, neighbours: np.ndarray, room: Room, unit: float, offset: float) -> Takeover:
    """Return the loops of robots that take over the cells of neighbours.

    A cell that shares no edge with the robot's own is left to the other neighbour.

    Args:
        plan: The plan without failures, all loops in phase.
        cell: (N,) cell of each robot.
        neighbours: (N, 2) previous and next robot on the ring, -1 for none.
        room: Constants of the plan.
        unit: Half height of the rectangle [m].
        offset: Spacing of the distances at which the quality of a loop is computed [m].
    """
    cells, own = plan.cells[cell][:, :4] / unit, plan.loop[cell] / unit
    count = len(cells)
    adjacent = are_adjacent(cells)
    loop = np.repeat(own[None], 4 * SHAPES, axis=0)
    away, cost = np.zeros((4 * SHAPES, count, 2)), np.zeros((4 * SHAPES, count, OFFSETS, OFFSETS))
    corners = np.zeros(loop.shape[:2], dtype=int)
    search = LoopSearch(room, own.shape[1], offset / unit)
    for robot, case in itertools.product(range(count), range(4)):
        taken = [neighbours[robot, side] for side in range(2) if case >> side & 1]
        taken = [other for other in taken if other >= 0 and adjacent[robot, other]]
        low = (cells[[robot, *taken], :2] - cells[[robot, *taken], 2:4]).min(axis=0)
        high = (cells[[robot, *taken], :2] + cells[[robot, *taken], 2:4]).max(axis=0)
        corners[SHAPES * case : SHAPES * (case + 1), robot] = _corners_of(low, high, room.half_width)
        options = search.alone((high - low) / 2, (low + high) / 2)
        if taken and not (options and options[0][2][:2, :2].max() < UNKNOWN):
            towards = (cells[taken, :2] - cells[robot, :2]).sum(axis=0)
            options = search.beside((high - low) / 2, middle_of(own[robot]) + TOWARDS * towards, towards)
        if not taken:  # the loop of the plan comes first
            options = [(own[robot], np.zeros(2), search.around(0.0)), *options]
        others = own[np.delete(np.arange(count), [robot, *taken])]
        options = [each for each in options if smallest_distance(each[0][None], others) >= room.apart] or [
            (own[robot], np.zeros(2), search.around(0.0))
        ]
        for shape in range(SHAPES):
            row = SHAPES * case + shape
            loop[row, robot], away[row, robot], cost[row, robot] = options[min(shape, len(options) - 1)]
    return Takeover(loop * unit, away * unit, cost, offset, corners)


def _corners_of(low: np.ndarray, high: np.ndarray, half_width: float) -> int:
    """Return the corners of the rectangle that a part of it has, as bits (`Takeover.corners`)."""
    left, right = low[0] < -half_width + _ALIKE, high[0] > half_width - _ALIKE
    bottom, top = low[1] < -1.0 + _ALIKE, high[1] > 1.0 - _ALIKE
    return sum(bool(each) << k for k, each in enumerate((left & bottom, right & bottom, left & top, right & top)))


class LoopSearch:
    """Loops of the period of the plan, each with its middle less the best place for it, and the costs around that."""

    def __init__(self, room: Room, count: int, offset: float):
        self.room, self.count, self.offset = room, count, offset
        self._alone: dict[bytes, list] = {}

    def alone(self, half: np.ndarray, middle: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Return loops by which one robot alone watches a rectangle, the best first; the cost is by how well."""
        key = np.round(half, 9).tobytes()
        if key not in self._alone:
            loops = _loops_in(half, self.room, self.count)[:SHAPES]
            self._alone[key] = [(around, _quality(half, around, self.room, self.offset)) for around in loops]
        found = []
        for around, cost in self._alone[key]:
            placed = self._inside(around, middle)
            found.append((placed, middle_of(placed) - middle, cost))
        return found

    def beside(self, half: np.ndarray, middle: np.ndarray, towards: np.ndarray) -> list:
        """Return loops by which robots in phase, side by side, watch what none of them could alone.

        In phase, their distances are constant; where these are below two sensing radii, nothing passes between the
        discs. A loop that is as long as the rectangle across the row can lead around a robot that has stopped there.
        The middle is the best place, whose cost grows with the distance.
        """
        room, along_x = self.room, abs(towards[0]) >= abs(towards[1])
        found = []
        for share in (1.0, 0.5, 0.0):
            long = room.turning + share * max((half[1] if along_x else half[0]) - room.turning, 0)
            size = (room.turning, long) if along_x else (long, room.turning)
            loop = closed_loop(*size, room.turning)
            if loop is not None and length_of(loop) <= speed_on(room.turning, room) * self.count * (1 + 1e-9):
                placed = self._inside(evenly_spaced(loop, self.count), middle)
                found.append((placed, np.zeros(2), self.around(5.0 * (1.0 - share))))
        return found

    def around(self, least: float) -> np.ndarray:
        """Return costs (OFFSETS, OFFSETS) that grow with the square of the distance, in sensing radii."""
        steps = self.offset * np.arange(OFFSETS) / self.room.sensing
        return least + 10 * (steps[:, None] ** 2 + steps**2)

    def _inside(self, around: np.ndarray, middle: np.ndarray) -> np.ndarray:
        limit = np.maximum(np.array(self.room.driven) - np.ptp(around, axis=0) / 2, 0)
        return np.clip(middle, -limit, limit) + around - middle_of(around)


def middle_of(loop: np.ndarray) -> np.ndarray:
    """Return the middle (2,) of the extent of a loop [m]."""
    return (loop.min(axis=0) + loop.max(axis=0)) / 2


def _quality(half: np.ndarray, around: np.ndarray, room: Room, offset: float) -> np.ndarray:
    """Return the costs (OFFSETS, OFFSETS) of a loop that watches a rectangle alone: the worst-case undetected time.

    They are in periods, and above `UNKNOWN` where there is no guarantee.
    """
    found = np.empty((OFFSETS, OFFSETS))
    place = (float(half[0]), float(half[1]))
    for k, m in itertools.product(range(OFFSETS), range(OFFSETS)):
        if min(k, m) > 0 and min(found[k - 1, m], found[k, m - 1]) >= UNKNOWN:  # farther away it is no better
            found[k, m] = max(found[k - 1, m], found[k, m - 1]) + 0.1
            continue
        moved = around[None] + offset * np.array([k, m])
        unvisited, gap = coverage(moved, place, room.sensing, coarse=True)
        worst = math.inf
        if unvisited == 0:
            worst = worst_undetected_time(moved, place, room.sensing, room.target_speed, 1.0)
        found[k, m] = min(worst / len(around), UNKNOWN + gap / len(around)) + UNKNOWN * unvisited
    return found


def _loops_in(half: np.ndarray, room: Room, count: int) -> list[np.ndarray]:
    """Return loops (K, 2) around the origin that a car can drive in K control steps, the best for a rectangle first."""
    found = []
    largest = np.maximum(np.minimum(half, room.driven), room.turning)
    for share_x, share_y in itertools.product(_SHARES, _SHARES):
        size = room.turning + np.array([share_x, share_y]) * (largest - room.turning)
        for corner in dict.fromkeys(np.linspace(room.turning, size.min(), 4).tolist()):
            loop = closed_loop(size[0], size[1], corner)
            if loop is None or length_of(loop) > speed_on(corner, room) * count * (1 + 1e-9):
                continue
            around = evenly_spaced(loop, count)
            place = (float(half[0]), float(half[1]))
            visits = coverage(around[None], place, room.sensing)
            worst = math.inf
            if visits[0] == 0:
                worst = worst_undetected_time(around[None], place, room.sensing, room.target_speed, 1.0)
            found.append((worst, *visits, len(found), around))
    found.sort(key=lambda each: each[:4])
    distinct: list[np.ndarray] = []
    for *_, around in found:
        size = np.ptp(around, axis=0) / 2
        differences = [np.abs(np.ptp(other, axis=0) / 2 - size).max() for other in distinct]
        if min(differences, default=math.inf) >= _DISTINCT * room.turning:
            distinct.append(around)
    return distinct
