"""Geometry of the lines of `line-abreast`: their spacing and speed, and the path that every car of a line copies.

Coordinates are along and across the sweep: `along` the longer side of the rectangle, `across` the shorter one, which
the lines span. A line's path is a table of one state for each control step, periodic: from the left end of the
rectangle to the right one, a turn, back, and a turn. Float64 NumPy.

In the open, a turn of three arcs outside of the rectangle leads back into the same lane. Where cars must stay inside,
every car turns on a half circle, and sweeps back beside its lane, by the circle's radius R to the other side. All cars
copy that, too, so the spacing law is valid in turns; an outermost car is R nearer to its wall on one way, and R farther
from it on the other. `failed_condition` has the conditions.
"""

import math
from dataclasses import dataclass

import numpy as np

from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.driving import slowest_top_speed
from baselines.policies.ideal_motion import worst_undetected_time
from baselines.policies.loops import fastest_speed
from baselines.policies.transit import along_arc, start_is_known, stays_inside
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, number, whole
from lissajous_env.theory.geometry import turning_radius
from lissajous_env.wording import counted

_CRUISE, _FASTEST = 0.96, 0.98
"""Speeds of a line over the top speed of the slowest car: by default, and at most; the rest is for catching up."""
_GRIP = 0.92
"""Share of the grip, and of the tightest turn, that the path uses: the rest corrects errors."""
_SHARES = (1.0, 0.8, 0.6, 0.45, 0.3)
"""Speeds of lines that turn inside, over the largest one: where grip limits turns, slower cars need less space."""
_PASSING = 1.5
"""Distance at which cars of two lines pass each other, in sums of their radii."""
_LINES_MAX = 8
"""Most lines that are compared."""


@dataclass(frozen=True)
class LineParameters(Checked):
    """Parameters of lines abreast, besides the scenario; None is derived from it."""

    speed: float | None = number(None, 1e-3, 1e4, "m/s")
    """Largest speed of the lines [m/s]; None means 0.96 of the top speed of the slowest car, at most the formation's
    where the curve is fastest. The speed is at most 0.98 of that top speed, that at which grip lets cars turn round in
    the shorter side of the rectangle, and what `speed_limit` allows, and a little less, so that a sweep lasts whole
    steps."""
    lines: int | None = whole(None, 1, 1024)
    """Number of lines; None means the number with the shortest worst-case undetected time."""


@dataclass(frozen=True, eq=False)
class Lines:
    """The lines of a scenario: lanes of cars, and the path that they copy."""

    speed: float
    """Speed of the lines [m/s]."""
    path: np.ndarray
    """(P, 3) along, across [m] and heading [rad] of a car in the lane 0, a period of P steps.

    Step 0 is where the sweep to the right begins.
    """
    radius: float
    """Radius of the first arc of a turn [m]."""
    aside: float
    """Distance of a car from its lane in a sweep, to the left of it: R of turns inside, else 0 [m]."""
    lanes: np.ndarray
    """(N,) places across of the cars, line by line [m]."""
    line_of: np.ndarray
    """(N,) line of each car."""


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


def best_lines(scenario: Scenario, parameters: LineParameters) -> Lines:
    """Return the lines, of any number and speed, with the shortest worst-case undetected time once they have formed.

    Raises:
        UnsuitableScenarioError: no lines span the rectangle, or robots that must stay inside do not know their starts.
    """
    n, radius = scenario.num_robots, scenario.sensing_radius
    counts = [parameters.lines] if parameters.lines else range(1, min(n, _LINES_MAX) + 1)
    options = [lines_of(scenario, parameters, count) for count in counts]
    fitting = [lines for of_count, _ in options for lines in of_count]
    if not fitting:
        span = 2 * min(scenario.curve.half_width, scenario.curve.half_height)
        lines = counted(counts[0], "line")
        rule = f"line-abreast requires {lines} of {counted(n, 'car')} to span {span:g} m with discs of {radius:g} m"
        raise UnsuitableScenarioError(f"{rule}: {options[0][1]}")
    if stays_inside(scenario) and not start_is_known(scenario):  # before they are compared, which can take seconds
        rule = "line-abreast requires a start that all robots know where they must stay inside"
        got = f"{scenario.formation.start} and {scenario.formation.start_noise:g} rad"
        raise UnsuitableScenarioError(f"{rule}, formation.start = equilibrium and little start_noise, got {got}")
    if len(fitting) == 1:
        return fitting[0]
    return min(fitting, key=lambda lines: ideal_worst_case(scenario, lines))


def ideal_worst_case(scenario: Scenario, lines: Lines) -> float:
    """Return the worst-case undetected time [s] of lines that have formed and follow their path without error."""
    across, along = sorted((scenario.curve.half_width, scenario.curve.half_height))
    rogues = scenario.sensing_radius, scenario.rogue_speed, scenario.task.step
    return worst_undetected_time(loops_of(lines)[..., :2], (along, across), *rogues)


