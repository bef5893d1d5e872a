"""Lower bounds of the mean detection time: what no policy can beat that knows nothing of where a target is.

After a time t, m discs of radius r that move at a speed v have swept at most m (pi r^2 + 2 r v t) of an area A, so a
target whose place is uniform on it is undetected with at least the share that is left; the mean time is at least the
integral of that share over time. `mean_time_inside` and `mean_time_on_boundary` are these integrals in closed form, for
targets that stand still and an episode without end; `mean_time_limit` is the bound for a scenario as it is scored.

**On the boundary** a robot sees at most 2 r of a straight side at once and v t more by a time t. At a corner it sees
both sides: going from one to the other it has to come by within r of the corner, over a point (x, y) from it with
x + y <= sqrt(2) r, and so sees at most that much more than on a straight line. Two robots at one corner share it:
what the second saves there, both see. So m robots have seen at most m (2 r + v t) + 4 sqrt(2) r of the perimeter
of a rectangle whose sides are at least 4 r, for which a change to the opposite side pays nothing either.

**Moving targets.** One that moves at a speed u and takes no notice of the robots is met at v + u at most: seen from it,
a disc moves no faster. (In a rectangle that reflects it, by the mean over its mirror images.) One that reacts may run
into a disc, but at time t it is within u t of where it appeared: discs of radius r + u t have to have passed there. One
that flees from robots within a distance d takes no notice of them before, so that it is found no sooner than it would
be by discs of radius d. Where two of these hold, the later time does.

**A target that appears unseen** is uniform on what no disc covers, A - m pi r^2 at least.
"""

import math
from collections.abc import Callable

import numpy as np

from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.parts import Targets
from lissajous_env.theory.geometry import largest_speed, top_speed

_INSTANTS = 40_001
"""Times at which the share of the undetected is computed; it is taken as small in between as at the next of them."""

_PLACES = 64
"""Places that are tried for a target that appears unseen; where none of them is, it is seen at once."""

_Swept = Callable[[np.ndarray | float, np.ndarray | float], np.ndarray]
"""What discs of a radius [m] have swept at most where each of them has gone a way [m]."""


def mean_time_inside(area: float, num_robots: int, radius: float, speed: float) -> float:
    """(A - m pi r^2)^2 / (4 m r v A) [s], of targets that appear anywhere in an area.

    Args:
        area: A [m^2].
        num_robots: m.
        radius: r, of a robot's sensor [m].
        speed: v, top speed of a robot, with that of a target where they move [m/s].
    """
    left = max(area - num_robots * math.pi * radius**2, 0.0)
    return left**2 / (4 * num_robots * radius * speed * area)


def mean_time_on_boundary(length: float, num_robots: int, radius: float, speed: float) -> float:
    """(P - 2 m r)^2 / (2 m v P) [s], of targets that appear anywhere on a closed line without corners.

    Equally spaced laps meet it. For a rectangle put P - 4 sqrt(2) r in the square: its corners can be cut.

    Args:
        length: P [m].
        num_robots: m.
        radius: r, of a robot's sensor [m].
        speed: v, top speed of a robot, with that of a target along the boundary where they move [m/s].
    """
    left = max(length - 2 * num_robots * radius, 0.0)
    return left**2 / (2 * num_robots * speed * length)


def robot_speed_limit(scenario: str | Scenario) -> float:
    """Top speed of a robot over the ground [m/s]; NaN for a model of robots that is not ours.

    A car's is that at full throttle, or at which it starts; a point's is alpha `phase_rate_max` max ||r'||.
    """
    made = named.scenario(scenario).resolve()
    if made.robot.kind == "car":
        return max(made.robot.top_speed, top_speed(made.curve, made.formation.phase_rate))
    if made.robot.kind == "curve":
        return made.alpha * float(made.robot.phase_rate_max or 0.0) * largest_speed(made.curve)
    return math.nan


def mean_time_limit(scenario: str | Scenario) -> float:
    """Lower bound of the expected `detection_time_mean` of a scenario [s], whatever the policy.

    With S(t) the share that is undetected at least a time t after it appeared, averaged over the kinds of motion, an
    episode of D seconds and arrivals that are uniform in it and rounded up to a step h, as a Poisson process has them:

        start    = integral of S over [0, D]
        arrivals = integral of S(t) (D - h - t) over [0, D - h], divided by D
        bound    = w start + (1 - w) arrivals,  w = count / (count + arrival_rate D)

    A target counts until the end of the episode and no longer, hence the ends of the integrals; w is the least that the
    mean share of the first kind can be, by Jensen's inequality. 0 where the discs can cover everything from the start.
    NaN where nothing is proved: no targets, targets or robots that move by a model that is not ours, an episode that
    robots can end by being removed, targets without a place of this scenario's kinds.
    """
    scenario = named.scenario(scenario)
    targets, task, speed = scenario.targets, scenario.task, robot_speed_limit(scenario)
    mean_arrivals = targets.arrival_rate * task.duration
    ends_early = "remove" in (task.on_collision, task.boundary)
    if not speed >= 0 or ends_early or targets.custom > 0 or targets.count + mean_arrivals == 0:
        return math.nan
    times = np.linspace(0.0, task.duration, _INSTANTS)
    left = sum(share * _undetected(scenario, motion, speed, times) for motion, share in _shares(targets).items())
    later, gap = np.asarray(left)[1:], times[1]
    left_over = np.maximum(task.duration - task.step - times[1:], 0.0)
    start, arrivals = later.sum() * gap, (later * left_over).sum() * gap / task.duration
    weight = targets.count / (targets.count + mean_arrivals)
    return float(weight * start + (1 - weight) * arrivals)


