"""Transits: the ways of a team of cars from their starts into synchronised loops, without collisions.

A way is a shortest path of bounded curvature, which enters a loop at the place of this loop's reference at that time,
with a speed that is a quadratic function of time. The assignment of cars to loops minimises the sum of the fourth
powers of the arrival times. The ways are then selected one car after the other, those that arrive last first: each
enters its loop as early as it can without coming near the cars before it.

Shortest paths of bounded curvature are made of arcs of the smallest radius and straight lines: L. E. Dubins, "On curves
of minimal length with a constraint on average curvature, and with prescribed initial and terminal positions and
tangents", American Journal of Mathematics 79 (1957).
"""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from baselines.policies.driving import slowest_top_speed, weakest_top_speed
from baselines.policies.loops import speed_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory import closed_forms
from lissajous_env.theory.geometry import largest_speed
from lissajous_env.world.robots.placing import start_headings

TURNS = np.array([[1.0, 0, 1], [-1, 0, -1], [1, 0, -1], [-1, 0, 1], [-1, 1, -1], [1, -1, 1]])
"""(6, 3) direction of each piece of each kind of path: 1 to the left, 0 straight on, -1 to the right.

The kinds are LSL, RSR, LSR, RSL, RLR and LRL in the notation of Dubins.
"""
_PLANNED_SHARE = 0.75
"""Share of the top speed and of the grip that planned ways and loops use; the rest corrects errors."""
STEP_TURN = 0.4
"""Largest turn in a control step [rad], in which steering is constant."""
_SLOWEST_SHARE = 0.9
"""Share of the top speed of the slowest car that planned ways and loops use at most."""
_LEAST_SHARE = 0.15
"""Least speed of planned ways and loops, as a share of the top speed."""
_RADIUS_FACTOR = 1.02
"""Radius of planned turns, over that of the tightest turn of the car with the longest wheelbase."""
_PROFILE = np.linspace(0, 1, 21)
"""Shares of the duration of a way at which its speed is tested."""
_TRIES = 24
"""Orders of the cars that are tried."""
_PER_ROBOT = 60
"""Paths of a car that are tried in an order, the earliest first."""
FARTHEST = 3.0
"""Largest coordinate on a way, in half sides of the rectangle; a car observes its own up to 4."""
_DEVIATION = 0.5
"""Largest standard deviation of a start that is known, over the least distance of two starts."""
_LONGEST = 6.0
"""Longest planned transit, in times in which a car drives a quarter of the rectangle's perimeter."""


def radius_for_all_cars(scenario: Scenario) -> float:
    """Return the radius of a turn that every car of a scenario can drive, also the one of the longest wheelbase [m]."""
    return _RADIUS_FACTOR * scenario.noise.wheelbase_range[1] * scenario.turning_radius


def planned_limits(scenario: Scenario) -> tuple[float, float]:
    """Return the largest speed [m/s] and grip [m/s^2] of planned ways and loops, with which every car can catch up."""
    top, slowest = scenario.robot.top_speed, slowest_top_speed(scenario)
    speed = max(min(_PLANNED_SHARE * top, _SLOWEST_SHARE * slowest), _LEAST_SHARE * top)
    return speed, _PLANNED_SHARE * scenario.robot.lateral_acceleration_max


def speed_on_arc(radius: float, largest: float, grip: float, step: float = 1.0) -> float:
    """Return the largest speed on an arc, for a lateral acceleration `grip` and a turn of `STEP_TURN` in a `step`.

    Lengths and times may have any units.
    """
    return min(largest, math.sqrt(grip * radius), STEP_TURN * radius / step)


def required_distance(scenario: Scenario, clearance: float | None = None) -> float:
    """Return the least distance of two robots in a plan [m]: two radii and a clearance, a radius by default."""
    radius = scenario.robot.radius
    return 2 * radius + (radius if clearance is None else clearance)


def start_is_known(scenario: Scenario) -> bool:
    """Return whether the scenario determines all starts, but for deviations after which all cars reach their ways."""
    if scenario.formation.start != "equilibrium":
        return False
    places = formation_starts(scenario)[0][:, :2]
    apart = np.linalg.norm(places[:, None] - places, axis=-1)[~np.eye(len(places), dtype=bool)].min(initial=math.inf)
    deviation = scenario.formation.start_noise * scenario.alpha * largest_speed(scenario.driven)
    return deviation <= max(_DEVIATION * apart, scenario.robot.radius)


