"""Loops on which the ring neighbours of a robot that has failed cover its cell.

A robot has loops for four cases: none of its ring neighbours has failed, the previous one, the next one, or both. In
each case it watches the rectangle around its own cell and those of the failed neighbours, for which there are a few
loops of different shapes, the best first. The robot drives one that is clear of the stopped robots. All loops have the
period and the phase of the plan: two robots on equal loops in phase never come nearer than the centres of these.
"""

import itertools
import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from baselines.policies.loops import are_adjacent, closed_loop, evenly_spaced, length_of
from baselines.policies.partition_plan import PartitionLoops, Problem, least_separation, rating_of, speed_on_loop

SHAPES = 4
"""Loops of different shapes for each case."""
CASES = 4
"""Cases of a robot, by the sum of 1 for a failed previous and 2 for a failed next robot."""
_TOWARDS = 0.3
"""Share of the way to a neighbour's cell by which a robot that cannot watch both alone moves its loop."""
_SHARES = (0.0, 0.3, 0.6, 1.0)
"""Extents of loops that are compared: 0 is a turning circle, 1 the rectangle."""
_ALIKE = 1e-6
"""Difference of two places, in half heights of the rectangle, up to which they are the same."""
_DISTINCT = 0.1
"""Difference of two shapes' half extents, in turning radii, from which on they count as different."""


@dataclass(frozen=True)
class TakeoverLoops:
    """Loops of each robot in its cases; row SHAPES c + s is for case c."""

    loop: np.ndarray
    """(CASES SHAPES, N, K, 2) places at each control step of a period [m]."""
    corners: np.ndarray
    """(CASES, N) corners of the rectangle that only this robot watches, as bits: 1 at the left and bottom, 2 at the
    right and bottom, 4 at the left and top, 8 at the right and top."""


