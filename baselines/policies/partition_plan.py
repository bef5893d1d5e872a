"""The plan of a partition: the division of the rectangle into cells and a synchronised loop in each.

Everything that a plan may be made of is compared by the worst-case undetected time of the ideal motion, on a coarse
grid (`baselines.policies.ideal_motion`): the division, the extent of the loops, their corners, the number of lanes, and
then the directions and phases of neighbouring loops. All loops last the same time, the shortest in which cars can drive
the longest one.
"""

import itertools
import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.cells import closed_loop, divisions, evenly_spaced, length_of
from baselines.policies.driving import SPREAD_MAX, slowest_top_speed
from baselines.policies.ideal_motion import coverage, worst_undetected_time
from baselines.policies.transit import Car
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, flag, number, whole
from lissajous_env.theory.geometry import turning_radius

_RESERVE = 0.75
"""Share of the top speed and of the grip that the loops use."""
_TURN = 0.4
"""Largest turn in a control step [rad], in which steering is constant."""
_ROOM = 1.02
"""Corners are wider than the tightest turn of the widest-turning car by this factor."""
_EXTENTS = (0.0, 0.3, 0.6, 0.9)
"""Extents of loops that are compared, from the smallest to that of the cell."""
_ALIKE = (0, 0, 0.0, 0.0)
"""Pattern in which all loops have the same direction and phase."""
_TIMES, _REACH = 256, 0.25
"""Fewest times of a long period at which motions are compared; most motion between two of them, in sensing radii."""
_SHAPES, _PATTERNS = 12, 2
"""Shapes whose motion is followed, and how many of these are tried with all directions and phases."""


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


@dataclass(frozen=True)
class Plan:
    """A division of the rectangle and the loops of its cells."""

    cells: np.ndarray
    """(N, 6) centre, half width and half height of the cells [m], number in the row, number of the row."""
    loop: np.ndarray
    """(N, K, 2) places on the loops at each control step of a period [m]."""
    speed: float
    """Speed on the longest loop [m/s]."""
    worst: float
    """Worst-case undetected time of the ideal motion [s]; infinite if there is none."""


def partition_plan(scenario: Scenario, parameters: PartitionParameters | None = None) -> Plan:
    """Return the best partition of a scenario's rectangle.

    Raises:
        UnsuitableScenarioError: the rectangle is smaller than the turning circle of a car, or the loops have no room
            beside one another.
        ValueError: there are more rows than robots.
    """
    scenario, parameters = scenario.resolve(), parameters or PartitionParameters()
    unit, step = scenario.curve.half_height, scenario.task.step
    room, curve = room_of(scenario, parameters), scenario.curve
    turning, smallest = room.turning * unit, min(curve.half_width, curve.half_height)
    if turning > smallest:
        rule = "partition requires a rectangle that contains a car's turning circle"
        raise UnsuitableScenarioError(f"{rule}, of radius {turning:.3g} m, got one of {smallest:.3g} m to a side")
    if parameters.rows is not None and parameters.rows > scenario.num_robots:
        raise ValueError(f"rows must be at most the {scenario.num_robots} robots, got {parameters.rows}")
    best = _best(room, replace(parameters, speed=None, clearance=None))
    if best is None:
        rule = f"partition requires room for {scenario.num_robots} loops of radius {turning:.3g} m"
        rule = f"{rule}, in phase at least {room.apart * unit:.3g} m from one another"
        raise UnsuitableScenarioError(f"{rule}, got {2 * curve.half_width:g} m x {2 * curve.half_height:g} m")
    cells, loop, worst = best
    cells = cells * np.array([unit, unit, unit, unit, 1, 1])
    speed = float(np.linalg.norm(np.diff(loop[:, :2], axis=1), axis=2).max()) * unit / step
    return Plan(cells, loop * unit, speed, worst * step)