def lanes_of(scenario: Scenario, count: int, aside: float = 0.0) -> tuple[float, float, np.ndarray, np.ndarray]:
    """Return the lanes of `count` lines on the span 2 B.

    The m lines are interleaved, so that their cars pass each other: lane j of N belongs to line j mod m. With
    the pitch 2 (B + R) / (N + 1 - m), the outermost car of any line is at most half a spacing, m pitches, from the
    wall, if it is R, `aside` [m], beside its lane. The pitch is smaller where the inset leaves less room.

    Returns:
        The pitch of the lanes; the spacing of the cars in a line, or twice the largest distance of an outermost car
        from the wall; and the place across [m] and the line of each car (N,).
    """
    n, half = scenario.num_robots, min(scenario.curve.half_width, scenario.curve.half_height)
    half_driven = min(scenario.driven.half_width, scenario.driven.half_height)
    pitch = min(2 * (half + aside) / (n + 1 - count), 2 * (half_driven - aside) / max(n - 1, 1))
    order = np.concatenate([np.arange(line, n, count) for line in range(count)])
    lanes = (order - (n - 1) / 2) * pitch
    wall = half + lanes.min() + (count - 1) * pitch + aside
    return pitch, max(count * pitch, 2 * wall), lanes, order % count


def failed_condition(scenario: Scenario, count: int, speed: float = 0.0, aside: float = 0.0) -> str:
    """Return the condition by which `count` lines cannot span the rectangle, with its numbers; "" if they can.

    Lines that turn inside have a speed [m/s], at which cars turn on half circles of the radius `aside` [m]; that of
    others is as low as necessary.
    """
    half, inset = min(scenario.curve.half_width, scenario.curve.half_height), scenario.inset
    radius, rogues, step = scenario.sensing_radius, scenario.rogue_speed, scenario.task.step
    about = f"at {speed:.3g} m/s cars turn on half circles of {aside:.3g} m, so " if aside else ""
    if aside + inset > half:
        return f"{about}they do not fit {inset:.3g} m inside of walls {2 * half:g} m apart"
    pitch, spacing, lanes, _ = lanes_of(scenario, count, aside)
    if count < len(lanes) and count * pitch >= 2 * radius:
        return f"{about}the cars of a line would be {count * pitch:.3g} m apart instead of below {2 * radius:.3g} m"
    if spacing >= 2 * radius:
        return f"{about}the outermost would be {spacing / 2:.3g} m from its wall instead of below {radius:.3g} m"
    limit = speed_limit(spacing, radius, rogues, step)
    if limit <= 0 or limit < speed:
        fastest = speed_limit(spacing, radius, speed, step)
        return f"rogues of {rogues:g} m/s cross a line within a step, as do all of at least {fastest:.3g} m/s"
    if len(lanes) > 1 and pitch <= 2 * scenario.robot.radius:
        return f"bodies {2 * scenario.robot.radius:.3g} m wide would be {pitch:.3g} m apart"
    apart, needed = pitch - 2 * aside * (count > 1), _PASSING * 2 * scenario.robot.radius
    if apart < needed and (count > 1 or aside > 0):
        return f"{about}cars would pass each other at {max(apart, 0):.3g} m, and need {needed:.3g} m"
    away = math.hypot(inset + aside, max(half - float(np.abs(lanes).max()), spacing / 2)) - aside
    if away > radius:
        return f"{about}places at the end of the rectangle would be {away:.3g} m from sensors of {radius:.3g} m"
    return ""


