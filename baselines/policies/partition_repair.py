"""Area partition in which robots take over the cells of ring neighbours that have failed.

Robustness, that the work is completed as long as a robot can move, is the second reason for a team beside efficiency:
N. Hazon, G. A. Kaminka, "On redundancy, efficiency, and robustness in coverage for multiple robots", Robotics and
Autonomous Systems 56 (2008).
"""

import math
import warnings
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from baselines.policies.cells import tour
from baselines.policies.failures import PLACES, WATCH, Watch, exchange_news, watch_neighbours
from baselines.policies.loop_shapes import PartitionParameters
from baselines.policies.partition import check_loops_apart, in_ring_order, loops_lie_apart, plain_of
from baselines.policies.partition_plan import Plan, partition_plan, room_of
from baselines.policies.path_tables import FINE, PathTables, path_tables
from baselines.policies.registry import register
from baselines.policies.repair_plan import (
    OFFSETS,
    SHAPES,
    Lines,
    Takeover,
    middle_of,
    slowed,
    takeover_of_lines,
    takeover_of_neighbours,
)
from baselines.policies.safety.filter import Safe
from baselines.policies.taking_over import (
    SIDE,
    Repair,
    case_of_line,
    case_of_neighbours,
    rest_after_failure,
    take_over,
)
from baselines.policies.timed_paths import ARRIVING, TimedPaths
from baselines.policies.transit import arrival_steps, planned_transit, required_distance, start_is_known
from lissajous_env.parameters.assumptions import AssumptionWarning
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, number, whole
from lissajous_env.world.observation import message_start

_SPARSE = 0.1
"""Most distance of two places on a loop that are compared with those of stopped robots, in required distances."""
_AVOIDANCE = 0.15
"""Distance of a loop from the body of a stopped robot, in radii of a body, besides two deviations of noise."""
_FINER = 10
"""Share of the distance from a stopped robot by which two shifts of a loop differ."""
_SEEN = 0.98
"""Share of the sensing radius within which a loop passes by corners, for cars that do not follow it exactly."""


@dataclass(frozen=True)
class RepairParameters(Checked):
    """Parameters of the repair of a partition, besides those of the partition."""

    patience: int = whole(2, 1, 100)
    """Control steps without motion after which a ring neighbour counts as failed."""
    reserve: float = number(1.35, 1, 10)
    """Factor by which the period is longer than the shortest, so that cars can drive longer loops in the same time."""


