"""Ways from the formation into the lines of `line-abreast`, chosen so that no two cars meet.

A car's place in the lines is fixed, by its place on the communication ring. If the formation is rotated by a random
angle at the start, each car derives this angle from its own phase, so the angles of different cars agree only
approximately. So a way is chosen for each car and each of many angles such that it stays clear of the ways that the
others have chosen for the same angle and for the nearest ones: whichever of these each car believes in, no two meet.

A way is a shortest path of a car that turns by a given radius, an arc, a straight stretch and an arc
(`baselines.policies.dubins`), with a speed that makes it end in time. Float64 NumPy.
"""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from baselines.policies.dubins import TURNS, dubins_lengths, dubins_poses
from baselines.policies.transit import formation_starts
from lissajous_env.parameters.scenario import Scenario

_ENDS = ((0.0, 1.0), (0.5, 1.0), (1.0, 1.0), (0.0, 1.5), (0.5, 1.5))
"""Length of the last straight stretch, in half widths of the formation, and radius of the arcs, in that of a turn."""
_TILTS = (0.0, -0.5, 0.5)
"""Changes of the speed between, from the middle to the ends of a way, in the speed."""
_SLACK = 1.13
"""Duration of the ways, relative to that of the slowest shortest way."""
_SLOWEST, _HASTY = 0.3, 0.92
"""Speeds that a way avoids: below this share of the last one, and above this share of the fastest."""
_LATE, _POOR, _SLOW, _HURRY = 1e4, 1e3, 0.01, 0.01
"""Costs of ways that end too late, are too slow, or leave nothing for catching up."""
_WANTED = 5.0
"""Distance of two cars below which coming closer costs something, in radii of a car."""
_CLOSE = 0.06
"""Cost from which on a choice is looked at again."""
_INTERVALS = 16
"""Intervals of time in which the speeds of all ways are compared."""
_PIECES = 54
"""Pieces of ways, about, the distances of which are compared."""
_ENTRIES = 250_000
"""Entries of the tables for one control step each, at most, unless that leaves fewer than 16 angles."""


class Effort(NamedTuple):
    """Fineness of the choice of ways: less fine for more cars, since the work grows with the square of their number."""

    angles: int
    """Number of angles of the formation in a turn."""
    choices: int
    """Ways of each car that are compared."""
    nearest: int
    """Largest distance of two angles that cars may believe in at the same time, in steps of the angle."""
    rounds: int
    """Rounds in which each car chooses its way anew, given the others' ways."""


