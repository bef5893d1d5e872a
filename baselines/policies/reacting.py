"""Policies that react to the targets that they observe, for cars whose actions are velocities.

A rule chooses a velocity by the targets in sight and on tracks, and patrols in `Lanes` while there are none. `Lanes`
observes no target, so the difference to it is the worth of reacting; `index_rule.Index` learns where targets appear.
All of them avoid the robots in sight. Each robot uses its own row alone: where the robots of a team divide work, each
computes the whole division from the places and tracks in its row, so all agree if they share both (`SentPlaces`).

The settings of a rule have the unit that stands behind each in brackets: [sight] is `sensing.sight`.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from baselines.policies.base import Policy
from baselines.policies.loops import lane_corners
from baselines.policies.memory import Remembering
from baselines.policies.own_row import Rows
from lissajous_env.device.copies import Copyable
from lissajous_env.parameters.scenario import Scenario

_APART = 6.25
"""Distance below which robots repel each other [body radius]."""
_REPULSION = 1.5
"""Weight of that repulsion."""
KEPT_FOR = 1.875
"""Time for which a target is assumed to keep its velocity, in units of sight over top speed."""
_POINTS = 21, 13
"""Points along the longer and the shorter side of the rectangle that stand for its area."""


def unit(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (..., 2) of length 1, in the same directions; zeros remain zeros."""
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(size > 0, size, 1.0)


def towards(offset: np.ndarray, slow: float) -> np.ndarray:
    """Return velocities [top speed] along offsets (..., 2), proportional to their lengths up to a length `slow`."""
    return unit(offset) * np.minimum(np.linalg.norm(offset, axis=-1, keepdims=True) / slow, 1.0)


