"""Area partition: one cell of the rectangle for each car, and synchronised loops in the cells.

That each robot patrols a part of its own is among the oldest strategies of multi-robot patrolling: D. Portugal, R.
Rocha, "A survey on multi-robot patrolling algorithms" (2011). Parts of equal measure balance the work: M. Pavone, A.
Arsie, E. Frazzoli, F. Bullo, "Distributed algorithms for environment partitioning in mobile robotic networks", IEEE
Transactions on Automatic Control 56 (2011). Against an adversary with knowledge of the strategy, a deterministic patrol
is as good as its weakest moment: N. Agmon, G. A. Kaminka, S. Kraus, "Multi-robot adversarial patrolling: facing a
full-knowledge opponent", Journal of Artificial Intelligence Research 42 (2011). So the plan is the one with the least
worst-case undetected time (`baselines.policies.partition_plan`).
"""

import dataclasses
import itertools
import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.cells import tour
from baselines.policies.partition_plan import PartitionParameters, Plan, car_of, partition_plans, required_distance
from baselines.policies.path_tables import PathTables, path_tables
from baselines.policies.registry import register
from baselines.policies.safety.filter import Safe, SafetyParameters
from baselines.policies.timed_paths import STEPS, TimedPaths, TrackingParameters
from baselines.policies.transit import formation_starts, start_is_known, transit
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.parts import Faults

wp.set_module_options(OPTIONS)

ARRIVING = SafetyParameters(clearance=0.07, growth=0.2)
"""Parameters of the collision filter of cars on the way to their loops, which give way earlier than those on loops."""
_PHASES = 4
"""Phases of the team for which a transit within an inset is sought."""
_VARIANTS = 800
"""Variants of plans for which a transit is sought, times the square of the number of robots; at least 4 are tried."""
_LONGEST = 6.0
"""Longest planned transit, in the time in which a car drives half of the rectangle's half perimeter."""


@wp.kernel
def take_filtered(
    until: float,
    memory: wp.array3d(dtype=float),
    filtered: wp.array3d(dtype=float),
    action_out: wp.array3d(dtype=float),
):
    """Take the actions of the collision filter up to a control step."""
    w, i = wp.tid()
    if memory[w, i, STEPS] <= until:
        for k in range(action_out.shape[2]):
            action_out[w, i, k] = filtered[w, i, k]


class FilteredPaths(TimedPaths):
    """Cars that follow timed paths, at first with the collision filter if the starts of the others are unknown.

    Args:
        scenario: The scenario, of cars.
        num_worlds: W.
        device: Warp device.
        tables: The timed paths.
        filtered_until: Duration of the collision filter [control step].
        tracking: Gains and limits of the following of the paths.
    """

    def __init__(
        self,
        scenario: Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        *,
        tables: PathTables,
        filtered_until: float = 0.0,
        tracking: TrackingParameters | None = None,
    ):
        super().__init__(scenario, num_worlds, device, tables=tables, parameters=tracking)
        self._filtered_until = filtered_until
        self._filter = None
        if filtered_until > 0:
            self._filter = Safe(self.scenario, num_worlds, self.device, ARRIVING.of(self.scenario))
        self.communicates = "nothing" if self._filter is None else self._filter.communicates

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        self.follow(observation)
        if self._filter is not None:
            filtered = self._filter(observation, self.action)
            self.launch(take_filtered, self.shape, [self._filtered_until, self._memory, filtered], [self.action])


@register("partition")
class Partition(FilteredPaths):
    """A cell of the rectangle for each car, with loops that are synchronised for the least worst-case undetected time.

    Robots that are neighbours on the ring have neighbouring cells where the start leaves the choice. From a start in
    the equilibrium, whose places are known, each car follows a planned transit (`baselines.policies.transit`) without
    collisions. From other starts, a robot has no information on where the others are: it drives to its cell at once,
    under the collision filter until all of them have had the time to arrive.

    Args:
        scenario: The scenario, of cars.
        num_worlds: W.
        device: Warp device.
        parameters: Parameters of the plan that are not optimised.
        tracking: Gains and limits of the following of the loops.

    Raises:
        ValueError: no loops that the cars can drive have room in the rectangle, side by side.
    """

    def __init__(
        self,
        scenario: Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        parameters: PartitionParameters | None = None,
        tracking: TrackingParameters | None = None,
    ):
        self.parameters = parameters or PartitionParameters()
        self.partition, tables, until = timed_partition(plain_of(scenario), self.parameters)
        super().__init__(scenario, num_worlds, device, tables=tables, filtered_until=until, tracking=tracking)


