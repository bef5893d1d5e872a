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
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np

from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.cells import tour
from baselines.policies.loop_shapes import PartitionParameters
from baselines.policies.partition_plan import Plan, partition_plans
from baselines.policies.path_tables import PathTables, path_tables
from baselines.policies.registry import register
from baselines.policies.timed_paths import TimedPaths
from baselines.policies.transit import arrival_steps, planned_transit, required_distance, start_is_known
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.parts import Faults

_PHASES = 4
"""Phases of the team for which a transit within an inset is sought."""
_VARIANTS = 800
"""Variants of plans for which a transit is sought, times the square of the number of robots; at least 4 are tried."""


@register("partition")
class Partition(TimedPaths):
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

    Raises:
        ValueError: no loops that the cars can drive have room in the rectangle, side by side.
    """

    def __init__(
        self,
        scenario: Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        parameters: PartitionParameters | None = None,
    ):
        self.parameters = parameters or PartitionParameters()
        self.partition, tables, until = timed_partition(plain_of(scenario), self.parameters)
        super().__init__(scenario, num_worlds, device, tables=tables, filtered_until=until)


def plain_of(scenario: Scenario) -> Scenario:
    """Return a scenario without what a plan does not depend on, resolved."""
    return dataclasses.replace(scenario.resolve().without_extensions(), name="", description="", faults=Faults())


@lru_cache(maxsize=64)
def timed_partition(scenario: Scenario, parameters: PartitionParameters) -> tuple[Plan, PathTables, float]:
    """Return the plan of a scenario, its timed paths by robot, and how long the collision filter is needed [step]."""
    plans = partition_plans(scenario, parameters)
    variants = (variant for plan in plans for variant in variants_of(scenario, plan))
    for plan in itertools.islice(variants, max(_VARIANTS // scenario.num_robots**2, 4)):
        ways = planned_transit(scenario, plan.loop, parameters) if start_is_known(scenario) else None
        if ways is not None:
            return plan, path_tables(scenario, ways.loop, ways.lead_in), 0.0
    check_loops_apart(scenario, plans[0].loop, parameters, "partition")
    loop = plans[0].loop[in_ring_order(scenario, tour(plans[0].cells))]
    return plans[0], path_tables(scenario, loop), float(arrival_steps(scenario, loop, plans[0].speed))


def loops_lie_apart(loops: np.ndarray, distance: float) -> bool:
    """Return whether no places of two loops (N, K, 2), at whatever times, are nearer than a distance [m]."""
    pairs = itertools.combinations(loops, 2)
    return all(np.linalg.norm(one[:, None] - other, axis=-1).min() >= distance for one, other in pairs)


def check_loops_apart(scenario: Scenario, loops: np.ndarray, parameters: PartitionParameters, policy: str) -> None:
    """Raise UnsuitableScenarioError if cars with a known start and no transit would drive onto loops that overlap.

    Within an inset there is no room to pass each other, so the collision filter does not separate them.
    """
    apart = required_distance(scenario, parameters)
    if scenario.inset and start_is_known(scenario) and not loops_lie_apart(loops, apart):
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


def in_ring_order(scenario: Scenario, order: np.ndarray) -> np.ndarray:
    """Return the cell (N,) of each robot where the ring goes along an order of the cells."""
    cells = np.empty(scenario.num_robots, dtype=int)
    cells[list(scenario.ring)] = order
    return cells
