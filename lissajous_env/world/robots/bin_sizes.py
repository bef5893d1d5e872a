"""Sizes of bins, and the scenarios for which they are faster."""

import dataclasses
import math
from typing import Any

import warp as wp

from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.robots.bins import Bins
from lissajous_env.world.robots.collisions import PARTED

MANY = 100
"""Number of robots from which on bins are faster than a test of every robot, for any number of targets."""
_SOME = 64
_PAIRS = 10_000
"""Pairs of a robot and a target from which on they are where robots are not many, but some."""

_FEWEST = 12
"""Bins below which they do not pay: every list is of nearly every robot."""

_BINS_PER_ROBOT = 16
_AT_LEAST = 1024
_MOST_ENTRIES = 256
"""Entries for each robot that there is room for at most; those for which there is none are in every list."""


def has_bins(scenario: Scenario) -> bool:
    """Return whether bins are faster for a resolved scenario."""
    n = scenario.num_robots
    if n < MANY and (n < _SOME or n * scenario.target_capacity < _PAIRS):
        return False
    *_, columns, rows = _squares(scenario)
    return columns * rows >= _FEWEST


def _squares(scenario: Scenario) -> tuple[float, float, float, int, int]:
    """Return the reach, the widened reach and the side of the bins [m], and the numbers of columns and rows.

    Lists reach as far as targets flee only if that costs less than comparing the fleeing ones with all robots.
    """
    targets, roaming = scenario.targets, dataclasses.replace(scenario.targets, fleeing=0.0, speed_limit=None)
    radius, step = scenario.sight, scenario.task.step
    bodies = 2 * float(PARTED) * (scenario.robot.radius or 0.0)
    moved = step * (targets.speed if targets.fleeing > 0 else roaming.speed_max)
    near = max(radius + moved, bodies)
    far = max(near, radius + step * targets.speed_max, targets.flee_radius) if targets.fleeing > 0 else near
    everybody = targets.fleeing * scenario.num_robots
    return min(_of_reach(scenario, far), _of_reach(scenario, near), key=lambda squares: _compared(scenario, squares)
               + (everybody if squares[0] < far else 0.0))  # fmt: skip


def _of_reach(scenario: Scenario, reach: float) -> tuple[float, float, float, int, int]:
    """Return `_squares` for lists that are complete up to a distance [m]."""
    curve = scenario.curve
    widened = 1.01 * reach + 1e-6 * max(curve.half_width, curve.half_height)
    most = max(_BINS_PER_ROBOT * scenario.num_robots, _AT_LEAST)
    size = max(widened, math.sqrt(4 * curve.half_width * curve.half_height / most))
    return reach, widened, size, math.ceil(2 * curve.half_width / size), math.ceil(2 * curve.half_height / size)


def _compared(scenario: Scenario, squares: tuple[float, float, float, int, int]) -> float:
    """Return the mean number of robots in a list, of robots that are anywhere in the rectangle."""
    _, widened, size, *_ = squares
    sides = (2 * scenario.curve.half_width, 2 * scenario.curve.half_height)
    return scenario.num_robots * math.prod(min(1.0, (size + 2 * widened) / side) for side in sides)


def bins_of(scenario: Scenario, speed: float, num_worlds: int, device: Any) -> Bins:
    """Make the bins of a resolved scenario, of robots that are mostly not faster than `speed` [m/s]; none for few."""
    filled, (n, curve) = Bins(), (scenario.num_robots, scenario.curve)
    sensing = scenario.sensing
    entries = max(sensing.robots_seen, sensing.targets_seen, sensing.tracks_seen, sensing.teammates_seen)
    filled.nearest = wp.zeros((num_worlds, n, entries), dtype=wp.vec2, device=device)
    if not has_bins(scenario):
        return filled
    filled.reach, filled.widened, filled.size, filled.columns, filled.rows = _squares(scenario)
    filled.half_width, filled.half_height = curve.half_width, curve.half_height
    across = 2 * filled.widened / filled.size + 2
    each = min(math.ceil(across * (across + speed * scenario.task.step / filled.size)), _MOST_ENTRIES)
    filled.room, bins = n * each, filled.columns * filled.rows

    def array(*shape: int, dtype: Any = wp.int32) -> Any:
        return wp.zeros((num_worlds, *shape), dtype=dtype, device=device)

    filled.first, filled.entry = array(bins), array(filled.room + n + 1, dtype=wp.vec2i)
    filled.used, filled.everywhere, filled.is_everywhere = array(), array(), array(n)
    filled.first_seen, filled.seen_used = array(bins), array()
    filled.seen = array(scenario.target_capacity, dtype=wp.vec4)
    return filled
