"""Area partition whose robots take over the cells of ring neighbours that have failed.

Robustness, that the work is completed as long as a robot can move, is the second reason for a team beside efficiency:
N. Hazon, G. A. Kaminka, "On redundancy, efficiency, and robustness in coverage for multiple robots", Robotics and
Autonomous Systems 56 (2008).
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from baselines.policies.cells import tour
from baselines.policies.memory import clear_worlds
from baselines.policies.neighbour_watch import PLACES, STATE, WATCH, WORKS, Watch, watch_neighbours
from baselines.policies.partition import arrival_of_all, plain_of, planned_transit, start_is_known, take_filtered
from baselines.policies.partition_plan import PartitionParameters, Plan, partition_plan, room_of
from baselines.policies.path_tables import FINE, PathTables, path_tables
from baselines.policies.patrol import Still
from baselines.policies.registry import register
from baselines.policies.repair_plan import OFFSETS, SHAPES, Takeover, slowed, takeover
from baselines.policies.timed_paths import TimedPaths, TrackingParameters
from baselines.safety.filter import Safe
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, number, whole

wp.set_module_options(OPTIONS)

_SIDE = wp.constant(6)
"""Shifts that are compared to each side, along x and y."""
_FINER = 5
"""Share of the distance from a robot that stands by which these differ."""


@dataclass(frozen=True)
class RepairParameters(Checked):
    """Parameters of the repair of a partition, besides those of the partition."""

    patience: int = whole(2, 1, 100)
    """Control steps without motion after which a ring neighbour counts as failed."""
    reserve: float = number(1.35, 1, 10)
    """Factor by which the period is longer than the shortest, so that cars can drive longer loops in the same time."""
    avoidance: float | None = number(None, 0, 1e4, "m")
    """Distance of a loop from the body of a robot that stands, besides its own [m]; None is 0.15 radii, and
    two deviations of noise."""


@wp.func
def clearance_of(path: wp.array(dtype=wp.vec4), first: int, shift: wp.vec2, standing: wp.array(dtype=wp.vec3)) -> float:
    """Return the smallest distance of a shifted loop from the robots that stand [m]."""
    least = float(wp.inf)
    for k in range(standing.shape[0]):
        if standing[k][2] > 0.0:
            place = wp.vec2(standing[k][0], standing[k][1]) - shift
            for sample in range(first, path.shape[0]):
                least = wp.min(least, wp.length(wp.vec2(path[sample][0], path[sample][1]) - place))
    return least


@wp.func
def cost_of(costs: wp.array2d(dtype=float), away: wp.vec2, offset: float) -> float:
    """Return the cost of a loop whose middle is some way from the best place, between those of a table."""
    last = float(costs.shape[0] - 1)
    x = wp.min(wp.abs(away[0]) / offset, last)
    y = wp.min(wp.abs(away[1]) / offset, last)
    column = wp.min(int(x), costs.shape[0] - 2)
    row = wp.min(int(y), costs.shape[0] - 2)
    x -= float(column)
    y -= float(row)
    lower = (1.0 - x) * costs[column, row] + x * costs[column + 1, row]
    upper = (1.0 - x) * costs[column, row + 1] + x * costs[column + 1, row + 1]
    return (1.0 - y) * lower + y * upper


@wp.kernel
def take_over(
    first: int,
    shapes: int,
    spacing: float,
    required: float,
    offset: float,
    pose: wp.array3d(dtype=wp.vec4),
    margins: wp.array2d(dtype=wp.vec4),
    away: wp.array2d(dtype=wp.vec2),
    costs: wp.array4d(dtype=float),
    watched: wp.array4d(dtype=float),
    standing: wp.array3d(dtype=wp.vec3),
    avoided: wp.array3d(dtype=wp.vec3),
    plan: wp.array2d(dtype=int),
    shift: wp.array2d(dtype=wp.vec2),
):
    """Choose each robot's loop and shift by its ring neighbours' states, clear of robots that stand.

    Of those that are clear it is the one of the least cost (`Takeover`), and then of the least shift. `margins` are how
    far a loop can be moved to the left, down, to the right and up within the rectangle [m].
    """
    w, i = wp.tid()
    case = int(0)
    for side in range(2):
        if watched[w, i, side, STATE] != float(WORKS):
            case += 1 + side
    changed = case != plan[w, i] / shapes
    stands = float(0.0)
    for k in range(PLACES):
        stands += standing[w, i, k][2]
        if wp.length(standing[w, i, k] - avoided[w, i, k]) > 0.25 * spacing:
            changed = True
    if not changed:
        return
    for k in range(PLACES):
        avoided[w, i, k] = standing[w, i, k]
    best = wp.vec2(0.0, 0.0)
    best_shape = int(0)
    best_cost = float(wp.inf)
    for shape in range(shapes):
        path = pose[case * shapes + shape, i]
        margin = margins[case * shapes + shape, i]
        for row in range(-_SIDE, _SIDE + 1):
            for column in range(-_SIDE, _SIDE + 1):
                x = wp.clamp(float(column) * spacing, margin[0], margin[2])
                y = wp.clamp(float(row) * spacing, margin[1], margin[3])
                tried = wp.vec2(x, y)
                # A collision costs more than any place, and that more than a shift.
                cost = 0.01 * wp.length(tried) / required
                cost += cost_of(costs[case * shapes + shape, i], away[case * shapes + shape, i] + tried, offset)
                if stands > 0.0 and cost < best_cost:
                    missed = wp.max(required - clearance_of(path, first, tried, standing[w, i]), 0.0)
                    cost += 1000.0 * missed / required
                if cost < best_cost and (stands > 0.0 or (row == 0 and column == 0)):
                    best_cost = cost
                    best = tried
                    best_shape = shape
        if stands == 0.0:  # the first is the best
            break
    plan[w, i] = case * shapes + best_shape
    shift[w, i] = best


@register("partition-repair")
class PartitionRepair(TimedPaths):
    """A partition whose robots take over the cells of ring neighbours that have failed, and drive around those.

    The loops are those of a partition with all of them in phase, driven slower (`RepairParameters.reserve`), and ring
    neighbours have neighbouring cells. A robot that hears from a ring neighbour that this does not move, or hears
    nothing, drives a loop in both cells (`baselines.policies.repair_plan`). It selects the loop, and where to move it,
    so that it is clear of robots that stand: beside them or around them. A robot that resumes waits on its loop until
    its reference comes by. From starts that the robots do not know of one another, the collision filter is under the
    transit, as in `partition`.

    A robot knows of failures what its own row shows (`baselines.policies.neighbour_watch`): of others than its ring
    neighbours it knows nothing. Where two neighbours fail together, the farther cell may stay open. A robot that stops
    dead at once before another one, on a stretch that their loops share, is not avoided in time.

    Args:
        scenario: The scenario, of cars.
        num_worlds: W.
        device: Warp device.
        parameters: What is not to be optimised.
        repair: Of the reaction to failures.
        tracking: Gains and limits of the following of the loops.

    Raises:
        ValueError: no loops that the cars can drive have room in the rectangle, side by side.
    """

    communicates = "positions of ring neighbours"

    def __init__(
        self,
        scenario: Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        parameters: PartitionParameters | None = None,
        repair: RepairParameters | None = None,
        tracking: TrackingParameters | None = None,
    ):
        self.parameters = replace(parameters or PartitionParameters(), in_phase=True)
        self.repair = repair or RepairParameters()
        self.partition, self.takeover, tables, until = timed_repair(plain_of(scenario), self.parameters, self.repair)
        plan = np.zeros(num_worlds, dtype=int)
        tracking = tracking or TrackingParameters(waits=True)
        super().__init__(scenario, num_worlds, device, tables=tables, plan=plan, parameters=tracking)
        self._required = _avoided_distance(self.scenario, self.repair)
        self._watch = _watch_of(self.scenario, self.partition, self.repair)
        half = np.array([self.scenario.curve.half_width, self.scenario.curve.half_height])
        low, high = self.takeover.loop.min(axis=2), self.takeover.loop.max(axis=2)
        margins = np.concatenate([np.minimum(-half - low, 0), np.maximum(half - high, 0)], axis=-1)
        self._margins = wp.array(margins, dtype=wp.vec4, device=self.device)
        self._away = wp.array(self.takeover.away, dtype=wp.vec2, device=self.device)
        self._cost = wp.array(self.takeover.cost, dtype=wp.float32, device=self.device)
        self._watched = wp.zeros((*self.shape, 2, WATCH), dtype=wp.float32, device=self.device)
        self._standing = wp.zeros((*self.shape, int(PLACES)), dtype=wp.vec3, device=self.device)
        self._avoided = wp.zeros((*self.shape, int(PLACES)), dtype=wp.vec3, device=self.device)
        self._filtered_until = until
        self._filter = Safe(Still(self.scenario, num_worlds, self.device)) if until > 0 else None

    def forget(self, mask: np.ndarray) -> None:
        """Forget the time, what is known of others, and what the cars have learned of themselves."""
        super().forget(mask)
        if self._filter is not None:
            self._filter.forget(mask)
        for memory in (self._watched, self._standing, self._avoided):
            clear_worlds(memory, mask)

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        inputs = [self._curve, self._watch, observation, self._watched, self._standing]
        self.launch(watch_neighbours, self.shape, inputs, [])
        inputs = [self.tables.lead_in * FINE, SHAPES, self._required / _FINER, self._required, self.takeover.offset]
        inputs += [self._pose, self._margins, self._away, self._cost, self._watched, self._standing, self._avoided]
        inputs += [self.plan, self.shift]
        self.launch(take_over, self.shape, inputs, [])
        self.follow(observation)
        if self._filter is not None:
            filtered = self._filter.filter(observation, self.action)
            self.launch(take_filtered, self.shape, [self._filtered_until, self._memory, filtered], [self.action])


def _avoided_distance(scenario: Scenario, repair: RepairParameters) -> float:
    """Return the least distance of a loop from a robot that stands [m]."""
    radius = scenario.robot.radius
    avoidance = 0.15 * radius + 2 * scenario.noise.position if repair.avoidance is None else repair.avoidance
    return 2 * radius + avoidance


def _watch_of(scenario: Scenario, plan: Plan, repair: RepairParameters) -> Any:
    watch, step = Watch(), scenario.task.step
    # A robot that stands seems to move where its measurements are noisy.
    watch.still = max(0.1 * plan.speed * step, 3 * math.sqrt(2) * scenario.noise.position)
    watch.patience, watch.step, watch.time_unit = repair.patience, step, scenario.time_unit
    watch.speed_unit, watch.radius = scenario.robot.top_speed, scenario.sensing_radius
    watch.robots_seen = scenario.sensing.robots_seen
    return watch


@lru_cache(maxsize=64)
def timed_repair(
    scenario: Scenario, parameters: PartitionParameters, repair: RepairParameters
) -> tuple[Plan, Takeover, PathTables, float]:
    """Return the plan, the loops for takeovers, the timed paths, and how long the filter is needed [step]."""
    plan = slowed(partition_plan(scenario, parameters), repair.reserve)
    order = tour(plan.cells)
    cell, lead_in = _in_ring_order(scenario, order), None
    if start_is_known(scenario):
        turned = [_in_ring_order(scenario, np.roll(way, k)) for way in (order, order[::-1]) for k in range(len(order))]
        planned = planned_transit(scenario, plan, parameters, np.array(turned))
        if planned is not None:
            lead_in, cell = planned
    unit = scenario.curve.half_height
    offset = _avoided_distance(scenario, repair) * int(_SIDE) / _FINER / (OFFSETS - 1)
    taken = takeover(plan, cell, scenario.neighbours, room_of(scenario, parameters), unit, offset)
    if lead_in is None:
        return plan, taken, path_tables(scenario, taken.loop), arrival_of_all(scenario, plan)
    loop = np.roll(taken.loop, -lead_in.shape[1], axis=2)
    return plan, taken, path_tables(scenario, loop, np.repeat(lead_in[None], len(loop), axis=0)), 0.0


def _in_ring_order(scenario: Scenario, order: np.ndarray) -> np.ndarray:
    """Return the cell (N,) of each robot where the ring goes along an order of the cells."""
    cells = np.empty(scenario.num_robots, dtype=int)
    cells[list(scenario.ring)] = order
    return cells