def stays_inside(scenario: Scenario) -> bool:
    """Return whether planned ways and loops must not leave the rectangle to drive in: with an inset or closed edge."""
    return scenario.inset > 0 or scenario.task.boundary != "open"


def formation_starts(scenario: Scenario, turned: Any = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return poses (..., N, 3), x, y [m] and heading [rad], and speeds (..., N) [m/s] of a start in the equilibrium.

    A robot starts at its own top speed if that is lower than the formation's. `turned` (...) are angles by which the
    whole formation is turned [rad].
    """
    gamma = scenario.alpha * (scenario.equilibrium + scenario.displacements + np.asarray(turned)[..., None])
    velocity = closed_forms.curve_derivatives(scenario.driven, gamma)[0] * scenario.formation.phase_rate
    heading = np.arctan2(velocity[..., 1], velocity[..., 0])
    speed = np.minimum(np.hypot(velocity[..., 0], velocity[..., 1]), scenario.top_speeds)
    pose = np.concatenate([closed_forms.curve_point(scenario.driven, gamma), heading[..., None]], axis=-1)
    pose[..., 2] = start_headings(scenario, pose, speed)
    return pose, speed


class Transit(NamedTuple):
    """The ways of a team into its loops."""

    lead_in: np.ndarray
    """(N, L, 2) places of the robots at control steps 0 to L - 1 [m]."""
    loop: np.ndarray
    """(N, K, 2) places on their loops from control step L on [m]."""
    chosen: np.ndarray
    """(N,) loop of each robot."""


def planned_transit(
    scenario: Scenario,
    loop: np.ndarray,
    speed: float | None = None,
    clearance: float | None = None,
    assignments: np.ndarray | None = None,
    after: int = 0,
) -> Transit | None:
    """Return the ways from the equilibrium into loops, without collisions; None if none are found.

    Args:
        scenario: The scenario, of cars whose start is known.
        loop: (N, K, 2) places on the loops at control steps 0, 1 ... of the episode [m].
        speed: Largest speed on the ways [m/s]; None for that of `planned_limits`.
        clearance: Least distance of two bodies [m]; None for the radius of a body.
        assignments: (A, N) loops of the robots that may be chosen; all by default.
        after: Control steps for which the robots first move in formation, on a curve that they can drive.
    """
    turned = scenario.formation.phase_rate * scenario.task.step / scenario.alpha * np.arange(after + 1)
    search = _Search(scenario, np.roll(loop, -after, axis=1), speed, turned[-1])
    arrival = search.arrival()
    cost = np.where(np.isfinite(arrival), arrival, 100.0 * search.arrivals[-1]) ** 4
    robots = np.arange(len(loop))
    if assignments is None:
        from scipy.optimize import linear_sum_assignment  # slow to import

        chosen = linear_sum_assignment(cost)[1]
    else:
        chosen = assignments[np.argmin(cost[robots, assignments].sum(axis=1))]
    lead_in = search.lead_in(chosen, arrival[robots, chosen], required_distance(scenario, clearance))
    if lead_in is None:
        return None
    together = formation_starts(scenario, turned[:-1])[0][..., :2].swapaxes(0, 1)
    lead_in = np.concatenate([together, lead_in], axis=1)
    return Transit(lead_in, np.roll(loop[chosen], -lead_in.shape[1], axis=1), chosen)


class _Search:
    """The search for the ways of cars from the equilibrium of a scenario, turned [rad], into loops (N, K, 2) [m].

    Every car of the scenario can drive within the limits on its motion; at a `speed` [m/s], slower cars fall behind.

    Attributes:
        arrivals: (T,) arrivals that are compared [control step].
        slowest: Smallest speed on ways [m/s].
        fastest: Largest speed on ways [m/s].
        top_speeds: (N,) steady speed of each robot at full throttle [m/s], at least that at which `speed` is possible.
        grip: Largest lateral acceleration in turns [m/s^2]; infinite without a limit.
        within: Half width and half height of the rectangle that cars do not leave [m]; infinite if they may leave it.
    """

    def __init__(self, scenario: Scenario, loop: np.ndarray, speed: float | None, turned: float):
        robot, driven, turning = scenario.robot, scenario.driven, radius_for_all_cars(scenario)
        planned, self.grip = planned_limits(scenario)
        self.loop, self.step, self.drag = loop, scenario.task.step, robot.drag
        self.slowest = max(1.02 * robot.idle_speed, _LEAST_SHARE * robot.top_speed)
        self.fastest = max(speed_on_arc(turning, speed or planned, self.grip, self.step), self.slowest)
        given = min((speed or 0.0) / _SLOWEST_SHARE, weakest_top_speed(scenario))
        self.top_speeds = [max(weakest_top_speed(scenario, factor), given) for factor in scenario.drive_factors]
        half = np.array([driven.half_width, driven.half_height])
        self.within = half if stays_inside(scenario) else np.full(2, math.inf)
        self.farthest = FARTHEST * np.array([scenario.curve.half_width, scenario.curve.half_height])
        self.start, self.speed = formation_starts(scenario, turned)
        self.turning = np.maximum(turning, self.speed**2 / self.grip)  # wider for a car that starts faster
        time = _LONGEST * (scenario.curve.half_width + scenario.curve.half_height) / speed_of(loop, self.step)
        self.arrivals = np.arange(2, math.ceil(time / self.step) + 1)
        velocity = (np.roll(loop, -1, axis=1) - np.roll(loop, 1, axis=1)) / (2 * self.step)
        heading = np.arctan2(velocity[..., 1], velocity[..., 0])
        pieces = np.linalg.norm(np.diff(loop, axis=1, append=loop[:, :1]), axis=2)
        self.loop_speed = (pieces + np.roll(pieces, 1, axis=1)) / (2 * self.step)
        at = self.arrivals % loop.shape[1]
        self.entry = np.concatenate([loop, heading[..., None]], axis=-1)[:, at]
        self.entry_speed = self.loop_speed[:, at, None]

    def arrival(self) -> np.ndarray:
        """Return the earliest arrival (N, N) of each robot on each loop [control step]; infinite if there is none."""
        # One by one: all together need gigabytes for large teams.
        possible = (self.drivable(robot, slice(None))[1].any(axis=2) for robot in range(len(self.loop)))
        return np.array([np.where(is_possible, self.arrivals, np.inf).min(axis=1) for is_possible in possible])

    def drivable(self, robot: int, loops: Any) -> tuple[np.ndarray, np.ndarray]:
        """Return the pieces (M, T, 6, 3) of a robot's paths into M loops [m], and which of these it can drive."""
        start, before, after = self.start[robot], self.speed[robot], self.entry_speed[loops]
        turning = float(self.turning[robot])
        pieces = dubins_lengths(start, self.entry[loops], turning)
        fastest_turning = max(self.fastest, math.sqrt(self.grip * turning))
        lengths, duration = pieces.sum(axis=-1), (self.arrivals * self.step)[:, None]
        swell = lengths / duration - (before + after) / 2
        possible = np.isfinite(lengths)
        for share in _PROFILE:
            speed = before + (after - before) * share + 6 * swell * share * (1 - share)
            gain = (after - before + 6 * swell * (1 - 2 * share)) / duration
            possible &= speed >= np.minimum(self.slowest, 0.9 * np.minimum(before, after)) - 1e-9 * self.fastest
            possible &= speed <= np.maximum(self.fastest, np.maximum(before, after)) * (1 + 1e-9)
            possible &= (gain <= self.drag * (self.top_speeds[robot] - speed)) & (gain >= -0.85 * self.drag * speed)
            along = _distance(before, after, swell, duration, share)
            is_straight = (along >= pieces[..., 0]) & (along <= lengths - pieces[..., 2]) & (TURNS[:, 1] == 0)
            possible &= is_straight | (speed <= fastest_turning * (1 + 1e-9))
        if np.isfinite(self.within).all():
            turns = np.broadcast_to(TURNS, pieces.shape)[possible]
            reach = dubins_reach(start, pieces[possible], turns, np.array(turning))
            possible[possible] = (reach <= np.maximum(self.within, np.abs(start[:2])) * (1 + 1e-9)).all(axis=-1)
        return pieces, possible

    def ways(self, robot: int, loop: Any) -> list[tuple[int, np.ndarray, np.ndarray]]:
        """Return the arrival [control step], the pieces [m] and the turns of a robot's ways, the earliest first."""
        (pieces,), (possible,) = self.drivable(robot, [loop])
        rows, kinds = np.nonzero(possible)
        order = np.lexsort((pieces.sum(axis=-1)[rows, kinds], rows))[:_PER_ROBOT]
        return [(int(self.arrivals[rows[k]]), pieces[rows[k], kinds[k]], TURNS[kinds[k]]) for k in order]

    def places(self, robot: int, loop: Any, arrives: int, pieces: np.ndarray, turns: np.ndarray) -> np.ndarray:
        """Return the places (H, 2) of a robot at every half control step of a way, and then of its loop [m]."""
        around, halves = self.loop[loop], 2 * int(self.arrivals[-1]) + 2 * self.loop.shape[1]
        duration, before, after = arrives * self.step, self.speed[robot], self.loop_speed[loop, arrives % len(around)]
        swell = pieces.sum() / duration - (before + after) / 2
        share = np.arange(2 * arrives) / (2 * arrives)
        along = _distance(before, after, swell, duration, share)
        lead = dubins_poses(self.start[robot], pieces, turns, self.turning[robot], along)[:, :2]
        onward = np.arange(2 * arrives, halves)
        ends = around[onward // 2 % len(around)], around[(onward + 1) // 2 % len(around)]
        return np.concatenate([lead, (ends[0] + ends[1]) / 2])

    def lead_in(self, chosen: np.ndarray, arrival: np.ndarray, apart: float) -> np.ndarray | None:
        """Return the lead-in (N, L, 2) of robots with chosen loops (N,) that stay apart [m]; None if none is found.

        Two robots that start nearer to each other than that do not come nearer.
        """
        ways = [self.ways(robot, loop) for robot, loop in enumerate(chosen)]
        places_of = cache(lambda robot, k: self.places(robot, chosen[robot], *ways[robot][k]))
        draw, order = np.random.default_rng(0), np.argsort(-arrival, kind="stable")
        for _ in range(_TRIES):
            places, arrives = {}, 0
            for robot in order:
                for k, (arrival_step, *_) in enumerate(ways[robot]):
                    is_observed = (np.abs(places_of(robot, k)) <= self.farthest).all()
                    if is_observed and _is_clear(places_of(robot, k), places.values(), apart):
                        places[robot], arrives = places_of(robot, k), max(arrives, arrival_step)
                        break
                else:  # the robot without a way goes first in the next order
                    rest = order[order != robot]
                    order = np.array([robot, *(rest if draw.random() < 0.5 else draw.permutation(rest))])
                    break
            else:
                return np.stack([places[robot][: 2 * arrives : 2] for robot in range(len(ways))])
        return None


def _distance(before: Any, after: Any, swell: Any, duration: Any, share: Any) -> Any:
    """Return the distance driven in a share of a duration [s] at speeds from `before` to `after` [m/s] in m.

    In the middle, the speed is higher than the line between them by 3/2 of `swell` [m/s].
    """
    return duration * (before * share + (after - before) * share**2 / 2 + swell * share**2 * (3 - 2 * share))


def _is_clear(places: np.ndarray, others: Any, apart: float) -> bool:
    """Return whether places (H, 2) stay apart from those of others [m]."""
    for other in others:
        distance = np.linalg.norm(places - other, axis=1)
        if (distance < min(apart, 0.999 * distance[0])).any():
            return False
    return True


def dubins_lengths(start: np.ndarray, end: np.ndarray, radius: float) -> np.ndarray:
    """Return the lengths (..., 6, 3) of the three pieces of each kind of path; NaN where there is none [m].

    Args:
        start: (..., 3) x, y [m] and heading [rad] of the start.
        end: (..., 3) x, y [m] and heading [rad] of the end; broadcasts with `start`.
        radius: Smallest radius of a turn [m].
    """
    start, end = np.broadcast_arrays(start, end)
    pieces = np.full((*start.shape[:-1], len(TURNS), 3), np.nan)
    for k, (first, middle, last) in enumerate(TURNS):
        # Centres of the first and the last turn.
        away = _centre(end, last, radius) - _centre(start, first, radius)
        distance, bearing = np.hypot(away[..., 0], away[..., 1]), np.arctan2(away[..., 1], away[..., 0])
        with np.errstate(invalid="ignore", divide="ignore"):
            if middle != 0:
                # The middle turn touches both others, so its centre is 2 radii from theirs.
                lean = np.arccos(distance / (4 * radius))
                # Headings at both ends of the middle turn, tangents of the circles where they touch.
                leaves = bearing + first * (np.pi / 2 - lean)
                enters = bearing + first * (np.pi / 2 + lean) + np.pi
                straight = radius * _turned(-first * (enters - leaves))
            elif first == last:
                leaves = enters = bearing
                straight = distance
            else:
                straight = np.sqrt(distance**2 - 4 * radius**2)
                leaves = enters = bearing + first * np.arcsin(2 * radius / distance)
        pieces[..., k, 0] = radius * _turned(first * (leaves - start[..., 2]))
        pieces[..., k, 1] = straight
        pieces[..., k, 2] = radius * _turned(last * (end[..., 2] - enters))
    return pieces


def dubins_poses(
    start: np.ndarray, pieces: np.ndarray, turns: np.ndarray, radius: np.ndarray, along: np.ndarray
) -> np.ndarray:
    """Return x, y [m] and heading [rad] (..., M, 3) on paths at some distances, straight on beyond the end.

    Args:
        start: (..., 3) x, y [m] and heading [rad] of the starts.
        pieces: (..., 3) lengths of the pieces [m].
        turns: (..., 3) directions of the pieces, rows of `TURNS`.
        radius: (...) radii of the turns [m].
        along: (..., M) distances from the start [m].
    """
    place, heading, left = start[..., None, :2], start[..., None, 2], along
    for k in range(4):
        length, turn = (pieces[..., k, None], turns[..., k, None]) if k < 3 else (np.inf, 0.0)
        gone = np.clip(left, 0, length)
        left = left - gone
        place, heading = along_arc(place, heading, gone, turn * gone / radius[..., None])
    return np.concatenate([place, heading[..., None]], axis=-1)


def dubins_reach(start: np.ndarray, pieces: np.ndarray, turns: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Return the largest |x| and |y| (..., 2) on paths of finite pieces [m].

    Args:
        start: (..., 3) x, y [m] and heading [rad] of the starts.
        pieces: (..., 3) lengths of the pieces [m].
        turns: (..., 3) directions of the pieces, rows of `TURNS`.
        radius: (...) radii of the turns [m].
    """
    place, heading = start[..., :2], start[..., 2]
    reach = np.abs(place)
    for k in range(3):
        length, turn, wide = pieces[..., k, None], turns[..., k, None], radius[..., None]
        # An arc is farthest out at its ends, or where it is parallel to an axis.
        until = wide * _turned(turn * (np.arange(4) * np.pi / 2 - heading[..., None]))
        gone = np.concatenate([np.minimum(until, length), length], axis=-1)
        passed, headings = along_arc(place[..., None, :], heading[..., None], gone, turn * gone / wide)
        reach = np.maximum(reach, np.abs(passed).max(axis=-2))
        place, heading = passed[..., -1, :], headings[..., -1]
    return reach


def along_arc(place: Any, heading: Any, length: Any, turned: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return places (..., 2) [m] and headings [rad] after arcs of some lengths [m] that turn by some angles [rad]."""
    chord, middle = length * np.sinc(turned / (2 * np.pi)), heading + turned / 2
    return place + chord[..., None] * np.stack([np.cos(middle), np.sin(middle)], axis=-1), heading + turned


def _centre(pose: np.ndarray, side: float, radius: float) -> np.ndarray:
    """Return the centre of a turn to a side (1 left, -1 right) of a pose [m]."""
    normal = np.stack([-np.sin(pose[..., 2]), np.cos(pose[..., 2])], axis=-1)
    return pose[..., :2] + side * radius * normal


def _turned(angle: np.ndarray) -> np.ndarray:
    """Return an angle in [0, 2 pi), 0 for one that is a whole turn but for rounding."""
    turned = np.mod(angle, 2 * np.pi)
    return np.where(turned > 2 * np.pi - 1e-9, 0.0, turned)
