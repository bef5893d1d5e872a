"""A partition whose cars drive around their loops at a random rate, which an observer cannot predict.

For adversaries with knowledge of the strategy, a patrol is unpredictable only if it is random: N. Agmon, G. A. Kaminka,
S. Kraus, "Multi-robot adversarial patrolling: facing a full-knowledge opponent", Journal of Artificial Intelligence
Research 42 (2011). The loops of `partition` are synchronised, and cars that drive at rates of their own would collide,
so all cars share one random rate: in control step t each is at its place of time tau(t) on its loop, and tau grows by
at most 1 per step. Places are visited later than by `partition`, so the worst-case undetected time is longer.

All robots draw the same numbers from a seed that is set before the mission. So the motion is the same in each episode,
and an adversary that knows the seed can predict it.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from baselines.policies.partition import (
    FilteredPaths,
    arrival_of_all,
    cells_of_ring,
    plain_of,
    planned_transit,
    start_is_known,
)
from baselines.policies.partition_plan import PartitionParameters, Plan, car_of, partition_plan
from baselines.policies.path_tables import PathTables, path_tables
from baselines.policies.registry import register
from baselines.policies.timed_paths import TrackingParameters
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import number, whole

_PERIODS = 4
"""Fewest periods of the loops after which the random rates repeat; they do not repeat within an episode."""
_ACCELERATION = 0.7
"""Share of the acceleration of the weakest car at full speed that changes of the rate use."""


@dataclass(frozen=True)
class RandomPartitionParameters(PartitionParameters):
    """Parameters of `partition-random`: those of `partition`, and those of the random rate."""

    seed: int = whole(0, 0, 2**31 - 1)
    """Seed that all robots share."""
    slowest: float = number(0.4, 0.05, 1)
    """Smallest rate; 1 is the rate of `partition`."""
    fastest: float = number(1.0, 0.05, 1)
    """Largest rate; where it equals the smallest, the rate is constant."""
    hold: float | None = number(None, 0.01, 100, "periods")
    """Time between two draws of the rate [period of the loops]; in between, the rate changes linearly. None is a
    quarter, or more where cars cannot change their speed so fast."""

    def _check_together(self) -> None:
        super()._check_together()
        self._require(self.slowest <= self.fastest, "slowest", f"must be at most fastest, {self.fastest:g}")


@register("partition-random", on_request=True)
class PartitionRandom(FilteredPaths):
    """`partition` with a random rate of all cars on their loops, which only the robots can compute in advance.

    Args:
        scenario: The scenario, of cars.
        num_worlds: W.
        device: Warp device.
        parameters: Parameters of the plan and of the random rate.
        tracking: Gains and limits of the following of the loops.

    Raises:
        ValueError: as `partition`.
    """

    def __init__(
        self,
        scenario: Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        parameters: RandomPartitionParameters | None = None,
        tracking: TrackingParameters | None = None,
    ):
        self.parameters = parameters or RandomPartitionParameters()
        tables, until = randomly_timed_partition(plain_of(scenario), self.parameters)
        super().__init__(scenario, num_worlds, device, tables=tables, filtered_until=until, tracking=tracking)


@lru_cache(maxsize=64)
def randomly_timed_partition(scenario: Scenario, parameters: RandomPartitionParameters) -> tuple[PathTables, float]:
    """Return the timed paths by robot, and the time for which the collision filter is needed [step]."""
    plan = partition_plan(scenario, PartitionParameters(**{name: getattr(parameters, name) for name in _PLANNED}))
    planned = planned_transit(scenario, plan, parameters) if start_is_known(scenario) else None
    tau = random_times(scenario, plan, parameters)
    if planned is None:
        loop = plan.loop[cells_of_ring(scenario, plan)]
        return path_tables(scenario, places_at(loop, tau)), arrival_of_all(scenario, plan)
    lead_in, chosen = planned
    loop = np.roll(plan.loop[chosen], -lead_in.shape[1], axis=1)
    return path_tables(scenario, places_at(loop, tau), lead_in), 0.0


def random_times(scenario: Scenario, plan: Plan, parameters: RandomPartitionParameters) -> np.ndarray:
    """Return the time tau (M,) of the loops at each control step until the rates repeat [control steps].

    The first is 0, and the one after the last would be a whole number of periods.
    """
    period, car = plan.loop.shape[1], car_of(scenario, parameters)
    steps = max(_PERIODS * period, scenario.task.steps)
    hold = (parameters.hold or 0.25) * period
    if parameters.hold is None:
        most = _ACCELERATION * car.drag * max(car.top_speed - plan.speed, 0.1 * car.top_speed)
        hold = max(hold, (parameters.fastest - parameters.slowest) * plan.speed / most / scenario.task.step)
    knots = math.ceil(2 * steps / parameters.slowest / hold) + 2
    rates = np.random.default_rng(parameters.seed).uniform(parameters.slowest, parameters.fastest, knots)
    rates[0] = parameters.fastest  # the cars come from their transit at about this rate
    tau = np.cumsum(np.interp(np.arange(int(hold * (knots - 1))) + 0.5, hold * np.arange(knots), rates))
    # A whole number of periods; a very small change of the rates makes it last a whole number of steps.
    around = math.ceil(tau[steps - 1] / period) * period
    count = int(np.searchsorted(tau, around - 1e-9)) + 1
    return np.concatenate([[0.0], tau[: count - 1]]) * (around / tau[count - 1])


def places_at(loop: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the places (N, M, 2) on loops (N, K, 2) at times (M,) [control steps], by a periodic cubic spline."""
    from scipy.interpolate import CubicSpline  # slow to import

    around = np.concatenate([loop, loop[:, :1]], axis=1)
    spline = CubicSpline(np.arange(around.shape[1]), around, axis=1, bc_type="periodic")
    return spline(times % loop.shape[1])


_PLANNED = tuple(PartitionParameters.__dataclass_fields__)
