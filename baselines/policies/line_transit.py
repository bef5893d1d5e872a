"""Ways from the formation into the lines of `line-abreast`, chosen so that cars stay apart.

In the open, a car's place in the lines follows from its place on the communication ring. If the formation is rotated by
a random angle at the start, each car derives this angle from its own phase, so the angles of different cars agree only
approximately. For each car and each of many angles, the way is therefore chosen that is farthest from the ways of the
others for the same angle and for the nearest ones, whichever of these each of them derives. Many cars, or starts with
much noise, leave ways on which some collide.

A way is a shortest path of a car that turns by a given radius, an arc, a straight stretch and an arc
(`baselines.policies.transit`), with a speed that makes it end in time, and may end with a further straight stretch.

Where cars must stay inside, the start is known, and the ways are a transit (`baselines.policies.transit`). Float64
NumPy.
"""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.ideal_motion import worst_undetected_time
from baselines.policies.transit import (
    FARTHEST,
    TURNS,
    Transit,
    dubins_lengths,
    dubins_poses,
    dubins_reach,
    formation_starts,
    planned_transit,
)
from lissajous_env.parameters.scenario import Scenario

_CLEAR = 0.5
"""Least distance of two bodies on the ways inside, in radii of a body."""
_PHASES = (0.5, 0.0, 0.25, 0.75)
"""Phases of the lines that are tried inside, in periods."""
_ENDS = ((0.0, 1.0), (0.5, 1.0), (1.0, 1.0), (0.0, 1.5), (0.5, 1.5))
"""Length of the last straight stretch, in half widths of the formation, and radius of the arcs, in that of a turn."""
_TILTS = (0.0, -0.5, 0.5)
"""Changes of the cruising speed from the middle to the ends of a way, relative to that speed."""
_SLACK = 1.13
"""Duration of the ways, relative to that of the slowest shortest way."""
_SLOWEST, _HASTY = 0.3, 0.92
"""Shares of the last speed below which, and of the fastest above which, the speed of a way is penalised."""
_LATE, _POOR, _SLOW, _HURRY = 1e4, 1e3, 0.01, 0.01
"""Penalties of ways that end too late or lead too far away, are too slow, or leave no speed for catching up."""
_WANTED = 5.0
"""Distance of two cars below which coming closer costs something, in radii of a car."""
_CLOSE = 0.06
"""Cost above which a choice is made again in the next round."""
_INTERVALS = 16
"""Intervals of time in which the speeds of all ways are compared."""
_PIECES = 54
"""Approximate number of pieces of a way whose distances are compared."""
_ENTRIES = 250_000
"""Largest number of places in the tables, unless fewer than 16 angles would remain."""


