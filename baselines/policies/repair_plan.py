"""Loops on which the ring neighbours of a robot that has failed cover its cell.

A robot has loops for four cases: none of its ring neighbours has failed, the previous one, the next one, or both. In
each case it watches the rectangle around its own cell and those of the failed neighbours, for which there are a few
loops of different shapes, the best first. The robot drives one that is clear of the stopped robots. All loops have the
period and the phase of the plan: two robots on equal loops in phase never come nearer than the centres of these.
"""

import itertools
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from baselines.policies.loops import are_adjacent, closed_loop, evenly_spaced, length_of
from baselines.policies.partition_plan import PartitionLoops, Problem, rating_of, smallest_distance, speed_on

SHAPES = 4
"""Loops of different shapes for each case."""
CASES = 4
"""Cases of a robot, by the sum of 1 for a failed previous and 2 for a failed next robot."""
OFFSETS = 4
"""Distances along x and y from the middle of a rectangle at which the quality of a loop is computed."""
_UNKNOWN = 10.0
"""Cost from which on a loop has no guarantee."""
_TOWARDS = 0.3
"""Share of the way to a neighbour's cell by which a robot that cannot watch both alone moves its loop."""
_SHARES = (0.0, 0.3, 0.6, 1.0)
"""Extents of loops that are compared: 0 is a turning circle, 1 the rectangle."""
_ALIKE = 1e-6
"""Difference of two places, in half heights of the rectangle, up to which they are the same."""
_DISTINCT = 0.1
"""Difference of two shapes' half extents, in turning radii, from which on they count as different."""


@dataclass(frozen=True)
class Takeover:
    """Loops of each robot in its cases; row SHAPES c + s is for case c."""

    loop: np.ndarray
    """(CASES SHAPES, N, K, 2) places at each control step of a period [m]."""
    away: np.ndarray
    """(CASES SHAPES, N, 2) middle of each loop less the place that is best for it [m]."""
    cost: np.ndarray
    """(CASES SHAPES, N, OFFSETS, OFFSETS) cost of a loop whose middle is k, l times an offset from that place."""
    corners: np.ndarray
    """(CASES SHAPES, N) corners of the rectangle that only this robot watches, as bits: 1 at the left and bottom, 2 at
    the right and bottom, 4 at the left and top, 8 at the right and top."""


class _Option(NamedTuple):
    """A loop for a case, in half heights of the rectangle."""

    loop: np.ndarray
    """(K, 2) places."""
    away: np.ndarray
    """(2,) middle of the loop less the place that is best for it."""
    cost: np.ndarray
    """(OFFSETS, OFFSETS) cost by the distance from that place."""


def slowed(plan: PartitionLoops, reserve: float) -> PartitionLoops:
    """Return a plan whose loops last longer by a factor, so that the cars can drive longer loops in the same time.

    The places on them are those of the Fourier series of the loops.
    """
    period = plan.loop.shape[1]
    count = math.ceil(period * reserve - 1e-9)
    waves = np.exp(2j * np.pi * np.arange(count)[:, None] / count * np.fft.fftfreq(period, 1 / period))
    loop = np.real(waves @ np.fft.fft(plan.loop, axis=1)) / period
    return replace(plan, loop=loop, speed=plan.speed * period / count)


def takeover_of(
    plan: PartitionLoops, cell: np.ndarray, neighbours: np.ndarray, problem: Problem, unit: float, offset: float
) -> Takeover:
    """Return the loops of robots that take over the cells of ring neighbours.

    A cell that shares no edge with the robot's own is left to the other neighbour.

    Args:
        plan: The plan without failures, all loops in phase.
        cell: (N,) cell of each robot.
        neighbours: (N, 2) previous and next robot on the ring, -1 for none.
        problem: Constants of the plan.
        unit: Half height of the rectangle [m].
        offset: Spacing of the distances at which the quality of a loop is computed [m].
    """
    cells, own = plan.cells[cell][:, :4] / unit, plan.loop[cell] / unit
    count, adjacent = len(cells), are_adjacent(cells)
    search = _LoopSearch(problem, own.shape[1], offset / unit)
    corners = np.zeros((CASES * SHAPES, count), dtype=int)
    chosen = []
    for robot, case in itertools.product(range(count), range(CASES)):
        failed = [neighbours[robot, side] for side in range(2) if case >> side & 1]
        failed = [other for other in failed if other >= 0 and adjacent[robot, other]]
        low = (cells[[robot, *failed], :2] - cells[[robot, *failed], 2:4]).min(axis=0)
        high = (cells[[robot, *failed], :2] + cells[[robot, *failed], 2:4]).max(axis=0)
        corners[SHAPES * case : SHAPES * (case + 1), robot] = _corners_of(low, high, problem.half[0])
        half, unmoved = (high - low) / 2, _Option(own[robot], np.zeros(2), search.around(0.0))
        options = search.alone(half, (low + high) / 2)
        if not failed:  # the loop of the plan comes first
            options = [unmoved, *options]
        elif not options or options[0].cost[:2, :2].max() >= _UNKNOWN:
            towards = (cells[failed, :2] - cells[robot, :2]).sum(axis=0)
            options = search.beside(half, middle_of(own[robot]) + _TOWARDS * towards, towards)
        others = own[np.delete(np.arange(count), [robot, *failed])]
        options = [option for option in options if smallest_distance(option.loop[None], others) >= problem.apart]
        chosen.append(options or [unmoved])
    rows = [  # of the first SHAPES of the options, the last of which is repeated
        [of_robot[min(shape, len(of_robot) - 1)] for of_robot in chosen[case::CASES]]
        for case in range(CASES)
        for shape in range(SHAPES)
    ]
    loop, away, cost = (np.array([[entry[k] for entry in row] for row in rows]) for k in range(3))
    return Takeover(loop * unit, away * unit, cost, corners)


