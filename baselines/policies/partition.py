"""Area partition: one cell of the rectangle for each car, synchronised loops in the cells, and their repair.

The cells and loops are those with the least worst-case undetected time (`baselines.policies.partition_plan`).
docs/policies.md has the literature, and the limits of both policies.
"""

import contextlib
import itertools
import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.loops import arrival_steps, tour
from baselines.policies.partition_plan import PartitionLoops, PartitionParameters, partition_plans, problem_of
from baselines.policies.path_tables import FINE, PathTables, path_tables
from baselines.policies.registry import register
from baselines.policies.takeover_loops import TakeoverLoops, middle_of, slowed, takeover_loops
from baselines.policies.taking_over import PLACES, WATCH_SIZE, Takeover, take_over, watch_neighbours
from baselines.policies.timed_paths import TimedPaths
from baselines.policies.transit import planned_transit, radius_for_all_cars, required_distance, start_is_known
from lissajous_env.parameters.assumptions import AssumptionWarning
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import number, whole
from lissajous_env.wording import outside

_SPARSE = 0.1
"""Largest distance of two places on a loop that are compared with stopped robots, in required distances."""
_AVOIDANCE = 0.15
"""Distance of a body on a loop from that of a stopped robot, in radii of a body, besides two deviations of noise."""
_MOVED = 0.4
"""Distance by which a loop around a failed robot must be movable without losing its bound, in distances from it."""
_FINER = 10
"""Number of shifts of a loop within the required distance from a stopped robot."""
_DELAYS = 3, 6, 9
"""Times for which cars may stay in formation before they leave it for their loops [control step]."""
_MOST_CANDIDATES = 50
"""Combinations of a plan, a shift of its loops and a delay for which ways are searched."""
_COVERED = 0.98
"""Share of the sensing radius within which a loop passes by corners, for cars that do not follow it exactly."""


@register("partition")
class Partition(TimedPaths):
    """A cell of the rectangle for each car, with loops that are synchronised for the least worst-case undetected time.

    Robots that are neighbours on the ring have neighbouring cells where the start leaves the choice. From a start in
    the equilibrium, whose places are known, each car follows a planned transit (`baselines.policies.transit`) without
    collisions. From other starts, a robot does not know the places of the others: it drives to its cell at once, under
    the collision filter until all of them have had the time to arrive.

    Raises:
        ValueError: no loops that the cars can drive have room in the rectangle, side by side.
    """

    Parameters = PartitionParameters

    def timed(self, scenario: Scenario) -> PathTables:
        """Return the timed paths."""
        self.partition, tables = timed_partition(scenario, self.parameters)
        return tables


@lru_cache(maxsize=64)
def timed_partition(scenario: Scenario, parameters: PartitionParameters) -> tuple[PartitionLoops, PathTables]:
    """Return the plan of a scenario, and its timed paths by robot."""
    plans = partition_plans(scenario, parameters)
    if not start_is_known(scenario) and _is_crowded(scenario, plans[0], parameters):
        # Cars that share a loop would have to overtake each other to reach their places.
        with contextlib.suppress(UnsuitableScenarioError):
            plans = partition_plans(scenario, replace(parameters, in_phase=True))
    forms = (form for plan in plans for form in (plan, slowed(plan, RepairParameters.reserve)))
    plan, cell, shift, entry = _entered(scenario, forms, parameters)
    return plan, path_tables(scenario, np.roll(plan.loop[cell], shift, axis=-2), **entry)


def _is_crowded(scenario: Scenario, plan: PartitionLoops, parameters: PartitionParameters) -> bool:
    """Return whether the loops of a plan overlap between walls."""
    return scenario.inset > 0 and not loops_lie_apart(plan.loop, required_distance(scenario, parameters.clearance))


