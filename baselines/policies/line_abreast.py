"""The policy `line-abreast`: cars in straight lines that sweep the rectangle back and forth."""

from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from baselines.policies.driving import slowest_top_speed
from baselines.policies.line_path import LineParameters, Lines, best_lines, loops_of
from baselines.policies.line_transit import Effort, Pace, angle_steps, transit_from_any_angle, transit_inside
from baselines.policies.own_row import Observation, own_phase
from baselines.policies.path_tables import PathTables, path_tables
from baselines.policies.registry import register
from baselines.policies.timed_paths import STEPS, TimedPaths
from baselines.policies.transit import stays_inside
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import wrap
from lissajous_env.parameters.scenario import Scenario

wp.set_module_options(OPTIONS)

_HASTE = 1.25
"""Largest speed on the way into the lines, over that of the lines."""
_FULL = 0.985
"""The same, over the top speed of the slowest car."""


@wp.kernel
def choose_ways(
    starts: wp.array(dtype=float),
    angles: int,
    first: int,
    variants: int,
    memory: wp.array3d(dtype=float),
    observation: Observation,
    variant_out: wp.array2d(dtype=int),
):
    """Choose the way into the lines at the first step, by the formation's angle, which follows from a robot's phase."""
    w, i = wp.tid()
    if memory[w, i, STEPS] == 0.0:
        turned = wrap(own_phase(w, i, observation) - starts[i]) / 6.283185307179586
        nearest = int(wp.floor(turned * float(angles) + 0.5)) - first
        if variants == angles:
            nearest = (nearest + angles) % angles
        variant_out[w, i] = wp.clamp(nearest, 0, variants - 1)


@lru_cache(maxsize=16)
def line_tables(scenario: Scenario, parameters: LineParameters) -> tuple[Lines, PathTables, tuple[int, int]]:
    """Return the lines of a scenario, the paths of its robots, the number of angles in a turn, and the first of them.

    The tables have a variant for each angle of the formation (`Effort.angles`), or one alone where cars stay inside.

    Raises:
        UnsuitableScenarioError: no lines span the rectangle, or there are no ways into them without collisions inside.
    """
    lines = best_lines(scenario, parameters)
    slots = np.argsort(scenario.ring)  # neighbours on the ring are neighbours in a line
    loops = loops_of(lines)
    if scenario.curve.half_height > scenario.curve.half_width:
        loops = np.stack([-loops[..., 1], loops[..., 0], loops[..., 2] + np.pi / 2], axis=-1)
    if stays_inside(scenario):
        ways = transit_inside(scenario, loops[..., :2], lines.speed, slots)
        return lines, path_tables(scenario, ways.loop, ways.lead_in), (1, 0)
    effort = Effort.of(scenario.num_robots, 3 * len(lines.path) // 2)
    fastest = min(_FULL * slowest_top_speed(scenario), _HASTE * lines.speed)
    fastest = min(fastest, (scenario.robot.lateral_acceleration_max * lines.radius) ** 0.5)
    pace = Pace(scenario.robot.drag, max(fastest, 1.001 * lines.speed), lines.speed)
    places = transit_from_any_angle(scenario, effort, loops[slots, 0], lines.radius, pace)
    tables = path_tables(scenario, loops[slots, :, :2], places)
    return lines, tables, (effort.angles, int(angle_steps(scenario, effort.angles)[0]))


@register("line-abreast", kind="car")
class LineAbreast(TimedPaths):
    """Cars in straight lines across the rectangle, which sweep it back and forth.

    The cars of a line are so close that no rogue passes between two sensing discs (`line_path.speed_limit` has the
    spacing law), the outermost ones reach the walls, and all copy one path: to the end of the rectangle, a turn, and
    back. In the open the turn is outside of the rectangle, of three arcs back into their own lanes; where they must
    stay inside, it is a half circle, and the way back is beside the lane. Several lines, where there are cars for them,
    are interleaved and spread over the period; their number is the one with the shortest worst-case undetected time of
    the ideal motion. `line_transit` computes the ways from the formation into the lines, on which cars stay apart.

    A car's place in a line is fixed: neighbours on the communication ring are neighbours in a line. Where a robot has
    stopped or been removed, the others stay in their lanes. A car that is farther from its place than a body's radius
    uses the collision filter, because others do not expect it there. Lines that turn inside need larger sensors and a
    start that all robots know; others are refused. docs/policies.md has the literature, and the limits.

    Raises:
        ValueError: sensing discs that are too small, or too few, for a line to span the shorter side.
    """

    Parameters = LineParameters

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu", parameters: Any = None):
        super().__init__(scenario, num_worlds, device, parameters)
        starts = self.scenario.equilibrium + self.scenario.displacements
        self._starts = wp.array(starts, dtype=wp.float32, device=self.device)
        self._avoid_others(self.scenario.robot.radius)

    def timed(self, scenario: Scenario) -> PathTables:
        """Return the timed paths: a variant for each angle of the formation, or one alone where cars stay inside."""
        self.lines, tables, self._angles = line_tables(scenario, self.parameters)
        return tables

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        if len(self.tables.pose) > 1:
            inputs = [self._starts, *self._angles, len(self.tables.pose), self._memory, observation]
            self.launch(choose_ways, self.shape, inputs, [self.variant])
        super().decide(observation)