def nearest(offset: np.ndarray, exists: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the value (W, N, 2) of the nearest thing that exists, and its distance (W, N) [m], infinite without one.

    Args:
        offset: (W, N, K, 2) relative places of the things [m].
        exists: (W, N, K) True for those that exist; K is at least 1.
        values: (W, N, K, 2) their values.
    """
    far = np.where(exists, np.linalg.norm(offset, axis=-1), np.inf)
    first = far.argmin(axis=-1)[..., None, None]
    return np.take_along_axis(values, first, axis=2)[:, :, 0], far.min(axis=-1)


def away_from_others(wish: np.ndarray, rows: Rows) -> np.ndarray:
    """Return wished velocities (W, N, 2) [top speed] that also lead away from near robots, in sight or else heard."""
    exists, offset = (rows.robots_seen, rows.robot_offset) if rows.scenario.sensing.robots_seen else others_heard(rows)
    far = np.where(exists, np.linalg.norm(offset, axis=-1), np.inf)
    near = np.clip(_APART * rows.scenario.robot.radius / np.maximum(far, 1e-9) - 1, 0.0, 3.0)
    return towards(wish - _REPULSION * (unit(offset) * near[..., None]).sum(axis=2), 1.0)


def others_heard(rows: Rows) -> tuple[np.ndarray, np.ndarray]:
    """Return which teammates, or else ring neighbours, are heard (W, N, M), and their relative places [m]."""
    sensing = rows.scenario.sensing
    if sensing.shared == "none" or sensing.teammates_seen == 0:
        return rows.heard, rows.neighbour_offset
    return rows.teammates, rows.teammate_offset


def known_places(rows: Rows) -> np.ndarray:
    """Return x, y of each robot and of those that it hears (W, N, 1 + M, 2) [m]; NaN for unknown ones."""
    exists, offset = others_heard(rows)
    offsets = [np.zeros_like(offset[:, :, :1]), np.where(exists[..., None], offset, np.nan)]
    return rows.position[:, :, None] + np.concatenate(offsets, axis=2)


class SentPlaces(Copyable, Remembering):
    """Places of robots when the messages that arrive now were sent, for rules that divide work by them.

    Robots that divide it each for themselves agree if all use places of one time, and so their own place of that time.
    """

    def __init__(self, scenario: Scenario, num_worlds: int):
        self.num_worlds = num_worlds
        self.delay = scenario.delay_steps
        """Delay of the messages [control step]."""
        self._own = np.zeros((num_worlds, scenario.num_robots, self.delay + 1, 2))
        self._begins = np.ones(num_worlds, dtype=bool)

    def forget(self, mask: np.ndarray) -> None:
        """Begin with the places of the next step."""
        self._begins = self._begins | mask

    def next(self, rows: Rows) -> np.ndarray:
        """Return `known_places` (W, N, 1 + M, 2) of a step, with the own places of that time [m]."""
        self._own = np.concatenate([rows.position[:, :, None], self._own[:, :, :-1]], axis=2)
        self._own[self._begins] = rows.position[self._begins][:, :, None]
        self._begins = np.zeros(self.num_worlds, dtype=bool)
        places = known_places(rows)
        places[:, :, 0] = self._own[:, :, -1]
        return places


def distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the distances (W, N, A, B) between places (W, N, A, 2) and (W, N, B, 2)."""
    x, y = (a[..., k, None] - b[:, :, None, :, k] for k in (0, 1))
    return np.sqrt(x * x + y * y)


def greedy_division(
    scores: Callable[[np.ndarray], np.ndarray], take: Callable[[np.ndarray], None], shape: tuple, least: float = 0.0
) -> np.ndarray:
    """Return the choice (W, N) of each robot, -1 for none, in a greedy division among the robots in its row.

    The pair of a robot and a choice with the highest score is chosen, and then one for each of the other robots.

    Args:
        scores: Function of (W, N, R, 1), 1 for robots without a choice and 0 for others, that returns (W, N, R, K).
        take: Function of the choices (W, N) that were chosen, after which the scores are computed anew.
        shape: (W, N, R), for R robots in each row, its own first.
        least: Score that a pair must exceed to be chosen.
    """
    own, free = np.full(shape[:2], -1), np.ones((*shape, 1))
    for _ in range(shape[2]):
        score = scores(free)
        robot, choice = np.divmod(score.reshape(*shape[:2], -1).argmax(axis=-1), score.shape[3])
        own = np.where((robot == 0) & (score.max(axis=(2, 3)) > least), choice, own)
        np.put_along_axis(free, robot[..., None, None], 0.0, axis=2)
        take(choice)
    return own


class Reacting(Policy):
    """Base of these policies: a subclass returns the velocities that it wishes, without regard to other robots.

    The keyword arguments are values for attributes of the class, by their names.
    """

    kind = "velocity"
    communicates = "positions and tracks of other robots"

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu", **settings: Any):
        super().__init__(scenario, num_worlds, device)
        for name, value in settings.items():
            if not hasattr(type(self), name):
                raise ValueError(f"setting of {self.name} must be an attribute of the class, got {name}")
            setattr(self, name, value)
        curve, self.sight = self.scenario.curve, self.scenario.sight
        self.half = np.array([curve.half_width, curve.half_height])
        self.top, self.step = self.scenario.robot.top_speed, self.scenario.task.step
        self.sent = SentPlaces(self.scenario, self.num_worlds)

    def wish(self, rows: Rows) -> np.ndarray:
        """Return the wished velocities (W, N, 2) in units of the top speed."""
        raise NotImplementedError(f"{type(self).__name__} must have a method wish(rows)")

    def rows(self, observation: np.ndarray) -> Rows:
        """Return the rows of the robots; a subclass may give robots more information."""
        return Rows(observation.astype(float), self.scenario)

    def decide(self, observation: np.ndarray) -> np.ndarray:
        """Return the wished velocities, and away from robots that are near."""
        rows = self.rows(observation)
        action = np.zeros(self.action.shape, np.float32)
        action[..., :2] = away_from_others(self.wish(rows), rows)
        return action


class Lanes(Reacting):
    """Patrol in lanes: robots follow each other, evenly spaced, on one closed tour; it observes no target.

    The lanes are parallel to the shorter side of the rectangle. Each robot takes the nearest free place on the tour at
    the start, as soon as the first messages can have arrived. If messages are lost, robots may disagree, so they choose
    anew in every step until they have had time to reach a place.
    """

    lanes: int | None = None
    """Number of lanes, even; by default they are about 1.1 `reach` apart."""
    reach: float | None = None
    """Distance that a robot searches to each side [m]; by default the sensing radius."""

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu", **settings: Any):
        super().__init__(scenario, num_worlds, device, **settings)
        reach = self.scenario.sensing_radius if self.reach is None else self.reach
        edge = min(0.8 * reach, 0.5 * float(self.half.min()))
        along, across = sorted(self.half - edge)
        fitting = 2 * round((1 + 2 * across / (1.1 * reach)) / 2)
        count = max(fitting, 2) if self.lanes is None else self.lanes
        corners = lane_corners(along, across, min(edge, 0.5 * along), count)
        corners = corners[:, ::-1] if self.half[0] >= self.half[1] else corners[::-1]
        self.corners = np.concatenate([corners, corners[:1]])
        self._along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.corners, axis=0), axis=1))])
        self._ahead = 0.5 * reach
        self._steps = np.zeros(self.num_worlds, int)
        self._slot = np.zeros(self.shape, int)
        self._spacing = self._along[-1] / self.num_robots
        longest = math.ceil(1.25 * self._spacing / (self.top * self.step))  # until robots are apart in their places
        self._last_choice = self.sent.delay + (longest if self.scenario.noise.message_loss > 0 else 0)

    def forget(self, mask: np.ndarray) -> None:
        """Begin the tour anew."""
        self._steps[mask] = 0

    def place(self, way: np.ndarray) -> np.ndarray:
        """Return the points (..., 2) of the tour after ways (...) along it [m]."""
        return np.stack([np.interp(way % self._along[-1], self._along, self.corners[:, k]) for k in (0, 1)], axis=-1)

    def wish(self, rows: Rows) -> np.ndarray:
        """Follow the robot's place on the tour."""
        chooses, places = self._steps <= self._last_choice, self.sent.next(rows)
        if chooses.any():
            then = self._way(np.maximum(self._steps - self.sent.delay, 0))
            self._slot[chooses] = self._nearest_slots(places[chooses], then[chooses])
        way = self._way(self._steps)
        self._steps += 1
        return towards(self.place(way[:, None] + self._spacing * self._slot) - rows.position, 0.5 * self._ahead)

    def _way(self, steps: np.ndarray) -> np.ndarray:
        """Return the way (W,) of slot 0 along the tour after some steps [m]."""
        return 0.95 * self.top * self.step * steps + self._ahead

    def _nearest_slots(self, places: np.ndarray, way: np.ndarray) -> np.ndarray:
        """Return the slot (W, N) of each robot.

        Args:
            places: (W, N, 1 + M, 2) places of the robots that it knows, its own first [m].
            way: (W,) way of slot 0 when the robots were there [m].
        """
        slots = self.place(way[:, None] + self._spacing * np.arange(self.num_robots))
        far = np.linalg.norm(places[..., None, :] - slots[:, None, None], axis=-1)
        far = np.where(np.isnan(far), np.inf, far)

        def take(slot: np.ndarray) -> None:
            np.put_along_axis(far, slot[..., None, None], np.inf, axis=3)

        return greedy_division(lambda free: np.where(free > 0, -far, -np.inf), take, far.shape[:3], -np.inf)