def _entered(
    scenario: Scenario, plans: Iterator[PartitionLoops], parameters: PartitionParameters
) -> tuple[PartitionLoops, np.ndarray, int, dict[str, Any]]:
    """Return a plan, the cell (N,) of each robot, the shift of the loops [control step], and how cars enter them.

    It is the best plan, or, where that has no ways from a known start onto its loops and these overlap between walls,
    the first one with ways. Without ways, the collision filter leads the cars onto their loops, but not onto loops that
    overlap between walls, where cars that give way meet walls and others.

    Args:
        scenario: The scenario.
        plans: Plans, the best first.
        parameters: Their parameters. With a repair, ring neighbours must have neighbouring cells.

    Returns:
        The last value is an argument of `path_tables`: the ways or the duration of the filter.

    Raises:
        UnsuitableScenarioError: no plan has ways, and the loops of the best one overlap between walls.
    """
    best, is_known, repairs = next(plans), start_is_known(scenario), isinstance(parameters, RepairParameters)
    is_crowded, budget = _is_crowded(scenario, best, parameters), iter(range(_MOST_CANDIDATES))
    for plan in itertools.chain([best] if is_known else [], plans if is_known and is_crowded else []):
        order, assigned = tour(plan.cells), None
        if repairs:
            ways = [np.roll(way, k) for way in (order, order[::-1]) for k in range(len(order))]
            assigned = np.array([in_ring_order(scenario, way) for way in ways])
        for (shift, after), _ in zip(_candidates(scenario, plan), budget, strict=False):
            loop = np.roll(plan.loop, shift, axis=1)
            transit = planned_transit(scenario, loop, parameters.speed, parameters.clearance, assigned, after)
            if transit is not None:
                return plan, transit.chosen, shift - transit.lead_in.shape[1], {"lead_in": transit.lead_in}
    if is_known and is_crowded:
        apart = required_distance(scenario, parameters.clearance)
        rule = f"partition{'-repair' * repairs} requires ways from the start to its loops inside of"
        rule = f"{rule} {scenario.inset:.3g} m from the edge, or loops at least {apart:.3g} m apart at any times"
        got = f"no ways for cars that turn on {radius_for_all_cars(scenario):.3g} m, and loops that overlap"
        raise UnsuitableScenarioError(f"{rule}; smaller bodies or turning circles need less room, got {got}")
    until = 0 if is_crowded else arrival_steps(scenario, best.loop, best.speed)
    return best, in_ring_order(scenario, tour(best.cells)), 0, {"filtered_until": until}


