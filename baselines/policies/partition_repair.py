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
from baselines.policies.line_shares import Lines, line_shares, lines_of
from baselines.policies.loop_shapes import PartitionParameters
from baselines.policies.neighbour_watch import PLACES, WATCH, Watch, watch_neighbours
from baselines.policies.news import exchange_news, share_line
from baselines.policies.partition import (
    check_loops_apart,
    loops_lie_apart,
    plain_of,
)
from baselines.policies.partition_plan import Plan, partition_plan, room_of
from baselines.policies.path_tables import FINE, PathTables, path_tables
from baselines.policies.registry import register
from baselines.policies.repair_plan import OFFSETS, SHAPES, Takeover, slowed, takeover
from baselines.policies.safety.filter import Safe
from baselines.policies.taking_over import (
    FINER,
    SEEN,
    SIDE,
    case_of_neighbours,
    rest_after_failure,
    take_clear,
    take_over,
)
from baselines.policies.timed_paths import ARRIVING, TimedPaths, take_filtered
from baselines.policies.transit import arrival_steps, planned_transit, required_distance, start_is_known
from lissajous_env.parameters.assumptions import AssumptionWarning
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, number, whole
from lissajous_env.world.observation import message_start

_SPARSE = 0.1
"""Most distance of two places on a loop that are compared with those of stopped robots, in required distances."""


@dataclass(frozen=True)
class RepairParameters(Checked):
    """Parameters of the repair of a partition, besides those of the partition."""

    patience: int = whole(2, 1, 100)
    """Control steps without motion after which a ring neighbour counts as failed."""
    reserve: float = number(1.35, 1, 10)
    """Factor by which the period is longer than the shortest, so that cars can drive longer loops in the same time."""
    avoidance: float | None = number(None, 0, 1e4, "m")
    """Distance of a loop from the body of a stopped robot, besides its own [m]; None is 0.15 radii, and two deviations
    of noise."""
    drift: float = number(1.0, 0.01, 10)
    """Speed at which a loop moves to another place, as a share of that of the cars on it. Where loops of different
    cells cross, a robot returns to its own loop at once."""