def turning_radius_of(scenario: Scenario) -> float:
    """Return the radius that all cars of a scenario can turn on, the one of the longest wheelbase included [m]."""
    spread = 1 + SPREAD_MAX * scenario.noise.wheelbase_spread
    return _ROOM * spread * turning_radius(scenario.robot.wheelbase, scenario.robot.steering_max)


def required_distance(scenario: Scenario, parameters: PartitionParameters) -> float:
    """Return the least distance of two robots in a plan [m]."""
    radius = scenario.robot.radius
    return 2 * radius + (radius if parameters.clearance is None else parameters.clearance)


def slowest_speed(scenario: Scenario) -> float:
    """Return the speed below which a car cannot drive for long [m/s]."""
    robot = scenario.robot
    if robot.throttle_min <= robot.dead_zone:
        return 0.0
    return max((robot.drive * robot.throttle_min - robot.offset) / robot.drag, 0.0)


def car_of(scenario: Scenario, parameters: PartitionParameters) -> Car:
    """Return the constants of the cars of a scenario for a transit: those of the weakest car."""
    robot, turning, step = scenario.robot, turning_radius_of(scenario), scenario.task.step
    speed = parameters.speed or _RESERVE * robot.top_speed
    speed = min(speed, _TURN * turning / step, math.sqrt(_RESERVE * robot.lateral_acceleration_max * turning))
    slowest = max(1.02 * slowest_speed(scenario), 0.15 * robot.top_speed)
    return Car(turning, max(speed, slowest), slowest, slowest_top_speed(scenario), robot.drag)


def room_of(scenario: Scenario, parameters: PartitionParameters) -> Room:
    """Return the constants that the plan of a scenario depends on."""
    robot, unit, step = scenario.robot, scenario.curve.half_height, scenario.task.step
    return Room(
        robots=scenario.num_robots,
        half_width=scenario.curve.half_width / unit,
        sensing=scenario.sensing_radius / unit,
        apart=required_distance(scenario, parameters) / unit,
        turning=turning_radius_of(scenario) / unit,
        speed=(parameters.speed or _RESERVE * robot.top_speed) * step / unit,
        slowest=slowest_speed(scenario) * step / unit,
        grip=_RESERVE * robot.lateral_acceleration_max * step**2 / unit,
        target_speed=scenario.rogue_speed * step / unit,
    )