@register("partition-repair")
class PartitionRepair(TimedPaths):
    """A partition whose robots take over the cells of ring neighbours that have failed, and drive around those.

    The loops are those of a partition with all of them in phase, driven slower (`RepairParameters.reserve`), and ring
    neighbours have neighbouring cells. If the messages of a ring neighbour show that it does not move, or if none
    arrive, a robot drives a loop in both cells (`baselines.policies.repair_plan`). It selects the loop, and the place
    of the loop, such that it is clear of stopped robots: beside them or around them. A robot that resumes waits on its
    loop until its reference comes by. If the robots have no information on each other's starts, the transit uses the
    collision filter, as in `partition`.

    If the loops of different cells do not overlap, a collision filter moves a car that is off its place around others,
    and a loop moves slowly to another place. If loops cross, as in `evaders`, only their common phase separates the
    cars. A filter that expects the others to drive straight on does not account for this: there a robot that stops dead
    at once before another one is not always avoided in time.

    A robot learns of failures only from its own row (`baselines.policies.failures`): the row shows only those of
    its ring neighbours. So a cell may remain uncovered if the ring neighbours of its robot have failed too, or are in
    another line. Where `messages.size` is at least the number of robots and the loops lie apart, robots pass on the
    news of failures, and those of a line of cells that work share the line evenly. Where robots can fail and messages
    alone are missing for this, an `AssumptionWarning` says so.

    Args:
        scenario: The scenario, of cars.
        num_worlds: W.
        device: Warp device.
        parameters: Parameters of the plan that are not optimised.
        repair: Parameters of the reaction to failures.

    Raises:
        ValueError: no loops that the cars can drive have room in the rectangle, side by side.
    """

    communicates = "positions of ring neighbours, and news of failures where messages have room for them"
    remembers = (*TimedPaths.remembers, "_watched", "_standing", "_avoided", "_target", "_news", "_resting")

    def __init__(
        self,
        scenario: Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        parameters: PartitionParameters | None = None,
        repair: RepairParameters | None = None,
    ):
        self.parameters = replace(parameters or PartitionParameters(), in_phase=True)
        self.repair = repair or RepairParameters()
        self.partition, self.takeover, tables, until = timed_repair(
            plain_of(scenario), self.parameters, self.repair.reserve
        )
        super().__init__(scenario, num_worlds, device, tables=tables, filtered_until=until, waits=True)
        scenario, lines, drift = self.scenario, self.takeover.lines, self.partition.speed * self.scenario.task.step
        self._watch = _watch_of(scenario, self.partition, self.repair.patience)
        self._watched = wp.zeros((*self.shape, 2, WATCH), dtype=wp.float32, device=self.device)
        self._standing = wp.zeros((*self.shape, int(PLACES)), dtype=wp.vec3, device=self.device)
        self._avoided = wp.zeros((*self.shape, int(PLACES)), dtype=wp.vec3, device=self.device)
        self._case = wp.zeros(self.shape, dtype=wp.int32, device=self.device)
        self._home = wp.zeros(self.shape, dtype=wp.vec2, device=self.device)
        self._target = wp.zeros(self.shape, dtype=wp.vec4, device=self.device)
        self._news = wp.zeros((*self.shape, self.num_robots if lines else 0), dtype=wp.float32, device=self.device)
        self._neighbours = wp.array(scenario.neighbours, dtype=wp.int32, device=self.device)
        if lines:
            self._line = wp.array(lines.robots, dtype=wp.int32, device=self.device)
            self._centre = wp.array(lines.centre, dtype=wp.vec2, device=self.device)
        self._repair = _repair_of(scenario, self.takeover, tables, drift, self.device)
        self._rest, self._resting = 0.0, wp.zeros(self.shape, dtype=wp.float32, device=self.device)
        if loops_lie_apart(self.partition.loop, required_distance(scenario, self.parameters)):
            if not lines:
                _warn_of_silence(scenario)
            self._filter = self._filter or Safe(scenario, num_worlds, self.device, ARRIVING.of(scenario))
            self._tolerance, self._repair.back = scenario.robot.radius, drift
            middle = middle_of(self.takeover.loop)
            shifted = math.sqrt(2) * int(SIDE) * self._repair.spacing
            self._rest = (float(np.linalg.norm(middle - middle[:1], axis=-1).max()) + shifted) / drift

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        inputs = [self._curve, self._watch, observation, self._watched, self._standing]
        self.launch(watch_neighbours, self.shape, inputs, [])
        if self.takeover.lines:
            self._share_lines(self.takeover.lines, observation)
        else:
            self.launch(case_of_neighbours, self.shape, [self._watched], [self._case])
        inputs = [self._repair, self._curve, self._pose, self._case, self._home, observation, self._standing]
        inputs += [self._avoided, self._target, self.plan, self.shift]
        self.launch(take_over, self.shape, inputs, [])
        super().decide(observation)
        self.launch(rest_after_failure, self.shape, [self._rest, observation], [self._resting, self.action])

    def _share_lines(self, lines: Lines, observation: wp.array) -> None:
        """Exchange the news of failures, and compute each robot's share of its line."""
        inputs = [message_start(self.scenario), self.scenario.task.step, self.scenario.time_unit, self._neighbours]
        inputs += [self._memory, observation, self._watched, self._news, self._standing]
        self.launch(exchange_news, self.shape, inputs, [self.action])
        reach = (self.scenario.curve.half_width, self.scenario.curve.half_height)[lines.along]
        along = wp.vec2(*np.eye(2)[lines.along])
        inputs = [reach, along, self._line, self._centre, self._news]
        self.launch(case_of_line, self.shape, inputs, [self._case, self._home])


def _warn_of_silence(scenario: Scenario) -> None:
    """Warn that messages could carry the news of failures to all robots, but have no room for it."""
    faults = scenario.faults
    if faults.schedule or faults.removed or faults.rate > 0 or faults.lost:
        words = (
            f"scenario {scenario.name}: robots can fail, and partition-repair reports a failure only to ring "
            f"neighbours, so the cell of a failed robot may stay uncovered; for news to all robots messages.size must "
            f"be at least {scenario.num_robots}, got {scenario.messages.size}"
        )
        warnings.warn(words, AssumptionWarning, stacklevel=3)


