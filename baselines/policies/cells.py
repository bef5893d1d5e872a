"""Cells of a rectangle, one for each robot, and closed loops in them that cars can drive."""

import math

import numpy as np

_FINE = 79
"""Points of an arc, at most 0.02 rad apart."""


def divisions(count: int, half: tuple[float, float]) -> list[np.ndarray]:
    """Return the divisions of a rectangle into rows, or columns, of cells of equal area.

    A row of more cells is higher, so that all cells have the area 4 half[0] half[1] / count.

    Args:
        count: Number of cells.
        half: Half width and half height of the rectangle [m].

    Returns:
        Arrays (count, 6): x, y of the centre, half width, half height [m], number in the row, number of the row.
    """
    arrays = []
    for rows in range(1, count + 1):
        arrays.append(_rows(_shares(count, rows), half))
        turned = _rows(_shares(count, rows), (half[1], half[0]))
        arrays.append(turned[:, [1, 0, 3, 2, 5, 4]])
    # A grid is among the rows and among the columns.
    distinct = {np.round(np.sort(cells[:, :4] / half[1], axis=0), 9).tobytes(): cells for cells in arrays}
    return list(distinct.values())


def _shares(count: int, rows: int) -> list[int]:
    """Return how many cells each row has: as even as possible, the longer rows in the middle."""
    base, more = divmod(count, rows)
    first = (rows - more) // 2
    return [base + (first <= k < first + more) for k in range(rows)]


def _rows(shares: list[int], half: tuple[float, float]) -> np.ndarray:
    width, height = half
    cells, bottom = [], -height
    for row, cells_in_row in enumerate(shares):
        tall = height * cells_in_row / sum(shares)
        for k in range(cells_in_row):
            x = width * ((2 * k + 1) / cells_in_row - 1)
            cells.append((x, bottom + tall, width / cells_in_row, tall, k, row))
        bottom += 2 * tall
    return np.array(cells)


def closed_loop(half_width: float, half_height: float, corner: float, lanes: int = 2) -> np.ndarray | None:
    """Return the points (M, 2) of a loop around the origin [m], counter-clockwise; None where it has no room.

    With two lanes it is a rectangle with round corners: a circle or a stadium where these take all of a side. With
    more, an even number, it goes up and down in lanes along the longer side and back along one end.

    Args:
        half_width: Half of its extent along x [m].
        half_height: Half of its extent along y [m].
        corner: Radius of its corners [m].
        lanes: Number of lanes.
    """
    if half_height > half_width:
        turned = closed_loop(half_height, half_width, corner, lanes)
        return None if turned is None else turned[::-1, ::-1]
    a, b, slack = half_width, half_height, 1e-9 * half_width
    between = 2 * b / (lanes - 1)
    if between < 2 * corner - slack or (lanes > 2 and 2 * a < 4 * corner - slack):
        return None
    return rounded(lane_corners(a, b, corner, lanes), corner, _FINE)


def lane_corners(half_width: float, half_height: float, corner: float, lanes: int) -> np.ndarray:
    """Return the corners (K, 2) of a loop along lanes, from left to right, and back along the left side [m].

    Two lanes are a rectangle. With more, an even number, the way back is beside the turns, of radius `corner`.
    """
    a, b = half_width, half_height
    if lanes == 2:
        return np.array([(-a, -b), (a, -b), (a, b), (-a, b)])
    corners = [(-a, b), (-a, -b)]
    for k, y in enumerate(np.linspace(-b, b, lanes)):
        ends = [(2 * corner - a, y), (a, y)]
        corners += ends if k % 2 == 0 else ends[::-1]
    del corners[2]  # the first lane goes straight on from the way back
    corners.pop()  # and the last one into it
    return np.array(corners)


def rounded(corners: np.ndarray, radius: float, points: int) -> np.ndarray:
    """Return a polygon (K, 2) of right angles with arcs of so many points in their place [m].

    An arc is as wide as the radius, or as half of the shorter side at its corner allows [m].
    """
    onward = np.roll(corners, -1, axis=0) - corners
    sides = np.linalg.norm(onward, axis=1, keepdims=True)
    onward = onward / sides
    shorter = np.minimum(sides, np.roll(sides, 1, axis=0))
    wide = np.where(shorter < 2 * radius * (1 - 1e-9), shorter / 2, radius)[:, None]
    t = np.linspace(0, math.pi / 2, points)[:, None]
    arcs = (1 - np.cos(t)) * onward[:, None] - (1 - np.sin(t)) * np.roll(onward, 1, axis=0)[:, None]
    return (corners[:, None] + wide * arcs).reshape(-1, 2)


def length_of(loop: np.ndarray) -> float:
    """Return the length of a closed polygon [m]."""
    return float(np.linalg.norm(np.diff(loop, axis=0, append=loop[:1]), axis=1).sum())


def evenly_spaced(loop: np.ndarray, count: int) -> np.ndarray:
    """Return `count` points (count, 2) at even distances along a closed polygon, the first one its rightmost [m]."""
    loop = np.roll(loop, -int(np.argmax(loop[:, 0] - 1e-6 * np.abs(loop[:, 1]))), axis=0)
    return resampled(loop, count)


def resampled(loop: np.ndarray, count: int) -> np.ndarray:
    """Return `count` points (count, 2) at even distances along a closed polygon, from its first point [m]."""
    closed = np.vstack([loop, loop[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = along[-1] * np.arange(count) / count
    return np.column_stack([np.interp(at, along, closed[:, k]) for k in range(2)])


def are_adjacent(cells: np.ndarray) -> np.ndarray:
    """Return which cells share a piece of an edge (N, N)."""
    away = np.abs(cells[:, None, :2] - cells[None, :, :2])
    reach = cells[:, None, 2:4] + cells[None, :, 2:4]
    slack = 1e-6 * reach
    return (away <= reach + slack).all(axis=-1) & (away < reach - slack).any(axis=-1) & ~np.eye(len(cells), dtype=bool)


def tour(cells: np.ndarray) -> np.ndarray:
    """Return an order (N,) of the cells, a closed tour in which as many neighbours as possible share an edge.

    It starts to and fro along the rows, and is improved by reversals of a part (2-opt).
    """
    forth = np.where(cells[:, 5] % 2 == 0, cells[:, 4], -cells[:, 4])
    order = np.lexsort((forth, cells[:, 5]))
    away = np.linalg.norm(cells[:, None, :2] - cells[None, :, :2], axis=-1)
    cost = np.where(are_adjacent(cells), 0.0, 1.0) + 1e-3 * away / max(away.max(), 1e-300)
    improved = len(cells) > 3
    while improved:
        improved = False
        for i in range(len(order) - 1):
            onward = np.roll(order, -1)
            later = np.arange(i + 1, len(order))
            gain = cost[order[i], onward[i]] + cost[order[later], onward[later]]
            gain = gain - cost[order[i], order[later]] - cost[onward[i], onward[later]]
            if gain.max() > 1e-9:
                k = later[int(np.argmax(gain))]
                order[i + 1 : k + 1] = order[i + 1 : k + 1][::-1]
                improved = True
    return order