def _candidates(scenario: Scenario, plan: PartitionLoops) -> Iterator[tuple[int, int]]:
    """Yield shifts of the loops of a plan, and times for which the cars stay in formation [control step].

    Cars that can drive along the curve, which is rounded within walls, have more ways to the loops from later places.
    """
    if not scenario.driven.harmonics:
        yield 0, 0
        return
    period = plan.loop.shape[1] * len(np.unique(plan.cells.round(9), axis=0)) // scenario.num_robots
    shifts = range(0, period, max(period // 4, 1))
    yield from ((shift, after) for after, shift in itertools.product(_DELAYS, shifts))


def loops_lie_apart(loops: np.ndarray, distance: float) -> bool:
    """Return whether no places of two loops (N, K, 2), at whatever times, are nearer than a distance [m]."""
    from scipy.spatial import KDTree  # slow to import

    pairs = itertools.combinations(map(KDTree, loops), 2)
    return all(one.query(other.data)[0].min() >= distance for one, other in pairs)


def in_ring_order(scenario: Scenario, order: np.ndarray) -> np.ndarray:
    """Return the cell (N,) of each robot where the ring goes along an order of the cells."""
    cells = np.empty(scenario.num_robots, dtype=int)
    cells[list(scenario.ring)] = order
    return cells


@dataclass(frozen=True)
class RepairParameters(PartitionParameters):
    """Parameters of a partition with repair, besides those of the partition."""

    patience: int = whole(2, 1, 100)
    """Messages without motion after which a ring neighbour counts as failed; more if positions are noisy."""
    reserve: float = number(1.35, 1, 10)
    """Factor by which the period is longer than the shortest, so that cars can drive longer loops in the same time."""


@register("partition-repair")
class PartitionRepair(TimedPaths):
    """A partition whose robots take over the cells of ring neighbours that have failed, and drive around those.

    The loops are those of a partition with all of them in phase, driven slower (`RepairParameters.reserve`), and ring
    neighbours have neighbouring cells. If the messages of a ring neighbour show that it does not move, or if none
    arrive, a robot drives a loop in both cells (`baselines.policies.takeover_loops`). It selects a loop and a place of
    it that are clear of stopped robots: beside them or around them. A robot that resumes waits on its loop until its
    reference comes by. If the robots have no information on each other's starts, the transit uses the collision filter,
    as in `partition`.

    If the loops of different cells do not overlap, a collision filter leads a car that is off its place around others,
    and a loop moves slowly to another place. If loops cross, only their common phase separates the cars; a collision
    filter, which predicts that others drive straight on, would disturb it.

    A robot learns only of failures of its ring neighbours (`baselines.policies.taking_over`), so a cell may remain
    uncovered. An `AssumptionWarning` says so where robots can fail and the loops lie apart.

    Raises:
        ValueError: no loops that the cars can drive have room in the rectangle, side by side.
    """

    communicates = "positions of ring neighbours"
    remembers = (*TimedPaths.remembers, "_watched", "_stopped", "_avoided", "_target")
    waits = True
    Parameters = RepairParameters

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu", parameters: Any = None):
        super().__init__(scenario, num_worlds, device, parameters)
        scenario, drift = self.scenario, self.partition.speed * self.scenario.task.step
        self._watched = wp.zeros((*self.shape, 2, WATCH_SIZE), dtype=wp.float32, device=self.device)
        self._stopped = wp.zeros((*self.shape, PLACES), dtype=wp.vec3, device=self.device)
        self._avoided = wp.zeros((*self.shape, PLACES), dtype=wp.vec3, device=self.device)
        self._case = wp.zeros(self.shape, dtype=wp.int32, device=self.device)
        self._target = wp.zeros(self.shape, dtype=wp.vec2, device=self.device)
        self._takeover = _constants_of(scenario, self.takeover_loops, self._tracking, drift, self.device)
        self._takeover.patience = self.parameters.patience
        if loops_lie_apart(self.partition.loop, required_distance(scenario, self.parameters.clearance)):
            _warn_of_open_cells(scenario)
            self._avoid_others(scenario.robot.radius)

    def timed(self, scenario: Scenario) -> PathTables:
        """Return the timed paths, a variant for each loop of `TakeoverLoops`."""
        self.partition, self.takeover_loops, tables = timed_repair(scenario, self.parameters)
        return tables

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        inputs = [self._curve, self._takeover, observation, self._watched, self._stopped]
        self.launch(watch_neighbours, self.shape, inputs, [self._case])
        inputs = [self._takeover, self._curve, self._pose, self._case, observation, self._stopped]
        inputs += [self._avoided, self._target, self.variant, self.shift]
        self.launch(take_over, self.shape, inputs, [])
        super().decide(observation)


def _warn_of_open_cells(scenario: Scenario) -> None:
    """Warn that the cell of a robot that fails may remain uncovered, if robots can fail."""
    faults = scenario.faults
    if faults.schedule or faults.removed or faults.rate > 0 or faults.lost:
        words = (
            f"scenario {scenario.name}: robots can fail, and in partition-repair only ring neighbours learn of a "
            "failure, so the cell of a failed robot may stay uncovered; another number of rows may avoid this"
        )
        warnings.warn(words, AssumptionWarning, stacklevel=outside())


def _avoided_distance(scenario: Scenario) -> float:
    """Return the smallest distance of a loop from a stopped robot [m]."""
    return (2 + _AVOIDANCE) * scenario.robot.radius + 2 * scenario.noise.position


def _constants_of(scenario: Scenario, loops: TakeoverLoops, tracking: Any, drift: float, device: Any) -> Any:
    """Return the constants of takeovers for their kernels; `drift` is `Takeover.drift`."""
    half = np.array([scenario.driven.half_width, scenario.driven.half_height])
    low, high = loops.loop.min(axis=2), loops.loop.max(axis=2)
    limits = np.concatenate([np.minimum(-half - low, 0), np.maximum(half - high, 0)], axis=-1)
    constants = Takeover()
    # With noisy measurements a stopped robot seems to move, so places are compared between which one moves farther.
    constants.still = max(0.1 * drift, 3 * math.sqrt(2) * scenario.noise.position)
    constants.compared = math.ceil(2 * constants.still / drift)
    constants.tracking, constants.time_unit = tracking, scenario.time_unit
    constants.speed_unit = scenario.robot.top_speed
    constants.sight, constants.robots_seen = scenario.sight, scenario.sensing.robots_seen
    constants.required = required = _avoided_distance(scenario)
    constants.stride, constants.spacing = max(int(_SPARSE * required / (drift / FINE)), 1), required / _FINER
    constants.corner_reach, constants.drift = _COVERED * scenario.sensing_radius, drift
    constants.neighbours = wp.array(scenario.neighbours, dtype=wp.vec2i, device=device)
    constants.shift_limits = wp.array(limits, dtype=wp.vec4, device=device)
    constants.middles = wp.array(middle_of(loops.loop), dtype=wp.vec2, device=device)
    constants.corners = wp.array(loops.corners, dtype=wp.int32, device=device)
    return constants


@lru_cache(maxsize=64)
def timed_repair(scenario: Scenario, parameters: RepairParameters) -> tuple[PartitionLoops, TakeoverLoops, PathTables]:
    """Return the plan, the loops for takeovers and the timed paths."""
    plans = partition_plans(scenario, replace(parameters, in_phase=True))
    plans = (slowed(plan, parameters.reserve) for plan in plans)
    plan, cell, shift, entry = _entered(scenario, plans, parameters)
    problem, unit = problem_of(scenario, parameters), scenario.curve.half_height
    loops = takeover_loops(plan, cell, scenario.neighbours, problem, unit, _MOVED * _avoided_distance(scenario))
    return plan, loops, path_tables(scenario, np.roll(loops.loop, shift, axis=-2), **entry)