def turn_of(curvature_step: float) -> np.ndarray:
    """Return the headings after each step of the shortest turn by half a circle back into the lane, from 0 to -pi.

    It is an arc to the left, a wide one to the right, and one to the left, of whole steps and at most so much curvature
    [rad/step]. With the angle a of the first arc, of n steps, and pi + 2 a of the second, of k steps, the path comes
    back into its lane where its radii fulfil R1 (1 - cos a) = R2 cos a, that is n (1 - cos a) / a = k cos a / (pi + 2
    a). Two equal radii have a = pi / 3.
    """
    steps = max(math.floor(7 * math.pi / 3 / curvature_step), 4)
    while True:
        for short in range(1, steps // 2):
            long = steps - 2 * short
            low, high = 1e-9, math.pi / 2
            for _ in range(60):
                angle = (low + high) / 2
                closes = short * (1 - math.cos(angle)) / angle < long * math.cos(angle) / (math.pi + 2 * angle)
                low, high = (angle, high) if closes else (low, angle)
            first, second = low / short, (math.pi + 2 * low) / long
            if max(first, second) <= curvature_step:
                return np.cumsum(np.repeat([first, -second, first], [short, long, short]))
        steps += 1


def lines_of(scenario: Scenario, parameters: LineParameters, count: int) -> tuple[tuple[Lines, ...], str]:
    """Return `count` lines that span the rectangle, at several speeds if they turn inside, and a failed condition."""
    if count > scenario.num_robots:
        return (), "there are fewer cars than lines"
    slowest = slowest_top_speed(scenario)
    if slowest == 0:
        return (), "the slowest car does not move"
    tightest, half = 1 / (_GRIP * _sharpest(scenario)), min(scenario.curve.half_width, scenario.curve.half_height)
    if tightest + scenario.inset >= half:
        return (), f"turns of {tightest:.3g} m do not fit {scenario.inset:.3g} m inside of sides {2 * half:g} m apart"
    turning = math.sqrt(scenario.robot.lateral_acceleration_max * half)  # faster cars turn far outside
    largest = parameters.speed or min(_CRUISE * slowest, fastest_speed(scenario))
    largest = min(largest, _FASTEST * slowest, turning)
    if not stays_inside(scenario):
        failed = failed_condition(scenario, count)
        return (() if failed else (_turning_outside(scenario, count, largest),)), failed
    fitting, failed = [], ""
    for share in (1.0,) if parameters.speed else _SHARES:
        lines = _turning_inside(scenario, count, share * largest)
        failed = failed_condition(scenario, count, lines.speed, lines.aside)
        fitting += [] if failed else [lines]
    return tuple(fitting), failed


def _turning_outside(scenario: Scenario, count: int, fastest: float) -> Lines:
    """Return `count` lines that turn outside of the rectangle, at a speed [m/s] or the largest one below it."""
    step = scenario.task.step
    _, spacing, lanes, line_of = lanes_of(scenario, count)
    fastest = min(fastest, speed_limit(spacing, scenario.sensing_radius, scenario.rogue_speed, step))
    reach = max(scenario.curve.half_width, scenario.curve.half_height)
    sweep = max(math.ceil(2 * reach / (fastest * step) - 1e-9), 1)
    speed = 2 * reach / (sweep * step)
    # At the lower speed of whole steps, the turn may use the reserve of `_GRIP`, but no more.
    turn = turn_of(min(_largest_turn(scenario, fastest), _sharpest(scenario) * speed * step))
    path = _path(speed * step, sweep, turn, np.array([-reach, 0.0]))
    return Lines(speed, path, speed * step / turn[0], 0.0, lanes, line_of)


def _turning_inside(scenario: Scenario, count: int, fastest: float) -> Lines:
    """Return `count` lines that turn inside at about a speed [m/s]: whole steps of a sweep and of a half circle.

    A sweep of k steps and a half circle of n steps span the driven rectangle if v dt (k / 2 + n / pi) is half of it.
    """
    driven, step = scenario.driven, scenario.task.step
    half, long = max(driven.half_width, driven.half_height), 4
    while True:
        sweep = max(math.ceil(2 * (half / (fastest * step) - long / math.pi) - 1e-9), 1)
        speed = half / (step * (sweep / 2 + long / math.pi))
        if math.pi <= _largest_turn(scenario, speed) * long * (1 + 1e-9):
            break
        long += 1
    aside = speed * step * (long / math.pi)
    *_, lanes, line_of = lanes_of(scenario, count, aside)
    turn = np.cumsum(np.full(long, -math.pi / long))
    path = _path(speed * step, sweep, turn, np.array([aside - half, aside]))
    return Lines(speed, path, aside, aside, lanes, line_of)


def _largest_turn(scenario: Scenario, speed: float) -> float:
    """Return the largest turn at a speed that steering and grip allow [rad/step]."""
    grip = scenario.robot.lateral_acceleration_max / speed
    return _GRIP * scenario.task.step * min(_sharpest(scenario) * speed, grip)


def _sharpest(scenario: Scenario) -> float:
    """Return the curvature of the tightest circle of the longest car [1/m]."""
    robot = scenario.robot
    return 1 / turning_radius(robot.wheelbase * scenario.noise.wheelbase_range[1], robot.steering_max)


def _path(way: float, sweep: int, turn: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """Return `Lines.path` from a place on, `way` [m] a step: a sweep of some steps, a turn, the way back, a turn.

    A turn is the headings after its steps [rad].
    """
    there = np.concatenate([np.zeros(sweep), turn])
    headings = np.concatenate([[0.0], there, there - math.pi])
    moved = np.cumsum(along_arc(0.0, headings[:-1], way, np.diff(headings))[0], axis=0)
    return np.column_stack([np.vstack([[0.0, 0.0], moved])[:-1] + begin, headings[:-1]])


def loops_of(lines: Lines) -> np.ndarray:
    """Return along, across [m] and heading [rad] (N, K, 3) of the cars in their lanes, a period of K steps.

    The lines are spread evenly over the period; the first one begins its sweep at the left end.
    """
    period = len(lines.path)
    starts = np.array([round(line * period / (lines.line_of.max() + 1)) for line in lines.line_of])
    at = lines.path[(starts[:, None] + np.arange(period)) % period]
    return np.stack([at[..., 0], at[..., 1] + lines.lanes[:, None], at[..., 2]], axis=-1)
