"""The loop of a patrol, with corners that a car can drive."""

import math
from dataclasses import dataclass

import numpy as np

from baselines.policies.cells import lane_corners, length_of, resampled, rounded
from baselines.similarity import motion_scale
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, flag, number, whole
from lissajous_env.theory import closed_forms
from lissajous_env.theory.geometry import top_speed, turning_radius

_POINTS = 2048
"""Points of a loop."""
_CRUISE = 0.85
"""Speed of a patrol as a share of the limit, so that a car that fell behind can catch up."""
_ROOM = 1.15
"""Radius of the corners, in radii of a car's tightest turn."""
_RAMP = 2.0
"""Distance from a corner beyond which a side is bowed by the whole bow, in radii of the corner after its end."""


@dataclass(frozen=True)
class SweepParameters(Checked):
    """Parameters of a patrol, besides the scenario; None is derived from it."""

    cruise: float | None = number(None, 1e-3, 1e4, "m/s")
    """Speed of the patrol [m/s]; None is `cruising_speed`."""
    inset: float | None = number(None, 0, 1e4, "m")
    """Distance of the loop from the boundary [m]; None is 0.1 sensing radii where targets enter at the
    boundary, else 0.7, or less if the corners would not fit."""
    lanes: int | None = whole(None, 2, 64)
    """Lanes of the loop, an even number; 2 goes around the rectangle. None is described in `patrol_loop`."""
    corner: float | None = number(None, 1e-3, 1e4, "m")
    """Radius of the loop's corners [m]; None is `corner_radius`."""
    bow: float = number(0.0, 0, 1e4, "m")
    """Further distance from the boundary in the middle of each side of a loop around the rectangle [m]. Round corners
    must be close to the boundary to be covered; on the sides a target that flees is better passed from inside."""
    gather: float = number(0.0, 0, 1e4, "s")
    """Time constant in which the places in the file of `sweep` start to move [s], so that cars reach them sooner."""
    slowest: float | None = number(None, 0, 1e4, "m/s")
    """Lowest speed at which a car of `sweep` waits for its place, if it is ahead of it on the loop [m/s]; None: cars
    drive straight to their places."""
    by_phase: bool = flag(False)
    """True if the phase of a car of `sweep` alone determines its place in the file: places are then evenly spaced
    however far cars are off the formation at the start, but some are farther away. False: the file has the order of the
    formation's places along the loop, on which cars that are off their places disagree."""
    lookahead: float | None = number(None, 1e-3, 1e4, "m")
    """Distance of the goal ahead of a car's place [m]; None is the distance that the patrol drives in
    0.3 s, in the time scale of the paper's experiment, and at least 4 wheelbases."""

    def _check_together(self) -> None:
        self._require(self.lanes is None or self.lanes % 2 == 0, "lanes", "must be even")


def fastest_speed(scenario: Scenario) -> float:
    """Return the smaller one of the cars' top speed and the formation's speed where the curve is fastest [m/s]."""
    return min(scenario.robot.top_speed, top_speed(scenario.driven, scenario.formation.phase_rate))


def cruising_speed(scenario: Scenario) -> float:
    """Return the speed of a patrol [m/s], which is so far below the limit that a car can catch up with its place."""
    return _CRUISE * fastest_speed(scenario)


def corner_radius(scenario: Scenario, cruise: float | None = None) -> float:
    """Return the radius of the loop's corners [m], which steering and, at cruising speed, grip allow with some room."""
    robot = scenario.robot
    by_steering = turning_radius(robot.wheelbase, robot.steering_max)
    by_grip = (cruise or cruising_speed(scenario)) ** 2 / robot.lateral_acceleration_max
    return _ROOM * max(by_steering, by_grip)


def lookahead(scenario: Scenario, cruise: float, parameters: SweepParameters) -> float:
    """Return the distance of the goal ahead of a car [m]."""
    return parameters.lookahead or max(4 * scenario.robot.wheelbase, 0.3 * motion_scale(scenario).time * cruise)


def loop_spacing(loop: np.ndarray) -> float:
    """Return the distance between the points of a loop [m]."""
    return length_of(loop) / len(loop)


def file_by_phase(scenario: Scenario, loop: np.ndarray) -> tuple[float, float]:
    """Return the turns of the loop per turn of the phase, and the index on the loop (K, 2) [m] of the phase 0.

    The places of a formation of evenly spaced phases are evenly spaced for any number of turns that shares no factor
    with that of the robots. The pair is the one with the least sum of two lengths: the mean way from a phase's place on
    the curve to its place in the file, and the shift of the latter by a deviation of the start.
    """
    count, size = scenario.num_robots, len(loop)
    phases = np.linspace(0, 2 * np.pi, 512, endpoint=False)
    places = closed_forms.curve_point(scenario.driven, scenario.alpha * phases)[:, None, :2]
    origins = np.arange(64) * size // 64
    shift = scenario.formation.start_noise / (2 * np.pi) * size * loop_spacing(loop)
    best = (math.inf, 0.0, 0.0)
    for turns in (sign * k for k in range(1, max(count, 2)) for sign in (1, -1) if math.gcd(k, count) == 1):
        at = (turns * phases[:, None] / (2 * np.pi) * size + origins).astype(int) % size
        way = np.linalg.norm(loop[at] - places, axis=-1).mean(axis=0)
        best = min(best, (float(way.min()) + abs(turns) * shift, float(turns), float(origins[way.argmin()])))
    return best[1:]


def patrol_loop(scenario: Scenario, parameters: SweepParameters | None = None) -> np.ndarray:
    """Return evenly spaced points (K, 2) of the loop [m], counter-clockwise.

    It goes around the rectangle if targets enter at the boundary (then close to it), or if a disc that reaches the
    boundary also reaches the middle. Otherwise it goes along lanes, two sensing radii apart, and back along one side.
    """
    parameters = parameters or SweepParameters()
    curve, radius = scenario.driven, scenario.sensing_radius
    A, B = curve.half_width, curve.half_height
    corner = parameters.corner or corner_radius(scenario, parameters.cruise)
    at_boundary = scenario.targets.entry == "boundary"
    wanted = (0.1 if at_boundary else 0.7) * radius if parameters.inset is None else parameters.inset
    inset = max(min(wanted, B - corner, A - corner), 0.0)
    around = at_boundary or B - inset <= radius
    lanes = parameters.lanes or (2 if around else 2 * math.ceil((B - inset) / (2 * radius) + 0.5))
    corners = lane_corners(A - inset, B - inset, corner, lanes)
    path = resampled(rounded(corners, corner, 16), _POINTS)
    if lanes == 2 and parameters.bow > 0:
        path = resampled(_bowed(path, np.array([A - inset, B - inset]), corner, parameters.bow), _POINTS)
    return path


def _bowed(path: np.ndarray, half_sides: np.ndarray, corner: float, bow: float) -> np.ndarray:
    """Move the sides of a loop around the rectangle inwards, smoothly from the ends of its corners."""
    from_sides = half_sides - np.abs(path)
    share = np.clip((from_sides.max(axis=1) - corner) / (_RAMP * corner), 0, 1)
    inwards = bow * share**2 * (3 - 2 * share)
    rows, side = np.arange(len(path)), from_sides.argmin(axis=1)
    path[rows, side] -= np.sign(path[rows, side]) * inwards
    return path