@lru_cache(maxsize=256)
def _best(room: Room, parameters: PartitionParameters) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Return the cells, loops and worst-case undetected time [control steps] of the best plan; None for none."""
    half = (room.half_width, 1.0)
    shapes = []
    for shape in _shapes(room, parameters, half):
        placed = shape.placed(half)
        if smallest_distance(placed) >= room.apart:
            thin, step = _thinned(placed, room)
            never, longest = coverage(thin, half, room.sensing, coarse=True)
            shapes.append((never, longest * step, len(shapes), shape))
    if not shapes:
        return None
    search = _Search(room, half)
    for *_, shape in sorted(shapes, key=lambda each: each[:3])[:_SHAPES]:
        search.compare(shape, _ALIKE)
    leading = sorted(search.compared, key=lambda each: each[0])[:_PATTERNS]
    for _, shape, _ in () if parameters.in_phase else leading:
        for turns in itertools.product((0, 1), (0, 1), (0.0, 0.5), (0.0, 0.5)):
            search.compare(shape, turns)
    _, shape, (turn_x, turn_y, *_) = search.best
    quarters = (0.0,) if parameters.in_phase else (0.0, 0.25, 0.5, 0.75)
    for phases in itertools.product(quarters, quarters):
        search.compare(shape, (turn_x, turn_y, *phases))
    (worst, *_), shape, pattern = search.best
    placed = shape.placed(half, *pattern)
    if math.isfinite(worst) and _thinned(placed, room)[1] > 1:
        worst = worst_undetected_time(placed, half, room.sensing, room.target_speed, 1.0)
    return shape.cells, placed, worst


class _Search:
    """Shapes and patterns that were compared, each with its score, shape and pattern, and the best of them."""

    def __init__(self, room: Room, half: tuple[float, float]):
        self.room, self.half = room, half
        self.compared: list = []

    @property
    def best(self) -> tuple:
        return min(self.compared, key=lambda each: each[0])

    def compare(self, shape: "_Shape", pattern: tuple) -> None:
        """Score a shape in a pattern by worst-case undetected time, share never visited, and time between visits."""
        placed = shape.placed(self.half, *pattern)
        if smallest_distance(placed) < self.room.apart:
            return
        limit = 1.5 * self.best[0][0] if self.compared else math.inf
        thin, step = _thinned(placed, self.room)
        never, longest = coverage(thin, self.half, self.room.sensing)
        worst = math.inf
        if never == 0:
            worst = worst_undetected_time(thin, self.half, self.room.sensing, self.room.target_speed, step, limit)
        self.compared.append(((worst, never, longest * step), shape, pattern))


def _thinned(placed: np.ndarray, room: Room) -> tuple[np.ndarray, float]:
    """Return places (N, K', 2) on loops (N, K, 2) of long periods, at fewer times, and the control steps between these.

    At least `_TIMES` remain, and a robot moves at most a part of its sensing radius from one to the next.
    """
    count = placed.shape[1]
    every = max(min(count // _TIMES, math.floor(_REACH * room.sensing / room.speed)), 1)
    kept = count // every
    return placed[:, np.arange(kept) * count // kept], count / kept


def _shapes(room: Room, parameters: PartitionParameters, half: tuple[float, float]):
    """Yield all shapes of loops that cars can drive."""
    found = divisions(room.robots, half)
    if parameters.rows is not None:
        found = [cells for cells in found if len(np.unique(np.round(cells[:, 1], 9))) == parameters.rows]
    else:
        stretch = [float(np.max(np.maximum(cells[:, 2] / cells[:, 3], cells[:, 3] / cells[:, 2]))) for cells in found]
        found = [cells for cells, each in zip(found, stretch, strict=True) if each <= 2.5 * min(stretch)]
    extents_x = _EXTENTS if parameters.extent_x is None else (parameters.extent_x,)
    extents_y = _EXTENTS if parameters.extent_y is None else (parameters.extent_y,)
    all_lanes = (2, 4, 6) if parameters.lanes is None else (parameters.lanes,)
    for cells, along_x, along_y, lanes in itertools.product(found, extents_x, extents_y, all_lanes):
        share = np.array([along_x, along_y])
        largest = np.minimum(cells[:, 2:4], half)
        sizes = room.turning + share * np.maximum(largest - room.turning, 0)
        if lanes > 2 and sizes.min() < 3 * room.turning:
            continue
        corners = (room.turning,) if lanes > 2 else (room.turning, float(sizes.min()))
        for corner in dict.fromkeys(corners):
            distinct, which = np.unique(np.round(sizes, 12), axis=0, return_inverse=True)
            loops = [closed_loop(size[0], size[1], corner, lanes) for size in distinct]
            if all(loop is not None for loop in loops):
                yield _Shape(cells, sizes, _timed(loops, room, corner)[which.ravel()])


def speed_on(corner: float, room: Room) -> float:
    """Return the largest speed on a loop with corners of some radius, a control step."""
    return max(min(room.speed, math.sqrt(room.grip * corner), _TURN * corner), 1.02 * room.slowest)


def _timed(loops: list, room: Room, corner: float) -> np.ndarray:
    """Return places (N, K, 2) on loops at each control step, for the shortest period that the cars can drive."""
    count = max(math.ceil(max(map(length_of, loops)) / speed_on(corner, room) - 1e-9), 8)
    return np.stack([evenly_spaced(loop, count) for loop in loops])


@dataclass(frozen=True, eq=False)
class _Shape:
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
        """Return the loops (N, K, 2) at their cells, moved inwards where they would leave the rectangle.

        Args:
            half: Half width and half height of the rectangle.
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