def plain_of(scenario: Scenario) -> Scenario:
    """Return a scenario without what a plan does not depend on, resolved."""
    return dataclasses.replace(scenario.resolve(), name="", description="", extensions=(), faults=Faults())


@lru_cache(maxsize=64)
def timed_partition(scenario: Scenario, parameters: PartitionParameters) -> tuple[Plan, PathTables, float]:
    """Return the plan of a scenario, its timed paths by robot, and how long the collision filter is needed [step]."""
    plans = partition_plans(scenario, parameters)
    variants = (variant for each in plans for variant in variants_of(scenario, each))
    for plan in itertools.islice(variants, max(_VARIANTS // scenario.num_robots**2, 4)):
        planned = planned_transit(scenario, plan, parameters) if start_is_known(scenario) else None
        if planned is not None:
            lead_in, chosen = planned
            loop = np.roll(plan.loop[chosen], -lead_in.shape[1], axis=1)
            return plan, path_tables(scenario, loop, lead_in), 0.0
    check_loops_apart(scenario, plans[0], parameters, "partition")
    loop = plans[0].loop[cells_of_ring(scenario, plans[0])]
    return plans[0], path_tables(scenario, loop), arrival_of_all(scenario, plans[0])


def loops_lie_apart(plan: Plan, distance: float) -> bool:
    """Return whether no places of two loops, at whatever times, are nearer than a distance [m]."""
    pairs = itertools.combinations(plan.loop, 2)
    return all(np.linalg.norm(one[:, None] - other, axis=-1).min() >= distance for one, other in pairs)


def check_loops_apart(scenario: Scenario, plan: Plan, parameters: PartitionParameters, policy: str) -> None:
    """Raise UnsuitableScenarioError if cars with a known start and no transit would drive onto loops that overlap.

    Within an inset there is no room to pass each other, so the collision filter does not separate them.
    """
    apart = required_distance(scenario, parameters)
    if scenario.inset and start_is_known(scenario) and not loops_lie_apart(plan, apart):
        rule = f"{policy} requires ways from the start to its loops inside of {scenario.inset:.3g} m from the edge"
        rule = f"{rule}, or loops at least {apart:.3g} m apart at any times"
        raise UnsuitableScenarioError(f"{rule}, got loops that overlap, and no ways without collisions")


def variants_of(scenario: Scenario, plan: Plan) -> Iterator[Plan]:
    """Yield plans of the same worst case among which one with a transit is selected: the plan alone without an inset.

    Within an inset they are the plan and its mirror image, in which the cars go around the other way, in some phases of
    the team.
    """
    if not scenario.inset:
        yield plan
        return
    mirror = np.array([1.0, -1.0])
    cells = np.concatenate([plan.cells[:, :2] * mirror, plan.cells[:, 2:]], axis=1)
    for shift in np.arange(_PHASES) * plan.loop.shape[1] // _PHASES:
        turned = np.roll(plan.loop, shift, axis=1)
        yield dataclasses.replace(plan, loop=turned)
        yield dataclasses.replace(plan, cells=cells, loop=turned * mirror)


def arrival_of_all(scenario: Scenario, plan: Plan) -> float:
    """Return the time after which all robots have arrived at their loops, from wherever they started [step]."""
    time = 2 * (scenario.curve.half_width + scenario.curve.half_height) / plan.speed
    return float(math.ceil(time / scenario.task.step) + 2 * plan.loop.shape[1])


def planned_transit(
    scenario: Scenario, plan: Plan, parameters: PartitionParameters, assignments: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the lead-in (N, L, 2) of each robot and its loop (N,), from the equilibrium; None if there is none.

    `assignments` (A, N) are the loops of the robots that may be chosen; all by default.
    """
    start, speed = formation_starts(scenario)
    time = _LONGEST * (scenario.curve.half_width + scenario.curve.half_height) / plan.speed / scenario.task.step
    apart = required_distance(scenario, parameters)
    car, step = car_of(scenario, parameters), scenario.task.step
    return transit(start, speed, plan.loop, car, apart, step, math.ceil(time), assignments)


def cells_of_ring(scenario: Scenario, plan: Plan) -> np.ndarray:
    """Return the cell (N,) of each robot: neighbours on the ring have neighbouring cells where that is possible."""
    cells = np.empty(scenario.num_robots, dtype=int)
    cells[list(scenario.ring)] = tour(plan.cells)
    return cells