def guaranteed_time_limit(scenario: str | Scenario) -> float:
    """Lower bound of the `guaranteed_detection_time` of a scenario [s], whatever the policy.

    A rogue that stands still can be introduced anywhere at any time, so that discs have to sweep everything in every
    time T at least: m (pi r^2 + 2 r v T) = A, and on a boundary m (2 r + v T) + 4 sqrt(2) r = P. Rogues that move only
    make it longer. NaN where nothing is proved, as for `mean_time_limit`; at most the time of an episode.
    """
    scenario = named.scenario(scenario)
    speed, radius = robot_speed_limit(scenario), scenario.sensing_radius
    if not speed > 0 or scenario.targets.count + scenario.targets.arrival_rate == 0:
        return math.nan
    swept, size = _swept_and_whole(scenario)
    at_once, after_a_second = float(swept(radius, 0.0)), float(swept(radius, speed))
    if at_once >= size:
        return 0.0
    return min((size - at_once) / (after_a_second - at_once), scenario.task.duration)


def _shares(targets: Targets) -> dict[str, float]:
    """Share of the targets by kind of motion."""
    moving = {"ambling": targets.drifting + targets.wandering, "fleeing": targets.fleeing}
    return {"still": max(1.0 - sum(moving.values()), 0.0), **moving}


def _undetected(scenario: Scenario, motion: str, speed: float, times: np.ndarray) -> np.ndarray:
    """(T,) least share that is undetected at some times after it appeared, of targets of one kind of motion."""
    targets, radius, way = scenario.targets, scenario.sensing_radius, speed * times
    on_boundary = targets.entry == "boundary"
    swept, size = _swept_and_whole(scenario)
    if motion == "still":
        seen = swept(radius, way)
    elif motion == "ambling":
        seen = _least_swept(swept, radius, way, targets.speed * times, on_boundary)
    else:
        fastest = max(targets.speed, targets.flee_speed)
        zone = max(radius, targets.flee_radius)
        until_it_flees = _least_swept(swept, zone, way, targets.speed * times, on_boundary)
        seen = np.minimum(swept(radius + fastest * times, way), until_it_flees)
    if targets.entry != "unseen":
        return np.clip(1 - seen / size, 0.0, 1.0)
    at_once = scenario.num_robots * math.pi * radius**2
    if at_once >= size:
        return np.zeros_like(times)
    found_a_place = 1 - (at_once / size) ** _PLACES
    return found_a_place * np.clip(1 - (seen - at_once) / (size - at_once), 0.0, 1.0)


def _swept_and_whole(scenario: Scenario) -> tuple[_Swept, float]:
    """What discs have swept at most of where targets appear, and how much of that there is: [m^2], or [m] of a line."""
    width, height, robots = 2 * scenario.curve.half_width, 2 * scenario.curve.half_height, scenario.num_robots

    def on_area(reach: np.ndarray | float, gone: np.ndarray | float) -> np.ndarray:
        return robots * (math.pi * np.square(reach) + 2 * np.multiply(reach, gone))

    def on_perimeter(reach: np.ndarray | float, gone: np.ndarray | float) -> np.ndarray:
        seen = robots * (2 * np.asarray(reach) + gone) + 4 * math.sqrt(2) * np.asarray(reach)
        return np.where(4 * np.asarray(reach) <= min(width, height), seen, math.inf)

    if scenario.targets.entry == "boundary":
        return on_perimeter, 2 * (width + height)
    return on_area, width * height


def _least_swept(swept: _Swept, radius: float, way: np.ndarray, moved: np.ndarray, on_boundary: bool) -> np.ndarray:
    """What discs have swept, for targets that have moved a way of their own [m] and take no notice of the discs."""
    within_reach = swept(radius + moved, way)
    # By relative speed it is less, which is not proved for the corners of a boundary.
    return within_reach if on_boundary else np.minimum(within_reach, swept(radius, way + moved))
