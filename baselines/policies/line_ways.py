"""Ways of cars into the lines of `line-abreast` within walls or an inset, where not every way has room.

The lines may begin in any phase, and a robot may have any place that the ring can be turned to: neighbours on the ring
stay neighbours in a line. The first such choice for which cars have ways without collisions is taken.
"""

import math
from collections.abc import Iterator

import numpy as np

from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.line_transit import Effort, Pace, transit
from baselines.policies.partition import planned_transit
from baselines.policies.partition_plan import PartitionParameters, Plan
from lissajous_env.parameters.scenario import Scenario

_CLEAR = 0.5
"""Least distance of two bodies on planned ways into the lines, in radii of a body."""
_PHASES = (0.5, 0.0, 0.25, 0.75)
"""Phases of the lines that are tried, in periods."""
_ROUNDS = 8
"""Rounds in which the cars choose their ways anew, as `line_transit.Effort.rounds`."""


def _turned(slots: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the places (N,) of the robots in the lines that the ring can be turned to, the nearest first."""
    for k in range(len(slots)):
        yield (slots + (k + 1) // 2 * (-1 if k % 2 else 1)) % len(slots)


def ways_from_start(
    scenario: Scenario, loops: np.ndarray, speed: float, slots: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the lead-in (N, L, 2) of each robot from a known start, the loop after it (N, K, 2) [m], and its place.

    Args:
        scenario: The scenario.
        loops: (N, K, 3) x, y [m] and heading [rad] at each place in the lines, at the steps of a period.
        speed: Speed of the lines [m/s].
        slots: (N,) place of each robot in the lines by its place on the ring.

    Raises:
        UnsuitableScenarioError: there are no ways on which no two cars collide.
    """
    room, places = (
        PartitionParameters(speed=speed, clearance=_CLEAR * scenario.robot.radius),
        np.array([*_turned(slots)]),
    )
    for phase in _PHASES:
        shifted = np.roll(loops[..., :2], -round(phase * loops.shape[1]), axis=1)
        plan = Plan(np.zeros((len(slots), 6)), shifted, speed, math.nan)
        planned = planned_transit(scenario, plan, room, places)
        if planned is not None:
            lead_in, chosen = planned
            return lead_in, np.roll(shifted[chosen], -lead_in.shape[1], axis=1), chosen
    rule = "line-abreast requires ways from the start into the lines inside the walls, on which no two cars collide"
    raise UnsuitableScenarioError(f"{rule}, got none")


def ways_from_angles(
    scenario: Scenario, loops: np.ndarray, radius: float, pace: Pace, effort: Effort, slots: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the ways (P, N, L, 2) from each angle of the formation, the loop (N, K, 2) [m] and each robot's place.

    Args:
        scenario: The scenario.
        loops: (N, K, 3) x, y [m] and heading [rad] at each place in the lines, at the steps of a period.
        radius: Radius of turns [m].
        pace: Limits of the speed.
        effort: Fineness of the choice of ways.
        slots: (N,) place of each robot in the lines by its place on the ring.

    Raises:
        UnsuitableScenarioError: from some angles there are no ways on which no two cars collide.
    """
    least = 1.0
    for phase in _PHASES:
        shifted = np.roll(loops, -round(phase * loops.shape[1]), axis=1)
        for places in _turned(slots):
            loop = shifted[places]
            ways = transit(scenario, effort._replace(rounds=_ROUNDS), loop[:, 0], radius, pace)
            failing = _share_that_fails(scenario, ways)
            if failing == 0:
                return ways, loop[..., :2], places
            least = min(least, failing)
    rule = "line-abreast requires ways from every angle of the formation into the lines inside the walls"
    raise UnsuitableScenarioError(f"{rule}, on which no two cars collide, got none from {least:.0%} of the angles")


def _share_that_fails(scenario: Scenario, ways: np.ndarray) -> float:
    """Return the share of the angles from which ways (P, N, L, 2) [m] collide or leave the rectangle to drive in."""
    first, second = np.triu_indices(ways.shape[1], 1)
    gaps = np.array([np.linalg.norm(way[first] - way[second], axis=-1).min(initial=math.inf) for way in ways])
    half = np.array([scenario.driven.half_width, scenario.driven.half_height])
    leaves = np.any(np.abs(ways) > half + scenario.robot.radius / 100, axis=(1, 2, 3))
    return float(np.mean((gaps < 2 * scenario.robot.radius) | leaves))