class Searching(Reacting):
    """Base of the rules, which patrol in lanes while they know of no target; a subclass implements `react`."""

    entries: str = "tracks"
    """Entries of `Rows` that it reacts to."""

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu", **settings: Any):
        super().__init__(scenario, num_worlds, device, **settings)
        self.patrol = Lanes(scenario, num_worlds, device, reach=self.scenario.sight)

    def react(self, rows: Rows) -> tuple[np.ndarray, np.ndarray]:
        """Return the wished velocities (W, N, 2) [top speed], and whether a robot reacts to a target (W, N)."""
        raise NotImplementedError(f"{type(self).__name__} must have a method react(rows)")

    def wish(self, rows: Rows) -> np.ndarray:
        """React to targets; a robot without any, or without entries for them in its row, patrols."""
        if getattr(rows, self.entries).shape[2] == 0:
            return self.patrol.wish(rows)
        velocity, reacts = self.react(rows)
        return np.where(reacts[..., None], velocity, self.patrol.wish(rows))

    def expected_offset(self, rows: Rows) -> np.ndarray:
        """Return where known targets are now (W, N, K, 2), relative to the robot, if they kept their velocity [m]."""
        return self.offset_after(rows, np.minimum(rows.track_age, KEPT_FOR * self.sight / self.top))

    def offset_after(self, rows: Rows, time: np.ndarray) -> np.ndarray:
        """Return the places of tracks (W, N, K, 2), relative to the robot, after times (W, N, K) [s] [m]."""
        here = rows.position[:, :, None]
        return np.clip(here + rows.track_offset + rows.track_velocity * time[..., None], -self.half, self.half) - here

    def in_sight(self, rows: Rows) -> np.ndarray:
        """Return whether a track is of an undetected target that some robot has in sight (W, N, K)."""
        return rows.tracks & (rows.track_age < 0.5 * self.step) & ~rows.track_leaves


class Follow(Searching):
    """Follow the nearest target in sight."""

    entries = "targets_seen"

    def react(self, rows: Rows) -> tuple[np.ndarray, np.ndarray]:
        """Drive to the nearest target in sight."""
        offset, far = nearest(rows.target_offset, rows.targets_seen, rows.target_offset)
        return towards(offset, 0.375 * self.sight), np.isfinite(far)


