"""Policies that divide the known targets among the robots, for cars whose actions are velocities."""

import numpy as np

from baselines.policies.own_row import Rows
from baselines.policies.reacting import Chase, Searching, distances, greedy_division, known_places, towards, unit

_CORNERS = np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
"""Corners of the rectangle, in units of its half width and half height."""
_CORNER = 0.25
"""Distance from a corner within which a target that stands still is cornered [sight]."""
_AWAY = 0.8
"""Cosine of the angle between the velocity of a target and its direction from the nearest robot, if it flees."""
_INSET = 0.125
"""Least distance of goals from the walls: cars turn badly beside them [sight]."""


def of_own(values: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Return the value (W, N) or (W, N, 2) of each robot's own thing, of values (W, N, K) or (W, N, K, 2).

    Args:
        values: Values of all things.
        own: (W, N) indices of the things; -1 for none, whose value is that of thing 0.
    """
    index = np.maximum(own, 0).reshape(*own.shape, *[1] * (values.ndim - 2))
    return np.take_along_axis(values, index, axis=2)[:, :, 0]


class Cover(Searching):
    """Greedy cover: pairs of a robot and a place are chosen by the known targets around the place, per driving time.

    Places are those of known targets, extrapolated, and the middles between two of them. A row with fewer tracks than
    entries also has the place of its robot, which stands still there, and the middles between it and the targets.
    """

    delay: float = 1.0
    """Time that is added to the driving time to a place, in units of sight over top speed."""
    fade: float = 3.0
    """Age at which a track counts 1/e of a target in sight, in the same unit."""
    margin: float = 0.7
    """Distance within which targets around a place count [sight]."""

    def react(self, rows: Rows) -> tuple[np.ndarray, np.ndarray]:
        """Drive to the robot's place, if it has one."""
        at = rows.position[:, :, None] + self.expected_offset(rows)
        pairs = np.stack(np.tril_indices(at.shape[2], -1), axis=-1)
        places = np.concatenate([at, at[:, :, pairs].mean(axis=3)], axis=2)
        own = self.division(self.sent.next(rows), places, at, self.worth(rows))
        return towards(of_own(places, own) - rows.position, 0.25 * self.sight), own >= 0

    def worth(self, rows: Rows) -> np.ndarray:
        """Return how much the tracks count (W, N, K), 1 for a target in sight."""
        fade = self.fade * self.sight / self.top
        return np.where(rows.tracks, np.exp(-rows.track_age / fade), 0.0)

    def division(self, robots: np.ndarray, places: np.ndarray, at: np.ndarray, worth: np.ndarray) -> np.ndarray:
        """Return the place (W, N) of each robot, -1 for none.

        Args:
            robots: (W, N, 1 + M, 2) robots, NaN for unknown ones [m].
            places: (W, N, P, 2) places, NaN for none [m].
            at: (W, N, K, 2) where the known targets are [m], NaN for none.
            worth: (W, N, K) how much they count.
        """
        covers = distances(places, at) < self.margin * self.sight
        time = distances(robots, places) / self.top + self.delay * (self.sight / self.top)
        time, counts = np.where(np.isnan(time), np.inf, time), covers.astype(float)

        def rates(free: np.ndarray) -> np.ndarray:
            return free * (counts * worth[:, :, None]).sum(axis=-1)[:, :, None] / time

        def take(place: np.ndarray) -> None:
            worth[np.take_along_axis(covers, place[..., None, None], axis=2)[:, :, 0]] = 0.0

        return greedy_division(rates, take, time.shape[:3])


class Herd(Cover):
    """Greedy cover that drives fleeing targets into corners, and rests where it has a cornered one in sight.

    A target cannot flee from a corner while a robot is near, so that one robot keeps all those in sight that were
    driven there. Places are those of known targets. A target flees if it is as fast as `targets.flee_speed` and moves
    away from the nearest robot; a robot pursues it from a point behind it, as seen from the corner that is most nearly
    in the direction from the robot to the target.
    """

    fade = 5.0
    margin = 0.6
    behind: float = 0.3
    """Distance of that point from the target [sight]."""
    fleeing: float = 2.0
    """Worth of a fleeing target."""
    slow: float = 0.8
    """Distance from its goal within which a robot is slower than its top speed [sight]."""

    def react(self, rows: Rows) -> tuple[np.ndarray, np.ndarray]:
        """Drive to the robot's place, behind a target that flees, or rest before a cornered one."""
        robots = self.sent.next(rows)
        flees, cornered = self.fleeing_and_cornered(rows, robots)
        at = np.where(rows.tracks[..., None], rows.position[:, :, None] + self.expected_offset(rows), np.nan)
        own = self.division(robots, at, at, self.worth(rows) * np.where(flees, self.fleeing, 1.0))
        place = np.where(own[..., None] >= 0, of_own(at, own), rows.position)
        away = place - rows.position
        ways = unit(self.half * _CORNERS - place[:, :, None])
        best = (ways * unit(away)[:, :, None]).sum(axis=-1).argmax(axis=-1)
        goal = np.where(of_own(flees, own)[..., None], place - self.behind * self.sight * of_own(ways, best), place)
        edge = self.half - _INSET * self.sight
        wish = towards(np.clip(goal, -edge, edge) - rows.position, self.slow * self.sight)
        rests = of_own(cornered, own) & (np.linalg.norm(away, axis=-1) < self.sight)
        return np.where(rests[..., None], 0.0, wish), own >= 0

    def fleeing_and_cornered(self, rows: Rows, robots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return which tracks are of targets that flee, and of those that stand in a corner (W, N, K)."""
        at = rows.position[:, :, None] + rows.track_offset
        speed, flight = np.linalg.norm(rows.track_velocity, axis=-1), self.scenario.targets.flee_speed
        robot = np.nan_to_num(distances(robots, at), nan=np.inf).argmin(axis=2)
        away = unit(at - np.take_along_axis(robots, robot[..., None], axis=2))
        flees = rows.tracks & (speed > 0.9 * flight) & ((unit(rows.track_velocity) * away).sum(axis=-1) > _AWAY)
        corner = np.linalg.norm(self.half - np.abs(at), axis=-1) < _CORNER * self.sight
        return flees, rows.tracks & (speed < 0.1 * flight) & corner


class DividedPursuit(Chase):
    """Lead pursuit of targets that are divided among the robots, the shortest way first.

    A robot without a target of its own helps another one.
    """

    lead = 0.7
    again: float = 0.2
    """Worth of a target that a robot pursues already."""
    extra: float = 0.1
    """Distance that is added to the way to a target [sight]."""

    def react(self, rows: Rows) -> tuple[np.ndarray, np.ndarray]:
        """Drive to where the robot's own target will be."""
        there = self.in_sight(rows)
        at = np.where(there[..., None], rows.position[:, :, None] + rows.track_offset, np.nan)
        far = distances(known_places(rows), at)
        far, worth = np.where(np.isnan(far), np.inf, far) + self.extra * self.sight, there.astype(float)

        def rates(free: np.ndarray) -> np.ndarray:
            return free * worth[:, :, None] / far

        def take(target: np.ndarray) -> None:
            index = target[..., None]
            np.put_along_axis(worth, index, self.again * np.take_along_axis(worth, index, axis=2), axis=2)

        own = greedy_division(rates, take, far.shape[:3])
        goal = of_own(self.offset_ahead(rows), own)
        return towards(goal, 0.02 * self.sight), own >= 0