@register("partition-repair")
class PartitionRepair(TimedPaths):
    """A partition whose robots take over the cells of ring neighbours that have failed, and drive around those.

    The loops are those of a partition with all of them in phase, driven slower (`RepairParameters.reserve`), and ring
    neighbours have neighbouring cells. If the messages of a ring neighbour show that it does not move, or if none
    arrive, a robot drives a loop in both cells (`baselines.policies.repair_plan`). It selects the loop, and the place
    of the loop, such that it is clear of stopped robots: beside them or around them. A robot that resumes waits on its
    loop until its reference comes by. If the robots have no information on each other's starts, the transit uses the
    collision filter, as in `partition`.

    If the loops of different cells do not overlap, collision filters move cars around stopped robots, and a car that is
    off its place around all others; a loop moves slowly to another place. If loops cross, as in `evaders`, only their
    common phase separates the cars. A filter that expects the others to drive straight on does not account for this:
    there a robot that stops dead at once before another one is not always avoided in time.

    A robot learns of failures only from its own row (`baselines.policies.neighbour_watch`): the row shows only those of
    its ring neighbours. So a cell may remain uncovered if the ring neighbours of its robot have failed too, or are in
    another line. Where `messages.size` is at least the number of robots and the loops lie apart, robots pass on the
    news of failures (`baselines.policies.news`), and those of a line of cells that work share the line evenly
    (`baselines.policies.line_shares`). Where robots can fail and messages alone are missing for this, an
    `AssumptionWarning` says so.

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
        self.partition, self.takeover, self._lines, tables, until = timed_repair(
            plain_of(scenario), self.parameters, self.repair
        )
        super().__init__(scenario, num_worlds, device, tables=tables, filtered_until=until, waits=True)
        self._required = _avoided_distance(self.scenario, self.repair)
        self._watch = _watch_of(self.scenario, self.partition, self.repair)
        half = np.array([self.scenario.driven.half_width, self.scenario.driven.half_height])
        low, high = self.takeover.loop.min(axis=2), self.takeover.loop.max(axis=2)
        margins = np.concatenate([np.minimum(-half - low, 0), np.maximum(half - high, 0)], axis=-1)
        longest = self.partition.speed * self.scenario.task.step / FINE
        self._every = max(int(_SPARSE * self._required / longest), 1)
        self._margins = wp.array(margins, dtype=wp.vec4, device=self.device)
        middle = (low + high) / 2
        self._middles = wp.array(middle, dtype=wp.vec2, device=self.device)
        self._away = wp.array(self.takeover.away, dtype=wp.vec2, device=self.device)
        self._corners = wp.array(self.takeover.corners, dtype=wp.int32, device=self.device)
        self._cost = wp.array(self.takeover.cost, dtype=wp.float32, device=self.device)
        self._watched = wp.zeros((*self.shape, 2, WATCH), dtype=wp.float32, device=self.device)
        self._standing = wp.zeros((*self.shape, int(PLACES)), dtype=wp.vec3, device=self.device)
        self._avoided = wp.zeros((*self.shape, int(PLACES)), dtype=wp.vec3, device=self.device)
        self._case = wp.zeros(self.shape, dtype=wp.int32, device=self.device)
        self._home = wp.zeros(self.shape, dtype=wp.vec2, device=self.device)
        self._target = wp.zeros(self.shape, dtype=wp.vec4, device=self.device)
        told = self.num_robots if self._lines else 0
        self._news = wp.zeros((*self.shape, told), dtype=wp.float32, device=self.device)
        self._neighbours = wp.array(self.scenario.neighbours, dtype=wp.int32, device=self.device)
        if self._lines:
            self._line = wp.array(self._lines.robots, dtype=wp.int32, device=self.device)
            self._centre = wp.array(self._lines.centre, dtype=wp.vec2, device=self.device)
        apart = loops_lie_apart(self.partition, required_distance(self.scenario, self.parameters))
        if apart and not self._lines:
            _warn_of_silence(self.scenario)
        batch, arriving = (self.scenario, num_worlds, self.device), ARRIVING.of(self.scenario)
        if apart and self._filter is None:
            self._filter = Safe(*batch, arriving)
        self._drift, self._avoidance = self.repair.drift * self.partition.speed * self.scenario.task.step, None
        self._back, self._rest = math.inf, 0.0
        self._resting = wp.zeros(self.shape, dtype=wp.float32, device=self.device)
        if apart:
            self._back = self._drift
            shifted = math.sqrt(2) * int(SIDE) * self._required / FINER
            self._rest = (float(np.linalg.norm(middle - middle[:1], axis=-1).max()) + shifted) / self._drift
            free = replace(arriving, speed_max=2 * self.scenario.robot.top_speed)
            self._avoidance = Safe(*batch, free, fastest=self._watch.still / self.scenario.task.step)

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        inputs = [self._curve, self._watch, observation, self._watched, self._standing]
        self.launch(watch_neighbours, self.shape, inputs, [])
        if self._lines:
            self._share_lines(self._lines, observation)
        else:
            self.launch(case_of_neighbours, self.shape, [self._watched], [self._case])
        first = self.tables.lead_in * FINE
        inputs = [
            first,
            self._every,
            SHAPES,
            self._required / FINER,
            self._required,
            self.takeover.offset,
            self._drift,
            self._back,
        ]
        inputs += [self._pose, self._margins, self._middles, self._away, self._cost, self._case, self._home]
        inputs += [self._curve, SEEN * self.scenario.sensing_radius, self._corners, observation]
        inputs += [self._standing, self._avoided, self._target, self.plan, self.shift]
        self.launch(take_over, self.shape, inputs, [])
        self.follow(observation)
        if self._filter is not None:
            self._take_filtered(self._filter, first, observation)
        self.launch(rest_after_failure, self.shape, [self._rest, observation], [self._resting, self.action])

    def _take_filtered(self, of_all: Safe, first: int, observation: wp.array) -> None:
        """Take the actions of the collision filters where they are needed."""
        clear_of_all = of_all(observation, self.action)
        if self._avoidance is None:
            self.launch(take_filtered, self.shape, [self._filtered_until, self._memory, clear_of_all], [self.action])
            return
        clear_of_standing = self._avoidance(observation, self.action)
        inputs = [self._filtered_until, self.scenario.robot.radius, first, self._curve, self._pose, self.plan]
        inputs += [self.shift, self._memory, observation, clear_of_all, self._avoidance.count, clear_of_standing]
        self.launch(take_clear, self.shape, inputs, [self.action])

    def _share_lines(self, lines: Lines, observation: wp.array) -> None:
        """Exchange the news of failures, and compute each robot's share of its line."""
        inputs = [message_start(self.scenario), self.scenario.task.step, self.scenario.time_unit, self._neighbours]
        inputs += [self._memory, observation, self._watched, self._news, self._standing]
        self.launch(exchange_news, self.shape, inputs, [self.action])
        reach = (self.scenario.curve.half_width, self.scenario.curve.half_height)[lines.along]
        along = wp.vec2(*np.eye(2)[lines.along])
        inputs = [reach, along, self._line, self._centre, self._news]
        self.launch(share_line, self.shape, inputs, [self._case, self._home])


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