def effort_of(num_robots: int, steps: int) -> Effort:
    """Return how finely the ways of so many cars are chosen, where their tables have about so many control steps."""
    if num_robots <= 8:
        effort = Effort(128, 20, 2, 3)
    else:
        effort = Effort(32, 6, 1, 1) if num_robots <= 20 else Effort(16, 1, 0, 1)
    while effort.angles > 16 and effort.angles * num_robots * steps > _ENTRIES:
        effort = effort._replace(angles=effort.angles // 2, nearest=1)
    return effort


def angle_steps(scenario: Scenario, angles: int) -> np.ndarray:
    """Return the indices (P,), ascending, of the angles of a turn for which ways are chosen: all, or those near 0."""
    if scenario.formation.start != "equilibrium":
        return np.arange(angles)
    near = min(math.ceil(4 * scenario.formation.start_noise * angles / (2 * np.pi)), angles // 2 - 1)
    return np.arange(-near, near + 1)


class Ways(NamedTuple):
    """Paths of an arc, a straight stretch and an arc, and a further straight stretch; arrays of one shape."""

    begin: np.ndarray
    """(..., 3) x, y [m] and heading [rad] at the beginning."""
    radius: np.ndarray
    """Radius of the arcs [m]."""
    pieces: np.ndarray
    """(..., 3) lengths of the arcs and of the stretch between them [m]; infinite for a way that does not exist."""
    turns: np.ndarray
    """(..., 3) their directions, as in `baselines.policies.dubins.TURNS`."""
    lead: np.ndarray
    """Length of the further stretch [m]."""

    @property
    def length(self) -> np.ndarray:
        """Length of the whole [m]."""
        return self.pieces.sum(axis=-1) + self.lead


def ways_between(begin: np.ndarray, end: np.ndarray, radius: float, lead: float) -> Ways:
    """Return the ways (..., 4) of each word with a straight stretch between poses (..., 3): x, y [m], heading [rad].

    Args:
        begin: Poses at the beginning.
        end: Poses at the end; broadcasts with `begin`.
        radius: Radius of the arcs [m].
        lead: Length of the further straight stretch at the end [m].
    """
    begin, end = np.broadcast_arrays(begin, end)
    ahead = np.stack([np.cos(end[..., 2]), np.sin(end[..., 2])], axis=-1)
    entry = np.concatenate([end[..., :2] - lead * ahead, end[..., 2:]], axis=-1)
    pieces = dubins_lengths(begin, entry, radius)[..., :4, :]
    pieces = np.where(np.isnan(pieces), [0.0, np.inf, 0.0], pieces)
    shape = pieces.shape[:-1]
    return Ways(
        np.broadcast_to(begin[..., None, :], pieces.shape),
        np.full(shape, radius),
        pieces,
        np.broadcast_to(TURNS[:4], pieces.shape),
        np.full(shape, lead),
    )


class Pace(NamedTuple):
    """Limits on the change of a car's speed: v' from -c v to c (v_max - v)."""

    drag: float
    """c [1/s]."""
    fastest: float
    """v_max [m/s]."""
    final: float
    """Speed at the end of a way [m/s]."""


def distances(pace: Pace, begin: np.ndarray, between: np.ndarray, tilt: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return (..., K) distances [m] at times [s], the last of which is the end, K even intervals apart.

    The speed approaches the one between, v_b + (v_0 - v_b) exp(-c t), and then the final one as late as the motor
    allows.
    """
    begin, between = begin[..., None], between[..., None]
    left = times[-1] - times
    between = np.minimum(between * (1 + tilt[..., None] * (1 - 2 * times / times[-1])), pace.fastest)
    towards = between + (begin - between[..., :1]) * np.exp(-pace.drag * times)
    rising = pace.fastest - (pace.fastest - pace.final) * np.exp(np.minimum(pace.drag * left, 50.0))
    falling = pace.final * np.exp(np.minimum(pace.drag * left, 50.0))
    speed = np.where(between < pace.final, np.maximum(towards, rising), np.minimum(towards, falling))
    mean = (speed[..., 1:] + speed[..., :-1]) / 2
    gone = np.cumsum(mean, axis=-1) * (times[1] - times[0])
    return np.concatenate([np.zeros((*gone.shape[:-1], 1)), gone], axis=-1)


def speed_between(pace: Pace, begin: np.ndarray, tilt: np.ndarray, length: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the speed between (...) at which a way of a length [m] lasts the whole time [m/s]."""
    low, high = np.zeros_like(length), np.full_like(length, 2 * pace.fastest)
    for _ in range(14):
        middle = (low + high) / 2
        short = distances(pace, begin, middle, tilt, times)[..., -1] < length
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    return (low + high) / 2


def closeness(one: np.ndarray, two: np.ndarray, wanted: float) -> np.ndarray:
    """Return how much two points that move straight between places (2, ..., K) come too close, without first and last.

    It is the sum over the pieces of the fourth power of what the least distance lacks to the wanted one, in its units.
    """
    x, y = (one - two) / wanted
    x_moved, y_moved = x[..., 1:] - x[..., :-1], y[..., 1:] - y[..., :-1]
    x, y = x[..., :-1], y[..., :-1]
    square = np.maximum(x_moved**2 + y_moved**2, 1e-12)
    share = np.clip(-(x * x_moved + y * y_moved) / square, 0, 1)
    nearest = (x + share * x_moved) ** 2 + (y + share * y_moved) ** 2
    lacks = np.maximum(1 - np.sqrt(nearest), 0) ** 2
    return (lacks * lacks).sum(axis=-1)


def transit(scenario: Scenario, effort: Effort, poses: np.ndarray, radius: float, pace: Pace) -> np.ndarray:
    """Return places (P, N, K, 2) [m] of ways from the formation, turned by any of P angles, to poses (N, 3).

    Each lasts as many steps as the longest of the cars' shortest ways. The last place is a step before the pose: x, y
    [m], heading [rad].
    """
    angles = 2 * np.pi * angle_steps(scenario, effort.angles) / effort.angles
    begin, speed = formation_starts(scenario, angles)
    choices = _choices(begin, poses, radius)
    times = _times(scenario, pace, speed, choices.length.min(axis=-1))
    wide = np.broadcast_to(speed[..., None], choices.length.shape)
    tilt = np.broadcast_to(np.repeat(_TILTS, choices.length.shape[-1] // len(_TILTS)), choices.length.shape)
    coarsely = np.linspace(0, times[-1], _INTERVALS + 1)
    between = speed_between(pace, wide, tilt, choices.length, coarsely)
    faults = _faults(pace, distances(pace, wide, between, tilt, coarsely), choices.length, coarsely)
    order = np.argsort(faults + 1e-3 * np.abs(between / pace.final - 1), axis=-1, kind="stable")[..., : effort.choices]
    choices, faults, tilt, between = (_selected(each, order) for each in (choices, faults, tilt, between))
    gone = distances(pace, np.broadcast_to(speed[..., None], between.shape), between, tilt, times)
    gone *= np.where(faults < _LATE, choices.length / gone[..., -1], 1.0)[..., None]
    coarse = _poses(choices, gone[..., :: max(len(times) // _PIECES, 1)])
    coarse = np.moveaxis(coarse[..., :2], -1, 0).astype(np.float32)
    noise = 3 * math.sqrt(2) * scenario.formation.start_noise * effort.angles / (2 * np.pi)
    effort = effort._replace(nearest=min(math.ceil(noise), effort.nearest))
    taken = _chosen(coarse, faults.astype(np.float32), effort, _WANTED * scenario.robot.radius)[:, :, None]
    places = _poses(_selected(choices, taken), _selected(gone, taken))
    return places[:, :, 0, :-1, :2]


def _poses(ways: Ways, along: np.ndarray) -> np.ndarray:
    """Return x, y [m] and heading [rad] (..., K, 3) after some distances (..., K) [m]."""
    return dubins_poses(ways.begin, ways.pieces, ways.turns, ways.radius, along)


def _selected(values: Any, order: np.ndarray) -> Any:
    """Return the choices (P, N, C, ...) of given indices (P, N, D)."""
    if isinstance(values, Ways):
        return Ways(*(_selected(each, order) for each in values))
    return np.take_along_axis(values, order.reshape(*order.shape, *(1,) * (values.ndim - 3)), axis=2)


def _faults(pace: Pace, gone: np.ndarray, length: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the costs of ways of a length [m] that end too late, are too slow, or leave nothing for catching up."""
    speeds = np.diff(gone, axis=-1) / (times[1] - times[0])
    slowest = speeds.min(axis=-1) / pace.final
    hasty = speeds[..., : -(len(times) // 4)].max(axis=-1) > _HASTY * pace.fastest
    late = length / times[-1] > _HASTY * pace.fastest
    return (
        _LATE * (gone[..., -1] < 0.98 * length)
        + _POOR * ((slowest < _SLOWEST / 3) + late)
        + (_HURRY * hasty + _SLOW * (slowest < _SLOWEST))
    )


def _choices(begin: np.ndarray, poses: np.ndarray, radius: float) -> Ways:
    """Return the ways (P, N, C) among which cars choose: words, and lengths of the last straight stretch."""
    span = np.abs(begin[..., :2]).max()
    found = [ways_between(begin, poses, wider * radius, lead * span) for _ in _TILTS for lead, wider in _ENDS]
    return Ways(*(np.concatenate(each, axis=2) for each in zip(*found, strict=True)))


def _times(scenario: Scenario, pace: Pace, speed: np.ndarray, shortest: np.ndarray) -> np.ndarray:
    """Return the times of the steps [s] in which every car can drive its shortest way."""
    step = scenario.task.step
    fastest = np.full_like(speed, pace.fastest)
    steps = max(math.ceil(shortest.max() / (pace.fastest * step)), 4)
    while (
        distances(pace, speed, fastest, np.zeros_like(speed), step * np.arange(steps + 1))[..., -1] < shortest
    ).any():
        steps += max(steps // 50, 1)
    return step * np.arange(math.ceil(_SLACK * steps) + 1)


class _Choice:
    """The choice of ways among places (2, P, N, C, K), with faults (P, N, C)."""

    def __init__(self, places: np.ndarray, faults: np.ndarray, nearest: int, wanted: float):
        self.places, self.faults, self.wanted = places, faults, wanted
        self.angles, self.robots = faults.shape[:2]
        self.shifts = range(-nearest, nearest + 1)
        self.taken = faults.argmin(axis=2)

    def cost(self, at: np.ndarray, i: int, others: Iterable[int], shifts: Iterable[int]) -> np.ndarray:
        """Return the cost (len(at), C) of car i's choices for some angles, given the others' for adjacent angles."""
        cost = np.zeros(self.faults[at, i].shape, dtype=np.float32)
        for j in others:
            for shift in shifts:
                theirs = (at + shift) % self.angles
                other = self.places[:, theirs, j, self.taken[theirs, j], None]
                cost += closeness(self.places[:, at, i], other, self.wanted)
        return cost

    def choose(self, at: np.ndarray, i: int, others: Iterable[int]) -> np.ndarray:
        """Let car i choose for some angles, and return the costs."""
        cost = self.faults[at, i] + self.cost(at, i, others, self.shifts)
        self.taken[at, i] = cost.argmin(axis=1)
        return cost.min(axis=1)


def _chosen(places: np.ndarray, faults: np.ndarray, effort: Effort, wanted: float) -> np.ndarray:
    """Return the choice (P, N) of each car among (P, N, C), which lead to places (2, P, N, C, K).

    Each car chooses in turn, for the current choices of the others: the way of the fewest faults that stays clear of
    the ways of the others for the same angle and the nearest ones.
    """
    choice = _Choice(places, faults, effort.nearest, wanted)
    cars = range(choice.robots)
    at = np.arange(choice.angles)
    for i in cars:
        choice.choose(at, i, range(i))
    for _ in range(effort.rounds):
        close = np.max([choice.choose(at, i, set(cars) - {i}) for i in cars], axis=0)
        at = at[close > _CLOSE]
    return choice.taken