class Effort(NamedTuple):
    """Fineness of the choice of ways: less fine for more cars, since the work grows with the square of their number."""

    angles: int
    """Number of angles of the formation in a turn."""
    choices: int
    """Ways of each car that are compared."""
    nearest: int
    """Largest difference of the angles that two cars derive, in steps of the angle."""
    rounds: int
    """Rounds in which each car chooses its way anew, given the others' ways."""

    @classmethod
    def of(cls, num_robots: int, steps: int) -> "Effort":
        """Return the fineness for a number of cars whose tables have about so many control steps."""
        few, more, many = cls(128, 20, 2, 3), cls(32, 6, 1, 1), cls(16, 1, 0, 1)
        effort = few if num_robots <= 8 else more if num_robots <= 20 else many
        while effort.angles > 16 and effort.angles * num_robots * steps > _ENTRIES:
            effort = effort._replace(angles=effort.angles // 2, nearest=1)
        return effort


class Pace(NamedTuple):
    """Limits on the change of a car's speed: v' from -c v to c (v_max - v)."""

    drag: float
    """c [1/s]."""
    fastest: float
    """v_max [m/s]."""
    final: float
    """Speed at the end of a way [m/s]."""


def transit_inside(scenario: Scenario, loops: np.ndarray, speed: float, slots: np.ndarray) -> Transit:
    """Return the ways from a known start into the lines that have the shortest worst case from the start on.

    The lines may begin in any of `_PHASES`, and a robot may have any place that the ring can be turned to: neighbours
    on the ring stay neighbours in a line.

    Args:
        scenario: The scenario.
        loops: (N, K, 2) x, y [m] at each place in the lines, at the steps of a period.
        speed: Speed of the lines [m/s].
        slots: (N,) place of each robot in the lines by its place on the ring.

    Raises:
        UnsuitableScenarioError: there are no ways without collisions.
    """
    clearance = _CLEAR * scenario.robot.radius
    half = scenario.curve.half_width, scenario.curve.half_height
    rogues = scenario.sensing_radius, scenario.rogue_speed, scenario.task.step
    turns = [(k + 1) // 2 * (-1 if k % 2 else 1) for k in range(len(slots))]  # the smallest first
    places = np.array([(slots + turn) % len(slots) for turn in turns])
    begun = [np.roll(loops, -round(phase * loops.shape[1]), axis=1) for phase in _PHASES]
    transits = [planned_transit(scenario, loop, speed, clearance, places) for loop in begun]
    options = [ways for ways in transits if ways is not None]
    if not options:
        rule = "line-abreast requires ways from the start into the lines inside the walls, on which no two cars collide"
        raise UnsuitableScenarioError(f"{rule}, got none")
    return min(options, key=lambda ways: worst_undetected_time(ways.loop, half, *rogues, lead_in=ways.lead_in))


def angle_steps(scenario: Scenario, angles: int) -> np.ndarray:
    """Return the indices (P,), ascending, of the angles of a turn for which ways are chosen: all, or those near 0."""
    if scenario.formation.start != "equilibrium":
        return np.arange(angles)
    near = min(math.ceil(4 * scenario.formation.start_noise * angles / (2 * np.pi)), angles // 2 - 1)
    return np.arange(-near, near + 1)


def transit_from_any_angle(
    scenario: Scenario, effort: Effort, poses: np.ndarray, radius: float, pace: Pace
) -> np.ndarray:
    """Return places (P, N, K, 2) [m] of ways from the formation, turned by any of P angles, to poses (N, 3).

    All last as many steps, `_SLACK` times those of the cars' slowest shortest way. The poses are x, y [m] and heading
    [rad] after the last step, so that the last place is a step before them.
    """
    begin, speed = formation_starts(scenario, 2 * np.pi * angle_steps(scenario, effort.angles) / effort.angles)
    pieces, turns, radii, leads, tilt = _choices(begin, poses, radius)
    length = pieces.sum(axis=-1) + leads
    times = _times(scenario, pace, speed, length.min(axis=-1))
    speed, coarsely = speed[..., None], np.linspace(0, times[-1], _INTERVALS + 1)
    cruise = cruise_speed(pace, speed, tilt, length, coarsely)
    penalties = _penalties(pace, distances(pace, speed, cruise, tilt, coarsely), length, coarsely)
    reach = dubins_reach(begin[:, :, None], np.nan_to_num(pieces, posinf=0.0), turns, radii)
    far = FARTHEST * np.array([scenario.curve.half_width, scenario.curve.half_height])
    penalties += _LATE * (reach > far).any(axis=-1)
    costs = penalties + 1e-3 * np.abs(cruise / pace.final - 1)
    order = np.argsort(costs, axis=-1, kind="stable")[..., : effort.choices]
    length, penalties, cruise = (np.take_along_axis(array, order, axis=2) for array in (length, penalties, cruise))
    pieces = np.take_along_axis(pieces, order[..., None], axis=2)
    turns, radii = turns[order], radii[order]
    travelled = distances(pace, speed, cruise, tilt[order], times)
    travelled *= np.where(penalties < _LATE, length / travelled[..., -1], 1.0)[..., None]
    coarse = dubins_poses(begin[:, :, None], pieces, turns, radii, travelled[..., :: max(len(times) // _PIECES, 1)])
    coarse = np.moveaxis(coarse[..., :2], -1, 0).astype(np.float32)
    noise = 3 * math.sqrt(2) * scenario.formation.start_noise * effort.angles / (2 * np.pi)
    effort = effort._replace(nearest=min(math.ceil(noise), effort.nearest))
    chosen = _chosen(coarse, penalties.astype(np.float32), effort, _WANTED * scenario.robot.radius)
    at = (*np.ogrid[: chosen.shape[0], : chosen.shape[1]], chosen)
    return dubins_poses(begin, pieces[at], turns[at], radii[at], travelled[at])[:, :, :-1, :2]


def _choices(begin: np.ndarray, poses: np.ndarray, radius: float) -> tuple[np.ndarray, ...]:
    """Return the ways among which cars choose: by kinds of paths, ends and tilts.

    They are the lengths (P, N, C, 3) of the arcs and of the stretch between them [m], infinite for a way that does not
    exist, the directions (C, 3) and radii (C,) of the arcs, the lengths (C,) of the last stretch, and the tilts (C,).
    """
    span = np.abs(begin[..., :2]).max()
    ahead = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=-1)
    leads, radii = np.array([(lead * span, wide * radius) for lead, wide in _ENDS]).T
    of_ends = []
    for lead, wide in zip(leads, radii, strict=True):
        entry = np.concatenate([poses[:, :2] - lead * ahead, poses[:, 2:]], axis=-1)
        pieces = dubins_lengths(begin, entry, wide)[..., :4, :]
        of_ends.append(np.where(np.isnan(pieces), [0.0, np.inf, 0.0], pieces))
    count, kinds = len(_TILTS), len(_ENDS) * 4
    leads, radii = (np.tile(np.repeat(array, 4), count) for array in (leads, radii))
    turns = np.tile(TURNS[:4], (len(_ENDS) * count, 1))
    return np.concatenate(of_ends * count, axis=2), turns, radii, leads, np.repeat(_TILTS, kinds)


def _times(scenario: Scenario, pace: Pace, speed: np.ndarray, shortest: np.ndarray) -> np.ndarray:
    """Return the times of the steps [s] in which every car can drive its shortest way, and `_SLACK` times as many."""
    step = scenario.task.step
    fastest, tilt = np.full_like(speed, pace.fastest), np.zeros_like(speed)
    steps = max(math.ceil(shortest.max() / (pace.fastest * step)), 4)
    while (distances(pace, speed, fastest, tilt, step * np.arange(steps + 1))[..., -1] < shortest).any():
        steps += max(steps // 50, 1)
    return step * np.arange(math.ceil(_SLACK * steps) + 1)


def distances(pace: Pace, begin: np.ndarray, cruise: np.ndarray, tilt: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return (..., K) distances driven [m] at K evenly spaced times [s], from 0 to the end of a way.

    The speed approaches the cruising speed v_b, as v_b + (v_0 - v_b) exp(-c t), and then the final one as late as the
    motor allows. At the start, v_b is greater than in the middle by the share `tilt` of it, and at the end smaller.
    """
    begin, cruise = begin[..., None], cruise[..., None]
    left = times[-1] - times
    cruise = np.minimum(cruise * (1 + tilt[..., None] * (1 - 2 * times / times[-1])), pace.fastest)
    towards = cruise + (begin - cruise[..., :1]) * np.exp(-pace.drag * times)
    rising = pace.fastest - (pace.fastest - pace.final) * np.exp(np.minimum(pace.drag * left, 50.0))
    falling = pace.final * np.exp(np.minimum(pace.drag * left, 50.0))
    speed = np.where(cruise < pace.final, np.maximum(towards, rising), np.minimum(towards, falling))
    mean = (speed[..., 1:] + speed[..., :-1]) / 2
    travelled = np.cumsum(mean, axis=-1) * (times[1] - times[0])
    return np.concatenate([np.zeros((*travelled.shape[:-1], 1)), travelled], axis=-1)


def cruise_speed(pace: Pace, begin: np.ndarray, tilt: np.ndarray, length: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the cruising speed (...) at which a way of a length [m] lasts the whole time [m/s]."""
    low, high = np.zeros_like(length), np.full_like(length, 2 * pace.fastest)
    for _ in range(14):
        middle = (low + high) / 2
        short = distances(pace, begin, middle, tilt, times)[..., -1] < length
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return (low + high) / 2


def _penalties(pace: Pace, travelled: np.ndarray, length: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the costs of ways of a length [m] that end too late, are too slow, or leave nothing for catching up."""
    speeds = np.diff(travelled, axis=-1) / (times[1] - times[0])
    slowest = speeds.min(axis=-1) / pace.final
    hasty = speeds[..., : -(len(times) // 4)].max(axis=-1) > _HASTY * pace.fastest
    late = length / times[-1] > _HASTY * pace.fastest
    return (
        _LATE * (travelled[..., -1] < 0.98 * length)
        + _POOR * ((slowest < _SLOWEST / 3) + late)
        + (_HURRY * hasty + _SLOW * (slowest < _SLOWEST))
    )


def closeness(one: np.ndarray, two: np.ndarray, wanted: float) -> np.ndarray:
    """Return a cost of two points that come close, which move straight between places (2, ..., K) [m].

    It is the sum over the pieces of the fourth power of (wanted - least distance) / wanted, where that is positive.
    """
    x, y = (one - two) / wanted
    x_moved, y_moved = x[..., 1:] - x[..., :-1], y[..., 1:] - y[..., :-1]
    x, y = x[..., :-1], y[..., :-1]
    square = np.maximum(x_moved**2 + y_moved**2, 1e-12)
    share = np.clip(-(x * x_moved + y * y_moved) / square, 0, 1)
    nearest = (x + share * x_moved) ** 2 + (y + share * y_moved) ** 2
    lacks = np.maximum(1 - np.sqrt(nearest), 0) ** 2
    return (lacks * lacks).sum(axis=-1)


def _chosen(places: np.ndarray, penalties: np.ndarray, effort: Effort, wanted: float) -> np.ndarray:
    """Return the way (P, N) of each car for each angle, among C that lead to places (2, P, N, C, K).

    Each car chooses in turn, for the current choices of the others: the way with the least sum of its penalty (P, N, C)
    and of the closeness to the ways of the others for the same angle and the nearest ones.
    """
    chosen = penalties.argmin(axis=2)
    angles, cars = chosen.shape

    def choose(at: np.ndarray, i: int, others: Iterable[int]) -> np.ndarray:
        """Let car i choose for some angles, given the choices of others for adjacent angles, and return the costs.

        If the angles are those near 0, the first and the last count as adjacent, too, which is needless but cheap.
        """
        cost = np.zeros(penalties[at, i].shape, dtype=np.float32)
        for j in others:
            for shift in range(-effort.nearest, effort.nearest + 1):
                nearby = (at + shift) % angles
                cost += closeness(places[:, at, i], places[:, nearby, j, chosen[nearby, j], None], wanted)
        cost = penalties[at, i] + cost
        chosen[at, i] = cost.argmin(axis=1)
        return cost.min(axis=1)

    at = np.arange(angles)
    for i in range(cars):
        choose(at, i, range(i))
    for _ in range(effort.rounds):
        close = np.max([choose(at, i, set(range(cars)) - {i}) for i in range(cars)], axis=0)
        at = at[close > _CLOSE]
    return chosen
