"""Rules by which a team divides targets or ground: greedy cover of tracks, and pursuit by Voronoi cells.

Each robot computes the division from the places and tracks that it knows, so a team that shares both agrees on it.
"""

from typing import Any

import numpy as np

from baselines.policies.reacting import Searching, known_places, towards
from baselines.policies.registry import register
from baselines.policies.rows import Rows
from lissajous_env.parameters.scenario import Scenario

_POINTS = 21, 13
"""Points along the longer and the shorter side of the rectangle that stand for its area."""


class Cover(Searching):
    """Greedy cover: pairs of a robot and a place are chosen by the known targets around the place, per driving time.

    Places are those of known targets, extrapolated, and the middles between two of them. Robots without a place patrol
    in lanes.

    Args:
        scenario: The scenario.
        num_worlds: W.
        device: Warp device.
        delay: Time that is added to the driving time to a place, in units of sight over top speed.
        fade: Age at which a track counts 1/e of a target in sight, in the same unit.
        margin: Distance within which targets around a place count [sight].
    """

    def __init__(
        self,
        scenario: Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        delay: float = 0.75,
        fade: float = 2.25,
        margin: float = 0.6,
    ):
        super().__init__(scenario, num_worlds, device)
        unit_time = self.sight / self.top
        self.delay, self.fade, self.margin = delay * unit_time, fade * unit_time, margin * self.sight
        tracks = self.scenario.sensing.tracks_seen
        self._pairs = np.array([(i, j) for i in range(tracks) for j in range(i)], int).reshape(-1, 2)

    def wish(self, rows: Rows) -> np.ndarray:
        """Drive to the own place, or patrol without one."""
        at = rows.position[:, :, None] + self.expected_offset(rows)
        places = np.concatenate([at, at[:, :, self._pairs].mean(axis=3)], axis=2)
        worth = np.where(rows.tracks, np.exp(-rows.track_age / self.fade), 0.0)
        covers = (_distances(places, at) < self.margin).astype(float)
        robots = known_places(rows)
        time = _distances(robots, places) / self.top + self.delay
        time[np.isnan(time)] = np.inf
        goal, has_goal = rows.position.copy(), np.zeros(self.shape, bool)
        for _ in range(robots.shape[2]):
            gain = (covers * worth[:, :, None]).sum(axis=-1)
            rate = gain[:, :, None] / time
            best = rate.reshape(*self.shape, -1).argmax(axis=-1)
            robot, place = best // places.shape[2], best % places.shape[2]
            own = (robot == 0) & (rate.max(axis=(2, 3)) > 0)
            target = np.take_along_axis(places, place[..., None, None], axis=2)[:, :, 0]
            goal = np.where(own[..., None], target, goal)
            has_goal |= own
            np.put_along_axis(time, robot[..., None, None], np.inf, axis=2)
            worth = np.where(np.take_along_axis(covers, place[..., None, None], axis=2)[:, :, 0] > 0, 0.0, worth)
        drive = towards(goal - rows.position, 0.25 * self.sight)
        return np.where(has_goal[..., None], drive, self.patrol.wish(rows))


def _distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the distances (W, N, A, B) between places (W, N, A, 2) and (W, N, B, 2)."""
    x, y = (a[..., k, None] - b[:, :, None, :, k] for k in (0, 1))
    return np.sqrt(x * x + y * y)


class VoronoiPursuit(Searching):
    """Pursuit that shrinks a target's Voronoi cell: drive to the middle of the border between it and the own cell.

    A robot pursues the nearest of the targets that any robot has in sight, and drives straight to it where it is near
    or the cells have no common border. Cells are those of points in the rectangle, by the time to reach them.

    Reference: H. Huang, W. Zhang, J. Ding, D. M. Stipanović, C. J. Tomlin, "Guaranteed decentralized pursuit-evasion in
    the plane with multiple pursuers", IEEE Conference on Decision and Control 2011, 4835-4840.

    Args:
        scenario: The scenario.
        num_worlds: W.
        device: Warp device.
        near: Distance within which a robot drives straight to its target [sight].
        width: Width of the strip of points around the border [sight].
        fade: Distance from the target at which a point of the border counts 1/e [sight].
    """

    def __init__(
        self,
        scenario: Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        near: float = 0.3,
        width: float = 0.15,
        fade: float = 0.4,
    ):
        super().__init__(scenario, num_worlds, device)
        self.near, self.width, self.fade = near * self.sight, width * self.sight, fade * self.sight
        targets = self.scenario.targets
        self.pace = self.top / max(targets.speed, targets.flee_speed if targets.fleeing > 0 else 0.0, 1e-9)
        counts = _POINTS if self.half[0] >= self.half[1] else _POINTS[::-1]
        axes = [np.linspace(-half, half, count) for half, count in zip(self.half, counts, strict=True)]
        self.points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)

    def wish(self, rows: Rows) -> np.ndarray:
        """Drive to the border of the nearest target's cell, or to the target; patrol without any."""
        now = rows.tracks & (rows.track_age < 0.5 * self.step) & ~rows.track_leaves
        far = np.where(now, np.linalg.norm(rows.track_offset, axis=-1), np.inf)
        offset = np.take_along_axis(rows.track_offset, far.argmin(axis=-1)[..., None, None], axis=2)
        target = rows.position[:, :, None] + offset
        robots = np.linalg.norm(known_places(rows)[:, :, :, None] - self.points, axis=-1)
        own = robots[:, :, 0] <= np.nanmin(robots, axis=2)
        way = np.linalg.norm(target - self.points, axis=-1)
        apart = np.abs(self.pace * way - robots[:, :, 0]) / self.width
        weight = np.where(own, np.exp(-(apart**2) - way / self.fade), 0.0)
        mass = weight.sum(axis=-1)
        border = (weight[..., None] * self.points).sum(axis=2) / np.maximum(mass, 1e-9)[..., None]
        at_border = (mass > 1e-3) & (far.min(axis=-1, initial=np.inf) > self.near)
        goal = np.where(at_border[..., None], border, target[:, :, 0])
        return np.where(
            now.any(axis=-1, keepdims=True), towards(goal - rows.position, 0.02 * self.sight), self.patrol.wish(rows)
        )


register("greedy-cover", "velocity", Cover, made_for=("watch",), about="Drive where the most known targets are near.")
register(
    "voronoi-pursuit",
    "velocity",
    VoronoiPursuit,
    made_for=("intercept",),
    about="Shrink the Voronoi cell of the nearest target in sight of any robot (Huang et al., 2011).",
)
