"""Lower bounds of the scores of a scenario, which apply to every policy without information on undetected targets.

**Mean detection time.** After a time t, m discs of radius r that move at a speed v have swept at most
m (pi r^2 + 2 r v t) of an area A, so the probability that a uniformly placed target is undetected is at least the
remaining share; the mean time is at least the integral of that share over time: (A - m pi r^2)^2 / (4 m r v A) for
targets that do not move and an episode without end. `mean_time_lower_bound` is the bound for the score of a scenario.

**On the boundary** a robot senses at most 2 r of a straight side at once and v t more by a time t. At a corner, it
senses both sides: on its way from one to the other it passes within r of the corner, through a point (x, y) from it
with x + y <= sqrt(2) r, and senses at most that much more than on a straight line. Two robots at one corner share this
gain. So m robots have sensed at most m (2 r + v t) + 4 sqrt(2) r of the perimeter of a rectangle whose sides are at
least 4 r; changing to the opposite side gains nothing in such a rectangle.

**Moving targets.** A target that moves at a speed u independently of the robots is approached at a relative speed of at
most v + u. (In a rectangle that reflects it, this follows from the mean over its mirror images.) A target that reacts
may move into a disc, but at time t it is within u t of its origin, which discs of radius r + u t must have passed. A
target that flees from robots within a distance d does not react to them before, so it is detected no earlier than by
discs of radius d. If two of these bounds apply, the later time is valid.

**A target that appears undetected** is uniform on the area outside all discs, which is at least A - m pi r^2.
"""

import math
from typing import Any

import numpy as np

from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory.geometry import largest_speed
from lissajous_env.theory.worst_case import clearing_time, revisiting_time
from lissajous_env.world.targets.detection import TRIES

_INSTANTS = 40_001
"""Number of times at which the undetected share is computed; between two times the later, smaller value is used."""


def robot_speed_limit(scenario: str | Scenario) -> float:
    """Return the top speed of a robot over the ground [m/s]; NaN for registered models.

    For a car or differential drive it is that with the largest drive that `robot.drive_factors` and
    `noise.drive_spread` allow; for a point it is alpha `phase_rate_max` max ||r'||.
    """
    scenario = named.build(scenario).resolve()
    if scenario.robot.kind in ("car", "differential"):
        return scenario.top_speed_bound
    if scenario.robot.kind == "curve":
        return scenario.alpha * float(scenario.robot.phase_rate_max or 0.0) * largest_speed(scenario.driven)
    return math.nan


def mean_time_lower_bound(scenario: str | Scenario) -> float:
    """Return the lower bound of the expected `detection_time_mean` of a scenario [s] for any policy.

    S(t) is the least share of targets that are undetected at a time t after they appeared, averaged over the kinds of
    motion. For an episode of D seconds and Poisson arrivals, which are rounded up to a step h:

        start    = integral of S over [0, D]
        arrivals = integral of S(t) (D - h - t) over [0, D - h], divided by D
        bound    = w start + (1 - w) arrivals,  w = count / (count + arrival_rate D)

    A target counts until the end of the episode, hence the ends of the integrals; w is a lower bound of the mean share
    of initial targets by Jensen's inequality. The bound is 0 if the discs can cover everything from the start. It is
    NaN if nothing is proved: no targets, rogues, a custom motion or robot model, targets that appear at hotspots, by an
    extension or anew, or an episode that ends when robots are removed.
    """
    scenario = named.build(scenario)
    targets, duration, speed = scenario.targets, _duration(scenario), robot_speed_limit(scenario)
    mean_arrivals = targets.arrival_rate * duration
    if (
        not speed >= 0
        or _ends_early(scenario)
        or targets.custom > 0
        or targets.rogues
        or targets.entry in ("hotspots", "custom")
        or targets.respawn
        or targets.count + mean_arrivals == 0
    ):
        return math.nan
    times = np.linspace(0.0, duration, _INSTANTS)
    moving = {"independent": targets.drifting + targets.wandering, "fleeing": targets.fleeing}
    shares = {"still": max(1.0 - sum(moving.values()), 0.0), **moving}
    undetected = sum(share * _undetected(scenario, motion, speed, times) for motion, share in shares.items())
    later, gap = np.asarray(undetected)[1:], times[1]
    left_over = np.maximum(duration - scenario.task.step - times[1:], 0.0)
    start, arrivals = later.sum() * gap, (later * left_over).sum() * gap / duration
    weight = targets.count / (targets.count + mean_arrivals)
    return float(weight * start + (1 - weight) * arrivals)