def _avoided_distance(scenario: Scenario, repair: RepairParameters) -> float:
    """Return the smallest distance of a loop from a stopped robot [m]."""
    radius = scenario.robot.radius
    avoidance = 0.15 * radius + 2 * scenario.noise.position if repair.avoidance is None else repair.avoidance
    return 2 * radius + avoidance


def _watch_of(scenario: Scenario, plan: Plan, repair: RepairParameters) -> Any:
    watch, step = Watch(), scenario.task.step
    # With noisy measurements, a stopped robot seems to move.
    watch.still = max(0.1 * plan.speed * step, 3 * math.sqrt(2) * scenario.noise.position)
    watch.patience, watch.step, watch.time_unit = repair.patience, step, scenario.time_unit
    watch.speed_unit, watch.radius = scenario.robot.top_speed, scenario.sight
    watch.robots_seen = scenario.sensing.robots_seen
    return watch


@lru_cache(maxsize=64)
def timed_repair(
    scenario: Scenario, parameters: PartitionParameters, repair: RepairParameters
) -> tuple[Plan, Takeover, Lines | None, PathTables, float]:
    """Return the plan, the loops for takeovers, the lines, the timed paths, and how long the filter is needed [step].

    Lines are None if robots learn only of their ring neighbours' failures, or if their loops cross.
    """
    plan = slowed(partition_plan(scenario, parameters), repair.reserve)
    order = tour(plan.cells)
    cell, lead_in = _in_ring_order(scenario, order), None
    if start_is_known(scenario):
        turned = [_in_ring_order(scenario, np.roll(way, k)) for way in (order, order[::-1]) for k in range(len(order))]
        planned = planned_transit(scenario, plan.loop, parameters, np.array(turned))
        if planned is not None:
            lead_in, _, cell = planned
        else:
            check_loops_apart(scenario, plan, parameters, "partition-repair")
    unit = scenario.curve.half_height
    offset = _avoided_distance(scenario, repair) * int(SIDE) / FINER / (OFFSETS - 1)
    room, lines = room_of(scenario, parameters), None
    told = scenario.messages.size >= scenario.num_robots
    if told and loops_lie_apart(plan, required_distance(scenario, parameters)):
        lines = lines_of(plan, cell)
    if lines:
        taken = line_shares(plan, cell, lines, room, unit, offset)
    else:
        taken = takeover(plan, cell, scenario.neighbours, room, unit, offset)
    if lead_in is None:
        until = float(arrival_steps(scenario, plan.loop, plan.speed))
        return plan, taken, lines, path_tables(scenario, taken.loop), until
    loop = np.roll(taken.loop, -lead_in.shape[1], axis=2)
    lead_in = np.repeat(lead_in[None], len(loop), axis=0)
    return plan, taken, lines, path_tables(scenario, loop, lead_in), 0.0


def _in_ring_order(scenario: Scenario, order: np.ndarray) -> np.ndarray:
    """Return the cell (N,) of each robot where the ring goes along an order of the cells."""
    cells = np.empty(scenario.num_robots, dtype=int)
    cells[list(scenario.ring)] = order
    return cells
