"""Ways of cars from a known start into the lines of `line-abreast` within walls or an inset.

The lines may begin in any phase, and a robot may have any place that the ring can be turned to: neighbours on the ring
stay neighbours in a line. The ways without collisions of the shortest worst case are taken.
"""

from collections.abc import Iterator

import numpy as np

from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.ideal_motion import worst_from_start
from baselines.policies.loop_shapes import PartitionParameters
from baselines.policies.transit import planned_transit, start_is_known
from lissajous_env.parameters.scenario import Scenario

_CLEAR = 0.5
"""Least distance of two bodies on planned ways into the lines, in radii of a body."""
_PHASES = (0.5, 0.0, 0.25, 0.75)
"""Phases of the lines that are tried, in periods."""


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
        UnsuitableScenarioError: the robots do not know their starts, or there are no ways without collisions.
    """
    if not start_is_known(scenario):
        rule = (
            "line-abreast requires a start that all robots know within walls or an inset, formation.start = equilibrium"
        )
        rule = f"{rule} and little start_noise"
        raise UnsuitableScenarioError(
            f"{rule}, got {scenario.formation.start} and {scenario.formation.start_noise:g} rad"
        )
    room = PartitionParameters(speed=speed, clearance=_CLEAR * scenario.robot.radius)
    places, half = np.array([*_turned(slots)]), (scenario.curve.half_width, scenario.curve.half_height)
    options = []
    for phase in _PHASES:
        shifted = np.roll(loops[..., :2], -round(phase * loops.shape[1]), axis=1)
        ways = planned_transit(scenario, shifted, room, places)
        if ways is not None:
            lead_in, loop, chosen = ways
            rogues = scenario.sensing_radius, scenario.rogue_speed, scenario.task.step
            options.append((worst_from_start(lead_in, loop, half, *rogues), len(options), (lead_in, loop, chosen)))
    if options:
        return min(options, key=lambda each: each[:2])[-1]
    rule = "line-abreast requires ways from the start into the lines inside the walls, on which no two cars collide"
    raise UnsuitableScenarioError(f"{rule}, got none")
