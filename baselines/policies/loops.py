"""Cells of a rectangle, one for each robot, and closed loops that cars can drive: in cells, around it, along lanes."""

import math
from dataclasses import dataclass

import numpy as np

from baselines.similarity import motion_scale
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, flag, number, whole
from lissajous_env.theory import closed_forms
from lissajous_env.theory.geometry import top_speed

_FINE = 79
"""Points of an arc, at most 0.02 rad apart."""
_POINTS, _MOST_POINTS = 2048, 2**20
"""Fewest and most points of a loop."""
_SPACING = 0.125
"""Largest distance of two points of a loop, over the distance of the goal ahead of a car."""
_CRUISE = 0.85
"""Speed of a patrol as a share of the limit, so that a car that fell behind can catch up."""
_ROOM = 1.15
"""Radius of the corners, over that of a car's tightest turn."""
_RAMP = 2.0
"""Distance from the end of a corner beyond which a side is moved by the whole bow, in radii of the corner."""


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
        arrays.append(_in_rows(count, rows, half))
        turned = _in_rows(count, rows, (half[1], half[0]))
        arrays.append(turned[:, [1, 0, 3, 2, 5, 4]])
    # A grid is among the rows and among the columns.
    distinct = {np.round(np.sort(cells[:, :4] / half[1], axis=0), 9).tobytes(): cells for cells in arrays}
    return list(distinct.values())


def _in_rows(count: int, rows: int, half: tuple[float, float]) -> np.ndarray:
    """Return a division into rows of as even numbers of cells as possible, the longer rows in the middle."""
    (width, height), (fewest, longer) = half, divmod(count, rows)
    first, cells, bottom = (rows - longer) // 2, [], -height
    for row in range(rows):
        cells_in_row = fewest + (first <= row < first + longer)
        half_height = height * cells_in_row / count
        for k in range(cells_in_row):
            x = width * ((2 * k + 1) / cells_in_row - 1)
            cells.append((x, bottom + half_height, width / cells_in_row, half_height, k, row))
        bottom += 2 * half_height
    return np.array(cells)


def are_adjacent(cells: np.ndarray) -> np.ndarray:
    """Return whether two cells share a piece of an edge (N, N)."""
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
    """Return a polygon (K, 2) of right angles with its corners replaced by arcs of `points` points each [m].

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


def speed_of(loop: np.ndarray, step: float) -> float:
    """Return the largest speed on loops (..., K, 2) [m], one place a control step [s], in m/s."""
    pieces = np.linalg.norm(loop - np.roll(loop, 1, axis=-2), axis=-1)
    return max(float(pieces.max()) / step, 1e-3)


def arrival_steps(scenario: Scenario, loop: np.ndarray, speed: float) -> int:
    """Return the time that cars of a speed [m/s] need from any start to loops (..., K, 2) [control step]."""
    time = 2 * (scenario.curve.half_width + scenario.curve.half_height) / speed
    return math.ceil(time / scenario.task.step) + 2 * loop.shape[-2]


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


@dataclass(frozen=True)
class SweepParameters(Checked):
    """Parameters of a patrol, besides the scenario; None is derived from it."""

    cruise: float | None = number(None, 1e-3, 1e4, "m/s")
    """Speed of the patrol [m/s]; None is `cruising_speed`, or with `laps` the smaller one of `fastest_speed` and
    `speed_to_turn`."""
    inset: float | None = number(None, 0, 1e4, "m")
    """Distance of the loop from the boundary [m]; None is 0.1 sensing radii where targets enter at the
    boundary, else 0.7, or less if the corners would not fit."""
    lanes: int | None = whole(None, 2, 64, "even")
    """Lanes of the loop; 2 goes around the rectangle. None is described in `patrol_loop`."""
    corner: float | None = number(None, 1e-3, 1e4, "m")
    """Radius of the loop's corners [m]; None is `corner_radius`."""
    bow: float = number(0.0, 0, 1e4, "m")
    """Further distance from the boundary in the middle of each side of a loop around the rectangle [m]. Round corners
    must be close to the boundary to be covered; on the sides a target that flees is better passed from inside."""
    gather: float = number(0.0, 0, 1e4, "s")
    """Time constant in which the slots of `sweep` start to move [s], so that cars reach them sooner."""
    slowest: float | None = number(None, 0, 1e4, "m/s")
    """Lowest speed at which a car of `sweep` waits for its slot, if it is ahead of it on the loop [m/s]; None: cars
    drive straight to their slots."""
    by_phase: bool = flag(False)
    """True if the slot of a car of `sweep`, its place among the cars in single file, follows from its phase alone:
    slots are as evenly spaced as the phases at the start, less `formation.displaced`, but some are far from their cars.
    False: slots have the order of the formation's places along the loop, on which cars off their places disagree."""
    lookahead: float | None = number(None, 1e-3, 1e4, "m")
    """Distance of the goal ahead of a car's place [m]; None is the distance that the patrol drives in
    0.3 s, in the time scale of the paper's experiment, and at least 4 wheelbases."""


def speed_to_turn(scenario: Scenario) -> float:
    """Return the speed v at which a car turns round in half of the rectangle, v^2 = a_lat min(A, B) / 2 [m/s]."""
    driven = scenario.driven
    return math.sqrt(scenario.robot.lateral_acceleration_max * min(driven.half_width, driven.half_height) / 2)


