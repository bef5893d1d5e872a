"""The policy `line-abreast`: cars in straight lines that sweep the rectangle back and forth."""

import math
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.driving import slowest_top_speed
from baselines.policies.ideal_motion import worst_undetected_time
from baselines.policies.line_closing import close_up, closes_up, closing_of
from baselines.policies.line_path import (
    LineParameters,
    LinePlan,
    can_span,
    check,
    inner_plans,
    line_path,
    line_plan,
    turns_inside,
)
from baselines.policies.line_transit import Effort, Pace, angle_steps, effort_of, transit
from baselines.policies.line_ways import ways_from_start
from baselines.policies.neighbour_watch import WATCH
from baselines.policies.own_row import own_phase
from baselines.policies.partition import plain_of
from baselines.policies.path_tables import PathTables, path_tables
from baselines.policies.registry import register
from baselines.policies.timed_paths import STEPS, TimedPaths
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import wrap
from lissajous_env.parameters.scenario import Scenario

wp.set_module_options(OPTIONS)

_LINES_MAX = 8
_HASTE = 1.25
"""Largest speed on the way into the lines, in that of the lines."""
_FULL = 0.985
"""The same, in the top speed of the slowest car."""


@wp.kernel
def choose_ways(
    equilibrium: wp.array(dtype=float),
    angles: int,
    first: int,
    plans: int,
    memory: wp.array3d(dtype=float),
    observation: wp.array3d(dtype=float),
    plan_out: wp.array2d(dtype=int),
):
    """Choose the way into the lines at the first step: by the angle of the formation, which the own phase shows."""
    w, i = wp.tid()
    if memory[w, i, STEPS] == 0.0:
        turned = wrap(own_phase(w, i, observation) - equilibrium[i]) / 6.283185307179586
        nearest = int(wp.floor(turned * float(angles) + 0.5)) - first
        if plans == angles:
            plan_out[w, i] = (nearest + angles) % angles
        else:
            plan_out[w, i] = wp.clamp(nearest, 0, plans - 1)


def best_plan(scenario: Scenario, parameters: LineParameters) -> LinePlan:
    """Return the plan of the given number of lines, or of the number with the best guarantee once they have formed."""
    check(scenario, parameters)
    if turns_inside(scenario):
        return best_inner_plan(scenario, parameters)
    if parameters.lines is not None:
        return line_plan(scenario, parameters, parameters.lines)
    counts = [m for m in range(1, min(scenario.num_robots, _LINES_MAX) + 1) if can_span(scenario, m)]
    plans = [line_plan(scenario, parameters, count) for count in counts]
    if len(plans) == 1:
        return plans[0]
    return min(plans, key=lambda plan: ideal_worst_case(scenario, plan))


def best_inner_plan(scenario: Scenario, parameters: LineParameters) -> LinePlan:
    """Return the plan with the best guarantee of lines that turn inside, by the number of lines and the speed.

    Raises:
        UnsuitableScenarioError: no line spans the rectangle in its turns, too, or rogues pass it while it turns.
    """
    most = min(scenario.num_robots, _LINES_MAX)
    counts = [parameters.lines] if parameters.lines else range(1, most + 1)
    found = [inner_plans(scenario, parameters, count) for count in counts]
    plans = [plan for some, _ in found for plan in some]
    if not plans:
        rule = f"line-abreast requires {counts[0]} line(s) of {scenario.num_robots} cars to turn inside"
        raise UnsuitableScenarioError(f"{rule}: {found[0][1]}")
    times = [ideal_worst_case(scenario, plan) for plan in plans]
    if not math.isfinite(min(times)):
        rule = "line-abreast requires lines that no rogue passes while they turn inside"
        raise UnsuitableScenarioError(f"{rule}, and rogues of {scenario.rogue_speed:g} m/s pass every one")
    return plans[int(np.argmin(times))]


def ideal_worst_case(scenario: Scenario, plan: LinePlan) -> float:
    """Return the worst-case undetected time [s] of lines that have formed and follow their path without error."""
    half = plan.half_length, plan.half_span
    loop = loops_of(plan, plan.starts, plan.lanes)[..., :2]
    return worst_undetected_time(loop, half, scenario.sensing_radius, scenario.rogue_speed, plan.step)


def loops_of(plan: LinePlan, starts: np.ndarray, lanes: np.ndarray) -> np.ndarray:
    """Return along, across [m] and heading [rad] (N, K, 3) of cars of some starts and lanes, a period of K steps."""
    at = line_path(plan)[(starts[:, None] + np.arange(plan.period)) % plan.period]
    return np.stack([at[..., 0], at[..., 1] + lanes[:, None], at[..., 2]], axis=-1)


