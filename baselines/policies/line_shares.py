"""Lines of cells that are shared out anew among the robots of a line that work.

The cells of a partition lie in lines, along x or along y. If all robots of a line have received which of them have
failed (`baselines.policies.news`), the others divide the line evenly: each drives a loop in the middle of its share,
and all loops have the period and the phase of the plan, so that robots of a line never come nearer than their shares.
"""

import math
from typing import NamedTuple

import numpy as np

from baselines.policies.loop_shapes import Room
from baselines.policies.partition_plan import Plan
from baselines.policies.repair_plan import OFFSETS, SHAPES, UNKNOWN, LoopSearch, Takeover, middle_of


class Lines(NamedTuple):
    """Lines of a partition's cells, along x or along y."""

    along: int
    """Direction of the lines: 0 for x, 1 for y."""
    robots: np.ndarray
    """(N, L) robots of each robot's line in the order of their cells; -1 behind the last one."""
    centre: np.ndarray
    """(N, 2) centre of each robot's cell [m]."""


def lines_of(plan: Plan, cell: np.ndarray) -> Lines:
    """Return the lines of a plan whose robots have some cells (N,), as long ones as there are."""
    cells = plan.cells[cell]
    found = []
    for along in range(2):
        number = cells[:, 5 - along]  # 5 is the row of a cell, 4 its column
        lines = [np.flatnonzero(number == each) for each in np.unique(number)]
        if all(np.ptp(cells[line, 1 - along]) < 1e-9 * plan.cells[:, 2:4].max() for line in lines):
            found.append((len(lines), along, lines))
    _, along, lines = min(found, key=lambda each: each[:2])
    robots = np.full((len(cells), max(map(len, lines))), -1)
    for line in lines:
        robots[line, : len(line)] = line[np.argsort(cells[line, along])]
    return Lines(along, robots, cells[:, :2])


def line_shares(plan: Plan, cell: np.ndarray, lines: Lines, room: Room, unit: float, offset: float) -> Takeover:
    """Return the loops of each robot when 0, 1, 2 ... others of its line have failed, in the cases 0, 1, 2 ...

    `away` is the middle of a loop less the centre of the robot's cell, and the cost is by how well one robot watches
    its share; where none can watch it alone, it is that of robots side by side (`repair_plan.LoopSearch.beside`).

    Args:
        plan: The plan without failures, all loops in phase.
        cell: (N,) cell of each robot.
        lines: Lines of the cells.
        room: Constants of the plan.
        unit: Half height of the rectangle [m].
        offset: Spacing of the distances at which the quality of a loop is computed [m].
    """
    cells, own = plan.cells[cell][:, :4] / unit, plan.loop[cell] / unit
    count, cases = lines.robots.shape
    reach = (room.half_width, 1.0)[lines.along]
    towards = np.eye(2)[lines.along]
    loop = np.repeat(own[None], cases * SHAPES, axis=0)
    away, cost = np.zeros((cases * SHAPES, count, 2)), np.zeros((cases * SHAPES, count, OFFSETS, OFFSETS))
    search = LoopSearch(room, own.shape[1], offset / unit)
    for robot in range(count):
        line = lines.robots[robot][lines.robots[robot] >= 0]
        strangers = own[np.setdiff1d(np.arange(count), line)]
        for case in range(cases):
            half = cells[robot, 2:4].copy()
            centre = cells[robot, :2]
            if 0 < case < len(line):
                half[lines.along] = reach / (len(line) - case)
            options = [(*each, search.around(float(least[0, 0]))) for *each, least in search.alone(half, centre)]
            if case == 0:
                options = [(own[robot], np.zeros(2), search.around(0.0)), *options]
            elif not (options and options[0][2][0, 0] < UNKNOWN):
                options = search.beside(half, centre, towards)
                options = [(own[robot], middle_of(own[robot]) - centre, search.around(0.0)), *options]
            options = [each for each in options if _passes(each[0], strangers, lines.along, room.apart)]
            options = options or [(own[robot], np.zeros(2), search.around(0.0))]
            for shape in range(SHAPES):
                row = SHAPES * case + shape
                loop[row, robot], away[row, robot], cost[row, robot] = options[min(shape, len(options) - 1)]
    return Takeover(loop * unit, away * unit, cost, offset, np.zeros(loop.shape[:2], dtype=int))


def _passes(loop: np.ndarray, strangers: np.ndarray, along: int, apart: float) -> bool:
    """Return whether a loop (K, 2), moved anywhere along its line, is clear of loops (M, K, 2) of other lines."""
    across = np.abs(loop[:, 1 - along] - strangers[..., 1 - along])
    return float(across.min(initial=math.inf)) >= apart
