"""Geometry of the lines of `line-abreast`: their spacing and speed, and the path that every car of a line copies.

Coordinates are along and across the sweep: `along` the longer side of the rectangle, `across` the shorter one, which
the lines span. A line's path is a table of one state for each control step, periodic: from the left end of the
rectangle to the right one, a turn, back, and a turn. Float64 NumPy.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.driving import SPREAD_MAX, slowest_top_speed
from baselines.policies.patrol_path import fastest_speed
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, number, whole
from lissajous_env.theory.geometry import turning_radius

_CRUISE, _FASTEST = 0.96, 0.98
"""Speeds of a line in the top speed of the slowest car: by default, and at most; the rest is for catching up."""
_GRIP = 0.92
"""Share of the grip, and of the tightest turn, that the path uses: the rest corrects errors."""
_PASSING = 1.5
"""Distance at which cars of two lines pass each other, in sums of their radii."""


@dataclass(frozen=True)
class LineParameters(Checked):
    """Parameters of lines abreast, besides the scenario; None is derived from it."""

    speed: float | None = number(None, 1e-3, 1e4, "m/s")
    """Largest speed of the lines [m/s]; None means 0.96 of the top speed of the slowest car, at most the formation's
    where the curve is fastest. The speed is at most 0.98 of that top speed and what `speed_limit` allows, and a little
    less, so that a sweep lasts whole steps."""
    lines: int | None = whole(None, 1, 1024)
    """Number of lines; None means the number with the best guarantee."""
    grip: float = number(_GRIP, 0.05, 1)
    """Share of the cars' grip and of their largest curvature that turns use."""
    settle: float = number(0.0, 0, 1e4, "m")
    """Distance outside of the rectangle at which turns begin and end [m]; without effect where `task.boundary` is
    closed."""


class Turn(NamedTuple):
    """A turn by half a circle back into the own lane: an arc to the left, a wide one to the right, one to the left."""

    short: int
    """Steps of the first and of the last arc."""
    long: int
    """Steps of the arc between them."""
    angle: float
    """Angle of the first and of the last arc [rad]."""

    @property
    def steps(self) -> int:
        """Steps of the whole turn."""
        return 2 * self.short + self.long

    @property
    def headings(self) -> np.ndarray:
        """Headings after each step, from 0 to -pi [rad]."""
        rates = np.repeat([self.angle / self.short, -(math.pi + 2 * self.angle) / self.long, self.angle / self.short],
                          [self.short, self.long, self.short])  # fmt: skip
        return np.cumsum(rates)


@dataclass(frozen=True)
class LinePlan:
    """The lines of a scenario."""

    half_length: float
    """Half of the longer side, along which lines sweep [m]."""
    half_span: float
    """Half of the shorter side, which lines span [m]."""
    speed: float
    """Speed of the lines [m/s]."""
    step: float
    """Control step [s]."""
    sweep: int
    """Steps from turn to turn."""
    turn: Turn
    reach: float
    """Distance from the middle at which turns begin and end [m]."""
    lanes: np.ndarray
    """(N,) places across of the cars, line by line [m]."""
    line_of: np.ndarray
    """(N,) line of each car."""
    squeeze: float
    """Factor of the places across in a turn; below 1 where turns have to fit into the rectangle."""

    @property
    def period(self) -> int:
        """Steps until the path repeats."""
        return 2 * (self.sweep + self.turn.steps)

    @property
    def starts(self) -> np.ndarray:
        """(N,) place of each car's line on the path when the lines have formed [step], spread evenly over the period.

        The first line begins its sweep at the left end then.
        """
        lines = self.line_of.max() + 1
        return np.array([round(line * self.period / lines) for line in self.line_of])


def speed_limit(spacing: float, radius: float, rogue_speed: float, step: float) -> float:
    """Return the largest speed of a line of discs from which no rogue escapes unsensed [m/s]; negative for none.

    v = 2 sqrt(r^2 - (s / 2)^2) / dt - u. Two discs whose centres are s apart across cover a band of the width
    2 h = 2 sqrt(r^2 - (s / 2)^2) along the sweep wherever a rogue tries to pass between them, and so does the disc of a
    car that is s / 2 from the wall. Relative to the line a rogue moves by (u + v) dt along at most from one observation
    to the next: if that is at most 2 h, then one observation is in the band. An observer without a step, dt -> 0,
    needs s < 2 r alone, for any speeds. All cars of a line move by the same vectors, so the law is valid in turns too.
    """
    inside = radius**2 - (spacing / 2) ** 2
    return 2 * math.sqrt(inside) / step - rogue_speed if inside > 0 else -math.inf