def slowed(plan: PartitionLoops, reserve: float) -> PartitionLoops:
    """Return a plan whose loops last longer by a factor `reserve`, in which the cars could drive longer loops.

    Places between the given ones are those of the Fourier series of the loops.
    """
    period = plan.loop.shape[1]
    count = math.ceil(period * reserve - 1e-9)
    waves = np.fft.fft(plan.loop, axis=1)
    waves = np.insert(waves, [(period + 1) // 2] * (count - period), 0, axis=1)  # faster ones are 0
    loop = np.real(np.fft.ifft(waves, axis=1)) * count / period
    return replace(plan, loop=loop, speed=plan.speed * period / count)


def takeover_loops(
    plan: PartitionLoops, cell: np.ndarray, neighbours: np.ndarray, problem: Problem, unit: float, moved: float
) -> TakeoverLoops:
    """Return the loops of robots that take over the cells of ring neighbours.

    A cell that shares no edge with the robot's own is left to the other neighbour. Loops that come too near to
    those of the robots that have not failed are left out.

    Args:
        plan: The plan without failures, all loops in phase.
        cell: (N,) cell of each robot.
        neighbours: (N, 2) previous and next robot on the ring, -1 for none.
        problem: Constants of the plan.
        unit: Half height of the rectangle [m].
        moved: Distance [m]; a loop for failed neighbours must bound the undetected time also if it is moved by this
            distance to the right, up or both.
    """
    cells, own = plan.cells[cell][:, :4] / unit, plan.loop[cell] / unit
    loop, adjacent = np.repeat(own[None], CASES * SHAPES, axis=0), are_adjacent(cells)
    corners = np.zeros((CASES, len(cells)), dtype=int)
    for case, robot in itertools.product(range(CASES), range(len(cells))):
        failed = [neighbours[robot, side] for side in range(2) if case >> side & 1]
        failed = [other for other in failed if other >= 0 and adjacent[robot, other]]
        low = (cells[[robot, *failed], :2] - cells[[robot, *failed], 2:4]).min(axis=0)
        high = (cells[[robot, *failed], :2] + cells[[robot, *failed], 2:4]).max(axis=0)
        corners[case, robot] = _corners_of(low, high, problem.half[0])
        half, middle = tuple(((high - low) / 2).round(9).tolist()), (low + high) / 2
        options, is_bounded = _watching_alone(half, problem, own.shape[1], moved / unit)
        if failed and not is_bounded:
            ways = cells[failed, :2] - cells[robot, :2]  # those to opposite sides cancel in a sum
            options = _watching_in_phase(half, np.abs(ways).sum(axis=0), problem, own.shape[1])
            middle = middle_of(own[robot]) + _TOWARDS * ways.sum(axis=0)
        others = own[np.delete(np.arange(len(cells)), [robot, *failed])]
        placed = [own[robot]] if not failed else []  # the loop of the plan comes first
        placed += [_placed(option, middle, problem) for option in options]
        clear = [option for option in placed if least_separation(option[None], others) >= problem.apart]
        for shape in range(SHAPES if clear else 0):  # the last one is repeated
            loop[SHAPES * case + shape, robot] = clear[min(shape, len(clear) - 1)]
    return TakeoverLoops(loop * unit, corners)


def _corners_of(low: np.ndarray, high: np.ndarray, half_width: float) -> int:
    """Return the corners of the rectangle that a part of it has, as bits (`TakeoverLoops.corners`)."""
    left, right = low[0] < -half_width + _ALIKE, high[0] > half_width - _ALIKE
    bottom, top = low[1] < -1.0 + _ALIKE, high[1] > 1.0 - _ALIKE
    return sum(bool(has) << k for k, has in enumerate((left & bottom, right & bottom, left & top, right & top)))


def middle_of(loop: np.ndarray) -> np.ndarray:
    """Return the middle (..., 2) of the extent of loops (..., K, 2) [m]."""
    return (loop.min(axis=-2) + loop.max(axis=-2)) / 2


def _placed(loop: np.ndarray, middle: np.ndarray, problem: Problem) -> np.ndarray:
    """Return a loop (K, 2) around a place, or as near to it as the rectangle to drive in allows."""
    limit = np.maximum(np.array(problem.driven) - np.ptp(loop, axis=0) / 2, 0)
    return np.clip(middle, -limit, limit) + loop - middle_of(loop)


def _drivable(size: np.ndarray, corner: float, problem: Problem, count: int) -> list[np.ndarray]:
    """Return the loop (K, 2) of half extents and corners, or none if cars need more than `count` control steps."""
    loop = closed_loop(size[0], size[1], corner)
    if loop is None or length_of(loop) > speed_on_loop(corner, problem) * count * (1 + 1e-9):
        return []
    return [evenly_spaced(loop, count)]


@lru_cache(maxsize=256)
def _watching_alone(
    half: tuple[float, float], problem: Problem, count: int, moved: float
) -> tuple[list[np.ndarray], bool]:
    """Return loops (K, 2) of K control steps by which one robot watches a rectangle, at most SHAPES, the best first.

    The second value is True if the first one bounds the undetected time, also if `moved` to the right, up or both.
    """
    rated = []
    largest = np.maximum(np.minimum(half, problem.driven), problem.turning)
    for share_x, share_y in itertools.product(_SHARES, _SHARES):
        size = problem.turning + np.array([share_x, share_y]) * (largest - problem.turning)
        for corner in dict.fromkeys(np.linspace(problem.turning, size.min(), 4).tolist()):
            for around in _drivable(size, corner, problem, count):
                rated.append((*rating_of(around[None], half, problem), len(rated), around))
    distinct: list[np.ndarray] = []
    for *_, around in sorted(rated, key=lambda rating: rating[:4]):
        size = np.ptp(around, axis=0) / 2
        differences = [np.abs(np.ptp(other, axis=0) / 2 - size).max() for other in distinct]
        if min(differences, default=math.inf) >= _DISTINCT * problem.turning:
            distinct.append(around)
    places = [distinct[0] + moved * np.array(way) for way in itertools.product(range(2), range(2)) if distinct]
    bounded = [rating_of(at[None], half, problem)[0] < math.inf for at in places]
    return distinct[:SHAPES], bool(distinct) and all(bounded)


def _watching_in_phase(half: tuple[float, float], way: np.ndarray, problem: Problem, count: int) -> list[np.ndarray]:
    """Return loops (K, 2) by which robots in phase, side by side, watch a rectangle that none of them could alone.

    In phase, their distances are constant; where these are below two sensing radii, nothing passes between the discs.
    The first loop is as long as the rectangle across the way (2,) to those that have failed, and can lead around one.
    """
    across, loops = int(way[0] >= way[1]), []
    for share in (1.0, 0.5, 0.0):
        size = np.full(2, problem.turning)
        size[across] += share * max(min(half[across], problem.driven[across]) - problem.turning, 0)
        loops += _drivable(size, problem.turning, problem, count)
    return loops