def effort(scenario: Scenario, plan: LinePlan) -> Effort:
    """Return how finely the ways into lines are chosen."""
    return effort_of(scenario.num_robots, 3 * plan.period // 2)


@lru_cache(maxsize=16)
def line_tables(scenario: Scenario, parameters: LineParameters) -> tuple[LinePlan, PathTables, np.ndarray]:
    """Return the lines of a scenario, the tables of the paths of its robots, and the place (N,) of each in the lines.

    The tables have one plan for each angle of the formation, or one plan alone within an inset.

    Raises:
        UnsuitableScenarioError: no lines span the rectangle, or there are no ways into them without collisions inside.
    """
    plan = best_plan(scenario, parameters)
    slots = np.argsort(scenario.ring)  # neighbours on the ring are neighbours in a line
    loops = loops_of(plan, plan.starts, plan.lanes)
    if scenario.curve.half_height > scenario.curve.half_width:
        loops = np.stack([-loops[..., 1], loops[..., 0], loops[..., 2] + np.pi / 2], axis=-1)
    if scenario.inset:
        lead_in, loop, slots = ways_from_start(scenario, loops, plan.speed, slots)
        return plan, path_tables(scenario, loop, lead_in), slots
    fastest = min(_FULL * slowest_top_speed(scenario), _HASTE * plan.speed)
    pace = Pace(scenario.robot.drag, max(fastest, 1.001 * plan.speed), plan.speed)
    radius = plan.aside or plan.speed * plan.step * plan.turn.short / plan.turn.angle
    loop = loops[slots, :, :2]
    ways = transit(scenario, effort(scenario, plan), loops[slots, 0], radius, pace)
    return plan, path_tables(scenario, np.broadcast_to(loop, (len(ways), *loop.shape)), ways), slots


@register("line-abreast", kind="car")
class LineAbreast(TimedPaths):
    """Cars in straight lines across the rectangle, which sweep it back and forth.

    The cars of a line are so close that no rogue passes between two sensing discs (`line_path.speed_limit` has the
    spacing law), the outermost ones reach the walls, and all copy one path: to the end of the rectangle, a turn, and
    back. In the open the turn is outside of the rectangle, of three arcs back into the own lanes; within walls or an
    inset it is a half circle inside, and the way back is beside the lane. Several lines, where there are cars for them,
    are interleaved and spread over the period; their number is the one with the shortest worst-case undetected time of
    the ideal motion. `line_transit`, or `line_ways` within an inset, computes the ways from the formation into the
    lines, chosen so that no two cars meet; `line_closing` closes a line up.

    A car's place in a line is fixed: neighbours on the communication ring are neighbours in a line. A line closes up
    where one of its robots has stopped or been removed, if the others can still span the rectangle. If they cannot, or
    where there are several lines, the others stay in their lanes. A robot that resumes catches up with its line without
    regard to others: `line-abreast-safe` avoids collisions then. Lines that turn inside need larger sensors and a start
    that all robots know; others are refused.

    Lines of searchers that sweep a region in which rogues have a known top speed: Y. Altshuler, V. Yanovsky, I. A.
    Wagner, A. M. Bruckstein, "Efficient cooperative search of smart targets using UAV swarms", Robotica 26 (2008); R.
    M. Francos, A. M. Bruckstein, "Search for smart evaders with sweeping agents", arXiv:1905.04006 (2019). Sweeps as an
    action of robot teams in pursuit and evasion: A. Kolling, S. Carpin, "Pursuit-evasion on trees by robot teams", IEEE
    Transactions on Robotics 26 (2010). A periodic patrol is predictable, so a rogue with knowledge of it can cross the
    perimeter undetected: N. Agmon, G. A. Kaminka, S. Kraus, "Multi-robot adversarial patrolling: facing a
    full-knowledge opponent", Journal of Artificial Intelligence Research 42 (2011). Such a rogue is the one that the
    guarantee is about: it may enter at any moment, but it is detected within that time.

    Args:
        scenario: The scenario, of cars.
        num_worlds: W.
        device: Warp device.
        parameters: Speed, number of lines, and turns.

    Raises:
        ValueError: sensing discs that are too small, or too few, for a line to span the shorter side.
    """

    remembers = (*TimedPaths.remembers, "_remembered")

    def __init__(
        self,
        scenario: Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        parameters: LineParameters | None = None,
    ):
        self.parameters = parameters or LineParameters()
        self.lines, tables, slots = line_tables(plain_of(scenario), self.parameters)
        super().__init__(scenario, num_worlds, device, tables=tables)
        self._closes = closes_up(self.scenario, self.lines)
        self._closing = closing_of(self.scenario, self.lines, tables.lead_in)
        self._slots = wp.array(slots, dtype=wp.int32, device=self.device)
        self._remembered = wp.zeros((*self.shape, 2, WATCH), dtype=wp.float32, device=self.device)
        angles = effort(self.scenario, self.lines).angles
        steps = angle_steps(self.scenario, angles)
        self._angles = (angles, int(steps[0]), len(tables.pose))
        self._equilibrium = wp.array(self.scenario.equilibrium, dtype=wp.float32, device=self.device)

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        inputs = [self._equilibrium, *self._angles, self._memory, observation]
        self.launch(choose_ways, self.shape, inputs, [self.plan])
        if self._closes:
            inputs = [self._curve, self._closing, self._slots, self._memory, observation, self._remembered]
            self.launch(close_up, self.shape, inputs, [self.shift])
        self.follow(observation)
