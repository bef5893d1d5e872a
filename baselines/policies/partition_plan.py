"""The plan of a partition: the division of the rectangle into cells and a synchronised loop in each.

Everything that a plan may be made of is compared by the worst-case undetected time of the ideal motion, on a coarse
grid (`baselines.policies.ideal_motion`): the division, the extent of the loops, their corners, the number of lanes, and
then the directions and phases of neighbouring loops. All loops last the same time, the shortest in which cars can drive
the longest one.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from operator import itemgetter
from typing import Any

import numpy as np

from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.ideal_motion import unvisited_and_gap, worst_undetected_time
from baselines.policies.loops import closed_loop, divisions, evenly_spaced, length_of
from baselines.policies.transit import planned_limits, radius_for_all_cars, required_distance, speed_on_arc
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, flag, number, whole

_EXTENTS = (0.0, 0.3, 0.6, 0.9)
"""Extents of loops that are compared, from the smallest to that of the cell."""
_RATING = itemgetter(0)
"""Key by which plans that are compared are sorted, the best first."""
_QUARTERS = (0.0, 0.25, 0.5, 0.75)
"""Phases that are compared last [period]."""
_TIMES, _REACH = 256, 0.25
"""Fewest times of a long period at which motions are compared; most motion between two of them, in sensing radii."""
_SHAPES, _PATTERNS = 12, 2
"""Shapes whose motion is followed, and how many of these are tried with all directions and phases."""
_MOST_SHAPES = 60
"""Shapes whose motion is followed within an inset if none of the first has a bound."""
_MOST_PLANS = 8
"""Plans within an inset that are tried in turn until there are ways to the loops."""
_WIDER = 1.0, 2.0
"""Tightest turns of loops that are compared for differential drives, in those that they can drive."""
_SENSED = 0.98
"""Share of the sensing radius within an inset, where errors of the following must not open a gap along a wall."""


@dataclass(frozen=True)
class PartitionParameters(Checked):
    """Parameters of a partition, besides the scenario; None selects the best worst-case undetected time."""

    speed: float | None = number(None, 1e-3, 1e4, "m/s")
    """Largest speed on the loops [m/s]; None is 0.75 of the top speed, and less where the slowest car, the grip or a
    turn of 0.4 rad in a control step limits it."""
    rows: int | None = whole(None, 1, 1024)
    """Rows of cells, at most as many as robots."""
    extent_x: float | None = number(None, 0, 1)
    """Extent of the loops along x: 0 is a turning circle, 1 the width of the cell."""
    extent_y: float | None = number(None, 0, 1)
    """Extent of the loops along y: 0 is a turning circle, 1 the height of the cell."""
    lanes: int | None = whole(None, 2, 64, "even")
    """Lanes of a loop."""
    turning: float | None = number(None, 1e-6, 1e4, "m")
    """Radius of the tightest turns of loops [m], if it is above that of the robots; None is that of the robots, or of
    differential drives that or twice that, whichever detects sooner."""
    clearance: float | None = number(None, 0, 1e4, "m")
    """Least distance of two bodies on the loops [m]; None is the radius of a body."""
    in_phase: bool = flag(False)
    """True if all loops have the same direction and phase, so that cars on equal loops never come nearer."""


@dataclass(frozen=True)
class Problem:
    """Constants that a plan depends on; all lengths are relative to the half height of the rectangle."""

    robots: int
    half: tuple[float, float]
    """Half width and half height, 1, of the rectangle that is monitored."""
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
        return self.driven != self.half


@dataclass(frozen=True, eq=False)
class Shape:
    """Cells with loops of one shape."""

    cells: np.ndarray
    """(N, 6) cells."""
    sizes: np.ndarray
    """(N, 2) half extents of the loops."""
    loops: np.ndarray
    """(N, K, 2) places on loops around the origin at each control step, counter-clockwise."""

    def placed(self, half: tuple[float, float], turns: tuple = (0, 0), phases: tuple = (0.0, 0.0)) -> np.ndarray:
        """Return the loops (N, K, 2) at their cells, moved inwards where they would leave the rectangle to drive in.

        Args:
            half: Half width and half height of that rectangle.
            turns: 1 if neighbours in a row go around in opposite directions, and 1 if neighbouring rows do.
            phases: Phase difference of a loop in a row and the one before, and of a row and the one before [period].
        """
        room = (np.array(half) - self.sizes).min(axis=0)
        outermost = np.abs(self.cells[:, :2]).max(axis=0)
        shrink = np.minimum(1, np.divide(room, outermost, out=np.ones(2), where=outermost > 0))
        numbers, count = self.cells[:, 4:], self.loops.shape[1]
        direction = np.where(numbers @ turns % 2 == 1, -1, 1)
        shift = np.rint(numbers @ phases * count)
        at = (direction[:, None] * np.arange(count) + shift[:, None]).astype(int) % count
        around = np.take_along_axis(self.loops, at[:, :, None], axis=1)
        return (self.cells[:, :2] * shrink)[:, None] + around


def least_separation(placed: np.ndarray, others: np.ndarray | None = None) -> float:
    """Return the smallest distance of two robots at any control step, or half way between two.

    Args:
        placed: (N, K, 2) places on loops.
        others: (M, K, 2) places of other robots, if the distances from these are wanted.
    """
    places, rest = _with_middles(placed), None if others is None else _with_middles(others)
    least = math.inf
    for k, place in enumerate(places):  # all pairs at once would not fit into the cache, nor those of many into memory
        between = place - (places[:k] if rest is None else rest)
        least = min(least, float((between[..., 0] ** 2 + between[..., 1] ** 2).min(initial=math.inf)))
    return math.sqrt(least)


def _with_middles(placed: np.ndarray) -> np.ndarray:
    return np.concatenate([placed, (placed + np.roll(placed, -1, axis=1)) / 2], axis=1)


def speed_on_loop(corner: float, problem: Problem) -> float:
    """Return the largest speed on a loop with corners of some radius, a control step."""
    return max(speed_on_arc(corner, problem.speed, problem.grip), 1.02 * problem.slowest)


def _layouts(problem: Problem, members: int, rows: int | None) -> list[np.ndarray]:
    """Return the divisions into a cell for each group of members: into some rows, or those that have no long cells."""
    layouts = divisions(problem.robots // members, problem.half)
    if rows is not None:
        return [cells for cells in layouts if all(len(np.unique(cells[:, k].round(9))) == rows for k in (1, 5))]
    stretch = [float(np.max(np.maximum(cells[:, 2] / cells[:, 3], cells[:, 3] / cells[:, 2]))) for cells in layouts]
    return [cells for cells, ratio in zip(layouts, stretch, strict=True) if ratio <= 2.5 * min(stretch)]


def shapes_of(problem: Problem, parameters: PartitionParameters) -> Iterator[Shape]:
    """Yield the shapes of loops that cars can drive, in the shortest period in which they can.

    Each car has a loop of its own. Within an inset, cars may also share loops, on which they follow one another at even
    distances: all loops have the same number of members.
    """
    most = problem.robots if problem.inside and not parameters.in_phase else 1
    sharing = [members for members in range(1, most + 1) if problem.robots % members == 0]
    layouts = [(members, cells) for members in sharing for cells in _layouts(problem, members, parameters.rows)]
    extents = (*_EXTENTS, 1.0) if problem.inside else _EXTENTS  # sensors have to reach across the inset
    extents_x = extents if parameters.extent_x is None else (parameters.extent_x,)
    extents_y = extents if parameters.extent_y is None else (parameters.extent_y,)
    all_lanes = (2, 4, 6) if parameters.lanes is None else (parameters.lanes,)
    for (members, cells), *share, lanes in itertools.product(layouts, extents_x, extents_y, all_lanes):
        largest = np.minimum(cells[:, 2:4], problem.driven)
        sizes = problem.turning + np.array(share) * np.maximum(largest - problem.turning, 0)
        if lanes > 2 and sizes.min() < 3 * problem.turning:
            continue
        corners = (problem.turning,) if lanes > 2 else (problem.turning, float(sizes.min()))
        for corner in dict.fromkeys(corners):
            distinct, which = np.unique(np.round(sizes, 12), axis=0, return_inverse=True)
            loops: list[Any] = [closed_loop(size[0], size[1], corner, lanes) for size in distinct]
            if all(loop is not None for loop in loops):
                fewest = max(math.ceil(max(map(length_of, loops)) / speed_on_loop(corner, problem) - 1e-9), 8)
                count = members * math.ceil(fewest / members)
                timed = np.stack([evenly_spaced(loop, count) for loop in loops])[which.ravel()]
                shared = [np.roll(loop, -k * count // members, axis=0) for loop in timed for k in range(members)]
                yield Shape(np.repeat(cells, members, axis=0), np.repeat(sizes, members, axis=0), np.array(shared))


@dataclass(frozen=True)
class PartitionLoops:
    """A division of the rectangle and the loops of its cells."""

    cells: np.ndarray
    """(N, 6) centre, half width and half height of the cells [m], number in the row, number of the row."""
    loop: np.ndarray
    """(N, K, 2) places on the loops at each control step of a period [m]."""
    speed: float
    """Speed on the longest loop [m/s]."""


def partition_plans(scenario: Scenario, parameters: PartitionParameters | None = None) -> list[PartitionLoops]:
    """Return partitions of a scenario's rectangle with loops of different shapes, the best first.

    Raises:
        UnsuitableScenarioError: the rectangle is smaller than the turning circle of a car, or the loops have no room
            beside one another.
        ValueError: there are more rows than robots.
    """
    scenario, parameters = scenario.resolve(), parameters or PartitionParameters()
    unit, step = scenario.curve.half_height, scenario.task.step
    problem, curve = problem_of(scenario, parameters), scenario.curve
    turning = problem.turning * unit
    driven, inset = scenario.driven, scenario.inset
    if turning > (smallest := min(driven.half_width, driven.half_height)):
        rule = "partition requires a rectangle that contains a car's turning circle"
        within = f" within an inset of {inset:.3g} m" if inset else ""
        got = f"got one of {smallest:.3g} m to a side{within}"
        raise UnsuitableScenarioError(f"{rule}, of radius {turning:.3g} m, {got}")
    if parameters.rows is not None and parameters.rows > scenario.num_robots:
        raise ValueError(f"rows must be at most the {scenario.num_robots} robots, got {parameters.rows}")
    # A drive, also as the car that stands for it, gains its yaw rate in some time.
    is_drive = math.isfinite(scenario.robot.top_yaw_acceleration) and parameters.turning is None
    widths = [w for w in (_WIDER if is_drive else _WIDER[:1]) if w == 1 or w * turning <= smallest]
    problems = [replace(problem, turning=width * problem.turning) for width in widths]
    ranked = [plan for problem in problems for plan in _ranked(problem, parameters)]
    if not ranked:
        rule = f"partition requires room for {scenario.num_robots} loops of radius {turning:.3g} m"
        rule = f"{rule}, in phase at least {problem.apart * unit:.3g} m from one another"
        raise UnsuitableScenarioError(f"{rule}, got {2 * curve.half_width:g} m x {2 * curve.half_height:g} m")
    plans = []
    for _, shape, loop in sorted(ranked, key=_RATING)[: _MOST_PLANS if problem.inside else 1]:
        speed = float(np.linalg.norm(np.diff(loop[:, :2], axis=1), axis=2).max()) * unit / step
        plans.append(PartitionLoops(shape.cells * np.array([unit, unit, unit, unit, 1, 1]), loop * unit, speed))
    return plans


def problem_of(scenario: Scenario, parameters: PartitionParameters) -> Problem:
    """Return the constants that the plan of a scenario depends on."""
    unit, step = scenario.curve.half_height, scenario.task.step
    speed, grip = planned_limits(scenario)
    return Problem(
        robots=scenario.num_robots,
        half=(scenario.curve.half_width / unit, 1.0),
        driven=(scenario.driven.half_width / unit, scenario.driven.half_height / unit),
        sensing=(_SENSED if scenario.inset else 1.0) * scenario.sensing_radius / unit,
        apart=required_distance(scenario, parameters.clearance) / unit,
        turning=max(radius_for_all_cars(scenario), parameters.turning or 0.0) / unit,
        speed=(parameters.speed or speed) * step / unit,
        slowest=scenario.robot.idle_speed * step / unit,
        grip=grip * step**2 / unit,
        target_speed=scenario.rogue_speed * step / unit,
    )


@lru_cache(maxsize=256)
def _ranked(problem: Problem, parameters: PartitionParameters) -> list[tuple[tuple, Shape, np.ndarray]]:
    """Return ratings, shapes and their loops (N, K, 2) at the cells, the best first; none where no shape has room."""
    compared: list[tuple] = []

    def compare(shape: Shape, *pattern: tuple) -> None:
        """Rate a shape in a pattern, the further arguments of `Shape.placed`, unless robots come too near."""
        placed = shape.placed(problem.driven, *pattern)
        if least_separation(placed) >= problem.apart:
            limit = 1.5 * min(compared, key=_RATING)[0][0] if compared else math.inf
            thin, step = _thinned(placed, problem)
            compared.append((rating_of(thin, problem.half, problem, step, limit), shape, pattern))

    shapes = []
    for shape in shapes_of(problem, parameters):
        placed = shape.placed(problem.driven)
        if least_separation(placed) >= problem.apart:
            thin, step = _thinned(placed, problem)
            unvisited, gap = unvisited_and_gap(thin, problem.half, problem.sensing, coarse=True)
            shapes.append(((unvisited, gap * step), shape))
    shapes = [shape for _, shape in sorted(shapes, key=itemgetter(0))[: _MOST_SHAPES if problem.inside else _SHAPES]]
    for k, shape in enumerate(shapes):
        if k < _SHAPES or min(compared, key=_RATING)[0][0] == math.inf:
            compare(shape, (0, 0), (0.0, 0.0))
    if not parameters.in_phase:
        for _, shape, _ in sorted(compared, key=_RATING)[:_PATTERNS]:
            for *turns, phase_x, phase_y in itertools.product((0, 1), (0, 1), (0.0, 0.5), (0.0, 0.5)):
                compare(shape, tuple(turns), (phase_x, phase_y))
        for _, shape, (turns, _) in sorted(compared, key=_RATING)[:1]:
            for phases in itertools.product(_QUARTERS, _QUARTERS):
                compare(shape, turns, phases)
    best: dict[int, tuple[tuple, Shape, np.ndarray]] = {}
    for rating, shape, pattern in sorted(compared, key=_RATING):
        best.setdefault(id(shape), (rating, shape, shape.placed(problem.driven, *pattern)))
    return list(best.values())


def rating_of(
    loop: np.ndarray, half: tuple, problem: Problem, step: float = 1.0, limit: float = math.inf
) -> tuple[float, float, float]:
    """Return how well robots on loops (N, K, 2), with places `step` apart, watch a rectangle of half sides `half`.

    Returns:
        Worst-case undetected time [control step], infinite above `limit`; share of places that are never visited; and
        longest time between two visits [control step].
    """
    unvisited, gap = unvisited_and_gap(loop, half, problem.sensing)
    worst = math.inf
    if unvisited == 0:
        worst = worst_undetected_time(loop, half, problem.sensing, problem.target_speed, step, limit)
    return worst, unvisited, gap * step


def _thinned(placed: np.ndarray, problem: Problem) -> tuple[np.ndarray, float]:
    """Return places (N, K', 2) on loops (N, K, 2) of long periods, at fewer times, and the control steps between these.

    At least `_TIMES` remain, and a robot moves at most a part of its sensing radius from one to the next.
    """
    count = placed.shape[1]
    every = max(min(count // _TIMES, math.floor(_REACH * problem.sensing / problem.speed)), 1)
    times = count // every
    return placed[:, np.arange(times) * count // times], count / times