def worst_case_lower_bound(scenario: str | Scenario) -> float:
    """Return the lower bound of the `guaranteed_detection_time` of a scenario [s] for any policy.

    It is the largest of the bounds that apply; `lissajous_env.theory.worst_case` proves the first two:

    * rogues appear inside: the time in which the discs can clear everything of rogues of the top speed `rogue_speed`;
    * rogues appear again and again: the time in which the robots can revisit each of a number of points that are far
      apart;
    * rogues appear on the boundary: the time in which the discs sweep it, m (2 r + v T) + 4 sqrt(2) r = P.

    If it is the length of an episode, no policy guarantees anything. A score is resolved to a control step and half a
    cell of the contamination grid, and may be lower by as much. The bound is NaN if nothing is proved: no targets, a
    custom robot model, or an episode that ends when robots are removed.
    """
    scenario = named.build(scenario)
    targets, speed, duration = scenario.targets, robot_speed_limit(scenario), _duration(scenario)
    if not speed > 0 or _ends_early(scenario) or targets.count + targets.arrival_rate == 0:
        return math.nan
    on_boundary, radius = targets.entry == "boundary", scenario.sensing_radius
    team = 2 * scenario.curve.half_width, 2 * scenario.curve.half_height, scenario.num_robots, radius, speed
    if on_boundary:
        bound = max(_whole(scenario) - float(_swept(scenario, radius, 0.0)), 0.0) / (scenario.num_robots * speed)
    else:
        bound = clearing_time(*team, scenario.rogue_speed)
    if targets.arrival_rate > 0:
        bound = max(bound, revisiting_time(*team, duration, on_boundary))
    return min(bound, duration if targets.count else duration - scenario.task.step)


def _ends_early(scenario: Scenario) -> bool:
    return "remove" in (scenario.task.on_collision, scenario.task.boundary)


def _undetected(scenario: Scenario, motion: str, speed: float, times: np.ndarray) -> np.ndarray:
    """Return (T,) the least share of targets of a motion that are undetected at times after they appeared."""
    targets, radius, driven = scenario.targets, scenario.sensing_radius, speed * times
    moved, whole = targets.speed * times, _whole(scenario)
    if motion == "fleeing":
        fastest, zone = max(targets.speed, targets.flee_speed), max(radius, targets.flee_radius)
        size = np.minimum(_swept(scenario, radius + fastest * times, driven), _swept(scenario, zone, driven, moved))
    else:
        size = _swept(scenario, radius, driven, 0.0 if motion == "still" else moved)
    if targets.entry != "unseen":
        return np.clip(1 - size / whole, 0.0, 1.0)
    at_once = float(_swept(scenario, radius, 0.0))
    if at_once >= whole:
        return np.zeros_like(times)
    has_place = 1 - (at_once / whole) ** TRIES  # probability that one of the places is outside all discs
    return has_place * np.clip(1 - (size - at_once) / (whole - at_once), 0.0, 1.0)


def _swept(scenario: Scenario, radius: Any, driven: Any, moved: Any = 0.0) -> np.ndarray:
    """Return the largest part of where targets appear that the discs of a team can have sensed [m^2 or m].

    Args:
        scenario: The scenario.
        radius: Radius of the discs [m].
        driven: Distance that each disc has moved [m].
        moved: Distance that each target has moved, independently of the discs [m].
    """
    robots, curve = scenario.num_robots, scenario.curve
    if scenario.targets.entry != "boundary":
        return robots * (math.pi * np.square(radius) + 2 * np.multiply(radius, driven + moved))
    # The relative speed gives a smaller value, which is not proved for the corners of a boundary.
    reach = np.asarray(radius + moved)
    size = robots * (2 * reach + driven) + 4 * math.sqrt(2) * reach
    return np.where(2 * reach <= min(curve.half_width, curve.half_height), size, math.inf)


def _whole(scenario: Scenario) -> float:
    """Return the size of where targets appear [m^2 or m]."""
    width, height = 2 * scenario.curve.half_width, 2 * scenario.curve.half_height
    return 2 * (width + height) if scenario.targets.entry == "boundary" else width * height


def _duration(scenario: Scenario) -> float:
    """Return the time of all steps of an episode, to which `task.duration` is rounded [s]."""
    return scenario.task.steps * scenario.task.step