class Force(Searching):
    """A-CMOMMT (Parker 2002): forces towards known targets, weaker if others observe them, and away from robots.

    Reference: L. E. Parker, "Distributed algorithms for multi-robot observation of multiple moving targets", Autonomous
    Robots 12 (2002) 231-255.
    """

    shared: float = 0.0
    """Weight of a target that another robot has in sight."""
    reach: float = 2.0
    """Distance up to which targets attract [sight]."""
    apart: float = 3.0
    """Distance up to which robots repel each other [sight]."""
    push: float = 1.0
    """Weight of the repulsion."""

    def react(self, rows: Rows) -> tuple[np.ndarray, np.ndarray]:
        """Add the forces, if any target is in reach."""
        guess = self.expected_offset(rows)
        far = np.linalg.norm(guess, axis=-1)
        weight = np.where(rows.track_of_other, self.shared, 1.0) * np.clip(far / (0.375 * self.sight), 0.0, 1.0)
        weight = np.where(rows.tracks & (far < self.reach * self.sight), weight, 0.0)
        force = (unit(guess) * weight[..., None]).sum(axis=2)
        exists, offset = others_heard(rows)
        mates = np.where(exists, np.linalg.norm(offset, axis=-1), np.inf)
        repels = np.clip(1 - mates / (self.apart * self.sight), 0.0, 1.0)
        force -= self.push * (unit(offset) * repels[..., None]).sum(axis=2)
        return force, (weight != 0).any(axis=-1)


class Chase(Searching):
    """Pursue the nearest target in sight of any robot, at the place where it will be."""

    lead: float = 0.8
    """Time for which the velocity of a target is extrapolated, in units of the time in which the robot drives to where
    the target is; 0 is pure pursuit."""

    def react(self, rows: Rows) -> tuple[np.ndarray, np.ndarray]:
        """Drive to where the nearest target will be."""
        goal, far = nearest(rows.track_offset, self.in_sight(rows), self.offset_ahead(rows))
        return towards(goal, 0.02 * self.sight), np.isfinite(far)

    def offset_ahead(self, rows: Rows) -> np.ndarray:
        """Return where tracks will be (W, N, K, 2), relative to the robot, after the time of `lead` [m]."""
        direct = np.linalg.norm(rows.track_offset, axis=-1)
        return self.offset_after(rows, np.minimum(self.lead * direct / self.top, 0.9 * self.sight / self.top))


class VoronoiPursuit(Searching):
    """Pursuit that shrinks a target's Voronoi cell: drive to the middle of the border between it and the robot's cell.

    A robot pursues the nearest of the targets that any robot has in sight, and drives straight to it where it is near
    or the cells have no common border. Cells are those of points in the rectangle, by the time to reach them.

    Reference: H. Huang, W. Zhang, J. Ding, D. M. Stipanović, C. J. Tomlin, "Guaranteed decentralized pursuit-evasion in
    the plane with multiple pursuers", IEEE Conference on Decision and Control 2011, 4835-4840.
    """

    near: float = 0.3
    """Distance within which a robot drives straight to its target [sight]."""
    width: float = 0.15
    """Width of the strip of points around the border [sight]."""
    fade: float = 0.25
    """Distance from the target at which a point of the border counts 1/e [sight]."""

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu", **settings: Any):
        super().__init__(scenario, num_worlds, device, **settings)
        targets = self.scenario.targets
        self.pace = self.top / max(targets.speed, targets.flee_speed if targets.fleeing > 0 else 0.0, 1e-9)
        counts = _POINTS if self.half[0] >= self.half[1] else _POINTS[::-1]
        axes = [np.linspace(-half, half, count) for half, count in zip(self.half, counts, strict=True)]
        self.points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)

    def react(self, rows: Rows) -> tuple[np.ndarray, np.ndarray]:
        """Drive to the border of the nearest target's cell, or to the target."""
        offset, far = nearest(rows.track_offset, self.in_sight(rows), rows.track_offset)
        target = rows.position + offset
        robots = np.linalg.norm(known_places(rows)[:, :, :, None] - self.points, axis=-1)
        own = robots[:, :, 0] <= np.nanmin(robots, axis=2)
        way = np.linalg.norm(target[:, :, None] - self.points, axis=-1)
        apart = np.abs(self.pace * way - robots[:, :, 0]) / (self.width * self.sight)
        weight = np.where(own, np.exp(-(apart**2) - way / (self.fade * self.sight)), 0.0)
        mass = weight.sum(axis=-1)
        border = (weight[..., None] * self.points).sum(axis=2) / np.maximum(mass, 1e-9)[..., None]
        at_border = (mass > 1e-3) & (far > self.near * self.sight)
        goal = np.where(at_border[..., None], border, target)
        return towards(goal - rows.position, 0.02 * self.sight), np.isfinite(far)