def largest_spacing(speed: float, radius: float, rogue_speed: float, step: float) -> float:
    """Return the largest spacing of a line of discs from which no rogue escapes unsensed [m]; 0 for none.

    s = 2 sqrt(r^2 - ((u + v) dt / 2)^2), `speed_limit` solved for s.
    """
    return 2 * math.sqrt(max(radius**2 - ((rogue_speed + speed) * step / 2) ** 2, 0.0))


def lanes_of(scenario: Scenario, lines: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Return how m lines share the span 2 B: pitch of their lanes [m], places across [m] and line of each car.

    The lines are interleaved, so that their cars pass each other: lane j of the N lanes belongs to line j mod m. With
    the pitch 2 B / (N + 1 - m), the outermost car of any line is at most half a spacing, m pitches, from the wall.
    """
    n, span = scenario.num_robots, 2 * min(scenario.curve.half_width, scenario.curve.half_height)
    pitch = min(span / (n + 1 - lines), span / max(n - 1, 1))
    order = np.concatenate([np.arange(line, n, lines) for line in range(lines)])
    return pitch, (order - (n - 1) / 2) * pitch, order % lines


def spacing_of(scenario: Scenario, lines: int) -> float:
    """Return the spacing of the cars in a line, or twice the largest distance of an outermost car from the wall [m]."""
    pitch, lanes, _ = lanes_of(scenario, lines)
    wall = min(scenario.curve.half_width, scenario.curve.half_height) + lanes.min() + (lines - 1) * pitch
    return max(lines * pitch, 2 * wall)


def can_span(scenario: Scenario, lines: int) -> bool:
    """Return whether that many lines can span the rectangle, with room for cars of two lines to pass each other."""
    spacing, pitch = spacing_of(scenario, lines), lanes_of(scenario, lines)[0]
    fits = speed_limit(spacing, scenario.sensing_radius, scenario.rogue_speed, scenario.task.step) > 0
    return fits and (lines == 1 or pitch >= _PASSING * 2 * scenario.robot.radius)


def check(scenario: Scenario, parameters: LineParameters) -> None:
    """Raise UnsuitableScenarioError if no lines can span the rectangle."""
    n, radius = scenario.num_robots, scenario.sensing_radius
    span = 2 * min(scenario.curve.half_width, scenario.curve.half_height)
    if n * 2 * radius < span:
        rule = "line-abreast requires N * 2 * sensing radius >= the shorter side"
        raise UnsuitableScenarioError(f"{rule}: {n} * 2 * {radius:g} < {span:g} [m]")
    lines = parameters.lines or 1
    if not can_span(scenario, lines):
        rule = f"line-abreast requires {lines} line(s) of {n} cars to span {span:g} m with discs of {radius:g} m"
        raise UnsuitableScenarioError(f"{rule}: {_what_fails(scenario, lines)}")


def _what_fails(scenario: Scenario, lines: int) -> str:
    """Return the reason why that many lines cannot span the rectangle."""
    spacing, moving, radius = spacing_of(scenario, lines), scenario.rogue_speed, scenario.sensing_radius
    if spacing >= 2 * radius:
        return f"the cars of a line would be {spacing:.3g} m apart, and not less than {2 * radius:.3g} m"
    fastest = speed_limit(spacing, radius, 0.0, scenario.task.step)
    if moving >= fastest:
        return f"rogues of {moving:g} m/s cross a line within a step, as do all of at least {fastest:.3g} m/s"
    pitch, needed = lanes_of(scenario, lines)[0], _PASSING * 2 * scenario.robot.radius
    return f"cars of two lines would pass each other at {pitch:.3g} m, and need {needed:.3g} m"


def turn_of(curvature_step: float) -> Turn:
    """Return the shortest turn of whole steps, of at most so much curvature [rad/step].

    With the angle a of the first arc, of n steps, and pi + 2 a of the second, of k steps, the path comes back into its
    lane where its radii fulfil R1 (1 - cos a) = R2 cos a, that is n (1 - cos a) / a = k cos a / (pi + 2 a). Two equal
    radii have a = pi / 3.
    """
    shortest = math.floor(7 * math.pi / 3 / curvature_step)
    for steps in range(max(shortest, 4), 4 * shortest + 8):
        for short in range(1, steps // 2):
            long = steps - 2 * short
            low, high = 1e-9, math.pi / 2
            for _ in range(60):
                angle = (low + high) / 2
                closes = short * (1 - math.cos(angle)) / angle < long * math.cos(angle) / (math.pi + 2 * angle)
                low, high = (angle, high) if closes else (low, angle)
            if max(low / short, (math.pi + 2 * low) / long) <= curvature_step:
                return Turn(short, long, low)
    raise AssertionError("a long turn fits")


def arcs(headings: np.ndarray, distances: np.ndarray) -> np.ndarray:
    """Return (K, 2) displacements along arcs of circles from heading to heading [rad], of some lengths [m]."""
    before, after = headings[:-1], headings[1:]
    half = (after - before) / 2
    chord = distances * np.sinc(half / np.pi)
    return chord[:, None] * np.stack([np.cos(before + half), np.sin(before + half)], axis=-1)


@lru_cache(maxsize=64)
def line_plan(scenario: Scenario, parameters: LineParameters, lines: int) -> LinePlan:
    """Return the plan of so many lines."""
    curve, robot, step = scenario.curve, scenario.robot, scenario.task.step
    A, B = max(curve.half_width, curve.half_height), min(curve.half_width, curve.half_height)
    _, lanes, line_of = lanes_of(scenario, lines)
    fastest = min(_CRUISE * slowest_top_speed(scenario), fastest_speed(scenario))
    limit = speed_limit(spacing_of(scenario, lines), scenario.sensing_radius, scenario.rogue_speed, step)
    speed = min(parameters.speed or fastest, limit, _FASTEST * slowest_top_speed(scenario))
    base = robot.wheelbase * (1 + SPREAD_MAX * scenario.noise.wheelbase_spread)
    sharpest = 1 / turning_radius(base, robot.steering_max)
    turn = turn_of(parameters.grip * step * min(sharpest * speed, robot.lateral_acceleration_max / speed))
    path = np.vstack([[0.0, 0.0], np.cumsum(arcs(np.append(0.0, turn.headings), np.full(turn.steps, speed * step)), 0)])
    reach, squeeze = A + parameters.settle, 1.0
    if scenario.task.boundary != "open":
        reach = A - path[:, 0].max()
        squeeze = min(max((B - np.abs(path[:, 1]).max()) / np.abs(lanes).max(), 0.0), 1.0) if lanes.any() else 1.0
    sweep = max(math.ceil(2 * max(reach, 0.0) / (speed * step) - 1e-9), 1)
    speed = 2 * max(reach, 0.0) / (sweep * step) or speed
    return LinePlan(A, B, speed, step, sweep, turn, reach, lanes, line_of, squeeze)


def line_path(plan: LinePlan) -> np.ndarray:
    """Return one period of the path of a car in the lane 0: (P, 4) along, across [m], heading [rad], factor of lanes.

    Step 0 is where the sweep to the right begins.
    """
    straight = np.zeros(plan.sweep)
    there = np.concatenate([straight, plan.turn.headings])
    headings = np.concatenate([[0.0], there, there - math.pi])
    moved = np.cumsum(arcs(headings, np.full(plan.period, plan.speed * plan.step)), axis=0)
    places = np.vstack([[0.0, 0.0], moved])[:-1] + np.array([-plan.reach, 0.0])
    return np.column_stack([places, headings[:-1], _lane_factors(plan)])


def _lane_factors(plan: LinePlan) -> np.ndarray:
    """Return the factor of the lanes at each step of the path: 1 in the middle of a sweep, `squeeze` in turns."""
    factors = np.full(plan.period, plan.squeeze)
    if plan.squeeze == 1:
        return factors
    ramp = max(plan.sweep // 4, 1)
    rising = 0.5 - 0.5 * np.cos(np.pi * np.minimum(np.arange(plan.sweep) / ramp, 1.0))
    share = np.minimum(rising, rising[::-1])
    for start in (0, plan.sweep + plan.turn.steps):
        factors[start : start + plan.sweep] = plan.squeeze + (1 - plan.squeeze) * share
    return factors