def fastest_speed(scenario: Scenario) -> float:
    """Return the formation's speed where the curve is fastest, or less where top speed or grip limits cars [m/s].

    Where grip limits it, cars can turn round in half of the rectangle at cruising speed.
    """
    formation = top_speed(scenario.driven, scenario.formation.phase_rate)
    return min(scenario.robot.top_speed, formation, speed_to_turn(scenario) / _CRUISE)


def cruising_speed(scenario: Scenario) -> float:
    """Return the speed of a patrol [m/s], far enough below the fastest that a car can catch up with its place."""
    return _CRUISE * fastest_speed(scenario)


def corner_radius(scenario: Scenario, cruise: float | None = None) -> float:
    """Return the radius of the loop's corners [m], which steering and, at cruising speed, grip allow with some room."""
    by_grip = (cruise or cruising_speed(scenario)) ** 2 / scenario.robot.lateral_acceleration_max
    return _ROOM * max(scenario.turning_radius, by_grip)


def lookahead(scenario: Scenario, cruise: float, parameters: SweepParameters) -> float:
    """Return the distance of the goal ahead of a car [m]."""
    return parameters.lookahead or max(4 * scenario.robot.wheelbase, 0.3 * motion_scale(scenario).time * cruise)


def slots_by_phase(scenario: Scenario, loop: np.ndarray) -> tuple[float, float]:
    """Return the turns of the loop per turn of the phase, and the index on the loop (K, 2) [m] of the phase 0.

    They determine a robot's slot, its place among the cars in single file, by its phase alone. The slots of evenly
    spaced phases are evenly spaced if the number of turns has no factor in common with that of the robots. The pair is
    the one with the least sum of two lengths: the mean way from a phase's place on the curve to its slot, and the shift
    of the slot by a deviation of the start.
    """
    count, size = scenario.num_robots, len(loop)
    phases = np.linspace(0, 2 * np.pi, 512, endpoint=False)
    places = closed_forms.curve_point(scenario.driven, scenario.alpha * phases)[:, None]
    origins = np.arange(64) * size // 64
    shift = scenario.formation.start_noise / (2 * np.pi) * length_of(loop)
    best = (math.inf, 0.0, 0.0)
    for turns in (sign * k for k in range(1, max(count, 2)) for sign in (1, -1) if math.gcd(k, count) == 1):
        at = (turns * phases[:, None] / (2 * np.pi) * size + origins).astype(int) % size
        way = np.linalg.norm(loop[at] - places, axis=-1).mean(axis=0)
        best = min(best, (float(way.min()) + abs(turns) * shift, float(turns), float(origins[way.argmin()])))
    return best[1:]


def patrol_loop(scenario: Scenario, parameters: SweepParameters | None = None) -> np.ndarray:
    """Return evenly spaced points (K, 2) of the loop [m], counter-clockwise.

    It goes around the rectangle if targets enter at the boundary (then close to it), if a disc that reaches the
    boundary also reaches the middle, or if it is too short for the corners. Otherwise it goes along lanes of the longer
    side, at most two sensing radii apart, and back along one end. The turns between lanes that are closer than two
    corners are tighter: cars that cut them detect more than around the rectangle, but collide more often.
    """
    parameters = parameters or SweepParameters()
    curve, radius = scenario.driven, scenario.sensing_radius
    short, long = sorted((curve.half_width, curve.half_height))
    corner = parameters.corner or corner_radius(scenario, parameters.cruise)
    at_boundary = scenario.targets.entry == "boundary"
    wanted = (0.1 if at_boundary else 0.7) * radius if parameters.inset is None else parameters.inset
    inset = max(min(wanted, short - corner), 0.0)
    around = at_boundary or short - inset <= radius
    lanes = parameters.lanes or (2 if around else 2 * math.ceil((short - inset) / (2 * radius) + 0.5))
    if long - inset < 2 * corner:
        lanes = 2
    corners = lane_corners(long - inset, short - inset, corner, lanes)
    path = rounded(corners, corner, 16)
    ahead = lookahead(scenario, parameters.cruise or cruising_speed(scenario), SweepParameters())
    count = min(max(math.ceil(length_of(path) / (_SPACING * ahead)), _POINTS), _MOST_POINTS)
    path = resampled(path, count)
    if lanes == 2 and parameters.bow > 0:
        path = resampled(_bowed(path, np.array([long - inset, short - inset]), corner, parameters.bow), count)
    return path[::-1, ::-1] if curve.half_height > curve.half_width else path


def _bowed(path: np.ndarray, half_sides: np.ndarray, corner: float, bow: float) -> np.ndarray:
    """Move the sides of a loop around the rectangle inwards, smoothly from the ends of its corners."""
    from_sides = half_sides - np.abs(path)
    share = np.clip((from_sides.max(axis=1) - corner) / (_RAMP * corner), 0, 1)
    inwards = bow * share**2 * (3 - 2 * share)
    rows, side = np.arange(len(path)), from_sides.argmin(axis=1)
    path[rows, side] -= np.sign(path[rows, side]) * inwards
    return path