def _avoided_distance(scenario: Scenario) -> float:
    """Return the smallest distance of a loop from a stopped robot [m]."""
    return (2 + _AVOIDANCE) * scenario.robot.radius + 2 * scenario.noise.position


def _watch_of(scenario: Scenario, plan: Plan, patience: int) -> Any:
    watch, step = Watch(), scenario.task.step
    # With noisy measurements, a stopped robot seems to move.
    watch.still = max(0.1 * plan.speed * step, 3 * math.sqrt(2) * scenario.noise.position)
    watch.patience, watch.step, watch.time_unit = patience, step, scenario.time_unit
    watch.speed_unit, watch.radius = scenario.robot.top_speed, scenario.sight
    watch.robots_seen = scenario.sensing.robots_seen
    return watch


def _repair_of(scenario: Scenario, takeover: Takeover, tables: PathTables, drift: float, device: Any) -> Any:
    """Return the loops of a takeover for its kernel; the middle of one drifts so far in a control step [m].

    Where loops of different cells cross, a robot returns to its own loop at once.
    """
    half = np.array([scenario.driven.half_width, scenario.driven.half_height])
    low, high = takeover.loop.min(axis=2), takeover.loop.max(axis=2)
    margins = np.concatenate([np.minimum(-half - low, 0), np.maximum(half - high, 0)], axis=-1)
    repair = Repair()
    repair.shapes, repair.first, repair.required = SHAPES, FINE * tables.lead_in, _avoided_distance(scenario)
    repair.every = max(int(_SPARSE * _avoided_distance(scenario) / (drift / FINE)), 1)
    repair.spacing, repair.offset = _avoided_distance(scenario) / _FINER, takeover.offset
    repair.sensing, repair.drift, repair.back = _SEEN * scenario.sensing_radius, drift, math.inf
    repair.margins = wp.array(margins, dtype=wp.vec4, device=device)
    repair.middles = wp.array(middle_of(takeover.loop), dtype=wp.vec2, device=device)
    repair.away = wp.array(takeover.away, dtype=wp.vec2, device=device)
    repair.cost = wp.array(takeover.cost, dtype=wp.float32, device=device)
    repair.corners = wp.array(takeover.corners, dtype=wp.int32, device=device)
    return repair


@lru_cache(maxsize=64)
def timed_repair(
    scenario: Scenario, parameters: PartitionParameters, reserve: float
) -> tuple[Plan, Takeover, PathTables, float]:
    """Return the plan, the loops for takeovers, the timed paths, and how long the filter is needed [step].

    The loops are for shares of lines where messages have room for the news of failures, and loops do not cross.
    """
    plan, ways = slowed(partition_plan(scenario, parameters), reserve), None
    order = tour(plan.cells)
    cell = in_ring_order(scenario, order)
    if start_is_known(scenario):
        turned = [in_ring_order(scenario, np.roll(way, k)) for way in (order, order[::-1]) for k in range(len(order))]
        ways = planned_transit(scenario, plan.loop, parameters, np.array(turned))
        if ways is None:
            check_loops_apart(scenario, plan.loop, parameters, "partition-repair")
        else:
            cell = ways.chosen
    offset = _avoided_distance(scenario) * int(SIDE) / _FINER / (OFFSETS - 1)
    room, unit = room_of(scenario, parameters), scenario.curve.half_height
    informed = scenario.messages.size >= scenario.num_robots
    if informed and loops_lie_apart(plan.loop, required_distance(scenario, parameters)):
        taken = takeover_of_lines(plan, cell, room, unit, offset)
    else:
        taken = takeover_of_neighbours(plan, cell, scenario.neighbours, room, unit, offset)
    if ways is None:
        return plan, taken, path_tables(scenario, taken.loop), float(arrival_steps(scenario, plan.loop, plan.speed))
    loop = np.roll(taken.loop, -ways.lead_in.shape[1], axis=2)
    lead_in = np.repeat(ways.lead_in[None], len(loop), axis=0)
    return plan, taken, path_tables(scenario, loop, lead_in), 0.0