def _corners_of(low: np.ndarray, high: np.ndarray, half_width: float) -> int:
    """Return the corners of the rectangle that a part of it has, as bits (`Takeover.corners`)."""
    left, right = low[0] < -half_width + _ALIKE, high[0] > half_width - _ALIKE
    bottom, top = low[1] < -1.0 + _ALIKE, high[1] > 1.0 - _ALIKE
    return sum(bool(has) << k for k, has in enumerate((left & bottom, right & bottom, left & top, right & top)))


class _LoopSearch:
    """Search for loops that last a period of the plan, each as an `_Option`."""

    def __init__(self, problem: Problem, count: int, offset: float):
        self.problem, self.count, self.offset = problem, count, offset
        self._alone: dict[bytes, list] = {}

    def alone(self, half: np.ndarray, middle: np.ndarray) -> list[_Option]:
        """Return loops by which one robot alone watches a rectangle, the best first; the cost is that of `_quality`."""
        key = np.round(half, 9).tobytes()
        if key not in self._alone:
            loops = _loops_in(half, self.problem, self.count)[:SHAPES]
            self._alone[key] = [(around, _quality(half, around, self.problem, self.offset)) for around in loops]
        placed = [(self._inside(around, middle), cost) for around, cost in self._alone[key]]
        return [_Option(loop, middle_of(loop) - middle, cost) for loop, cost in placed]

    def beside(self, half: np.ndarray, middle: np.ndarray, towards: np.ndarray) -> list[_Option]:
        """Return loops by which robots in phase, side by side, watch a rectangle that none of them could alone.

        In phase, their distances are constant; where these are below two sensing radii, nothing passes between the
        discs. A loop that is as long as the rectangle across the row can lead around a robot that has stopped there.
        The middle is the best place, whose cost grows with the distance.
        """
        problem, along_x = self.problem, abs(towards[0]) >= abs(towards[1])
        half, options = np.minimum(half, problem.driven), []
        for share in (1.0, 0.5, 0.0):
            long = problem.turning + share * max((half[1] if along_x else half[0]) - problem.turning, 0)
            loop = closed_loop(*((problem.turning, long) if along_x else (long, problem.turning)), problem.turning)
            if loop is not None and _is_drivable(loop, problem.turning, problem, self.count):
                placed = self._inside(evenly_spaced(loop, self.count), middle)
                options.append(_Option(placed, np.zeros(2), self.around(5.0 * (1.0 - share))))
        return options

    def around(self, least: float) -> np.ndarray:
        """Return costs (OFFSETS, OFFSETS) that grow with the square of the distance, in sensing radii."""
        steps = self.offset * np.arange(OFFSETS) / self.problem.sensing
        return least + 10 * (steps[:, None] ** 2 + steps**2)

    def _inside(self, around: np.ndarray, middle: np.ndarray) -> np.ndarray:
        limit = np.maximum(np.array(self.problem.driven) - np.ptp(around, axis=0) / 2, 0)
        return np.clip(middle, -limit, limit) + around - middle_of(around)


def middle_of(loop: np.ndarray) -> np.ndarray:
    """Return the middle (..., 2) of the extent of loops (..., K, 2) [m]."""
    return (loop.min(axis=-2) + loop.max(axis=-2)) / 2


def _is_drivable(loop: np.ndarray, corner: float, problem: Problem, count: int) -> bool:
    """Return whether a car can drive a loop with corners of a radius in `count` control steps."""
    return length_of(loop) <= speed_on(corner, problem) * count * (1 + 1e-9)


def _quality(half: np.ndarray, around: np.ndarray, problem: Problem, offset: float) -> np.ndarray:
    """Return the costs (OFFSETS, OFFSETS) of a loop that watches a rectangle alone: the worst-case undetected time.

    They are in periods, and above `_UNKNOWN` where there is no guarantee.
    """
    cost = np.empty((OFFSETS, OFFSETS))
    for k, m in itertools.product(range(OFFSETS), range(OFFSETS)):
        if min(k, m) > 0 and min(cost[k - 1, m], cost[k, m - 1]) >= _UNKNOWN:  # farther away it is no better
            cost[k, m] = max(cost[k - 1, m], cost[k, m - 1]) + 0.1
            continue
        moved = around + offset * np.array([k, m])
        worst, unvisited, gap = rating_of(moved[None], half, problem, coarse=True)
        cost[k, m] = min(worst / len(around), _UNKNOWN + gap / len(around)) + _UNKNOWN * unvisited
    return cost


def _loops_in(half: np.ndarray, problem: Problem, count: int) -> list[np.ndarray]:
    """Return loops (K, 2) around the origin that a car can drive in K control steps, the best for a rectangle first."""
    rated = []
    largest = np.maximum(np.minimum(half, problem.driven), problem.turning)
    for share_x, share_y in itertools.product(_SHARES, _SHARES):
        size = problem.turning + np.array([share_x, share_y]) * (largest - problem.turning)
        for corner in dict.fromkeys(np.linspace(problem.turning, size.min(), 4).tolist()):
            loop = closed_loop(size[0], size[1], corner)
            if loop is not None and _is_drivable(loop, corner, problem, count):
                around = evenly_spaced(loop, count)
                rated.append((*rating_of(around[None], half, problem), len(rated), around))
    rated.sort(key=lambda rating: rating[:4])
    distinct: list[np.ndarray] = []
    for *_, around in rated:
        size = np.ptp(around, axis=0) / 2
        differences = [np.abs(np.ptp(other, axis=0) / 2 - size).max() for other in distinct]
        if min(differences, default=math.inf) >= _DISTINCT * problem.turning:
            distinct.append(around)
    return distinct
